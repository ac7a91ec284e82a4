"""The path of a body through all frames by dynamic programming (Viterbi 1967) over the places where it may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Array
from trackers._auto.appearance import Peaks

MAX_GAP = 12  # frames over which two places are joined directly
MISSED = 0.35  # cost of a frame in which the body is not found, in units of the score of a typical place
STEP = 0.3  # cost of a step as long as the reach
MAX_STEP_COST = 4.0  # largest cost of a step, however far
RESTART = 2.0  # cost of going on after a longer gap: three frames that clearly show the body outweigh it
MARKED = 1000.0  # gain of a place at a mark
CLEAR = 1.3  # times the score of any other place: a frame that leaves no doubt where the body is
MIN_STEPS, LARGE = 3, 0.9  # between such frames, which tell how far it goes: their quantile


@dataclass(frozen=True, eq=False, slots=True)
class Steps:
    """Costs of the motion: ``reach`` is how far a body usually goes in a frame, px."""

    reach: float

    def cost(self, before: Array, after: Array, frames: int) -> Array:
        """Costs (k, l) of going from places (k, 2) to places (l, 2) in that number of frames."""
        apart = np.linalg.norm(after[np.newaxis] - before[:, np.newaxis], axis=2)
        return np.minimum(MAX_STEP_COST, STEP * (apart / (self.reach * frames)) ** 2)


def usual_reach(candidates: Sequence[Peaks]) -> float:
    """How far, px, a body goes in a frame, by neighbouring frames that leave no doubt where it is; 0 by too few."""
    clear = [len(each.score) > 0 and bool(each.score[0] > CLEAR * each.score[1:2].sum()) for each in candidates]
    pairs = [(k, k + 1) for k in range(len(candidates) - 1) if clear[k] and clear[k + 1]]
    steps = [float(np.hypot(*(candidates[after].xy[0] - candidates[before].xy[0]))) for before, after in pairs]
    return float(np.quantile(steps, LARGE)) if len(steps) >= MIN_STEPS else 0.0


def best_path(candidates: Sequence[Peaks], reach: float) -> list[int | None]:
    """Which of the candidates of each frame is the body; None where none of them is.

    The path maximises the sum of the scores, each over the median of the best scores, less the costs of its steps and
    of the frames that it leaves out.

    Parameters
    ----------
    candidates
        The places of each frame, in order.
    reach
        How far the body usually goes between two frames, px.
    """
    if not any(len(peaks.score) for peaks in candidates):
        return [None] * len(candidates)
    best = [peaks.score[0] for peaks in candidates if len(peaks.score) and not _marked(peaks)]
    typical = max(float(np.median(best)), 1e-6) if best else 1.0
    steps = Steps(max(reach, 1e-6))
    totals: list[Array] = []
    origins: list[list[tuple[int, int] | None]] = []
    champion: tuple[float, int, int] | None = None  # the best path that ended longer ago
    for k, peaks in enumerate(candidates):
        gains = np.minimum(peaks.score / typical, 1.5 if not _marked(peaks) else np.inf) - MISSED
        total = gains.copy()
        origin: list[tuple[int, int] | None] = [None] * len(gains)
        earlier = k - MAX_GAP - 1
        if earlier >= 0 and len(totals[earlier]):
            at = int(np.argmax(totals[earlier]))
            if champion is None or totals[earlier][at] > champion[0]:
                champion = (float(totals[earlier][at]), earlier, at)
        if champion is not None and len(gains):
            _improve(total, origin, gains + champion[0] - RESTART, np.full(len(gains), champion[2]), champion[1])
        for before in range(max(0, k - MAX_GAP), k):
            if not len(totals[before]) or not len(gains):
                continue
            cost = steps.cost(candidates[before].xy, peaks.xy, k - before)
            values = totals[before][:, np.newaxis] - cost
            chosen = np.argmax(values, axis=0)
            _improve(total, origin, gains + values[chosen, np.arange(len(gains))], chosen, before)
        totals.append(total)
        origins.append(origin)
    return _traced(totals, origins)


def _marked(peaks: Peaks) -> bool:
    return bool(len(peaks.score)) and bool(peaks.score[0] >= MARKED)


def _improve(total: Array, origin: list[tuple[int, int] | None], values: Array, chosen: Array, before: int) -> None:
    for column in np.flatnonzero(values > total):
        total[column] = values[column]
        origin[column] = (before, int(chosen[column]))


def _traced(totals: Sequence[Array], origins: Sequence[list[tuple[int, int] | None]]) -> list[int | None]:
    """The best path back from its end."""
    path: list[int | None] = [None] * len(totals)
    ends = [(float(total.max()), k, int(np.argmax(total))) for k, total in enumerate(totals) if len(total)]
    _, k, column = max(ends)
    step: tuple[int, int] | None = (k, column)
    while step is not None:
        k, column = step
        path[k] = column
        step = origins[k][column]
    return path


def bound_to_marks(candidates: Sequence[Peaks], marks: Mapping[int, tuple[float, float]], radius: float) -> list[Peaks]:
    """The candidates with those of marked frames replaced by the mark, or the candidate that lies on it."""
    bound = list(candidates)
    for k, place in marks.items():
        peaks = candidates[k]
        apart = np.hypot(*(peaks.xy - place).T) if len(peaks.score) else np.zeros(0)
        near = np.flatnonzero(apart < radius)
        xy = peaks.xy[near[0]] if near.size else np.array(place)
        bound[k] = Peaks(xy[np.newaxis].astype(np.float64), np.array([MARKED]))
    return bound
