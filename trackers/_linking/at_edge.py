"""Positions of a body that the edge of the image touches or cuts, from the sides of it that are visible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trackers._detection.detection import Detection, EdgeObject, FrameDetections
from trackers._frames.arrays import Box
from trackers._linking.frame_to_frame import SPEED_CHANGE, Tracklet

TOUCHES = 1.5  # px of the search: an object that ends so near to the edge goes on beyond it
LIKE_THE_BODY = 0.35  # of the diameter: how much wider or narrower its visible sides may be
SIDE_ERROR = 0.1  # of the radius: standard error of a position by one side and a known radius
MIN_BEFORE = 3  # detections that predict where the body is


def with_frames_at_edge(body: Tracklet, all_detections: Sequence[FrameDetections], box: Box, step: int) -> Tracklet:
    """The body with the frames before its first and after its last detection in which the edge cuts less than half.

    Across the cut it is as wide as elsewhere, and its far side is one radius from its centre. Such a position is known
    to a tenth of the radius.

    Parameters
    ----------
    body
        Measured detections, in order.
    all_detections
        Those of all frames, in order.
    box
        Left, top, right, bottom (exclusive) of the region of interest, px.
    step
        Side, px, of the pixels in which objects were found.
    """
    if len(body.detections) < MIN_BEFORE:
        return body
    row_of = {seen.frame: row for row, seen in enumerate(all_detections)}
    after = _going_on(body, all_detections[row_of[body.last.frame] + 1 :], box, step)
    backwards = Tracklet(body.detections[::-1])
    before = _going_on(backwards, all_detections[: row_of[body.first.frame]][::-1], box, step)
    return Tracklet([*before[::-1], *body.detections, *after])


def _going_on(body: Tracklet, frames: Sequence[FrameDetections], box: Box, step: int) -> list[Detection]:
    """The detections at the edge in the next frames, up to the first without one."""
    path, radius = Tracklet(list(body.detections)), body.typical("radius")
    found: list[Detection] = []
    for seen in frames:
        places = [place for reaching in seen.edge_objects if (place := _place(reaching, radius, box, TOUCHES * step))]
        expected = path.predicted(seen.t_s)
        reach = max(radius, SPEED_CHANGE * float(np.hypot(*path.velocity())) * abs(seen.t_s - path.last.t_s))
        off = [float(np.hypot(*(np.array(place) - expected))) for place in places]
        if not off or min(off) > reach:
            break
        path.detections.append(_detection(path.last, seen, places[int(np.argmin(off))], radius))
        found.append(path.last)
    return found


def _place(reaching: EdgeObject, radius: float, box: Box, reach: float) -> tuple[float, float] | None:
    """Centre (x, y), px, of a body of that radius which one side of the image cuts; None where it is something else."""
    low, high = np.array(reaching.box[:2]), np.array(reaching.box[2:])
    before, beyond = low <= np.array(box[:2]) + reach, high >= np.array(box[2:]) - reach
    cut = before | beyond
    if cut.sum() != 1 or (before & beyond).any():
        return None
    axis = int(np.flatnonzero(cut)[0])
    width, length = (high - low)[1 - axis], (high - low)[axis]
    widest = 2 * radius * (1 + LIKE_THE_BODY)
    if not 2 * radius * (1 - LIKE_THE_BODY) <= width <= widest or not radius <= length <= widest:
        return None
    centre = (low + high) / 2 - 0.5
    centre[axis] = (high[axis] - radius if before[axis] else low[axis] + radius) - 0.5
    return float(centre[0]), float(centre[1])


def _detection(neighbour: Detection, seen: FrameDetections, place: tuple[float, float], radius: float) -> Detection:
    """A body of that radius at a place (x, y), px, that otherwise appears as in the neighbouring frame."""
    error: Mapping[str, float] = dict.fromkeys(("sigma_x", "sigma_y"), max(SIDE_ERROR * radius, 0.5))
    centre = replace(
        neighbour.centre,
        x=place[0],
        y=place[1],
        **error,
        area=np.pi * radius**2,
        sigma_area=2 * np.pi * radius * error["sigma_x"],
        cut=True,
        lobes=(),
    )
    return replace(neighbour, frame=seen.frame, t_s=seen.t_s, centre=centre, left=0, top=0)
