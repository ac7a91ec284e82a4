"""Detections to tracks by two assignments: from frame to frame to pieces, then of all pieces of the clip at once [1]_.

The second decides over the whole clip: each end of a piece goes on with the beginning of one later piece, or ends, at
the least total cost. Any number of bodies is linked at once, whatever the requested number.

.. [1] K. Jaqaman et al., Robust single-particle tracking in live-cell time-lapse sequences, Nat. Methods 5 (2008) 695.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Detections, Linker, LinkOptions, Track
from trackers._tracklets.least_cost import least_cost_pairs

DEFAULT_RANGE = 0.25  # of the diagonal: how far a body may be from its prediction, where no search range is given
SPEED_CHANGE = 0.2  # of the distance that a body goes: standard deviation of where it is from where it is predicted
STRUCK = 0.02  # share of frames in which a body is struck: where it goes then does not follow from where it came from
MAX_PIECES = 2000  # of a clip: the assignment takes memory in proportion to their square
MIN_DETECTIONS = 3  # of a track
SURE = 1e-4  # no detection is surer than this to be of a body, or to be of none
Piece = list[int]  # numbers of its detections, in order


@dataclass(frozen=True, eq=False, slots=True)
class _Links:
    """Costs of joining detections: minus the logarithm of how likely that is, against any other detection.

    ``step`` (n,) is the place of each detection's frame among all frames, ``log_odds`` (n,) those of its being a body.
    """

    found: Detections
    options: LinkOptions
    step: NDArray[np.int64]
    log_odds: Array

    @property
    def range_px(self) -> float:
        """How far a body may be from where it is predicted, px a frame."""
        diagonal = float(np.hypot(*self.found.size))
        return self.options.search_range_px or DEFAULT_RANGE * diagonal

    def joined(self, pieces: Sequence[Piece], others: Sequence[Piece]) -> dict[int, int]:
        """Which piece goes on with which other, at the least total cost; the rest ends or begins there."""
        if not pieces or not others:
            return {}
        ends = np.array([self._alone(piece, self.options.death_odds) for piece in pieces])
        starts = np.array([self._alone(piece, self.options.birth_odds) for piece in others])
        more = np.minimum(self._costs(pieces, others) - ends[:, np.newaxis] - starts, 0.0)
        pairs = zip(*least_cost_pairs(more), strict=True)
        return {int(row): int(column) for row, column in pairs if more[row, column] < 0}

    def _alone(self, piece: Piece, odds: float) -> float:
        """Cost of the birth or the death of a body, or of taking the piece for false detections where that is less."""
        return float(np.clip(self.log_odds[piece].sum(), 0.0, -np.log(odds)))

    def _costs(self, pieces: Sequence[Piece], others: Sequence[Piece]) -> Array:
        """Cost (a, b) of going on from the end of each piece with the beginning of each other."""
        ends, starts = np.array([piece[-1] for piece in pieces]), np.array([piece[0] for piece in others])
        gap = self.step[starts] - self.step[ends][:, np.newaxis]
        towards = np.array([piece[-2] if len(piece) > 1 else -1 for piece in pieces])
        onwards = np.array([piece[1] if len(piece) > 1 else -1 for piece in others])
        before, after = self._misses(ends, towards, starts), self._misses(starts, onwards, ends).T
        known = np.stack(np.broadcast_arrays((towards >= 0)[:, np.newaxis], (onwards >= 0)))  # velocities
        either = known | ~known.any(axis=0)  # where none is known, both say the same
        motion = np.where(either, np.stack([before, after]), 0.0).sum(axis=0) / either.sum(axis=0)
        looks = ((self.found.looks[starts] - self.found.looks[ends][:, np.newaxis]) ** 2).sum(axis=2) / 2
        each_gap = -np.log(self.options.gap_odds / max(1, self.options.memory))  # gaps of any length are as likely
        allowed = (gap >= 1) & (gap <= self.options.memory + 1)
        return np.where(allowed, motion + looks + np.where(gap > 1, each_gap, 0.0), np.inf)

    def _misses(self, last: NDArray[np.int64], further: NDArray[np.int64], to: NDArray[np.int64]) -> Array:
        """Cost (a, b) of going to detections ``to`` from ``last``, with the velocity between ``further`` and ``last``.

        A body keeps its velocity, with a spread, or is struck and may be as far as it could go. ``further`` is -1 where
        no velocity is known.
        """
        found, known = self.found, further >= 0
        steps = np.abs(self.step[to] - self.step[last][:, np.newaxis]).astype(np.float64)
        between = np.where(known, np.abs(self.step[last] - self.step[further]), 1)
        way = np.where(known[:, np.newaxis], found.xy_px[last] - found.xy_px[further], 0.0) / between[:, np.newaxis]
        predicted = found.xy_px[last][:, np.newaxis] + way[:, np.newaxis] * steps[..., np.newaxis]
        miss = np.linalg.norm(found.xy_px[to] - predicted, axis=2)
        moved = np.linalg.norm(found.xy_px[to] - found.xy_px[last][:, np.newaxis], axis=2)
        error = np.hypot(found.sigma_px[to], found.sigma_px[last][:, np.newaxis] * (1 + steps / between[:, np.newaxis]))
        speed = np.linalg.norm(way, axis=1)[:, np.newaxis]
        spread = np.hypot(error, SPEED_CHANGE * speed * steps)
        wide = np.hypot(error, np.where(known[:, np.newaxis], speed, self.range_px / 3) * steps)
        area = float(np.prod(found.size)) / max(1.0, len(found) / found.frames.size)  # that a detection has to itself
        struck = np.where(known, STRUCK, 1.0)[:, np.newaxis]
        likely = (1 - struck) * _density(miss, spread) + struck * _density(moved, wide)
        with np.errstate(divide="ignore"):
            cost = -np.log(area * likely)
        return np.asarray(np.where(np.minimum(miss, moved) <= self.range_px * steps, cost, np.inf))


def _density(miss: Array, spread: Array) -> Array:
    """Density of a normal distribution in the plane at a distance from its middle, 1/px^2."""
    return np.asarray(np.exp(-0.5 * (miss / spread) ** 2) / (2 * np.pi * spread**2))


def link(detections: Detections, options: LinkOptions) -> list[Track]:
    """Link detections to the tracks that are likeliest to be of bodies.

    Parameters
    ----------
    detections
        From a detector.
    options
        Number of bodies, search range, memory and odds.

    Returns
    -------
    list of Track
        One for each body, the likeliest first: rough positions with the errors of the detections.

    Raises
    ------
    TrackingError
        When there are fewer tracks than bodies, or more pieces than can be joined.
    """
    sure = np.clip(detections.probability, SURE, 1 - SURE)
    log_odds = np.log(sure / (1 - sure))
    links = _Links(detections, options, np.searchsorted(detections.frames, detections.frame), log_odds)
    pieces = _joined(links, _from_frame_to_frame(links))
    long_enough = [piece for piece in pieces if len(piece) >= MIN_DETECTIONS]
    if len(long_enough) < options.bodies:
        raise TrackingError(
            f"{options.bodies} bodies were requested, but {len(long_enough)} tracks have {MIN_DETECTIONS} detections; "
            "request fewer, use another detector, or allow for a larger search_range_px or memory"
        )
    best = sorted(long_enough, key=lambda piece: -float(log_odds[piece].sum()))[: options.bodies]
    return [_track(detections, piece, str(number)) for number, piece in enumerate(best, start=1)]


def _from_frame_to_frame(links: _Links) -> list[Piece]:
    """Pieces without gaps: the detections of each frame are assigned to those of the frame before."""
    order = np.argsort(links.step, kind="stable")
    starts = np.searchsorted(links.step[order], np.arange(links.found.frames.size + 1))
    done: list[Piece] = []
    live: list[Piece] = []
    for first, stop in pairwise(starts):
        new = [[int(k)] for k in order[first:stop]]
        taken = links.joined(live, new)
        for row, column in taken.items():
            live[row] += new[column]
        done += [piece for row, piece in enumerate(live) if row not in taken]
        free = set(range(len(new))) - set(taken.values())
        live = [live[row] for row in taken] + [new[column] for column in sorted(free)]
    return done + live


def _joined(links: _Links, pieces: Sequence[Piece]) -> list[Piece]:
    """The pieces joined over gaps, all at once."""
    if len(pieces) > MAX_PIECES:
        raise TrackingError(
            f"the detections make {len(pieces)} pieces, more than {MAX_PIECES}: most are noise; restrict the region "
            "with roi, or leave out detections of low probability"
        )
    following = links.joined(pieces, pieces)
    chains = []
    for first in sorted(set(range(len(pieces))) - set(following.values())):
        chain, at = list(pieces[first]), first
        while at in following:
            at = following[at]
            chain += pieces[at]
        chains.append(chain)
    return chains


def _track(found: Detections, piece: Piece, body: str) -> Track:
    """The Track of some detections over all frames."""
    rows = np.searchsorted(found.frames, found.frame[piece])
    xy, sigma = np.full((2, found.frames.size, 2), np.nan)
    radius = np.full(found.frames.size, np.nan)
    xy[rows], sigma[rows], radius[rows] = (
        found.xy_px[piece],
        found.sigma_px[piece][:, np.newaxis],
        found.radius_px[piece],
    )
    probability = float(np.mean(found.probability[piece]))
    origin = {"linker": LINKER.name, "probability": probability}
    valid = np.isfinite(radius)
    return Track(found.t_s, xy, sigma, valid, found.frames, body=body, radius_px=radius, origin=origin)


LINKER = Linker(
    name="assignment",
    summary="pieces from frame to frame, joined by one assignment over the clip",
    link=link,
)
