"""What a track may be an observation of: a height, a distance along a line, an angle about a pivot, an apparent radius.

An observable turns the raw channels (x, z, apparent radius, one set a body) into the quantities that models observe,
and keeps the rest: the part of the raw channels that the observable takes for constant. Only both together can be
compared between observables, and they have the units of the raw channels, so that the noise is that of the tracker.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from fitters.noise.measurement_noise import noise_from_differences
from iris_sysid.trajectory.circle import circle_through
from iris_sysid.types import Array, Mask, OdeModel, Quantity, Trajectory

MAX_RADIUS = 30.0  # times the extent of a track: a circle that large is a line
ObservableName = Literal[
    "as given",
    "level",
    "position",
    "height",
    "tilted height",
    "distance",
    "angle",
    "apparent radius",
    "angles",
    "distances",
]
TILTED: ObservableName = "tilted height"
INCLINATION = "angle"  # the constant of models that move along a line: its angle from the horizontal
UPRIGHT = 0.05  # rad: how far a camera's vertical may be off, and its horizontal with it


@dataclass(frozen=True, eq=False, slots=True)
class Raw:
    """One body as tracked: ``t_s`` (n,), ``channels`` (n, c) by ``quantities``, ``noise`` (c,) of each."""

    t_s: Array
    quantities: tuple[Quantity, ...]
    channels: Array
    noise: Array

    def has(self, *names: str) -> bool:
        """Whether all these quantities were tracked."""
        return {quantity.name for quantity in self.quantities} >= set(names)

    def column(self, name: str) -> Array:
        """One channel (n,). It has the unit of the channel."""
        return self.channels[:, self._index(name)]

    @property
    def plane(self) -> Array:
        """X and z (n, 2), in the unit of the position."""
        return np.column_stack([self.column("x"), self.column("z")])

    def sigma(self, *names: str) -> float:
        """Noise of some channels together."""
        return float(np.sqrt(np.mean([self.noise[self._index(name)] ** 2 for name in names])))

    def _index(self, name: str) -> int:
        return [quantity.name for quantity in self.quantities].index(name)

    @property
    def unit(self) -> str:
        """Unit of the position."""
        return self.quantities[self._index("x" if self.has("x") else self.quantities[0].name)].unit


@dataclass(frozen=True, eq=False, slots=True)
class ObservableCandidate:
    """Quantities (n, q) for a model; what they mean for the raw channels; and the rest of those.

    ``lever`` (q,): raw noise units by which one unit of each quantity moves the body; ``rest`` (n, m) of the raw
    channels, in noise units; ``count`` numbers that describe the observable, e.g. 3 for a circle. ``known`` are
    constants that models may take from it by name.
    """

    name: ObservableName
    quantities: Array
    units: tuple[str, ...]
    lever: Array
    rest: Array
    count: int
    known: Mapping[str, float] = field(default_factory=dict)


def raw_of(trajectory: Trajectory, used: Mask) -> Raw:
    """The samples of a trajectory that are used, with the noise of each channel from differences of neighbours.

    Parameters
    ----------
    trajectory
        Any quantities.
    used
        (n,) samples to take.
    """
    t_s, channels = trajectory.t_s[used], trajectory.position[used]
    noise = np.array([noise_from_differences(t_s, column) for column in channels.T])
    size = np.ptp(channels, axis=0)
    floor = np.maximum(1e-9 * size.max(initial=0.0), 1e-300)
    return Raw(t_s, trajectory.quantities, channels, np.maximum(np.nan_to_num(noise), floor))


def observables_of(raw: Raw, known: Mask) -> list[ObservableCandidate]:
    """Every observable that the channels admit, its own constants from the ``known`` samples (n,) alone."""
    no_rest = np.empty((raw.t_s.size, 0))
    if not raw.has("x", "z"):
        units = tuple(quantity.unit for quantity in raw.quantities)
        name: ObservableName = "level" if [quantity.name for quantity in raw.quantities] == ["h"] else "as given"
        return [ObservableCandidate(name, raw.channels, units, 1 / raw.noise, no_rest, 0)]
    lever, (x, z) = 1 / raw.sigma("x", "z"), raw.plane.T
    across = lever * (x - np.mean(x[known]))
    observables = [
        ObservableCandidate("position", raw.plane, (raw.unit,) * 2, np.full(2, lever), no_rest, 0),
        ObservableCandidate("height", z[:, None], (raw.unit,), np.array([lever]), across[:, None], 1),
        _line(raw, known),
        *([circle] if (circle := _circle(raw, known)) is not None else []),
    ]
    if not raw.has("r"):
        return observables
    return [*(_with_constant_size(observable, raw, known) for observable in observables), _size(raw, known)]


def _line(raw: Raw, known: Mask) -> ObservableCandidate:
    """Distance along the line of least squares, forwards in time; the height on one that may be upright."""
    sigma, position = raw.sigma("x", "z"), raw.plane
    middle = position[known].mean(axis=0)
    along = np.linalg.svd(position[known] - middle, full_matrices=False)[2]
    distance, across = ((position - middle) @ along.T).T
    lever, rest = np.array([1 / sigma]), across[:, None] / sigma
    steep = abs(float(np.arctan2(along[0, 1], along[0, 0])))
    angle = min(steep, np.pi - steep)
    if np.pi / 2 - angle < UPRIGHT:
        return ObservableCandidate(
            TILTED, (middle[1] + np.sign(along[0, 1]) * distance)[:, None], (raw.unit,), lever, rest, 2
        )
    ahead = 1.0 if distance[known][-1] >= distance[known][0] else -1.0
    return ObservableCandidate("distance", ahead * distance[:, None], (raw.unit,), lever, rest, 2, {INCLINATION: angle})


def _circle(raw: Raw, known: Mask) -> ObservableCandidate | None:
    """Angle from straight down about the centre of the circle of least squares; None for a straight track."""
    sigma, position = raw.sigma("x", "z"), raw.plane
    x, z, radius, _ = circle_through(position[known])
    if not 0 < radius < MAX_RADIUS * float(np.max(np.ptp(position[known], axis=0))):
        return None
    angle = np.unwrap(np.arctan2(position[:, 0] - x, z - position[:, 1]))
    rest = (np.hypot(position[:, 0] - x, position[:, 1] - z) - radius) / sigma
    constants = {"pivot_x": x, "pivot_z": z, "radius": radius}
    return ObservableCandidate(
        "angle", angle[:, None], ("rad",), np.array([radius / sigma]), rest[:, None], 3, constants
    )


def _with_constant_size(observable: ObservableCandidate, raw: Raw, known: Mask) -> ObservableCandidate:
    radius = raw.column("r")
    rest = (radius - np.mean(radius[known])) / raw.sigma("r")
    return replace(observable, rest=np.column_stack([observable.rest, rest]), count=observable.count + 1)


def _size(raw: Raw, known: Mask) -> ObservableCandidate:
    """The apparent radius; the position moves with it on a line through where the camera looks."""
    radius = raw.column("r")
    basis = np.column_stack([np.ones(radius.size), radius])
    coefficients = np.linalg.lstsq(basis[known], raw.plane[known], rcond=None)[0]
    rest = (raw.plane - basis @ coefficients) / raw.sigma("x", "z")
    lever = np.sqrt(raw.sigma("r") ** -2 + np.sum((coefficients[1] / raw.sigma("x", "z")) ** 2))
    return ObservableCandidate("apparent radius", radius[:, None], ("px",), np.array([lever]), rest, 4)


# --------------------------------------------------------------------------- several bodies


def combined(parts: Sequence[ObservableCandidate], name: ObservableName) -> ObservableCandidate:
    """The same observable of several bodies as one, a column a body."""
    return ObservableCandidate(
        name=name,
        quantities=np.column_stack([part.quantities for part in parts]),
        units=tuple(unit for part in parts for unit in part.units),
        lever=np.concatenate([part.lever for part in parts]),
        rest=np.column_stack([part.rest for part in parts]),
        count=sum(part.count for part in parts),
        known=_between(parts),
    )


def _between(parts: Sequence[ObservableCandidate]) -> dict[str, float]:
    """The distance of the second pivot from the first, over the first radius."""
    if len(parts) != 2 or not all("pivot_x" in part.known for part in parts):
        return {}
    first, second = (part.known for part in parts)
    return {"pivot_ratio": (second["pivot_x"] - first["pivot_x"]) / first["radius"]}


# --------------------------------------------------------------------------- models


def suits(model: OdeModel, observable: ObservableCandidate) -> bool:
    """Whether a model admits an observable: as many quantities of the same units, upright or sloping as it says."""
    if model.inputs or len(model.observed) != len(observable.units):
        return False
    same = all(
        quantity.unit == unit or (quantity.unit == "m" and unit == "px")
        for quantity, unit in zip(model.observed, observable.units, strict=True)
    )
    same = same or model.may_be_of(observable.units[0])
    only = ONLY.get(observable.name)
    slopes = observable.known.get(INCLINATION, np.pi / 2) > UPRIGHT  # a level line is not an incline
    return same and (only is None or only(model)) and (slopes or not model.with_role("inclination"))


def _upright(model: OdeModel) -> bool:
    return model.observed[0].name in ("z", "h")


def _sloping(model: OdeModel) -> bool:
    """Along any line: not what falls or drains."""
    falls = bool(model.with_role("gravity"))
    return model.observed[0].name == "s" or (model.observed[0].name == "z" and not falls)


ONLY: Mapping[ObservableName, Callable[[OdeModel], bool]] = {
    "height": _upright,
    "level": _upright,
    TILTED: _upright,
    "distance": _sloping,
    "position": lambda model: {quantity.name for quantity in model.observed} == {"x", "z"},
    "apparent radius": lambda model: model.observed[0].name == "r",
    "distances": lambda model: all(quantity.name.startswith("z") for quantity in model.observed),
}


def as_trajectory(raw_times: Array, observable: ObservableCandidate, model: OdeModel) -> Trajectory:
    """The observable as the trajectory that a model observes. ``raw_times`` (n,), s."""
    quantities = tuple(
        Quantity(quantity.name, unit, quantity.symbol)
        for quantity, unit in zip(model.observed, observable.units, strict=True)
    )
    n, d = observable.quantities.shape
    every = np.ones(n, dtype=np.bool_)
    return Trajectory(raw_times, quantities, observable.quantities, np.full((n, d), np.nan), every)


def moves_with_its_zero(model: OdeModel) -> bool:
    """Whether the equation stays the same when the observed quantities are counted from elsewhere."""
    count = len(model.observed)
    state = np.linspace(0.3, 0.9, len(model.states))
    moved = state + np.concatenate([np.full(count, 0.37), np.zeros(state.size - count)])
    params = tuple(0.5 if parameter.default is None else parameter.default for parameter in model.parameters)
    before, after = (model.rhs(0.1, tuple(point.tolist()), params) for point in (state, moved))
    return bool(np.allclose(before, after))
