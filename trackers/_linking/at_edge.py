"""Positions of a body that the edge of the image touches or cuts, from the sides of it that are visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile

import numpy as np

from trackers._detection.detection import Detection, EdgeObject, FrameDetections
from trackers._detection.subpixel_centroid import Centre
from trackers._frames.arrays import QUANTISATION_SD, Box
from trackers._linking.select_bodies import held_frames
from trackers._tracklets.frame_to_frame import Tracklet

TOUCHES = 1.5  # px of the search: an object that ends so near to the edge goes on beyond it
LIKE_THE_BODY = 0.35  # of the diameter: how much wider or narrower its visible sides may be
MIN_BEFORE = 3  # detections that predict where the body is


def with_frames_at_edge(body: Tracklet, all_detections: Sequence[FrameDetections], box: Box, step: int) -> Tracklet:
    """The body with the frames before its first and after its last detection in which the edge cuts less than half.

    Across the cut it is as wide as elsewhere, and its far side is one radius from its centre. The difference of the
    widths is the standard error. Where a hand reaches the body, it is held, not cut.

    Parameters
    ----------
    body
        Measured detections, in order.
    all_detections
        Those of all frames, in order.
    box
        Left, top, right, bottom (exclusive) of the image that is looked at, px.
    step
        Side, px, of the pixels in which objects were found.
    """
    if len(body.detections) < MIN_BEFORE:
        return body
    row_of = {seen.frame: row for row, seen in enumerate(all_detections)}
    held = held_frames(body, all_detections)
    later = takewhile(lambda row: row not in held, range(row_of[body.last.frame] + 1, len(all_detections)))
    earlier = takewhile(lambda row: row not in held, range(row_of[body.first.frame] - 1, -1, -1))
    after = _going_on(body, [all_detections[row] for row in later], box, step)
    before = _going_on(Tracklet(body.detections[::-1]), [all_detections[row] for row in earlier], box, step)
    return Tracklet([*before[::-1], *body.detections, *after])


def _going_on(body: Tracklet, frames: Sequence[FrameDetections], box: Box, step: int) -> list[Detection]:
    """The detections at the edge in the next frames, up to the first without one."""
    path, radius = Tracklet(list(body.detections)), body.typical("radius")
    for seen in frames:
        centres = [_centre(path.last, reaching, radius, box, step) for reaching in seen.edge_objects]
        places = [centre for centre in centres if centre is not None]
        expected = path.predicted(seen.t_s)
        reach = max(radius, path.speed_change(seen.t_s))
        off = [float(np.hypot(centre.x - expected[0], centre.y - expected[1])) for centre in places]
        if not off or min(off) > reach:
            break
        centre = places[int(np.argmin(off))]
        path.detections.append(replace(path.last, frame=seen.frame, t_s=seen.t_s, centre=centre, left=0, top=0))
    return path.detections[len(body.detections) :]


def _centre(body: Detection, reaching: EdgeObject, radius: float, box: Box, step: int) -> Centre | None:
    """Centre, px of the frame, of a body of that radius which one side of the image cuts; None where it is another."""
    low, high = np.array(reaching.box[:2]), np.array(reaching.box[2:])
    before, beyond = low <= np.array(box[:2]) + TOUCHES * step, high >= np.array(box[2:]) - TOUCHES * step
    cut = before | beyond
    if cut.sum() != 1 or (before & beyond).any():
        return None
    axis = int(np.flatnonzero(cut)[0])
    width, length = (high - low)[1 - axis], (high - low)[axis]
    widest = 2 * radius * (1 + LIKE_THE_BODY)
    if not 2 * radius * (1 - LIKE_THE_BODY) <= width <= widest or not radius <= length <= widest:
        return None
    xy = (low + high) / 2 - 0.5
    xy[axis] = (high[axis] - radius if before[axis] else low[axis] + radius) - 0.5
    error = float(np.hypot(QUANTISATION_SD * step, width / 2 - radius))
    return replace(
        body.centre,
        x=float(xy[0]),
        y=float(xy[1]),
        sigma_x=error,
        sigma_y=error,
        area=np.pi * radius**2,
        sigma_area=2 * np.pi * radius * error,
        cut=True,
        lobes=(),
    )
