"""Selection of the tracklets that are the bodies, not shadows, hands or noise; frames in which a hand holds a body."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from iris_sysid.errors import TrackingError
from trackers._detection.detection import HAND_SHARE, Box, Detection, EdgeObject, FrameDetections
from trackers._tracklets.frame_to_frame import Brightness, Tracklet, link

FIRST_REACH = 0.25  # of the image's diagonal: how far a body may go between its first two detections
CAUTIOUS_REACH = 0.03  # of the diagonal: how far from its prediction it may be among anything that moves
BOLD_REACH = 0.25  # the same among what looks like it
MIN_DETECTIONS = 3
MIN_EXTENT = 3.0  # px, diagonal of the box that holds a tracklet: less is not motion
MIN_OVERLAP = 0.3  # of the shorter tracklet: two tracklets seen together as long are two bodies
SHADOW_OVERLAP = 0.6  # of the shadow's tracklet
SHADOW_SHARPNESS = 0.7  # of the body's: a shadow's outline is softer
SHADOW_LIKENESS = 0.9  # correlation of a shadow's motion with its body's
NOTHING = 1e-9  # of a feature: a speck of noise may have an outline that is not sharp at all
SAME = {
    "radius": np.log(1.6),
    "contrast": np.log(3),
    "steepness": np.log(4),
    "compactness": np.log(2),
}  # largest log ratios in one body
STEADY = 0.5  # of the change of the background behind it: a body whose own brightness changes less is the same
OPPOSITE = 1.0  # of 2: a body is brighter, or darker, than its background as a whole
SPEED_MARGIN = 1.5  # times the fastest that the body was seen to go
END_MARGIN = 1.5  # times the reach: how far off the first or last detection may be
LONE_END_MARGIN = 0.4  # the same after a gap: one detection beyond it is soon a chance
BIGGER = 1.5  # times the body's area: a larger object that reaches in is not the body itself
BREAK = 3  # frames: shorter breaks in a hold are an arm that does not show
NEARBY = 2.25  # radii round the body in which a hand holds it


def extent(tracklet: Tracklet) -> float:
    """Diagonal of the box that holds a tracklet, px."""
    return float(np.hypot(*np.ptp(tracklet.xy, axis=0)))


def score(tracklet: Tracklet) -> float:
    """How much a tracklet looks like the body that is meant: far-going, lasting, large, sharp, compact."""
    appearance = tracklet.typical("radius") * tracklet.typical("sharpness") * tracklet.typical("compactness")
    return extent(tracklet) * len(tracklet.detections) * appearance


def link_bodies(
    all_detections: Sequence[FrameDetections],
    count: int,
    diagonal: float,
    meant: Callable[[Tracklet], bool] = lambda tracklet: True,
) -> list[Tracklet]:
    """The tracklets of the ``count`` bodies that are meant, the best first, in an image of that diagonal (px).

    Linked twice: among all detections, cautiously, to learn what the bodies look like; then boldly
    among the detections that look like one of them. Raises TrackingError when nothing moves or fewer
    bodies than requested do.
    """
    first = link(all_detections, FIRST_REACH * diagonal, CAUTIOUS_REACH * diagonal)
    main = _main_tracklets(list(filter(meant, first)), count)
    shadows = [
        tracklet for tracklet in first if any(is_shadow(tracklet, seed) for seed in main if seed is not tracklet)
    ]
    tracklets = link(_only_alike(all_detections, main, shadows), FIRST_REACH * diagonal, BOLD_REACH * diagonal)
    bodies = _main_tracklets(list(filter(meant, tracklets)), count)
    return with_fragments(bodies, [tracklet for tracklet in tracklets if not any(tracklet is body for body in bodies)])


def _only_alike(
    all_detections: Sequence[FrameDetections], bodies: Sequence[Tracklet], shadows: Sequence[Tracklet]
) -> list[FrameDetections]:
    """The frames with only those detections that are of one of the bodies, or look like it and are not a shadow."""
    of_bodies = {id(detection) for body in bodies for detection in body.detections}
    of_shadows = {id(detection) for shadow in shadows for detection in shadow.detections}
    known = [_Appearance.of(body) for body in bodies]

    def meant(detection: Detection) -> bool:
        if id(detection) in of_bodies or id(detection) in of_shadows:
            return id(detection) in of_bodies
        seen = _Appearance.of(Tracklet([detection]))
        return any(seen.is_like(body) for body in known)

    return [
        replace(frame_detections, detections=tuple(filter(meant, frame_detections.detections)))
        for frame_detections in all_detections
    ]


def _main_tracklets(tracklets: Sequence[Tracklet], count: int) -> list[Tracklet]:
    """The best tracklet of each body: those that move most, seen together, not the shadow of each other."""
    moving = [
        tracklet
        for tracklet in tracklets
        if len(tracklet.detections) >= MIN_DETECTIONS and extent(tracklet) >= MIN_EXTENT
    ]
    if not moving:
        raise TrackingError(
            "nothing moves in the clip beyond the noise of the image; check that the camera stands still, "
            "that the body differs in brightness from the background, and --roi and --colour if given"
        )
    chosen: list[Tracklet] = []
    for tracklet in sorted(moving, key=score, reverse=True):
        seen_with_all = all(_overlap_in_time(tracklet, other) >= MIN_OVERLAP for other in chosen)
        if len(chosen) < count and seen_with_all and not any(is_shadow(tracklet, other) for other in chosen):
            chosen.append(tracklet)
    if len(chosen) < count:
        raise TrackingError(
            f"{count} bodies were requested, but only {len(chosen)} move(s) at the same time; "
            f"request fewer, or restrict the region with --roi or the bodies with --colour"
        )
    return chosen


def _overlap_in_time(tracklet: Tracklet, other: Tracklet) -> float:
    """Share of the shorter tracklet's frames in which both are seen."""
    return len(tracklet.frames & other.frames) / min(len(tracklet.frames), len(other.frames))


def is_shadow(tracklet: Tracklet, body: Tracklet) -> bool:
    """Whether a tracklet is the shadow of a body: darker than the background, softer, and moving along with it."""
    if tracklet.typical("brightening") >= 0 or tracklet.typical("sharpness") > SHADOW_SHARPNESS * body.typical(
        "sharpness"
    ):
        return False
    common = tracklet.frames & body.frames
    if len(common) < max(MIN_DETECTIONS, SHADOW_OVERLAP * len(tracklet.frames)):
        return False
    steps = [np.diff([(s.x, s.y) for s in path.detections if s.frame in common], axis=0) for path in (tracklet, body)]
    lengths = np.linalg.norm(steps[0]) * np.linalg.norm(steps[1])
    return bool(lengths > 0 and (steps[0] * steps[1]).sum() / lengths > SHADOW_LIKENESS)


def with_fragments(bodies: list[Tracklet], fragments: list[Tracklet]) -> list[Tracklet]:
    """The bodies, each with the pieces that can only be more of it, the best pieces first.

    A piece that shares some frames with a body, fewer than two bodies would, adds its other frames.
    """
    properties = [_properties(body) for body in bodies]
    for fragment in sorted(fragments, key=lambda tracklet: -len(tracklet.detections)):
        pieces = {
            k: Tracklet([detection for detection in fragment.detections if detection.frame not in known.frames])
            for k, known in enumerate(properties)
            if _overlap_in_time(fragment, bodies[k]) < MIN_OVERLAP
        }
        free = [k for k, piece in pieces.items() if piece.detections and _may_be(piece, bodies[k], properties[k])]
        if free:
            nearest = min(free, key=lambda k: _gap_px(pieces[k], bodies[k]))
            detections = [*bodies[nearest].detections, *pieces[nearest].detections]
            bodies[nearest].detections = sorted(detections, key=lambda detection: detection.frame)
            properties[nearest] = _properties(bodies[nearest])
    for body in bodies:
        body.detections = _trimmed(_trimmed(body.detections)[::-1])[::-1]
    return bodies


def _trimmed(detections: list[Detection]) -> list[Detection]:
    """The detections without those at the end that lie off where the ones before them lead."""
    kept = list(detections)
    while len(kept) > MIN_DETECTIONS:
        before, end = Tracklet(kept[-MIN_DETECTIONS:-1]), kept[-1]
        miss = np.hypot(*(before.predicted(end.t_s) - (end.x, end.y)))
        adjacent = abs(end.frame - before.last.frame) == 1
        if miss <= (END_MARGIN if adjacent else LONE_END_MARGIN) * before.reach(end.t_s):
            break
        kept.pop()
    return kept


@dataclass(frozen=True, eq=False, slots=True)
class _Appearance:
    """Appearance of a body: the logarithms of its features in ``SAME``, and its brightness.

    The steepness of its outline is that of the contrast, 1/px, whatever the background.
    """

    features: dict[str, float]
    brightness: Brightness

    @classmethod
    def of(cls, tracklet: Tracklet) -> _Appearance:
        seen = {name: tracklet.typical(name) for name in ("radius", "contrast", "sharpness", "compactness")}
        seen["steepness"] = seen["sharpness"] / seen["contrast"]
        return cls({name: float(np.log(max(seen[name], NOTHING))) for name in SAME}, tracklet.brightness)

    def is_like(self, other: _Appearance) -> bool:
        """Whether two bodies are alike in size, outline and shape, and in contrast or in their own brightness."""
        alike = {name for name, limit in SAME.items() if abs(self.features[name] - other.features[name]) < limit}
        if self.brightness.is_steady(other.brightness, STEADY):
            return alike >= SAME.keys() - {"contrast"}
        return alike >= SAME.keys() and self.brightness.opposition(other.brightness) <= OPPOSITE


@dataclass(frozen=True, eq=False, slots=True)
class _BodyProperties:
    """Of a body's tracklet: the frames in which it is seen, its appearance, and the fastest that it goes, px/s."""

    frames: set[int]
    appearance: _Appearance
    fastest: float


def _properties(body: Tracklet) -> _BodyProperties:
    steps = np.linalg.norm(np.diff(body.xy, axis=0), axis=1) / np.diff([detection.t_s for detection in body.detections])
    return _BodyProperties(body.frames, _Appearance.of(body), float(np.max(steps)))


def _may_be(fragment: Tracklet, body: Tracklet, properties: _BodyProperties) -> bool:
    """Whether a piece looks like the body and could be reached by it."""
    if not _Appearance.of(fragment).is_like(properties.appearance):
        return False
    fragment_end, body_end = _ends(fragment, body)
    allowed = SPEED_MARGIN * properties.fastest * abs(fragment_end.t_s - body_end.t_s) + 2 * np.exp(
        properties.appearance.features["radius"]
    )
    return bool(np.hypot(fragment_end.x - body_end.x, fragment_end.y - body_end.y) <= allowed)


def _ends(fragment: Tracklet, body: Tracklet) -> tuple[Detection, Detection]:
    """The detection of the piece and that of the body between which the gap lies."""
    before = bisect_left(body.detections, fragment.first.frame, key=lambda detection: detection.frame)
    after = bisect_right(body.detections, fragment.last.frame, key=lambda detection: detection.frame)
    gaps = [(fragment.first, detection) for detection in body.detections[max(0, before - 1) : before]]
    gaps += [(fragment.last, detection) for detection in body.detections[after : after + 1]]
    if not gaps:
        return fragment.first, body.first
    return min(gaps, key=lambda pair: abs(pair[0].frame - pair[1].frame))


def _gap_px(fragment: Tracklet, body: Tracklet) -> float:
    fragment_end, body_end = _ends(fragment, body)
    return float(np.hypot(fragment_end.x - body_end.x, fragment_end.y - body_end.y))


def held_frames(tracklet: Tracklet, all_detections: Sequence[FrameDetections]) -> set[int]:
    """Indices in ``all_detections`` at which a hand holds the body, also where the hand hides the body.

    From each gap's ends the search goes on outwards as long as something that reaches in from the
    edge, larger than the body, is where the body or the hand was in the frame before.
    """
    seen = {detection.frame: detection for detection in tracklet.detections}
    larger = (BIGGER * tracklet.typical("area"), HAND_SHARE * tracklet.typical("radius"))
    held = {
        k
        for k, frame_detections in enumerate(all_detections)
        if frame_detections.frame in seen and seen[frame_detections.frame].hand
    }
    for order in (range(len(all_detections)), range(len(all_detections) - 1, -1, -1)):
        position: Box | None = None
        for k in order:
            detection = seen.get(all_detections[k].frame)
            if detection is not None:
                position = _round(detection)
            elif position is not None:
                hand = _hand_at(position, all_detections[k].edge_objects, *larger)
                position = hand.box if hand else None
                held |= {k} if hand else set()
    return held | _between(held)


def _between(held: set[int]) -> set[int]:
    """The frames in short breaks between held ones: a hand does not let go for a frame."""
    pairs = pairwise(sorted(held))
    return {k for first, next_one in pairs if next_one - first <= BREAK for k in range(first, next_one)}


def _round(detection: Detection) -> Box:
    """The box round a body that a hand must reach to hold it."""
    reach = NEARBY * detection.radius
    return (detection.x - reach, detection.y - reach, detection.x + reach, detection.y + reach)


def _hand_at(box: Box, edge_objects: Sequence[EdgeObject], area: float, inscribed: float) -> EdgeObject | None:
    """The first object that reaches into the box and has more than that area, px, and inscribed radius, px."""
    for edge_object in edge_objects:
        apart = (
            edge_object.box[0] > box[2]
            or edge_object.box[2] < box[0]
            or edge_object.box[1] > box[3]
            or edge_object.box[3] < box[1]
        )
        if not apart and edge_object.area > area and edge_object.inscribed > inscribed:
            return edge_object
    return None
