"""Many bodies followed at once, also where they touch: predicted, shared out, assigned, forwards and backwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Mask
from trackers._multi_body.appearance_classes import Kind
from trackers._multi_body.motion_model import Motions
from trackers._multi_body.pixel_assignment import Pool, Portions, Shown

COMPLETE = 0.2  # of the area of all bodies of a kind: by so little it may differ where all are seen
AT_EDGE = 0.05  # of the area of one body may lie at the edge where all are seen
CANDIDATES = 8  # frames in which the bodies are looked for without a prediction
GATE = 16.0  # squared distance over its variance: beyond it a body is not taken for another (chi2, 2 dof: 0.03 %)
PULL = 0.02  # weight of a squared distance from the prediction, over its variance, beside 1 for a body's spread
UNEVEN = 0.3  # of its area: by so much at most a portion may differ from a body
CLEAR = 0.5  # radii from the prediction: a body so near can be no other
HIDDEN = 0.4  # of its area: a body of which less is seen is not measured
WHOLE = 0.8  # of its area: a body of which less is seen is measured with doubt
DOUBT = 4.0
GONE = 0.1  # of its area: less at the edge and the body has left
PATIENCE = 12  # frames for which a body that is not seen is expected
FAR = 1e6


@dataclass(frozen=True, eq=False, slots=True)
class Placed:
    """One frame: the body of each pixel (n,), -1 for none; centres (k, 2) px; share of each that is seen (k,)."""

    labels: NDArray[np.int64]
    centres: Array
    filled: Array


@dataclass(eq=False, slots=True)
class Crowd:
    """All bodies of a clip: the number of the kind of each (k,), and what is known of their motion."""

    kinds: Sequence[Kind]
    of_kind: NDArray[np.int64]
    motions: Motions
    unseen: NDArray[np.int64]
    t_s: float

    @property
    def here(self) -> Mask:
        """Which bodies are expected in the picture."""
        return self.unseen <= PATIENCE


def followed(frames: Sequence[Shown], kinds: Sequence[Kind]) -> list[Placed]:
    """The bodies in every frame, from the frame in which they can best be told apart to both ends.

    Parameters
    ----------
    frames
        What bodies cover in each frame, in order.
    kinds
        The kinds of bodies, with their numbers.

    Raises
    ------
    TrackingError
        When in no frame all bodies are seen.
    """
    best, start = _first(frames, kinds)
    placed: list[Placed | None] = [None] * len(frames)
    placed[best] = start
    frame_s = float(np.median(np.diff([one.t_s for one in frames])))
    for order in (range(best + 1, len(frames)), range(best - 1, -1, -1)):
        crowd = _crowd_at(kinds, start, frames[best].t_s)
        for k in order:
            placed[k] = _step(crowd, frames[k], frame_s)
    return [one for one in placed if one is not None]


def _first(frames: Sequence[Shown], kinds: Sequence[Kind]) -> tuple[int, Placed]:
    """The frame in which the bodies can best be told apart, and where they are there."""
    complete = [k for k, one in enumerate(frames) if _is_complete(one, kinds)]
    if not complete:
        bodies = sum(kind.count for kind in kinds)
        raise TrackingError(
            f"{bodies} bodies were asked for, but in no frame so many are seen at once; ask for fewer, "
            f"or limit the clip with --start and --stop"
        )
    chosen = [complete[k] for k in np.unique(np.linspace(0, len(complete) - 1, CANDIDATES).astype(int))]
    rng = np.random.default_rng(0)
    found = {k: _looked_for(frames[k], kinds, rng) for k in chosen}
    best = min(found, key=lambda k: found[k][1])
    return best, found[best][0]


def _is_complete(one: Shown, kinds: Sequence[Kind]) -> bool:
    """Whether each kind covers about the area of all its bodies, next to none of it at the edge of the picture."""
    at_edge = (one.xy <= 1).any(axis=1) | (one.xy >= np.array(one.size) - 2).any(axis=1)
    areas = [float(one.pool(k, kind.radius).share.sum()) / (kind.count * kind.area) for k, kind in enumerate(kinds)]
    few = np.count_nonzero(at_edge) < AT_EDGE * min(kind.area for kind in kinds)
    return bool(few) and all(abs(area - 1) < COMPLETE for area in areas)


def _looked_for(one: Shown, kinds: Sequence[Kind], rng: np.random.Generator) -> tuple[Placed, float]:
    """Bodies found in a frame without a prediction, the largest kind first, from the left; and how unevenly."""
    labels, centres, filled = np.full(len(one.kind), -1), [np.zeros((0, 2))], [np.zeros(0)]
    spread = 0.0
    for number, kind in enumerate(kinds):
        found = one.pool(number, kind.radius).searched(kind.count, rng)
        found = found.taken(np.argsort(found.centres[:, 0], kind="stable"))
        labels[one.kind == number] = np.where(found.labels >= 0, found.labels + sum(map(len, centres)), -1)
        centres.append(found.centres)
        filled.append(found.areas / kind.area)
        spread += found.energy
    areas = np.concatenate(filled)
    return Placed(labels, np.concatenate(centres), areas), spread / len(areas) + float(np.abs(areas - 1).max())


def _crowd_at(kinds: Sequence[Kind], start: Placed, t_s: float) -> Crowd:
    of_kind = np.concatenate([np.full(kind.count, number) for number, kind in enumerate(kinds)])
    radius = np.array([kinds[number].radius for number in of_kind])
    return Crowd(kinds, of_kind, Motions.at(start.centres, radius), np.zeros(len(of_kind), dtype=np.int64), t_s)


def _step(crowd: Crowd, one: Shown, frame_s: float) -> Placed:
    """Take the crowd on to the next frame, and say where its bodies are there."""
    elapsed = abs(one.t_s - crowd.t_s) / frame_s
    crowd.t_s = one.t_s
    motions = crowd.motions
    starts = [motions.position + elapsed * motions.velocity, motions.after_impacts(elapsed), motions.position]
    motions.advance(elapsed)
    placed = Placed(np.full(len(one.kind), -1), motions.position.copy(), np.zeros(len(crowd.of_kind)))
    for number, kind in enumerate(crowd.kinds):
        bodies = np.flatnonzero((crowd.of_kind == number) & crowd.here)
        pool = one.pool(number, kind.radius)
        if not len(bodies) or not len(pool.xy):
            continue
        found = _assigned(motions, bodies, _divided(motions, bodies, pool, starts))
        placed.labels[one.kind == number] = np.where(found.labels >= 0, bodies[found.labels], -1)
        placed.centres[bodies], placed.filled[bodies] = found.centres, found.areas / kind.area
    _learn(crowd, placed, one.size)
    return placed


def _divided(motions: Motions, bodies: NDArray[np.int64], pool: Pool, starts: Sequence[Array]) -> Portions:
    """The best of the portions that the hypotheses about the motion lead to: flight, impact, rest."""
    variance = motions.covariance[bodies, 0, 0]
    found = [pool.divided(starts[0][bodies])]
    if _is_clear(found[0], motions, bodies, pool):
        return found[0]
    found += [pool.divided(start[bodies]) for start in starts[1:]]

    def cost(one: Portions, start: Array) -> float:
        miss = ((one.centres - start[bodies]) ** 2).sum(axis=-1) / variance
        return one.energy + PULL * float(np.minimum(miss, GATE).sum())

    best = min(range(len(starts)), key=lambda k: cost(found[k], starts[k]))
    return found[best]


def _is_clear(found: Portions, motions: Motions, bodies: NDArray[np.int64], pool: Pool) -> bool:
    """Whether every body fills its portion, near where free flight leads."""
    miss = np.linalg.norm(found.centres - motions.position[bodies], axis=-1)
    uneven = np.abs((found.areas + found.beyond) / pool.area - 1).max()
    return bool(uneven < UNEVEN and miss.max() < CLEAR * pool.radius)


def _assigned(motions: Motions, bodies: NDArray[np.int64], found: Portions) -> Portions:
    """The portions given to the bodies at the least total squared distance from the predictions (Kuhn-Munkres)."""
    variance = motions.covariance[bodies, 0, 0][:, np.newaxis]
    miss = ((motions.position[bodies][:, np.newaxis] - found.centres) ** 2).sum(axis=-1) / variance
    _, columns = linear_sum_assignment(np.minimum(miss, FAR))
    return found.taken(columns)


def _learn(crowd: Crowd, placed: Placed, size: tuple[int, int]) -> None:
    """Correct the motion of the bodies that are seen; count for how long the others have not been."""
    radius = crowd.motions.radius[:, np.newaxis]
    outside = ((placed.centres < -radius) | (placed.centres > np.array(size) - 1 + radius)).any(axis=1)
    at_edge = ((placed.centres < radius) | (placed.centres > np.array(size) - 1 - radius)).any(axis=1)
    seen = crowd.here & (placed.filled > np.where(at_edge, GONE, HIDDEN))
    crowd.motions.correct(placed.centres, seen, np.where(placed.filled < WHOLE, DOUBT, 1.0))
    crowd.unseen = np.where(seen, 0, np.where(outside, PATIENCE, crowd.unseen) + 1)
