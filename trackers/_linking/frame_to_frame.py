"""Sightings of successive frames joined into paths: assignment to where each path is predicted to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from iris_sysid.types import Array
from trackers._detection.detection import Glimpse, Sighting

SPEED_CHANGE = 0.8  # of the distance that the body goes in the time
LONGEST_GAP = 5  # frames over which a path is predicted
LOOKS_WEIGHT = 1.0  # cost of looking different by a factor e, beside 1 for a miss as large as the reach
DEAREST = 2.0  # cost above which a sighting is not joined
FORBIDDEN = 1e6


@dataclass(eq=False)
class Path:
    """Sightings believed to be of one body, in time order."""

    sightings: list[Sighting] = field(default_factory=list)

    @property
    def first(self) -> Sighting:
        """The earliest sighting."""
        return self.sightings[0]

    @property
    def last(self) -> Sighting:
        """The latest sighting."""
        return self.sightings[-1]

    @property
    def xy(self) -> Array:
        """Positions (n, 2), px."""
        return np.array([(one.x, one.y) for one in self.sightings])

    @property
    def frames(self) -> set[int]:
        """Numbers of the frames in which the body was seen."""
        return {one.frame for one in self.sightings}

    def typical(self, name: str) -> float:
        """Median over the path of a property of its sightings."""
        if len(self.sightings) == 1:
            return float(getattr(self.last, name))
        return float(np.median([getattr(one, name) for one in self.sightings]))

    def velocity(self) -> Array:
        """Velocity (2,) between the last two sightings, px/s; zero when there is one."""
        if len(self.sightings) < 2:
            return np.zeros(2)
        before, last = self.sightings[-2:]
        return np.array([last.x - before.x, last.y - before.y]) / (last.t_s - before.t_s)

    def predicted(self, t_s: float) -> Array:
        """Position (2,) in px at time ``t_s`` in s if the velocity stays."""
        return np.array([self.last.x, self.last.y]) + self.velocity() * (t_s - self.last.t_s)

    def reach(self, t_s: float) -> float:
        """How far from the prediction the body may be at ``t_s``, px, judged by its speed and size."""
        change = SPEED_CHANGE * float(np.hypot(*self.velocity())) * abs(t_s - self.last.t_s)
        return max(3.0 * self.last.radius, change)


def unlikeness(one: Sighting, other: Sighting) -> float:
    """How different two sightings look: log ratios of area, contrast and, weighing half, compactness; and the side.

    The side is -1 for a body darker than what is behind it, 1 for a brighter one: two balls that strike one another are
    where the other one is predicted, and may differ in nothing else.
    """
    sides = (one.brightening / one.contrast, other.brightening / other.contrast)
    return float(
        abs(np.log(one.area / other.area))
        + abs(np.log(one.contrast / other.contrast))
        + 0.5 * abs(np.log(one.compactness / other.compactness))
        + 0.5 * abs(sides[0] - sides[1])
    )


def link(glimpses: Sequence[Glimpse], first_reach: float, least_reach: float) -> list[Path]:
    """Join the sightings of all frames into paths; a path ends when it is not seen for some frames.

    Each frame's sightings go to the paths at the least total cost (Kuhn-Munkres): the miss from the
    prediction over the reach, plus the difference in looks.

    Parameters
    ----------
    glimpses
        The sightings of each frame, in order.
    first_reach
        How far a body may go between its first two sightings, px.
    least_reach
        How far from its prediction a body may be whatever its speed and size, px.
    """
    live: list[Path] = []
    done: list[Path] = []
    for glimpse in glimpses:
        done += [path for path in live if glimpse.frame - path.last.frame > LONGEST_GAP]
        live = [path for path in live if glimpse.frame - path.last.frame <= LONGEST_GAP]
        joined = _assign(live, glimpse, first_reach, least_reach)
        for row, column in joined.items():
            live[row].sightings.append(glimpse.sightings[column])
        new = set(range(len(glimpse.sightings))) - set(joined.values())
        live += [Path([glimpse.sightings[k]]) for k in sorted(new)]
    return done + live


def _assign(live: list[Path], glimpse: Glimpse, first_reach: float, least_reach: float) -> dict[int, int]:
    """Which live path (row) takes which sighting (column)."""
    if not live or not glimpse.sightings:
        return {}
    seen = np.array([(one.x, one.y) for one in glimpse.sightings])
    cost = np.full((len(live), len(seen)), FORBIDDEN)
    for row, path in enumerate(live):
        reach = max(path.reach(glimpse.t_s), first_reach if len(path.sightings) < 2 else least_reach)
        miss = np.hypot(*(seen - path.predicted(glimpse.t_s)).T) / reach
        for column in np.flatnonzero(miss < 1.0):
            looks = unlikeness(path.last, glimpse.sightings[column])
            cost[row, column] = miss[column] + LOOKS_WEIGHT * looks
    rows, columns = linear_sum_assignment(cost)
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < DEAREST}
