"""Many bodies tracked together, also where they touch: prediction, pixel assignment and matching, both ways in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Mask
from trackers._multi_body.appearance_classes import AppearanceClass
from trackers._multi_body.motion_model import MotionStates
from trackers._multi_body.pixel_assignment import ClassPixels, CoveredPixels, PixelAssignment
from trackers._tracklets.least_cost import least_cost_pairs

COMPLETE = 0.2  # of the area of all bodies of a class: largest difference where all are seen
AT_EDGE = 0.05  # of the area of one body may lie at the edge where all are seen
CANDIDATES = 8  # frames in which the bodies are searched without a prediction
GATE = 16.0  # squared distance over its variance: beyond it a body is not taken for another (chi2, 2 dof: 0.03 %)
PULL = 0.02  # weight of a squared distance from the prediction, over its variance, beside 1 for a body's spread
UNEVEN = 0.3  # of the area of a body: largest difference of its share of the pixels
CLEAR = 0.5  # radii from the prediction: a body nearer than this is the predicted one
HIDDEN = 0.4  # of its area: a body that shows less is not measured
WHOLE = 0.8  # of its area: a body that shows less is measured with a larger error
DOUBT = 4.0  # times the standard error of a body that is partly hidden
GONE = 0.1  # of its area: less at the edge and the body has left
PATIENCE = 12  # frames for which a body that is not seen is expected
FAR = 1e6


@dataclass(frozen=True, eq=False, slots=True)
class FrameAssignment:
    """One frame: the body of each pixel (n,), -1 for none; centres (k, 2) px; share of each that is seen (k,)."""

    labels: NDArray[np.int64]
    centres: Array
    filled: Array


@dataclass(eq=False, slots=True)
class BodyGroup:
    """All bodies of a clip: the number of the class of each (k,), and the prediction of their motion."""

    classes: Sequence[AppearanceClass]
    class_of: NDArray[np.int64]
    motions: MotionStates
    unseen: NDArray[np.int64]
    t_s: float

    @property
    def here(self) -> Mask:
        """Which bodies are expected in the image. Shape (bodies,)."""
        return self.unseen <= PATIENCE


def follow_bodies(frames: Sequence[CoveredPixels], classes: Sequence[AppearanceClass]) -> list[FrameAssignment]:
    """The bodies in every frame, from the frame in which they can best be distinguished to both ends.

    Parameters
    ----------
    frames
        Pixels that bodies cover in each frame, in order.
    classes
        The classes of bodies, with their numbers.

    Raises
    ------
    TrackingError
        When in no frame all bodies are seen.
    """
    best, start = _first(frames, classes)
    placed: list[FrameAssignment | None] = [None] * len(frames)
    placed[best] = start
    frame_s = float(np.median(np.diff([pixels.t_s for pixels in frames])))
    for order in (range(best + 1, len(frames)), range(best - 1, -1, -1)):
        group = _crowd_at(classes, start, frames[best].t_s)
        for k in order:
            placed[k] = _step(group, frames[k], frame_s)
    return [assignment for assignment in placed if assignment is not None]


def _first(frames: Sequence[CoveredPixels], classes: Sequence[AppearanceClass]) -> tuple[int, FrameAssignment]:
    """The frame in which the bodies can best be distinguished, and where they are there."""
    complete = [k for k, pixels in enumerate(frames) if _is_complete(pixels, classes)]
    if not complete:
        bodies = sum(appearance.count for appearance in classes)
        raise TrackingError(
            f"{bodies} bodies were requested, but no frame shows that number at once; request fewer, "
            f"or limit the clip with --start and --stop"
        )
    chosen = [complete[k] for k in np.unique(np.linspace(0, len(complete) - 1, CANDIDATES).astype(int))]
    rng = np.random.default_rng(0)
    attempts = {k: _looked_for(frames[k], classes, rng) for k in chosen}
    best = min(attempts, key=lambda k: attempts[k][1])
    return best, attempts[best][0]


def _is_complete(pixels: CoveredPixels, classes: Sequence[AppearanceClass]) -> bool:
    """Whether each class covers about the area of all its bodies, next to none of it at the edge of the image."""
    at_edge = (pixels.xy <= 1).any(axis=1) | (pixels.xy >= np.array(pixels.size) - 2).any(axis=1)
    areas = [
        float(pixels.pool(k, appearance.radius).share.sum()) / (appearance.count * appearance.area)
        for k, appearance in enumerate(classes)
    ]
    few = np.count_nonzero(at_edge) < AT_EDGE * min(appearance.area for appearance in classes)
    return bool(few) and all(abs(area - 1) < COMPLETE for area in areas)


def _looked_for(
    pixels: CoveredPixels, classes: Sequence[AppearanceClass], rng: np.random.Generator
) -> tuple[FrameAssignment, float]:
    """Bodies found in a frame without a prediction, the largest class first, from the left; and how unevenly."""
    labels, centres, filled = np.full(len(pixels.class_index), -1), [np.zeros((0, 2))], [np.zeros(0)]
    spread = 0.0
    for number, appearance in enumerate(classes):
        assignment = pixels.pool(number, appearance.radius).assign_without_prediction(appearance.count, rng)
        assignment = assignment.taken(np.argsort(assignment.centres[:, 0], kind="stable"))
        labels[pixels.class_index == number] = np.where(
            assignment.labels >= 0, assignment.labels + sum(map(len, centres)), -1
        )
        centres.append(assignment.centres)
        filled.append(assignment.areas / appearance.area)
        spread += assignment.energy
    areas = np.concatenate(filled)
    return FrameAssignment(labels, np.concatenate(centres), areas), spread / len(areas) + float(np.abs(areas - 1).max())


def _crowd_at(classes: Sequence[AppearanceClass], start: FrameAssignment, t_s: float) -> BodyGroup:
    class_of = np.concatenate([np.full(appearance.count, number) for number, appearance in enumerate(classes)])
    radius = np.array([classes[number].radius for number in class_of])
    return BodyGroup(
        classes, class_of, MotionStates.at(start.centres, radius), np.zeros(len(class_of), dtype=np.int64), t_s
    )


def _step(group: BodyGroup, pixels: CoveredPixels, frame_s: float) -> FrameAssignment:
    """Take the group on to the next frame, and say where its bodies are there."""
    elapsed = abs(pixels.t_s - group.t_s) / frame_s
    group.t_s = pixels.t_s
    motions = group.motions
    starts = [motions.position + elapsed * motions.velocity, motions.after_impacts(elapsed), motions.position]
    motions.advance(elapsed)
    placed = FrameAssignment(
        np.full(len(pixels.class_index), -1), motions.position.copy(), np.zeros(len(group.class_of))
    )
    for number, appearance in enumerate(group.classes):
        bodies = np.flatnonzero((group.class_of == number) & group.here)
        pool = pixels.pool(number, appearance.radius)
        if not len(bodies) or not len(pool.xy):
            continue
        assignment = _assigned(motions, bodies, _divided(motions, bodies, pool, starts))
        placed.labels[pixels.class_index == number] = np.where(assignment.labels >= 0, bodies[assignment.labels], -1)
        placed.centres[bodies], placed.filled[bodies] = assignment.centres, assignment.areas / appearance.area
    _learn(group, placed, pixels.size)
    return placed


def _divided(
    motions: MotionStates, bodies: NDArray[np.int64], pool: ClassPixels, starts: Sequence[Array]
) -> PixelAssignment:
    """The best of the assignments that the hypotheses about the motion lead to: flight, impact, rest."""
    variance = motions.covariance[bodies, 0, 0]
    assignments = [pool.assign(starts[0][bodies])]
    if _is_clear(assignments[0], motions, bodies, pool):
        return assignments[0]
    assignments += [pool.assign(start[bodies]) for start in starts[1:]]

    def cost(assignment: PixelAssignment, start: Array) -> float:
        miss = ((assignment.centres - start[bodies]) ** 2).sum(axis=-1) / variance
        return assignment.energy + PULL * float(np.minimum(miss, GATE).sum())

    best = min(range(len(starts)), key=lambda k: cost(assignments[k], starts[k]))
    return assignments[best]


def _is_clear(assignment: PixelAssignment, motions: MotionStates, bodies: NDArray[np.int64], pool: ClassPixels) -> bool:
    """Whether every body fills its share, near where free flight leads."""
    miss = np.linalg.norm(assignment.centres - motions.position[bodies], axis=-1)
    uneven = np.abs((assignment.areas + assignment.beyond) / pool.area - 1).max()
    return bool(uneven < UNEVEN and miss.max() < CLEAR * pool.radius)


def _assigned(motions: MotionStates, bodies: NDArray[np.int64], assignment: PixelAssignment) -> PixelAssignment:
    """The assignments given to the bodies at the least total squared distance from the predictions (Kuhn-Munkres)."""
    variance = motions.covariance[bodies, 0, 0][:, np.newaxis]
    miss = ((motions.position[bodies][:, np.newaxis] - assignment.centres) ** 2).sum(axis=-1) / variance
    _, columns = least_cost_pairs(np.minimum(miss, FAR))
    return assignment.taken(columns)


def _learn(group: BodyGroup, placed: FrameAssignment, size: tuple[int, int]) -> None:
    """Correct the motion of the bodies that are seen; count for how long the others have not been."""
    radius = group.motions.radius[:, np.newaxis]
    outside = ((placed.centres < -radius) | (placed.centres > np.array(size) - 1 + radius)).any(axis=1)
    at_edge = ((placed.centres < radius) | (placed.centres > np.array(size) - 1 - radius)).any(axis=1)
    seen = group.here & (placed.filled > np.where(at_edge, GONE, HIDDEN))
    group.motions.correct(placed.centres, seen, np.where(placed.filled < WHOLE, DOUBT, 1.0))
    group.unseen = np.where(seen, 0, np.where(outside, PATIENCE, group.unseen) + 1)
