"""Bodies followed by appearance through a whole clip: places in each frame, the best path, then a measured centre.

Needs no still background: the camera may move, and the body may rest or be hidden for a while. The clip is read twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, Track, TrackOptions, part_of_progress, with_progress
from trackers._auto.appearance import Appearance, Peaks, search_image
from trackers._auto.best_path import best_path, bound_to_marks, usual_reach
from trackers._auto.body_appearance import BodyAppearance
from trackers._auto.scene import Place
from trackers._detection.detect_frames import REPORT_EVERY
from trackers._detection.detection import Detection, FrameDetections
from trackers._detection.foreground import Blob, ConnectedComponent, blobs_of
from trackers._detection.local_background import GAP, components_of, local_detector
from trackers._detection.subpixel_centroid import Centre
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes
from trackers._frames.working_image import WorkingView
from trackers._linking.to_track import track_of
from trackers._tracklets.frame_to_frame import Tracklet

REACH_RADII, REACH_SHARE = 4.0, 0.05  # of the radius, of the diagonal: how far a fast body goes in a frame
WINDOW = 2.5  # radii: half the side of the window in which a body is measured
MAX_RADIUS_RATIO = 1.9  # times the radius: a larger blob is not the body alone
APART = 1.5  # radii: two bodies are not nearer to each other
MIN_DETECTIONS = 3  # detections
ROUGH = 0.35  # of the radius: standard error of a position by appearance alone


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """One body to follow: name, appearance, and where it is known to be, (x, y) px of the frame by frame number."""

    name: str
    appearance: BodyAppearance
    marks: Mapping[int, Place]


def follow_appearance(
    video: FrameSource, view: WorkingView, bodies: Sequence[Body], options: TrackOptions
) -> list[Track]:
    """One Track for each body.

    Parameters
    ----------
    video
        The clip.
    view
        The region of interest.
    bodies
        The bodies to follow.
    options
        For progress, and as the origin.

    Raises
    ------
    TrackingError
        When a body is found in fewer than three frames.
    """
    view = view.with_chroma()
    first_half, second_half = (part_of_progress(options.progress, k, 2) for k in range(2))
    frames = with_progress(video.frames(), first_half, video.n_expected, every=REPORT_EVERY)
    numbers: list[int] = []
    peaks: list[list[Peaks]] = [[] for _ in bodies]
    for number, found in ahead(partial(_seen, view, bodies), frames):
        numbers.append(number)
        for of_body, places in zip(peaks, found, strict=True):
            of_body.append(places)
    paths = _paths(view, numbers, peaks, bodies)
    tracklets: list[list[Detection]] = [[] for _ in bodies]
    all_detections: list[FrameDetections] = []
    frames = with_progress(video.frames(), second_half, len(numbers), every=REPORT_EVERY)
    for empty, measured in ahead(partial(_measured, view, bodies, paths), enumerate(frames)):
        all_detections.append(empty)
        for detections, new in zip(tracklets, measured, strict=True):
            detections += new
    for body, detections in zip(bodies, tracklets, strict=True):
        if len(detections) < MIN_DETECTIONS:
            raise TrackingError(
                f"body {body.name} is found by appearance in {len(detections)} of {len(numbers)} frames"
            )
    origin = {"tracker": "appearance", "bodies": len(bodies), "roi": options.roi, "colour": options.colour}
    tracks = [
        track_of(Tracklet(detections), all_detections, body.name, dict(origin))
        for body, detections in zip(bodies, tracklets, strict=True)
    ]
    return [replace(track, hand=None) for track in tracks]  # a hand is not looked for


def _seen(view: WorkingView, bodies: Sequence[Body], frame: Frame) -> tuple[int, list[Peaks]]:
    """The number of a frame, and where each of the bodies may be in it."""
    image = search_image(view, frame)
    return frame.index, [body.appearance.peaks(image) for body in bodies]


def _measured(
    view: WorkingView, bodies: Sequence[Body], paths: Sequence[Mapping[int, Place]], numbered: tuple[int, Frame]
) -> tuple[FrameDetections, list[list[Detection]]]:
    """A frame without detections, and each of the bodies as it is measured on its path, if that passes the frame."""
    k, frame = numbered
    image = search_image(view, frame)
    found = [
        [_at(view, frame, image, body.appearance.colours, path[k])] if k in path else []
        for body, path in zip(bodies, paths, strict=True)
    ]
    return FrameDetections(frame.index, frame.t_s, (), ()), found


def _at(view: WorkingView, frame: Frame, image: Bytes, appearance: Appearance, place: Place) -> Detection:
    """The body at a place of the search image, measured if its outline is found."""
    return measured_at(view, frame, image, appearance, place) or roughly_at(view, frame, image, appearance, place)


def _paths(
    view: WorkingView, numbers: Sequence[int], peaks: Sequence[list[Peaks]], bodies: Sequence[Body]
) -> list[dict[int, Place]]:
    """Where each body is in the search image, by number of the frame in order; the clearest body first."""
    row_of = {number: k for k, number in enumerate(numbers)}
    reach_image = REACH_SHARE * float(np.hypot(*view.search_size))
    paths: list[dict[int, Place]] = []
    for candidates, body in zip(peaks, bodies, strict=True):
        free = [_without(places, [path[k] for path in paths if k in path], body) for k, places in enumerate(candidates)]
        known = {row_of[n]: view.in_search(*place) for n, place in body.marks.items() if n in row_of}
        bound = bound_to_marks(free, known, max(body.appearance.radius, 3.0))
        reach = max(REACH_RADII * body.appearance.radius, reach_image, usual_reach(free))
        chosen = best_path(bound, reach)
        paths.append({k: tuple(bound[k].xy[c]) for k, c in enumerate(chosen) if c is not None})
    return paths


def _without(places: Peaks, taken: Sequence[Place], body: Body) -> Peaks:
    """The places that no other body has taken."""
    free = np.ones(len(places.score), dtype=np.bool_)
    for place in taken:
        free &= np.hypot(*(places.xy - place).T) > APART * body.appearance.radius
    return places.where(free)


def measured_at(
    view: WorkingView, frame: Frame, image: Bytes, appearance: Appearance, place: Place
) -> Detection | None:
    """The body at a place of the search image, measured against its surroundings; None where none does."""
    height, width = image.shape[:2]
    reach = WINDOW * appearance.radius + 4
    left, top = (max(0, int(c - reach)) for c in place)
    right, bottom = min(width, int(place[0] + reach) + 2), min(height, int(place[1] + reach) + 2)
    part = np.ascontiguousarray(image[top:bottom, left:right])
    ratio = cv2.blur(appearance.of_pixels(part), (3, 3))
    mask = np.zeros((height, width), np.uint8)
    mask[top:bottom, left:right] = (ratio > 0) & _near(part.shape, (place[0] - left, place[1] - top), appearance.radius)
    window = mask[top:bottom, left:right]
    components = [component.moved(left, top) for component in components_of(window)]
    blob = _blob_at(components, mask.shape, place, appearance.radius)
    if blob is None or blob.at_edge:
        return None
    covered = cv2.dilate(mask, np.ones((GAP, GAP), np.uint8))
    detector = local_detector(view, frame, image, covered, blob)
    if detector is None:
        return None
    seen = replace(detector, streaks=False).detect(frame, [blob], [blob]).detections
    return seen[0] if seen else None


def roughly_at(view: WorkingView, frame: Frame, image: Bytes, appearance: Appearance, place: Place) -> Detection:
    """The body at a place where its outline merges with the surroundings: known to a third of its radius."""
    radius = appearance.radius * view.step
    x, y = view.in_frame(*place)
    brightness = float(image[round(place[1]), round(place[0]), 0])
    error = max(ROUGH * radius, 0.5)
    area = np.pi * radius**2
    centre = Centre(x, y, error, error, area, 2 * area * ROUGH, 1.0, brightness, brightness, cut=False)
    return Detection(frame.index, frame.t_s, centre, 0, 0, 1.0, 1.0, 1.0, hand=False)


def _near(shape: tuple[int, ...], place: Place, radius: float) -> Bytes:
    """Pixels of a window that may be of the body at a place."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray((x - place[0]) ** 2 + (y - place[1]) ** 2 <= (MAX_RADIUS_RATIO * radius + 2) ** 2)


def _blob_at(
    components: Sequence[ConnectedComponent], shape: tuple[int, ...], place: Place, radius: float
) -> Blob | None:
    """The largest compact part near a place."""
    near = []
    for blob in blobs_of(components, shape):
        left, top, right, bottom = blob.box
        apart = np.hypot((left + right - 1) / 2 - place[0], (top + bottom - 1) / 2 - place[1])
        if apart < max(radius, 3.0):
            near.append(blob)
    return max(near, key=lambda blob: blob.area, default=None)
