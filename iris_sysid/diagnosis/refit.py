"""Refits of every clip with effects added, their cost, and how significant the effects between two refits are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitters.compose_effects import in_order, with_effect
from fitters.effect_sensitivity import shaped
from fitters.image_effects import view_of
from fitters.noise.sandwich_covariance import inverse_normal
from fitters.ode import FitRequest, solve
from fitters.ode.simulation import predicted_by
from fitters.ode.weak_fit import weak_fit
from iris_sysid.diagnosis.measurement_errors import observed_columns, unit_noise
from iris_sysid.diagnosis.score_test import common_size
from iris_sysid.errors import FitError
from iris_sysid.types import (
    Array,
    Effect,
    Estimate,
    FitResult,
    Mask,
    OdeModel,
    Parameter,
    Trajectory,
    normal_isf,
    student_sf,
)

MAX_HALVINGS = 6  # of a size to first order
MAX_MOVES = 4  # steps from an effect's shape to a better one nearby
ACCURATE = 1e-6  # error of a predicted state from its time step, relative: far below the noise of any sensor
LOST = 0.5  # of the squares, below which another start shows that a fit had lost its way
MATERIAL = 0.01  # of the squares, by which a better form of an effect reduces them
FAR_OFF, AT_NOISE = 10.0, 1.1  # residual over noise
COMPLETE = 1.3  # residual / noise up to which effects explain the data: of correlated noise the estimate is that unsure
BODY = ("mass", "radius", "length")  # values that a clip may state
HIGHEST = 0.95  # largest lag-1 correlation that is allowed for
DETERMINED = ("ok", "misfit")  # statuses of a fit whose free values the data determine


def with_free_geometry(clip: FitRequest) -> tuple[FitRequest, FitResult]:
    """Free the uncertain geometry of a clip, with what was measured as its prior; return that request and its fit.

    Without the prior the pivot or the vertical would move to where no effect is missing. A constant without a default
    is not part of the motion, e.g. the angle of a board, and stays fixed; so does all geometry if the fit fails.

    Parameters
    ----------
    clip
        The model without effects.
    """
    measured, chosen = clip.trajectory.geometry, {*clip.fixed, *clip.free}
    constants = [
        parameter.name for parameter in clip.model.parameters if parameter.constant and parameter.default is not None
    ]
    unsure = {
        name: measured[name]
        for name in constants
        if name in measured and 0 < measured[name].stderr < np.inf and name not in chosen
    }
    freed = clip.with_(fixed={**clip.fixed, **unsure}, free=[*clip.free, *unsure])
    fitted = solve(freed)
    return (freed, fitted) if not unsure or fitted.status in DETERMINED else (clip, solve(clip))


def fit_from(clip: FitRequest, model: OdeModel, start: Mapping[str, float]) -> FitResult:
    """Fit another model to a clip; a local fit from the values of ``start``, where there are any."""
    request = clip.with_(model=model)
    return solve(request.from_near(start) if start else request)


def with_values(
    clip: FitRequest, fitted: FitResult, values: Mapping[str, tuple[float, float]], *, free: bool = False
) -> FitResult:
    """The fit of a clip with values known from elsewhere and their standard errors: its start alone, or all of them.

    Parameters
    ----------
    clip
        What is known of it otherwise is held.
    fitted
        A fit of the model, from whose start it begins.
    values
        By name, each with its standard error.
    free
        Whether they are a prior, and fitted as well.
    """
    known = {
        name: replace(fitted.estimates[name], value=value, stderr=error, ci95=None)
        for name, (value, error) in values.items()
    }
    start = {name: fitted.estimates[name].value for name in fitted.model.initial_names}
    request = clip.with_(model=fitted.model, fixed={**clip.fixed, **known}, free=[*known] if free else [])
    return solve(request.from_near(start))


def forms(effect: Effect) -> tuple[str, ...]:
    """Names of the parameters that hold the form of an effect, an exponent or a width."""
    return tuple(parameter.name for parameter in effect.parameters if parameter.role == "form")


def fitted_forms(effect: Effect) -> tuple[str, ...]:
    """Those of :func:`forms` that are fitted."""
    return tuple(name for name in forms(effect) if not _parameter(effect, name).constant)


def with_free_form(effect: Effect) -> Effect:
    """The effect with its form fitted as well."""
    free = [replace(each, constant=False) if each.role == "form" else each for each in effect.parameters]
    return replace(effect, parameters=tuple(free))


def _parameter(effect: Effect, name: str) -> Parameter:
    return next(parameter for parameter in effect.parameters if parameter.name == name)


@dataclass(frozen=True, eq=False, slots=True)
class ModelWithEffects:
    """The model with some effects, fitted to all clips; ``units`` (n, d) of the residuals, one a clip.

    ``bodies`` are the factors on mass, radius and cord length of each clip's body over the first one's, where they
    were stated and differ; empty otherwise.
    """

    fits: tuple[FitResult, ...]
    units: tuple[Array, ...]
    effects: tuple[Effect, ...] = field(default=())
    bodies: tuple[Mapping[str, float], ...] = field(default=())

    @classmethod
    def without_effects(cls, clips: Sequence[FitRequest], fits: Sequence[FitResult]) -> ModelWithEffects:
        """The model without effects; its noise is the unit of the residuals of all later models."""
        units = [unit_noise(fitted, clip.trajectory) for fitted, clip in zip(fits, clips, strict=True)]
        return cls(tuple(fits), tuple(units), bodies=_bodies([clip.trajectory for clip in clips]))

    @property
    def usable(self) -> bool:
        """Whether every clip has estimates."""
        return all(fitted.usable for fitted in self.fits)

    @property
    def squares(self) -> float:
        """Sum of squares of the residuals and of what the priors miss, in units of the noise."""
        return sum(
            _sum_of_squares(fitted, unit, fitted.used) + _prior_squares(fitted)
            for fitted, unit in zip(self.fits, self.units, strict=True)
        )

    def factors(self, effect: Effect) -> list[float]:
        """The factor on the size of an effect in each clip over that in the first; 1 where it is not known."""
        return [effect.factor(body) or 1.0 for body in self.bodies] or [1.0] * len(self.fits)

    def sizes_of(self, name: str) -> list[Estimate]:
        """The estimates of one value in all clips; the size of an effect as the first clip has it."""
        found = [fitted.estimates[name] for fitted in self.fits]
        effect = next((each for each in self.effects if each.parameters[0].name == name), None)
        return found if effect is None else list(map(_over, found, self.factors(effect)))

    @property
    def disagreement(self) -> float:
        """Chi-square by which sizes differ where it is stated how they go with the body, less the price of each.

        Only where clips have different bodies. The price is that of a free value in the criterion.
        """
        count = float(np.log(max(min(fitted.n for fitted in self.fits), 2)))
        known = [effect for effect in self.effects if effect.recurrence == "always" and effect.image is None]
        shared = [effect for effect in known if self.bodies and None not in map(effect.factor, self.bodies)]
        return sum(_scatter(self.sizes_of(effect.parameters[0].name)) for effect in shared) - (
            len(shared) * (len(self.fits) - 1) * count
        )

    @property
    def far_off(self) -> bool:
        """Whether the residual is so far above the noise that first-order tests along this motion say little."""
        return self.squares > self._squares_at(FAR_OFF)

    @property
    def at_noise(self) -> bool:
        """Whether nothing of the residual is left beside the noise, which is known to a few per cent."""
        return self.squares <= self._squares_at(AT_NOISE)

    @property
    def explains(self) -> bool:
        """Whether the residual is as small as the noise, as far as the size of that is known."""
        return self.squares <= self._squares_at(COMPLETE)

    def _squares_at(self, ratio: float) -> float:
        """The sum of squares of a residual of ``ratio`` times the noise."""
        return ratio**2 * sum(fitted.n * len(fitted.rms) for fitted in self.fits)

    @property
    def independent(self) -> float:
        """Effective number of independent samples, from the lag-1 correlation of the residual."""
        counts = [(fitted.n * len(fitted.rms), min(abs(fitted.correlation), HIGHEST)) for fitted in self.fits]
        return float(sum(samples * (1.0 - rho) / (1.0 + rho) for samples, rho in counts))

    @property
    def inflation(self) -> float:
        """Variance of slow sums of the residual over that for white noise, by its lag-1 correlation; at least 1."""
        correlation = max(max(min(fitted.correlation, HIGHEST) for fitted in self.fits), 0.0)
        return (1.0 + correlation) / (1.0 - correlation)

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(effect.name for effect in self.effects)

    @property
    def key(self) -> frozenset[str]:
        """Names of the effects, and of the parameters of their form that are fitted: no two models have the same."""
        return self.names | {name for effect in self.effects for name in fitted_forms(effect)}

    @property
    def names_in_order(self) -> tuple[str, ...]:
        """Names of the effects in the order in which they were added."""
        return tuple(effect.name for effect in self.effects)

    @property
    def sizes(self) -> tuple[str, ...]:
        """Names of the effects' parameters."""
        return tuple(parameter.name for effect in self.effects for parameter in effect.parameters)


# by effect name: the first size, then the values of the effect's other parameters (none: their defaults)
Starts = Mapping[str, tuple[float, tuple[float, ...]]]


def refitted(
    clips: Sequence[FitRequest],
    current: ModelWithEffects,
    model: OdeModel,
    effects: Sequence[Effect],
    starts: Sequence[Starts],
) -> ModelWithEffects:
    """Fit the model with these effects to every clip, starting from its present fit.

    Parameters
    ----------
    clips
        The fit requests, one a clip, with their fixed and free values.
    current
        The fits that give the starting values of the parameters that they share with the new ones.
    model
        Without effects.
    effects
        All effects to add, in order.
    starts
        One a clip: of effects that are new, the size and the shape to begin with.
    """
    each_clip = zip(clips, current.fits, starts, current.units, strict=True)
    fits = tuple(_refitted(clip, fitted, start, unit, model, effects) for clip, fitted, start, unit in each_clip)
    return ModelWithEffects(fits, current.units, tuple(effects), current.bodies)


def _refitted(
    clip: FitRequest, fitted: FitResult, start: Starts, unit: Array, model: OdeModel, effects: Sequence[Effect]
) -> FitResult:
    """One clip's fit; an effect whose shape is chosen and not fitted gets the best shape near its starting shape."""
    values, weak = _nearest_start(clip, fitted, start, unit, model, effects)
    best = _fit_from(clip, values, fitted.free, model, effects)
    held = {} if weak else _with_shapes_held(clip, fitted, start, values, model, effects)
    if held:
        found = _fit_from(clip, {**values, **held}, fitted.free, model, effects)
        best = found if _left(clip, found, unit) < LOST * _left(clip, best, unit) else best
    if len(effects) == 1 and not weak:
        misfit = _left(clip, best, unit)
        if misfit > FAR_OFF**2 * fitted.n * len(fitted.rms):
            grown = _fit_from(clip, values, fitted.free, model, effects, growing=True)
            best = grown if _left(clip, grown, unit) < misfit else best
    for effect in effects:
        moves = MAX_MOVES if effect.is_placed else int(effect.name in start)
        for _ in range(moves):
            values = _in_better_shape(effect, clip, best, unit)
            if not values:
                break
            moved = _fit_from(clip, values, fitted.free, model, effects)
            least = 0.0 if effect.is_placed else MATERIAL
            if _left(clip, moved, unit) >= (1.0 - least) * _left(clip, best, unit):
                break
            best = moved
    return best


def _with_shapes_held(
    clip: FitRequest,
    fitted: FitResult,
    start: Starts,
    values: Mapping[str, float],
    model: OdeModel,
    effects: Sequence[Effect],
) -> dict[str, float]:
    """The free values of a fit that holds the shapes of new effects whose size was halved; none where there are none.

    Beside a size near zero a shape is not determined, and the first step of a fit of both leads anywhere.
    """
    sizes = {name: abs(size) for name, (size, _) in start.items()}
    new = [effect for effect in effects if abs(values[effect.parameters[0].name]) < sizes.get(effect.name, 0.0)]
    fixed = {each.name: values[each.name] for effect in new for each in effect.parameters[1:] if not each.constant}
    if not fixed:
        return {}
    sized = _fit_from(clip.with_(fixed={**clip.fixed, **fixed}), values, fitted.free, model, effects)
    return free_values(sized) if sized.usable else {}


def _nearest_start(
    clip: FitRequest, fitted: FitResult, start: Starts, unit: Array, model: OdeModel, effects: Sequence[Effect]
) -> tuple[dict[str, float], bool]:
    """Of the present values and those of the weak form the ones whose free run is nearer; whether there were both."""
    values = _no_worse(clip, fitted, start, unit, model, effects)
    if not model.inputs:
        return values, False
    composed = composed_model(clip, values, model, effects)
    request = weak_request(clip, composed, values)
    found = weak_fit(request)
    if found is None:
        return values, False
    whole = replace(fitted, model=composed)
    nearer = _misfit(clip, whole, unit, found.values) < _misfit(clip, whole, unit, request.start)
    return (dict(found.values) if nearer else values), True


def weak_request(clip: FitRequest, composed: OdeModel, values: Mapping[str, float]) -> FitRequest:
    """The request to fit a model with effects, in place of the one of a clip, from these values.

    Parameters
    ----------
    clip
        What is known of it is held.
    composed
        The model with effects.
    values
        By name; those that the model has not are left out.
    """
    names = {parameter.name for parameter in composed.parameters} | set(composed.initial_names)
    return clip.with_(model=composed, start={name: value for name, value in values.items() if name in names})


def _no_worse(
    clip: FitRequest, fitted: FitResult, start: Starts, unit: Array, model: OdeModel, effects: Sequence[Effect]
) -> dict[str, float]:
    """Starting values from which a fit only has to improve: with the new sizes, halved until none adds to the residual.

    A size to first order goes with changes of all other values, without which it can lead the motion out of phase.
    """
    values = {**estimate_values(fitted), **_values(effects, start)}
    sizes = [effect.parameters[0].name for effect in effects if effect.name in start]
    if not sizes:
        return values
    whole = replace(fitted, model=composed_model(clip, values, model, effects))
    without = _misfit(clip, whole, unit, {**values, **dict.fromkeys(sizes, 0.0)})
    for _ in range(MAX_HALVINGS):
        if _misfit(clip, whole, unit, values) <= without:
            break
        values |= {name: values[name] / 2 for name in sizes}
    return values


def composed_model(
    clip: FitRequest, values: Mapping[str, float], model: OdeModel, effects: Sequence[Effect]
) -> OdeModel:
    """The model with effects, in the shapes that ``values`` give them by name.

    Parameters
    ----------
    clip
        Its view of the motion is that of effects of the camera.
    values
        Of the effects' parameters.
    model, effects
        What is composed.
    """
    composed = model
    for effect in in_order(effects, model):
        variant = shaped(effect, [values[parameter.name] for parameter in effect.parameters[1:]])
        composed = with_effect(composed, variant, view_of(clip.trajectory, model))
    return composed


def _fit_from(
    clip: FitRequest,
    values: Mapping[str, float],
    free: Sequence[str],
    model: OdeModel,
    effects: Sequence[Effect],
    *,
    growing: bool = False,
) -> FitResult:
    """The fit of the model with effects from these starting values; free constants stay free.

    ``growing`` fits the first samples first: slower, and it finds a minimum that is farther away.
    """
    composed = composed_model(clip, values, model, effects)
    free_now = {parameter.name for parameter in composed.parameters if not parameter.constant} | {*free, *clip.free}
    names = {parameter.name for parameter in composed.parameters} | set(composed.initial_names)
    held = {*clip.fixed} - {*clip.free}  # a name in both has a prior
    start = {name: values[name] for name in free_now & names if name in values and name not in held}
    if growing:
        clip = clip.with_(options=replace(clip.options, growing=True))
    return fit_from(clip, composed, start)


def _in_better_shape(effect: Effect, clip: FitRequest, fitted: FitResult, unit: Array) -> dict[str, float]:
    """The values of a fit with the effect in the best nearby shape; none where the present shape fits best."""
    if effect.nearby is None or not fitted.usable:
        return {}
    values, names = estimate_values(fitted), [parameter.name for parameter in effect.parameters[1:]]
    shapes = effect.nearby(fitted.t_s[fitted.used], tuple(values[name] for name in names))
    others = [{**values, **dict(zip(names, shape, strict=True))} for shape in shapes]
    misfits = [_misfit(clip, fitted, unit, candidate) for candidate in [values, *others]]
    best = int(np.argmin(misfits))
    return others[best - 1] if best else {}


def _misfit(clip: FitRequest, fitted: FitResult, unit: Array, values: Mapping[str, float] | None = None) -> float:
    """Sum of squares of the residual over all samples of a clip in the time of a fit, outliers included.

    ``values``, where given, replace the fitted ones.
    """
    used, trajectory = fitted.t_s[fitted.used], clip.trajectory
    stop = int(np.searchsorted(trajectory.t_s, used[-1], side="right"))
    predicted = predicted_by(fitted, trajectory, values or estimate_values(fitted), stop, tolerance=ACCURATE)
    observed = trajectory.position[:stop, observed_columns(fitted, trajectory)]
    inside = trajectory.valid[:stop] & (trajectory.t_s[:stop] >= used[0])
    with np.errstate(over="ignore"):  # a prediction that diverges is infinitely wrong
        return float(np.nansum(((observed - predicted) / unit[:stop])[inside] ** 2))


def _left(clip: FitRequest, fitted: FitResult, unit: Array) -> float:
    """:func:`_misfit` of a fit; infinite where it failed."""
    return _misfit(clip, fitted, unit) if fitted.usable else np.inf


def free_values(fitted: FitResult) -> dict[str, float]:
    """The fitted values by name, without constants: where a similar fit begins."""
    return {name: fitted.estimates[name].value for name in fitted.free}


def estimate_values(fitted: FitResult) -> dict[str, float]:
    """The values of all estimates by name."""
    return {name: estimate.value for name, estimate in fitted.estimates.items()}


def _values(effects: Sequence[Effect], start: Starts) -> dict[str, float]:
    values: dict[str, float] = {}
    for effect in effects:
        if effect.name in start:
            size, shape = start[effect.name]
            first, *others = effect.parameters
            values[first.name] = float(np.nan_to_num(size))
            chosen = shape or [parameter.default or 0.0 for parameter in others]
            values |= {parameter.name: value for parameter, value in zip(others, chosen, strict=True)}
    return values


def significance(before: ModelWithEffects, after: ModelWithEffects, effects: Sequence[Effect]) -> float:
    """Significance of the effects by which two fits differ, as standard errors of one normal variable.

    Of one clip, the root of the chi-square that they explain, in units of the noise that remains, thinned by the
    autocorrelation of that noise along them: unlike a size over its standard error, this also holds where an effect
    has a shape that the data fix poorly. Of several clips, the smallest of the effects' common sizes over their
    standard errors (:func:`common_size`).
    """
    if len(after.fits) > 1:
        sizes = [after.sizes_of(effect.parameters[0].name) for effect in effects]
        common = [common_size([(size.value, size.stderr) for size in clips]) for clips in sizes]
        return float(min(abs(value) / stderr for value, stderr in common))
    first, second, unit = before.fits[0], after.fits[0], after.units[0]
    both = first.used & second.used
    remaining = _sum_of_squares(second, unit, both) + _prior_squares(second)
    degrees = max(int(both.sum()) * len(second.rms) + second.prior_residual.size - len(second.free), 1)
    explained = _sum_of_squares(first, unit, both) + _prior_squares(first) - remaining
    gain = max(explained, 0.0) * degrees / max(remaining, 1e-300)
    inflation = max(_inflation(second, unit, effect.parameters[0].name) for effect in effects)
    if len(effects) == 1:
        return normal_isf(student_sf(float(np.sqrt(gain / inflation)), degrees))
    return float(np.sqrt(gain / inflation))


def _inflation(fitted: FitResult, unit: Array, name: str) -> float:
    """Variance of a value over what it would be for white noise of the same size."""
    k = fitted.free.index(name)
    noise = unit[fitted.used].ravel()
    white = inverse_normal(fitted.informed_jacobian(noise), 1e-9)[k, k]
    degrees = max(noise.size - len(fitted.free), 1)
    ratio = fitted.covariance[k, k] / (white * _sum_of_squares(fitted, unit, fitted.used) / degrees)
    return float(ratio) if np.isfinite(ratio) and ratio > 0 else float("inf")


def _sum_of_squares(fitted: FitResult, unit: Array, samples: Mask) -> float:
    return float(np.nansum((fitted.residual[samples] / unit[samples]) ** 2))


def _prior_squares(fitted: FitResult) -> float:
    """Sum of squares of what the priors miss, in units of the noise."""
    return float(fitted.prior_residual @ fitted.prior_residual)


def _bodies(clips: Sequence[Trajectory]) -> tuple[Mapping[str, float], ...]:
    """The stated factors on the body of each clip over that of the first; none where no clip differs."""
    each = {name: [_stated(clip, name) for clip in clips] for name in BODY}
    stated = {name: [value for value in values if value is not None] for name, values in each.items()}
    for name in ("mass", "radius"):
        if stated[name] and len(stated[name]) < len(clips):
            raise FitError(f"the {name} is stated for {len(stated[name])} of {len(clips)} clips; state it for all")
    known = {name: values for name, values in stated.items() if len(values) == len(clips) and min(values) > 0}
    found = tuple({name: values[k] / values[0] for name, values in known.items()} for k in range(len(clips)))
    return found if any(factor != 1.0 for body in found for factor in body.values()) else ()


def _stated(clip: Trajectory, name: str) -> float | None:
    """What is known of the body of a clip, or a column of the table has throughout; None where neither is."""
    if name in clip.known:
        return clip.known[name].value
    columns = [clip.position[clip.valid, k] for k, quantity in enumerate(clip.quantities) if quantity.name == name]
    return next((float(column[0]) for column in columns if column.size and np.ptp(column) == 0.0), None)


def _over(size: Estimate, factor: float) -> Estimate:
    """The size as the first clip has it."""
    if factor == 1.0:
        return size
    interval = None if size.ci95 is None else (size.ci95[0] / factor, size.ci95[1] / factor)
    return replace(size, value=size.value / factor, stderr=size.stderr / factor, ci95=interval)


def _scatter(sizes: Sequence[Estimate]) -> float:
    """Chi-square of sizes about their common value."""
    known = np.array([(size.value, size.stderr) for size in sizes if size.stderr > 0]).reshape(-1, 2)
    weights = known[:, 1] ** -2.0
    return float(weights @ (known[:, 0] - weights @ known[:, 0] / weights.sum()) ** 2) if len(known) > 1 else 0.0


def pooled(sizes: Sequence[Estimate]) -> Estimate:
    """The common size of independent clips (:func:`common_size`), with the scatter between them in its standard error.

    Estimates without a standard error are left out; a single one is returned as it is.
    """
    known = [size for size in sizes if size.stderr > 0]
    if len(known) < 2:
        return known[0] if known else sizes[0]
    value, stderr = common_size([(size.value, size.stderr) for size in known])
    return replace(known[0], value=value, stderr=stderr, source=f"common to {len(known)} clips", ci95=None)
