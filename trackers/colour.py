"""A body by its colour alone: no background is needed, so that the camera may move and the body may rest.

Pixels of the colour asked for (``--colour``) are joined into compact bodies. Each is measured to a fraction of a
pixel by how far the pixels at its outline lie between its own colour and that just outside of it.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, Track, Tracker, TrackerExample, TrackOptions, with_progress
from trackers._background.median import MAD_TO_SD, QUANTISATION_SD, Background, Bytes, Image, Still
from trackers._detection.detect_frames import REPORT_EVERY
from trackers._detection.detection import Glimpse, Lens
from trackers._detection.foreground import SMALLEST_AREA, Component, Core, cores_of
from trackers._frames.sampled_frames import Samples
from trackers._frames.working_image import View, view_of
from trackers._linking.frame_to_frame import Path, link
from trackers._linking.select_bodies import joined
from trackers._linking.to_track import track_of

RING, GAP = 9, 3  # px at the size that is searched: width of the ring outside of a body, and from where on
FIRST_REACH, LEAST_REACH = 0.25, 0.1  # of the picture's diagonal: how far a body may go unforeseen
FEWEST_SIGHTINGS = 3
TOGETHER = 0.3  # of the shorter path: two paths seen together as long are two bodies
FEWEST_RING = 12  # px that show what is outside


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the largest bodies of one colour, one Track each.

    Parameters
    ----------
    video
        The clip; its camera may move.
    options
        ``colour`` is the colour of the bodies, ``bodies`` the number to follow, ``roi`` limits the picture,
        ``progress`` is called now and then.

    Returns
    -------
    list of Track
        Every frame has a row; a frame in which the body is not seen, or is cut by the edge of the picture, is a gap.
        The standard error allows for how uneven the surroundings are.

    Raises
    ------
    TrackingError
        When no colour is given, or fewer bodies have it than are asked for.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    view = view_of(video, options)
    if view.colour is None:
        raise TrackingError("this tracker follows a colour: name it with --colour, e.g. --colour red or '#c8e61e'")
    glimpses = []
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        glimpses.append(_glimpse(view, frame))
    diagonal = float(np.hypot(video.width, video.height))
    paths = _largest(link(glimpses, FIRST_REACH * diagonal, LEAST_REACH * diagonal), options)
    origin = {"tracker": TRACKER.name, "bodies": options.bodies, "roi": options.roi, "colour": options.colour}
    return [track_of(path, glimpses, str(number), origin) for number, path in enumerate(paths, start=1)]


def _glimpse(view: View, frame: Frame) -> Glimpse:
    """The candidates of one frame, each measured against what is round it."""
    picture, wanted = view.searched(frame), np.asarray(view.wanted(frame))
    bodies = cores_of(_components(wanted.astype(np.uint8)), wanted.shape)
    covered = cv2.dilate(wanted.astype(np.uint8), np.ones((GAP, GAP), np.uint8))
    found = Glimpse(frame.index, frame.t_s, (), ())
    for core in bodies:
        lens = _lens(view, frame, picture, covered, core)
        if lens is not None:
            seen = lens.glimpse(frame, [core], [core])
            found = replace(found, sightings=found.sightings + seen.sightings)
    return found


def _components(mask: Bytes) -> list[Component]:
    """The connected parts of a mask, all of one strength."""
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    found = []
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        if area >= SMALLEST_AREA:
            one = (labels[top : top + height, left : left + width] == label).astype(np.uint8)
            found.append(Component(one, 255 * one, left, top))
    return found


def _lens(view: View, frame: Frame, picture: Bytes, covered: Bytes, core: Core) -> Lens | None:
    """What measures one body against the colour just outside of it; None where nothing is seen outside."""
    left, top, right, bottom = core.box
    reach = GAP + RING
    window = (slice(max(0, top - reach), bottom + reach), slice(max(0, left - reach), right + reach))
    outside = picture[window][covered[window] == 0].astype(np.float32)
    if len(outside) < FEWEST_RING:
        return None
    middle = np.median(outside, axis=0)
    noise = np.maximum(MAD_TO_SD * np.median(np.abs(outside - middle), axis=0), QUANTISATION_SD)
    samples = Samples([frame], view)
    sizes = [size for size in range(1, view.step + 1) if view.step % size == 0]
    coarser = {
        size: Background(samples, None, _even(middle, noise, (view.height // size, view.width // size)))
        for size in sizes
    }
    return Lens(replace(coarser[1], coarser=coarser), view, 1.0)


def _even(middle: Image, noise: Image, size: tuple[int, int]) -> Still:
    """The same colour and noise everywhere in a picture of that height and width."""
    return Still(*(np.broadcast_to(one.astype(np.float32), (*size, 3)) for one in (middle, noise)))


def _largest(paths: list[Path], options: TrackOptions) -> list[Path]:
    """The bodies that are largest and seen longest, seen together, each with the pieces that can only be more of it."""
    seen = [path for path in paths if len(path.sightings) >= FEWEST_SIGHTINGS]
    chosen: list[Path] = []
    for path in sorted(seen, key=lambda one: -sum(sighting.area for sighting in one.sightings)):
        with_all = all(
            len(path.frames & other.frames) >= TOGETHER * min(len(path.frames), len(other.frames)) for other in chosen
        )
        if len(chosen) < options.bodies and with_all:
            chosen.append(path)
    if len(chosen) < options.bodies:
        raise TrackingError(
            f"{options.bodies} bodies of the colour {options.colour} were asked for, but {len(chosen)} can be seen at "
            "the same time; give the colour as it is in the picture, e.g. '#c8e61e', or limit the picture with --roi"
        )
    return joined(chosen, [path for path in paths if not any(path is one for one in chosen)])


TRACKER = Tracker(
    name="colour",
    summary="bodies of one colour, also before a camera that moves, or at rest",
    track=track,
    example=TrackerExample(options=TrackOptions(colour="#b4b4b4")),
)
