"""Score every effect that a model may lack against what a fit leaves over, without refitting.

With s the effect's sensitivity, J those of the fitted parameters and r the residual, all in units of the noise,
s' = s - J (J'J)^-1 J's is what the parameters cannot imitate, (s'r) / (s's') estimates the size to first order
(Rao 1948, Proc. Camb. Phil. Soc. 44, 50), and (s'r)^2 / (s's' r'r) is the share of the residual that it explains.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import numpy as np
from scipy.stats import norm

from fitters.effect_sensitivity import Motion, motion_of, sensitivity
from fitters.noise.autoregression import Autoregression, grid_positions, on_grid
from fitters.noise.sandwich_covariance import inverse_normal, middle, random_uncertainty
from iris_sysid.diagnosis.measurement_errors import stands_out_from, stated_errors, unit_noise
from iris_sysid.types import Array, Effect, FitResult, Trajectory

ALIKE = 0.99  # cosine between projected sensitivities above which two effects cannot be told apart
MOST_NUMBERS = 20_000_000  # in the directions; beyond, pairs are formed of each effect's best shape only
SINGULAR = 1e-9  # of the largest singular value: the fitted parameters' own null directions
HIDDEN = 1e-4  # share of a sensitivity that must be left after the parameters have taken theirs


@dataclass(frozen=True, slots=True)
class Score:
    """One effect in one round of the screen.

    ``size`` and ``stderr`` are its first-order estimate in ``unit``; ``gain`` is the share of the residual's
    sum of squares ``total``, in units of the noise, that it would take away; ``chi2`` is what that would take off
    the chi-square of white noise, with so many ``degrees`` of freedom. ``size`` and ``stderr`` are NaN when the data
    cannot show the effect. ``shape`` are the other parameters at their best, of ``tried`` sets of them. Below the size
    ``stands_out`` it changes too little to be more than the errors that the track states may be. ``shifts`` say by how
    much each fitted value changes when the effect is added, for each unit of its size.
    """

    effect: str
    size: float
    stderr: float
    unit: str
    gain: float
    total: float
    chi2: float
    degrees: int = 1
    shape: tuple[float, ...] = ()
    tried: int = 1
    stands_out: float = 0.0
    shifts: Mapping[str, float] = field(default_factory=dict)

    @property
    def z(self) -> float:
        """Size in standard errors."""
        return self.size / self.stderr if self.stderr > 0 else float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class _Direction:
    """An effect in one shape: what the parameters cannot imitate of its sensitivity, as a unit vector and a length.

    ``along`` is the residual's component, ``shifts`` (k,) what each fitted value changes by for a unit of the effect.
    """

    effect: str
    shape: tuple[float, ...]
    unit: Array
    length: float
    along: float
    shifts: Array


@dataclass(frozen=True, eq=False, slots=True)
class _Residual:
    """What a fit leaves over, in units of the noise, and how it hangs together in time.

    ``values`` (n, d); ``basis`` (n * d, k) orthonormal, spans what the k fitted values can imitate, ``solve`` (k, k)
    takes a component along it to their values, ``free`` are their names; ``process`` one autoregression a quantity;
    ``stated`` (n, d) the errors that the track states, 0 where it states none; ``unit`` that of what is observed.
    """

    t_s: Array
    values: Array
    basis: Array
    solve: Array
    free: tuple[str, ...]
    process: tuple[Autoregression, ...]
    stated: Array
    unit: str

    @classmethod
    def of(cls, fitted: FitResult, noise: Array, stated: Array) -> _Residual:
        values = fitted.residual[fitted.used] / noise
        jacobian = fitted.jacobian / noise.ravel()[:, None]
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        jacobian = jacobian / scale
        shaped = jacobian.reshape(*values.shape, -1)
        t_s = fitted.t_s[fitted.used]
        process = random_uncertainty(t_s, values, shaped, inverse_normal(jacobian)).noise
        basis, triangle = np.linalg.qr(jacobian)
        solve = np.linalg.pinv(triangle, rcond=SINGULAR) / scale[:, None]
        unit = fitted.model.observed[0].unit
        return cls(t_s, values, basis, solve, tuple(fitted.free), process, stated / noise, unit)

    @property
    def total(self) -> float:
        """Sum of squares."""
        return max(float(np.sum(self.values**2)), 1e-300)

    def direction(self, effect: str, shape: tuple[float, ...], sensitivity: Array) -> _Direction:
        """Of an effect's sensitivity (n, d) in one shape; of length 0 where the parameters can imitate it."""
        along = sensitivity.ravel()
        imitated = self.basis.T @ along
        left = along - self.basis @ imitated
        length = float(np.linalg.norm(left))
        if not np.isfinite(length) or length <= HIDDEN * float(np.linalg.norm(along)):
            return _Direction(effect, shape, np.zeros_like(along), 0.0, 0.0, np.zeros(len(self.free)))
        unit = left / length
        return _Direction(effect, shape, unit, length, float(unit @ self.values.ravel()), -self.solve @ imitated)

    def score(self, effect: Effect, directions: Sequence[_Direction], tried: int) -> Score:
        """The score of an effect in the shape that explains most; of NaN where it cannot be seen in any."""
        unit = effect.parameters[0].unit.replace("{x}", self.unit)
        hidden = Score(effect.name, np.nan, np.nan, unit, 0.0, self.total, 0.0, tried=tried)
        if not directions:
            return hidden
        best = max(directions, key=lambda one: abs(one.along))
        gain = min(best.along**2 / self.total, 1.0)
        degrees = max(best.unit.size - self.basis.shape[1] - 1, 1)
        return replace(
            hidden,
            size=best.along / best.length,
            stderr=float(np.sqrt(self.variance_along(best.unit))) / best.length,
            gain=gain,
            chi2=degrees * gain / max(1.0 - gain, 1e-12),
            degrees=degrees,
            shape=best.shape,
            stands_out=stands_out_from(best.length * best.unit.reshape(self.values.shape), self.stated),
            shifts=dict(zip(self.free, best.shifts.tolist(), strict=True)),
        )

    def variance_along(self, direction: Array) -> float:
        """Variance of the residual's component along a unit vector (n * d,): 1 for white noise of sigma."""
        positions = grid_positions(self.t_s)
        shaped = direction.reshape(self.values.shape)
        parts = [
            middle(on_grid(positions, shaped[:, [k]], 0.0), process.coefficients)[0, 0] * process.innovation_sd**2
            for k, process in enumerate(self.process)
        ]
        return float(sum(parts))


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Two effects in the shapes in which they explain most together, and their sizes to first order.

    ``gain`` is the part of the residual's sum of squares that they would take away, in units of the noise.
    """

    gain: float
    sizes: tuple[float, float]
    shapes: tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True, eq=False, slots=True)
class Screen:
    """What every effect, in every shape tried, would explain of one clip's residual.

    ``scores`` by effect are those of its best shape. Of the m effects and shapes that the parameters cannot imitate:
    ``effects`` their names, ``shapes``, ``directions`` (m, n * d) s' of unit length, ``lengths`` (m,) of s', and
    ``along`` (m,) the residual's components.
    """

    scores: Mapping[str, Score]
    effects: tuple[str, ...]
    shapes: tuple[tuple[float, ...], ...]
    directions: Array
    lengths: Array
    along: Array

    @property
    def visible(self) -> frozenset[str]:
        """The effects that the fitted parameters cannot imitate."""
        return frozenset(self.effects)

    def cosine(self, one: str, other: str) -> float:
        """Between two effects in their best shapes; 0 where one of them cannot be seen."""
        if not {one, other} <= self.visible:
            return 0.0
        return float(self.directions[self._best(one)] @ self.directions[self._best(other)])

    def _best(self, name: str) -> int:
        return max(self._rows(name), key=lambda k: abs(self.along[k]))

    def _rows(self, name: str) -> list[int]:
        return [k for k, effect in enumerate(self.effects) if effect == name]

    def pairs(self, names: Collection[str]) -> dict[tuple[str, str], Pair]:
        """The best of each pair of these effects; none where they are alike in every shape."""
        rows = {name: self._rows(name) for name in sorted(self.visible & set(names))}
        if self.directions.size > MOST_NUMBERS:
            rows = {name: [self._best(name)] for name in rows}
        found = {pair: self._pair(rows[pair[0]], rows[pair[1]]) for pair in combinations(rows, 2)}
        return {names: pair for names, pair in found.items() if pair is not None}

    def _pair(self, rows: Sequence[int], columns: Sequence[int]) -> Pair | None:
        cosine = self.directions[rows] @ self.directions[columns].T
        first, second = self.along[rows][:, None], self.along[columns][None, :]
        apart = 1.0 - cosine**2
        if not np.any(apart > 1.0 - ALIKE**2):
            return None
        apart = np.where(apart > 1.0 - ALIKE**2, apart, np.inf)
        gain = (first**2 + second**2 - 2 * cosine * first * second) / apart
        i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
        shares = np.array([first[i, 0] - cosine[i, j] * second[0, j], second[0, j] - cosine[i, j] * first[i, 0]])
        k, m = rows[int(i)], columns[int(j)]
        sizes = shares / apart[i, j] / self.lengths[[k, m]]
        return Pair(float(gain[i, j]), (float(sizes[0]), float(sizes[1])), (self.shapes[k], self.shapes[m]))


def screen(effects: Sequence[Effect], fitted: FitResult, trajectory: Trajectory) -> Screen:
    """Score each effect against the residual of a fit.

    Parameters
    ----------
    effects
        All apply to the fitted model.
    fitted
        The model without them.
    trajectory
        What it was fitted to.
    """
    noise = unit_noise(fitted, trajectory)[fitted.used]
    residual = _Residual.of(fitted, noise, stated_errors(fitted, trajectory)[fitted.used])
    forces = any(effect.acceleration is not None for effect in effects)
    motion = motion_of(fitted, trajectory) if forces else None
    seen = (fitted.predicted + fitted.residual)[fitted.used]
    scores, rows = {}, []
    for effect in effects:
        shapes = list(effect.trials(residual.t_s, seen)) if effect.trials is not None else [()]
        seen_in = partial(_direction_of, effect, residual, noise, fitted, trajectory, motion)
        visible = _visible(effect, shapes, residual.t_s, seen_in)
        rows += visible
        tried = len(shapes) if effect.nearby is None else residual.t_s.size  # the best of all, wherever it began
        scores[effect.name] = residual.score(effect, visible, tried)
    return Screen(
        scores,
        tuple(one.effect for one in rows),
        tuple(one.shape for one in rows),
        np.array([one.unit for one in rows]).reshape(len(rows), residual.values.size),
        np.array([one.length for one in rows]),
        np.array([one.along for one in rows]),
    )


def _direction_of(
    effect: Effect,
    residual: _Residual,
    noise: Array,
    fitted: FitResult,
    trajectory: Trajectory,
    motion: Motion | None,
    shape: tuple[float, ...],
) -> _Direction:
    along = sensitivity(shaped(effect, shape), fitted, trajectory, motion) / noise
    return residual.direction(effect.name, shape, along)


def _visible(
    effect: Effect, shapes: Sequence[tuple[float, ...]], t_s: Array, seen_in: Callable[[tuple[float, ...]], _Direction]
) -> list[_Direction]:
    """The shapes that can be seen, and those near the best of them as long as one of these explains more."""
    found = [one for one in map(seen_in, shapes) if one.length > 0]
    best = max(found, key=lambda one: abs(one.along), default=None)
    while effect.trials is not None and effect.nearby is not None and best is not None:
        around = [one for one in map(seen_in, effect.nearby(t_s, best.shape)) if one.length > 0]
        found += around
        before, best = best, max([best, *around], key=lambda one: abs(one.along))
        if best is before:
            break
    return found


def shaped(effect: Effect, shape: Sequence[float]) -> Effect:
    """The effect with other values of its parameters after the first as their defaults; as it is when there are none.

    Parameters
    ----------
    effect
        The effect.
    shape
        As many values as parameters after the first, or none.
    """
    if not shape:
        return effect
    size, *rest = effect.parameters
    changed = (replace(one, default=value) for one, value in zip(rest, shape, strict=True))
    return replace(effect, parameters=(size, *changed))


def significant_from(share: float, tries: int) -> float:
    """Standard errors from which a size differs from zero at the level ``share``, two-sided, in so many tries."""
    return float(norm.isf(share / 2 / tries))


def combined(scores: Sequence[Score]) -> Score:
    """One effect's scores in several clips, as of one effect of one size; the only one, where there is but one."""
    first = scores[0]
    if len(scores) == 1:
        return first
    weights = np.array([1.0 / one.stderr**2 if one.stderr > 0 else 0.0 for one in scores])
    total = sum(one.total for one in scores)
    gain = sum(one.gain * one.total for one in scores) / total
    chi2, least = sum(one.chi2 for one in scores), min(one.stands_out for one in scores)
    together = replace(first, size=np.nan, stderr=np.nan, gain=gain, total=total, chi2=chi2, stands_out=least)
    if not weights.sum() > 0:
        return together
    size = float(np.sum(weights * np.nan_to_num([one.size for one in scores])) / weights.sum())
    return replace(together, size=size, stderr=float(weights.sum() ** -0.5))
