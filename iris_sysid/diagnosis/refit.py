"""Refits of every clip with effects added, and how well each such model does on what it was and was not fitted to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from fitters.compose_effects import with_effect
from fitters.noise.random_effects import random_effects
from fitters.noise.sandwich_covariance import inverse_normal
from fitters.ode import fit, simulate
from iris_sysid.diagnosis.measurement_errors import unit_noise
from iris_sysid.diagnosis.score_test import shaped
from iris_sysid.types import Array, Effect, Estimate, FitResult, Mask, OdeModel, Trajectory

SAMPLES_A_VALUE = 2  # that a fit must have when others are held out
MOST_MOVES = 4  # of an effect's shape to a better one nearby
HIGHEST = 0.95  # correlation from sample to sample that is allowed for


@dataclass(frozen=True, eq=False, slots=True)
class Errors:
    """Root mean square of the residual, in the observed unit: over what was fitted, and over what was held out.

    Held out is the end of each clip, after a fit to its beginning; of several clips, also the size of every effect
    added, which then comes from the other clips. ``weighed`` is that of what was held out, in units of each sample's
    noise.
    """

    fitted: float
    heldout: float
    weighed: float


@dataclass(frozen=True, eq=False, slots=True)
class Clip:
    """What is asked of one clip: the same for every refit."""

    trajectory: Trajectory
    fixed: Mapping[str, float | Estimate]
    free: Sequence[str]

    def refit(self, model: OdeModel, start: Mapping[str, float] | None = None) -> FitResult:
        """Fit a model, straight down from ``start`` where there is one."""
        begin = start or {}
        return fit(self.trajectory, model, fixed=self.fixed, free=self.free, start=begin, nearby=bool(begin))

    def with_open_geometry(self, model: OdeModel) -> tuple[Clip, FitResult]:
        """The same question with the geometry that was measured with an error left open, where the data fix it.

        And the model's fit to the clip, so asked. Without a default it is no part of the motion, e.g. a board's angle.
        """
        measured, own = self.trajectory.geometry, [one for one in model.parameters if one.default is not None]
        names = [one.name for one in own if one.constant and one.name in measured]
        unsure = [name for name in names if measured[name].stderr > 0 and name not in {*self.fixed, *self.free}]
        wider = replace(self, free=[*self.free, *unsure])
        fitted = wider.refit(model)
        return (wider, fitted) if not unsure or fitted.status in ("ok", "misfit") else (self, self.refit(model))


@dataclass(frozen=True, eq=False, slots=True)
class State:
    """The fits of all clips with the effects added so far; ``units`` (n, d) of the residuals, one a clip."""

    fits: tuple[FitResult, ...]
    units: tuple[Array, ...]
    effects: tuple[Effect, ...] = field(default=())

    @classmethod
    def without_effects(cls, clips: Sequence[Clip], fits: Sequence[FitResult]) -> State:
        """The state of the model as it is, whose units are those of all that follow."""
        units = [unit_noise(fit, clip.trajectory) for fit, clip in zip(fits, clips, strict=True)]
        return cls(tuple(fits), tuple(units))

    @property
    def usable(self) -> bool:
        """Whether every clip has estimates."""
        return all(one.usable for one in self.fits)

    @property
    def cost(self) -> float:
        """Sum of squares of what is left over, in units of the noise, and as much a free value as it is worth (BIC)."""
        squares = sum(_sum_of_squares(*one, one[0].used) for one in zip(self.fits, self.units, strict=True))
        return squares + sum(len(one.free) * float(np.log(one.n * len(one.rms))) for one in self.fits)

    @property
    def margin(self) -> float:
        """Cost that tells two states apart: twice the log of 20 : 1, more as correlation thins out the samples."""
        correlation = max(min(abs(one.correlation), HIGHEST) for one in self.fits)
        return float(2 * np.log(20.0) * (1 + correlation) / (1 - correlation))

    @property
    def independent(self) -> float:
        """How many independent samples these are worth: correlation thins them out."""
        each = [(one.n * len(one.rms), min(abs(one.correlation), HIGHEST)) for one in self.fits]
        return float(sum(samples * (1.0 - rho) / (1.0 + rho) for samples, rho in each))

    @property
    def names(self) -> frozenset[str]:
        """Of the effects."""
        return frozenset(one.name for one in self.effects)

    @property
    def sizes(self) -> tuple[str, ...]:
        """Names of the effects' parameters."""
        return tuple(parameter.name for effect in self.effects for parameter in effect.parameters)


# of effects by name: the first size, then the values of their other parameters (or none, for their defaults)
Starts = Mapping[str, tuple[float, tuple[float, ...]]]


def refitted(
    clips: Sequence[Clip], current: State, model: OdeModel, effects: Sequence[Effect], starts: Sequence[Starts]
) -> State:
    """Every clip's fit of the model with these effects, going on from where its present fit is.

    Parameters
    ----------
    clips
        What is asked of each.
    current
        The fits that give the starting values of all that they share with the new ones.
    model
        Without effects.
    effects
        All that are to be added, in order.
    starts
        One a clip: of effects that are new, the size and the shape to begin with.
    """
    each = zip(clips, current.fits, starts, current.units, strict=True)
    return State(tuple(_refitted(*one, model, effects) for one in each), current.units, tuple(effects))


def _refitted(
    clip: Clip, fitted: FitResult, start: Starts, unit: Array, model: OdeModel, effects: Sequence[Effect]
) -> FitResult:
    """One clip's fit, with each effect whose shape is chosen in the best of those around the one it begins with."""
    found = _fit_from(clip, {**_estimates(fitted), **_values(effects, start)}, fitted.free, model, effects)
    for effect in effects:
        for _ in range(MOST_MOVES):
            values = _in_better_shape(effect, clip, found, unit)
            again = _fit_from(clip, values, fitted.free, model, effects) if values else found
            if not again.usable or _misfit(clip, again, unit) >= _misfit(clip, found, unit):
                break
            found = again
    return found


def _fit_from(
    clip: Clip, values: Mapping[str, float], free: Sequence[str], model: OdeModel, effects: Sequence[Effect]
) -> FitResult:
    """The fit of the model with effects, going on from these values, with what was free before free."""
    own = model
    for effect in effects:
        own = with_effect(own, shaped(effect, [values[one.name] for one in effect.parameters[1:]]))
    open_now = {one.name for one in own.parameters if not one.constant} | {*free, *clip.free}
    own_names = {one.name for one in own.parameters} | {f"{one.name}_0" for one in own.states}
    begin = {name: values[name] for name in open_now & own_names if name in values and name not in clip.fixed}
    return clip.refit(own, begin)


def _in_better_shape(effect: Effect, clip: Clip, found: FitResult, unit: Array) -> dict[str, float]:
    """The values of a fit with the effect in the shape nearby that fits best, all else the same; none if it does."""
    if effect.nearby is None or not found.usable:
        return {}
    values, names = _estimates(found), [one.name for one in effect.parameters[1:]]
    shapes = effect.nearby(found.t_s[found.used], tuple(values[name] for name in names))
    others = [{**values, **dict(zip(names, shape, strict=True))} for shape in shapes]
    left = [_misfit(clip, found, unit, one) for one in [values, *others]]
    best = int(np.argmin(left))
    return others[best - 1] if best else {}


def _misfit(clip: Clip, fitted: FitResult, unit: Array, values: Mapping[str, float] | None = None) -> float:
    """Sum of squares of what the model leaves of all samples, also of those that the fit took for wild.

    With other values where they are given.
    """
    used = np.flatnonzero(fitted.used)
    stop, trajectory = int(used[-1]) + 1, clip.trajectory
    predicted = _prediction_of(clip, fitted, values or _estimates(fitted), stop)
    seen = trajectory.position[:stop, [trajectory.column(one.name) for one in fitted.model.observed]]
    inside = trajectory.valid[:stop] & (np.arange(stop) >= used[0])
    return float(np.nansum(((seen - predicted) / unit[:stop])[inside] ** 2))


def _estimates(fitted: FitResult) -> dict[str, float]:
    return {name: one.value for name, one in fitted.estimates.items()}


def _values(effects: Sequence[Effect], start: Starts) -> dict[str, float]:
    values: dict[str, float] = {}
    for effect in effects:
        if effect.name in start:
            size, shape = start[effect.name]
            first, *others = effect.parameters
            values[first.name] = float(np.nan_to_num(size))
            given = shape or [one.default or 0.0 for one in others]
            values |= {one.name: value for one, value in zip(others, given, strict=True)}
    return values


def standard_errors(before: State, after: State, effects: Sequence[Effect]) -> float:
    """How sure it is that the effects between two fits are there, as standard errors of a single normal number.

    Of one clip, the root of what the fit gains by them, in units of the noise that is left, thinned as that noise is
    correlated along them: unlike a size over its standard error, this also holds where an effect has a shape that
    the data hardly fix. Of several clips and one effect, its mean size over its standard error, scatter between the
    clips included.
    """
    if len(after.fits) > 1:
        sizes = [pooled(sizes_of(after.fits, one.parameters[0].name)) for one in effects]
        return float(min(abs(one.value) / one.stderr for one in sizes))
    first, second, unit = before.fits[0], after.fits[0], after.units[0]
    both = first.used & second.used
    left = _sum_of_squares(second, unit, both)
    degrees = max(int(both.sum()) * len(second.rms) - len(second.free), 1)
    gain = max(_sum_of_squares(first, unit, both) - left, 0.0) * degrees / max(left, 1e-300)
    inflation = max(_inflation(second, unit, one.parameters[0].name) for one in effects)
    if len(effects) == 1:
        return float(norm.isf(student.sf(np.sqrt(gain / inflation), degrees)))
    return float(np.sqrt(gain / inflation))


def _inflation(fitted: FitResult, unit: Array, name: str) -> float:
    """Variance of a value over what it would be for white noise of the same size."""
    k = fitted.free.index(name)
    noise = unit[fitted.used].ravel()
    white = inverse_normal(fitted.jacobian / noise[:, None], 1e-9)[k, k]
    degrees = max(noise.size - len(fitted.free), 1)
    ratio = fitted.covariance[k, k] / (white * _sum_of_squares(fitted, unit, fitted.used) / degrees)
    return float(ratio) if np.isfinite(ratio) and ratio > 0 else float("inf")


def _sum_of_squares(fitted: FitResult, unit: Array, samples: Mask) -> float:
    return float(np.nansum((fitted.residual[samples] / unit[samples]) ** 2))


def sizes_of(fits: Sequence[FitResult], name: str) -> list[Estimate]:
    """A value's estimates in all clips."""
    return [one.estimates[name] for one in fits]


def pooled(sizes: Sequence[Estimate]) -> Estimate:
    """Mean of estimates of one size in independent clips, with the scatter between them in its standard error.

    The only one, where there is but one. Estimates without a standard error are left out.
    """
    known = [one for one in sizes if one.stderr > 0]
    if len(known) < 2:
        return known[0] if known else sizes[0]
    values, stderrs = np.array([one.value for one in known]), np.array([one.stderr for one in known])
    return random_effects(values, stderrs, known[0].unit).mean


def errors_of(clips: Sequence[Clip], state: State, holdout: float, parts: int = 1) -> Errors:
    """The error over the samples fitted, and over those held out; NaN where a clip has none to spare.

    Parameters
    ----------
    clips
        What was asked of each.
    state
        Their fits; the sizes of its effects come from the other clips where there are any.
    holdout
        Share of each part of a clip, at its end, that is held out.
    parts
        Into how many parts a clip is cut; 1 holds out its end only.
    """
    fits, later, weighed = state.fits, [], []
    for k, (clip, fitted, unit) in enumerate(zip(clips, fits, state.units, strict=True)):
        others = [one for j, one in enumerate(fits) if j != k]
        shared = [one.parameters[0].name for one in state.effects] if others else []  # moments are each clip's own
        given = {name: pooled(sizes_of(others, name)).value for name in shared}
        at, wrong = _prediction_error(replace(clip, fixed={**clip.fixed, **given}), fitted, holdout, parts)
        later.append(wrong.ravel())
        weighed.append((wrong / unit[at]).ravel())
    inside = np.concatenate([one.residual[one.used].ravel() for one in fits])
    return Errors(_rms(inside), _rms(np.concatenate(later)), _rms(np.concatenate(weighed)))


def _rms(values: Array) -> float:
    with np.errstate(over="ignore"):  # a prediction that runs away is infinitely wrong
        return float(np.sqrt(np.mean(values**2)))


def _prediction_error(clip: Clip, fitted: FitResult, holdout: float, parts: int) -> tuple[NDArray[np.intp], Array]:
    """The last samples (m,) of each part, and observed - predicted (m, d) there after a fit to the others.

    One sample and NaN where none can be held out.
    """
    unknown = np.zeros(1, dtype=np.intp), np.full((1, fitted.residual.shape[1]), np.nan)
    used = np.flatnonzero(fitted.used)
    later = used[(np.arange(len(used)) * parts / len(used)) % 1.0 >= 1.0 - holdout]
    if len(used) - len(later) < SAMPLES_A_VALUE * len(fitted.free) or len(later) == 0:
        return unknown
    trajectory = clip.trajectory
    kept = trajectory.valid.copy()
    kept[later] = False
    start = {name: fitted.estimates[name].value for name in fitted.free if name not in clip.fixed}
    part = replace(clip, trajectory=trajectory.with_(valid=kept)).refit(fitted.model, start)
    if not part.usable:
        return unknown
    later = later[later >= int(np.searchsorted(trajectory.t_s, part.t0_s))]
    columns = [trajectory.column(quantity.name) for quantity in fitted.model.observed]
    predicted = _prediction_of(clip, part, _estimates(part), used[-1] + 1)
    return later, np.asarray(trajectory.position[later][:, columns] - predicted[later])


def _prediction_of(clip: Clip, fitted: FitResult, values: Mapping[str, float], stop: int) -> Array:
    """What the model of a fit predicts with these values for the first samples (stop, d), NaN before it begins."""
    trajectory = clip.trajectory
    begin = int(np.searchsorted(trajectory.t_s, fitted.t0_s))
    known = trajectory.inputs[begin:stop] if trajectory.inputs is not None else None
    _, predicted = simulate(fitted.model, trajectory.t_s[begin:stop], values, inputs=known)
    return np.concatenate([np.full((begin, predicted.shape[1]), np.nan), predicted])
