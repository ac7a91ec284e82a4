"""The simple form of a missing force: a power of the speed or of the position, a drift, a pulse, or a sine.

Each form is a force along the whole fitted motion, in shapes on a grid. Its linear response, freed of what the fitted
values can imitate, is compared with the residual by least squares (Rao 1948); the best shape and its error follow from
the curvature of the sum of squares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitters.compose_effects import bodies_of
from fitters.effect_sensitivity import Motion
from fitters.latent_force.linear_response import NoisyResidual, Whitened, responses
from iris_sysid.types import Array, Estimate, ForceForm, ForceKind

SPEED_POWERS = np.arange(0.0, 4.01, 0.25)
POSITION_POWERS = np.arange(0.0, 6.01, 0.5)
MOMENTS = 48
FREQUENCIES = 45  # from 0.5 to 15 cycles in the clip: a sine is found where it is within a third of a cycle
RESONANCE = 1.0  # cycles in the clip by which a sine must differ from the motion itself
SHORTEST_PULSE = 2.0  # sample steps
MARGIN = 5.991464547107982  # 2 ln 20: odds of 20 to 1 between two kinds
EXPLAINED = 0.8  # least fraction of the explainable sum of squares that a form must explain
FEWEST_TURNS = 2  # times that a coordinate passes its zero, so that the zero has a meaning
VISIBLE = 1e-4  # relative strength of a response that the fitted values must leave


@dataclass(frozen=True, eq=False, slots=True)
class _Family:
    """Forces of one kind on a motion's grid: ``forces`` (m, f, shapes, c), the sizes of its c columns being free.

    ``shapes`` (shapes,) in ``unit``; ``positive``: only a size above zero is of this kind.
    """

    kind: ForceKind
    unit: str
    shapes: Array
    forces: Array
    positive: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class _Fitted:
    """What a family explains: ``gains`` (shapes,), the decrease of the sum of squares, and ``sizes`` (shapes,)."""

    family: _Family
    gains: Array
    sizes: Array

    @property
    def size(self) -> float:
        """The size in the best shape; NaN where there are several."""
        return float(self.sizes[int(np.argmax(self.gains))])

    @property
    def gain(self) -> float:
        """The largest gain."""
        return float(np.max(self.gains))

    @property
    def values(self) -> int:
        """Number of values that are fitted: sizes, and the shape."""
        return self.family.forces.shape[3] + (self.gains.size > 1)

    def shape(self, variance: float) -> Estimate | None:
        """The best shape, from a parabola through the gains around the largest; None where the kind has no shape."""
        shapes, k = self.family.shapes, int(np.argmax(self.gains))
        if shapes.size < 2:
            return None
        step, inner = float(shapes[1] - shapes[0]), int(np.clip(k, 1, shapes.size - 2))
        left, top, right = self.gains[inner - 1 : inner + 2]
        bend = max(float(2 * top - left - right), 1e-300)
        stderr = step * float(np.sqrt(2 * variance / bend))
        if k != inner:  # the largest gain is at the end of the grid
            return Estimate(float(shapes[k]), max(stderr, step), self.family.unit)
        return Estimate(float(shapes[k]) + step * float(right - left) / (2 * bend), stderr, self.family.unit)


def form_of(motion: Motion, residual: NoisyResidual, rho: float, noise_variance: float) -> ForceForm | None:
    """The form of a missing force; None where no form explains most of it.

    Parameters
    ----------
    motion
        A fitted motion with the inverse of its transition matrices.
    residual
        Of the fit, at all samples used.
    rho
        Correlation of the noise over one step of time.
    noise_variance
        Of the residual without the missing force, in units of the stated noise.
    """
    families = _families(motion)
    forces = [family.forces.reshape(*family.forces.shape[:2], -1) for family in families]
    shown = responses(motion, np.concatenate(forces, axis=2), np.arange(residual.t_s.size))
    white = residual.whitened(shown, rho)
    strength = np.linalg.norm((shown / residual.noise[:, :, None]).reshape(-1, shown.shape[2]), axis=0)
    ends = np.cumsum([part.shape[2] for part in forces])
    fits = [
        _fitted(family, white, strength, np.arange(end - part.shape[2], end))
        for family, part, end in zip(families, forces, ends, strict=True)
    ]
    return _best(fits, white, noise_variance)


def _fitted(family: _Family, white: Whitened, strength: Array, columns: NDArray[np.int_]) -> _Fitted:
    """The gain of each shape of a family; 0 where the fitted values imitate it, or its size has the wrong sign."""
    gains, first = np.zeros(family.shapes.size), np.full(family.shapes.size, np.nan)
    for k, group in enumerate(columns.reshape(family.shapes.size, -1)):
        products, along = white.responses[:, group].T @ white.responses[:, group], white.components[group]
        if not np.all(np.sqrt(np.diag(products)) > VISIBLE * strength[group]):
            continue
        sizes = np.linalg.lstsq(products, along, rcond=None)[0]
        if not family.positive or sizes[0] > 0:
            gains[k], first[k] = float(along @ sizes), sizes[0] if group.size == 1 else np.nan
    return _Fitted(family, gains, first)


def _best(fits: Sequence[_Fitted], white: Whitened, noise_variance: float) -> ForceForm | None:
    """The form with the largest gain, its fitted values deducted, if it explains enough."""
    remaining = [white.squares - fit.gain for fit in fits]
    degrees = white.degrees
    costs = [degrees * np.log(left) + fit.values * np.log(degrees) for fit, left in zip(fits, remaining, strict=True)]
    best = int(np.argmin(costs))
    explainable = white.squares - degrees * noise_variance
    share = fits[best].gain / explainable if explainable > 0 else 0.0
    if share < EXPLAINED:
        return None
    similar = [k for k in np.argsort(costs) if k != best and costs[k] - costs[best] < MARGIN]
    shape = fits[best].shape(remaining[best] / degrees)
    kinds = tuple(fits[k].family.kind for k in similar)
    return ForceForm(fits[best].family.kind, fits[best].size, shape, min(share, 1.0), kinds)


def _families(motion: Motion) -> list[_Family]:
    """The forms that make sense for a motion."""
    in_time = [_drift(motion), _own_drift(motion), _pulse(motion), _sine(motion)]
    states = motion.states[:, : motion.model.degrees_of_freedom]
    if not motion.model.second_order:
        return [_in_position("odd-in-position", motion, np.sign), *in_time]
    turns = np.min(np.sum(np.diff(np.sign(states), axis=0) != 0, axis=0))
    in_state = [_against_velocity(motion)]
    if turns >= FEWEST_TURNS:  # else the coordinate's zero is arbitrary
        in_state += [
            _in_position("odd-in-position", motion, np.sign),
            _in_position("even-in-position", motion, np.ones_like),
        ]
    return [*in_state, *in_time]


def usual(motion: Motion, kind: ForceKind) -> float:
    """The speed, or for a force that depends on it the position, whose power a force is: its root mean square."""
    count = motion.model.degrees_of_freedom
    values = motion.states[:, -count:] if kind == "against-velocity" else motion.states[:, :count]
    return float(np.sqrt(np.mean(values**2))) or 1.0


def _against_velocity(motion: Motion) -> _Family:
    """-|v|^p along the velocity of each body, v in units of its root mean square."""
    velocity = motion.states[:, motion.model.degrees_of_freedom :]
    speed = np.empty_like(velocity)
    for body in bodies_of(motion.model):
        speed[:, body] = np.sqrt(np.sum(velocity[:, body] ** 2, axis=1))[:, None]
    scaled = np.maximum(speed / usual(motion, "against-velocity"), 1e-9)
    direction = velocity / np.maximum(speed, 1e-300)
    forces = -direction[:, :, None] * scaled[:, :, None] ** SPEED_POWERS
    return _Family("against-velocity", "1", SPEED_POWERS, forces[..., None], positive=True)


def _in_position(kind: ForceKind, motion: Motion, sign: Callable[[Array], Array]) -> _Family:
    """|x|^p with a sign, x in units of its root mean square."""
    position = motion.states[:, : motion.model.degrees_of_freedom]
    scaled = np.maximum(np.abs(position) / usual(motion, kind), 1e-9)
    forces = sign(position)[:, :, None] * scaled[:, :, None] ** POSITION_POWERS
    return _Family(kind, "1", POSITION_POWERS, forces[..., None])


def _drift(motion: Motion) -> _Family:
    """A force that grows evenly with time."""
    share = (motion.grid - motion.grid[0]) / (motion.grid[-1] - motion.grid[0])
    return _Family("drift", "", np.zeros(1), _each_freedom(motion, share[:, None, None]))


def _own_drift(motion: Motion) -> _Family:
    """The model's own force, growing evenly with time."""
    share = (motion.grid - motion.grid[0]) / (motion.grid[-1] - motion.grid[0])
    own = motion.slopes[:, -motion.model.degrees_of_freedom :] * share[:, None]
    return _Family("own-force-drift", "", np.zeros(1), own[:, :, None, None])


def _pulse(motion: Motion) -> _Family:
    """A short force at one moment."""
    grid = motion.grid
    moments_s = np.linspace(grid[0], grid[-1], MOMENTS + 2)[1:-1]
    width_s = max(SHORTEST_PULSE * float(np.median(np.diff(grid[motion.at_samples]))), moments_s[1] - moments_s[0])
    pulses = np.maximum(1.0 - np.abs(grid[:, None] - moments_s) / width_s, 0.0)
    return _Family("pulse", "s", moments_s, _each_freedom(motion, pulses[:, :, None]))


def _sine(motion: Motion) -> _Family:
    """A periodic force of any phase."""
    elapsed_s = motion.grid - motion.grid[0]
    frequencies_hz = (1.5 + np.arange(FREQUENCIES)) / 3.0 / elapsed_s[-1]
    own_hz = _own_frequency(motion)
    frequencies_hz = frequencies_hz[np.abs(frequencies_hz - own_hz) * elapsed_s[-1] > RESONANCE]
    phase = 2 * np.pi * elapsed_s[:, None] * frequencies_hz
    return _Family(
        "sine", "Hz", frequencies_hz, _each_freedom(motion, np.stack([np.sin(phase), np.cos(phase)], axis=2))
    )


def _own_frequency(motion: Motion) -> float:
    """How often the motion itself repeats, Hz: a force at that frequency imitates every slow change of it."""
    signs = np.sign(motion.states[:, -1] - np.mean(motion.states[:, -1]))
    return float(np.count_nonzero(np.diff(signs))) / 2.0 / float(motion.grid[-1] - motion.grid[0])


def _each_freedom(motion: Motion, courses: Array) -> Array:
    """Courses (m, shapes, c) as forces (m, f, shapes, c * f), one column for each degree of freedom."""
    count = motion.model.degrees_of_freedom
    forces = np.einsum("msc,fg->mfscg", courses, np.eye(count))
    return np.asarray(forces.reshape(*forces.shape[:3], -1))
