"""Many or touching bodies: pixels assigned at reduced size, then a sub-pixel centroid of each body at full size."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Frame, FrameSource, TrackOptions, with_progress
from trackers._detection.depth import depth_of
from trackers._detection.detect_frames import REPORT_EVERY, DetectionSetup, detection_setup
from trackers._detection.detection import MIN_INSCRIBED, Detection, FrameDetections, touches
from trackers._detection.foreground import MIN_AREA, SQUARE, Blob
from trackers._detection.subpixel_centroid import Centre
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes
from trackers._frames.working_image import WorkingView
from trackers._multi_body.appearance_classes import HALF_COVERED, background_level, learn_classes
from trackers._multi_body.pixel_assignment import CoveredPixels, covered_pixels
from trackers._multi_body.predict_and_assign import FrameAssignment, follow_bodies
from trackers._tracklets.frame_to_frame import Tracklet

SEAM = 0.08  # radii: how well the line is known along which two touching bodies part, standard deviation
ROUNDING = 0.5  # px, of the outline of a body, standard deviation
SEEN = 0.6  # of its area: the centre of a body that shows less is not known


def track_together(
    video: FrameSource, view: WorkingView, options: TrackOptions
) -> tuple[list[FrameDetections], list[Tracklet], WorkingView]:
    """All bodies followed at once, told apart by colour where they differ in it; also how the clip was viewed.

    Parameters
    ----------
    video, options
        As for :func:`many`.
    view
        How to look at it; colour is added.
    """
    setup = detection_setup(video, view.with_chroma())
    return *track_many(video, setup, options), setup.view


def track_many(
    video: FrameSource, setup: DetectionSetup, options: TrackOptions
) -> tuple[list[FrameDetections], list[Tracklet]]:
    """What each frame shows, and the tracklet of each of ``options.bodies`` bodies; the clip is read twice.

    Parameters
    ----------
    video
        The clip.
    setup
        What its samples show, with colour.
    options
        How many bodies; progress.

    Raises
    ------
    TrackingError
        When no frame shows all bodies.
    """
    setup, classes = learn_classes(setup, options.bodies)
    background, view = background_level(setup.background_range), setup.view

    def covered(frame: Frame) -> CoveredPixels:
        image = np.atleast_3d(view.search_image(frame))
        return covered_pixels(setup.background_range, classes, background, image, frame.index, frame.t_s)

    frames = list(ahead(covered, video.frames()))
    if len(frames) < 2:
        raise TrackingError(f"{len(frames)} frame(s) cannot tell bodies from one another; there must be at least 2")
    return measure_bodies(video, setup, frames, follow_bodies(frames, classes), options)


def measure_bodies(
    video: FrameSource,
    setup: DetectionSetup,
    frames: Sequence[CoveredPixels],
    placed: Sequence[FrameAssignment],
    options: TrackOptions,
) -> tuple[list[FrameDetections], list[Tracklet]]:
    """What each frame shows, and the tracklet of each body, once it is known which pixels each covers.

    Parameters
    ----------
    video
        The clip.
    setup
        What its samples show.
    frames, placed
        What is covered in each frame, and by which body.
    options
        Progress.
    """
    all_detections: list[FrameDetections] = []
    tracklets = [Tracklet() for _ in placed[0].filled]
    search_windows = setup.search_windows()
    covered = {pixels.frame: (pixels, assignment) for pixels, assignment in zip(frames, placed, strict=True)}
    seen = with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY)

    def measured(
        frame: Frame, _: Sequence[Blob], foreground: Sequence[Blob]
    ) -> tuple[FrameDetections, list[Detection | None]]:
        return _measured(setup, frame, *covered[frame.index], foreground)

    for frame_detections, detections in search_windows.each(measured, seen):
        all_detections.append(frame_detections)
        for tracklet, detection in zip(tracklets, detections, strict=True):
            if detection is not None:
                tracklet.detections.append(detection)
    return all_detections, tracklets


def _measured(
    setup: DetectionSetup, frame: Frame, pixels: CoveredPixels, assignment: FrameAssignment, foreground: Sequence[Blob]
) -> tuple[FrameDetections, list[Detection | None]]:
    """The centre of each body of a frame; None for one that is hidden, cut off, or not there.

    A body that stands alone is measured at full size. Where bodies touch, the line that parts them decides, and a
    closer look at the rest of the outline would not help.
    """
    bodies = [core_of(pixels, assignment, body) for body in range(len(assignment.filled))]
    known = [blob for blob in bodies if blob is not None]
    reaching = [edge_blob for edge_blob in foreground if edge_blob.held and not _is_of(edge_blob, known)]
    labels = np.full((pixels.size[1], pixels.size[0]), -1)
    labels[pixels.xy[:, 1], pixels.xy[:, 0]] = assignment.labels
    detections: list[Detection | None] = []
    for body, (blob, filled) in enumerate(zip(bodies, assignment.filled, strict=True)):
        if blob is None or filled < SEEN or blob.at_edge:
            detections.append(None)
        elif (seams := seams_of(labels, body, blob)).any():
            hand = any(touches(blob, edge_blob) for edge_blob in reaching)
            detections.append(_parted(setup, frame, blob, assignment.centres[body], seams, hand))
        else:
            detections.append(setup.detector.detect_body(frame, blob, known, reaching))
    seen = tuple(detection for detection in detections if detection is not None)
    return FrameDetections(
        frame.index, frame.t_s, seen, tuple(setup.detector.edge_object(edge_blob) for edge_blob in reaching)
    ), detections


def seams_of(labels: NDArray[np.int64], body: int, blob: Blob) -> Array:
    """Moments (j, 2) px^2 of the lines along which the bodies of a frame (h, w) part from one: one row a neighbour.

    Each row is the sum over the line's pixels of their position about the body's middle: what the sum of the body's
    coordinates changes by when the line moves by a pixel.
    """
    left, top, right, bottom = blob.box
    y0, x0 = max(0, top - 1), max(0, left - 1)
    window = labels[y0 : bottom + 1, x0 : right + 1]
    mine = (window == body).astype(np.uint8)
    rim = (cv2.dilate(mine, SQUARE) > 0) & (window != body) & (window >= 0)
    rows, columns = np.nonzero(rim)
    middle = np.array([(left + right) / 2 - x0, (top + bottom) / 2 - y0])
    arms = np.stack([columns, rows], axis=-1) - middle
    whose = window[rows, columns]
    return np.array([arms[whose == other].sum(axis=0) for other in np.unique(whose)]).reshape(-1, 2)


def _parted(setup: DetectionSetup, frame: Frame, blob: Blob, middle: Array, seams: Array, hand: bool) -> Detection:
    """A body that touches others: its middle at the size of the search, as sure as the lines are that part them."""
    view, step = setup.view, setup.view.step
    inside = blob.mask > 0
    image = np.atleast_3d(view.part(frame, blob.box, step)).astype(np.float32)
    difference = image - background_level(setup.background_range.part(blob.box))
    radius = float(np.sqrt(blob.area / np.pi))
    line = SEAM * radius
    variance = (line * seams / blob.area) ** 2
    sigma_x, sigma_y = np.sqrt(variance.sum(axis=0) + ROUNDING**2 / blob.area) * step
    x, y = middle * step + (step - 1) / 2
    centre = Centre(
        x=float(x),
        y=float(y),
        sigma_x=float(sigma_x),
        sigma_y=float(sigma_y),
        area=float(blob.area * step**2),
        sigma_area=float(line * np.abs(seams).sum() / radius * step**2),
        contrast=float(np.abs(difference)[inside].max(axis=-1).mean()),
        intensity=float(image[..., 0][inside].mean()),
        sigma_intensity=float(image[..., 0][inside].std() / np.sqrt(blob.area)),
        cut=False,
    )
    brightening = float(difference[..., 0][inside].mean())
    compactness = min(1.0, np.pi * blob.inscribed**2 / blob.area)
    return Detection(frame.index, frame.t_s, centre, view.left, view.top, brightening, 1.0, compactness, hand)


def core_of(pixels: CoveredPixels, assignment: FrameAssignment, body: int) -> Blob | None:
    """The part of a frame that a body covers, the largest piece of it; None when it is too small."""
    chosen = (assignment.labels == body) & (pixels.share > HALF_COVERED)
    if np.count_nonzero(chosen) < MIN_AREA:
        return None
    xy = pixels.xy[chosen].astype(np.int64)
    left, top = xy.min(axis=0)
    width, height = xy.max(axis=0) - (left, top) + 1
    mask = np.zeros((height, width), dtype=np.uint8)
    mask[xy[:, 1] - top, xy[:, 0] - left] = 1
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    largest = 1 + int(stats[1:count, cv2.CC_STAT_AREA].argmax())
    x, y, columns, rows, area = (int(value) for value in stats[largest])
    piece = (labels[y : y + rows, x : x + columns] == largest).astype(np.uint8)
    inscribed = float(depth_of(piece).max())
    if area < MIN_AREA or inscribed < MIN_INSCRIBED:
        return None
    box = (int(left) + x, int(top) + y, int(left) + x + columns, int(top) + y + rows)
    edge = box[0] <= 1 or box[1] <= 1 or box[2] >= pixels.size[0] - 1 or box[3] >= pixels.size[1] - 1
    return Blob(np.ascontiguousarray(piece), box[0], box[1], inscribed, edge, edge)


def _is_of(reaching: Blob, bodies: Sequence[Blob]) -> bool:
    """Whether bodies are most of an object that reaches in: a pile at the edge is not a hand."""
    covered: Bytes = reaching.mask.copy()
    left, top, right, bottom = reaching.box
    for body in bodies:
        x0, y0, x1, y1 = body.box
        inner = (max(left, x0), max(top, y0), min(right, x1), min(bottom, y1))
        if inner[0] < inner[2] and inner[1] < inner[3]:
            rows, columns = slice(inner[1] - top, inner[3] - top), slice(inner[0] - left, inner[2] - left)
            overlap = body.mask[inner[1] - y0 : inner[3] - y0, inner[0] - x0 : inner[2] - x0]
            covered[rows, columns] &= 1 - overlap
    return bool(np.count_nonzero(covered) < 0.5 * reaching.area)
