"""The checked input of a fit: its samples, its known and free values, and their starting values."""

from __future__ import annotations

import keyword
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from fitters.integrator.initial_value_problem import InitialValueProblem, initial_value_problem, value_names
from fitters.noise.measurement_noise import noise_from_differences, outliers_in_motion
from fitters.ode.known_inputs import known_inputs
from fitters.ode.least_squares import Target, Unknowns
from iris_sysid.errors import FitError
from iris_sysid.types import METRE, Array, Estimate, Mask, OdeModel, Parameter, SegmentLabel, Trajectory

FROM_POSITIONS = ", or, for the model of a phenomenon, take it from x and z by fitters.positions.observed_positions"
NO_PRIORS: Mapping[str, Estimate] = MappingProxyType({})


@dataclass(frozen=True, eq=False, slots=True)
class Selection:
    """Samples ``start`` to ``stop - 1`` of a trajectory; ``used`` (n of the trajectory) says which can be fitted."""

    start: int
    stop: int
    used: Mask
    note: str = ""

    @property
    def span(self) -> slice:
        """The samples over which the model is integrated."""
        return slice(self.start, self.stop)


@dataclass(frozen=True, eq=False, slots=True)
class PreparedFit:
    """A fit that is prepared to run.

    ``known`` by name: the values held, with their uncertainty; ``priors`` those estimated that were measured
    elsewhere; ``noise`` (d,) is the standard deviation of the measurement from differences of neighbours, in the
    units of the observed quantities; ``systematic`` by source (r, n, d) what their errors have in common.
    """

    trajectory: Trajectory
    model: OdeModel
    selection: Selection
    known: Mapping[str, Estimate]
    priors: Mapping[str, Estimate]
    free: tuple[str, ...]
    problem: InitialValueProblem
    target: Target
    unknowns: Unknowns
    noise: Array
    systematic: Mapping[str, Array]


def select(trajectory: Trajectory, labels: Sequence[SegmentLabel]) -> Selection:
    """The valid samples inside segments of these labels; the longest stretch where other segments lie between."""
    stretches = list(_stretches(trajectory, labels))
    best = Selection(0, 0, np.zeros(trajectory.n, dtype=np.bool_))
    for first, last in stretches:
        used = np.zeros(trajectory.n, dtype=np.bool_)
        used[first:last] = (trajectory.valid & trajectory.mask(*labels))[first:last]
        if used.sum() > best.used.sum():
            index = np.flatnonzero(used)
            best = Selection(int(index[0]), int(index[-1]) + 1, used)
    if len(stretches) > 1 and best.stop:
        t0_s, t1_s = trajectory.t_s[[best.start, best.stop - 1]]
        note = f"of {len(stretches)} stretches of {'/'.join(labels)} the longest was fitted, {t0_s:.6g} to {t1_s:.6g} s"
        return Selection(best.start, best.stop, best.used, note)
    return best


def _stretches(trajectory: Trajectory, labels: Sequence[SegmentLabel]) -> Iterator[tuple[int, int]]:
    """Runs of segments with these labels without any other segment between, as (start, stop)."""
    if not trajectory.segments:
        yield 0, trajectory.n
        return
    run: tuple[int, int] | None = None
    for segment in sorted(trajectory.segments, key=lambda segment: segment.start):
        if segment.label in labels:
            run = (segment.start if run is None else run[0], segment.stop)
        elif run is not None:
            yield run
            run = None
    if run is not None:
        yield run


def check_names(model: OdeModel, **given: Sequence[str]) -> None:
    """FitError when a name is given that the model does not have, or one that cannot be a parameter's name."""
    names = value_names(model)
    for name in names:
        if not name.isidentifier() or keyword.iskeyword(name):
            raise FitError(f"model {model.name!r}: {name!r} cannot name a parameter; use letters, digits and _")
    for option, listed in given.items():
        for name in listed:
            if name not in names:
                raise FitError(f"{option}: model {model.name!r} has no parameter {name!r}; it has {', '.join(names)}")


def known_values(
    model: OdeModel, trajectory: Trajectory, fixed: Mapping[str, float | Estimate], free: Sequence[str]
) -> dict[str, Estimate]:
    """Values that are held, by name: those given, then those from the geometry, then the model's constants.

    Parameters
    ----------
    model
        Its constants are held unless freed.
    trajectory
        ``geometry`` may hold a constant of the model, e.g. the angle of an incline, or the scale.
    fixed
        Given by the caller; a plain number is taken as exact.
    free
        Names to estimate.
    """
    given = _all_given(model, trajectory, fixed)
    constant = {
        parameter.name: _constant(parameter, trajectory, model)
        for parameter in model.parameters
        if parameter.constant and parameter.name not in fixed
    }
    relaxed = {
        f"{state.name}_0": Estimate(0.0, 0.0, state.unit, "assumed", "an effect's hidden state begins at zero")
        for state in model.states[len(model.own_states) :]
    }
    return {name: estimate for name, estimate in {**relaxed, **constant, **given}.items() if name not in free}


def priors_of(
    model: OdeModel, trajectory: Trajectory, fixed: Mapping[str, float | Estimate], free: Sequence[str]
) -> dict[str, Estimate]:
    """Values that are measured elsewhere and estimated as well, by name: normal priors.

    Parameters
    ----------
    model, trajectory
        As for :func:`known_values`.
    fixed, free
        A name in both is a prior; FitError when its value has no standard error.
    """
    both = {name: estimate for name, estimate in _all_given(model, trajectory, fixed).items() if name in free}
    exact = sorted(name for name, estimate in both.items() if not 0 < estimate.stderr < np.inf)
    if exact:
        raise FitError(
            f"{', '.join(exact)} cannot be both fixed and free: give it with its standard error, which then is a "
            f"prior (e.g. {exact[0]}={both[exact[0]].value:g}+-0.01), or leave out one of the two"
        )
    return both


def _all_given(model: OdeModel, trajectory: Trajectory, fixed: Mapping[str, float | Estimate]) -> dict[str, Estimate]:
    units = {parameter.name: parameter.unit for parameter in model.parameters} | {
        f"{state.name}_0": state.unit for state in model.states
    }
    given = {
        name: _given(name, fixed[name], _unit_in(trajectory, model, unit))
        for name, unit in units.items()
        if name in fixed
    }
    for parameter in model.parameters:
        if parameter.name in given:
            _check_bounds(parameter, given[parameter.name])
    return given


def _unit_in(trajectory: Trajectory, model: OdeModel, unit: str) -> str:
    return METRE.sub("px", unit) if in_pixels(trajectory, model) else unit


def _given(name: str, value: float | Estimate, unit: str) -> Estimate:
    estimate = value if isinstance(value, Estimate) else Estimate(float(value), 0.0, unit, "assumed", "given")
    if not np.isfinite(estimate.value):
        raise FitError(f"the fixed value of {name} must be a finite number, not {estimate.value}")
    if estimate.unit not in ("", unit):
        remedy = "give the scale as well" if "px" in unit else "give it in that unit"
        raise FitError(f"{name} is given in {estimate.unit}, but it is in {unit} here: {remedy}")
    return replace(estimate, unit=unit)


def _check_bounds(parameter: Parameter, given: Estimate) -> None:
    if not parameter.lower <= given.value <= parameter.upper:
        bounds = f"{parameter.lower:g} to {parameter.upper:g} {parameter.unit}"
        raise FitError(f"{parameter.name} must lie within {bounds}, not {given.value:g}")


def _constant(parameter: Parameter, trajectory: Trajectory, model: OdeModel) -> Estimate:
    measured = trajectory.geometry.get(parameter.name)
    if measured is not None and np.isfinite(measured.value):
        return measured
    stated_in_metres = parameter.role not in ("shape", "form") and METRE.search(parameter.unit)
    unknown = parameter.default != 0.0 and in_pixels(trajectory, model) and stated_in_metres  # no length is none in px
    if parameter.default is None or unknown:
        return Estimate(np.nan, np.nan, parameter.unit, "assumed", "not known")
    stderr, source = parameter.stderr, parameter.source
    scale = None if trajectory.systematic else trajectory.geometry.get("scale")  # count its error only once
    if parameter.role == "magnification" and scale is not None and scale.value > 0 and scale.stderr > 0:
        stderr, source = scale.stderr / scale.value, f"scale: {scale.source}"
    return Estimate(parameter.default, stderr, parameter.unit, "assumed", source)


def in_pixels(trajectory: Trajectory, model: OdeModel) -> bool:
    """Whether lengths that should be in m are in px: no scale is known, so constants in metres have no meaning."""
    units = {quantity.name: quantity.unit for quantity in trajectory.quantities}
    return any(METRE.search(q.unit) and "px" in units.get(q.name, "") for q in model.observed)


def in_units_of(trajectory: Trajectory, model: OdeModel) -> OdeModel:
    """The model with metres replaced by px where the trajectory is in px."""
    if not in_pixels(trajectory, model):
        return model

    def renamed(items: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(item, unit=METRE.sub("px", item.unit)) for item in items)

    return replace(
        model,
        states=renamed(model.states),
        parameters=renamed(model.parameters),
        observed=renamed(model.observed),
        derived=renamed(model.derived),
    )


def check_columns(trajectory: Trajectory, model: OdeModel) -> None:
    """FitError when a quantity that the model observes is missing, or has it in another unit."""
    units = {quantity.name: quantity.unit for quantity in trajectory.quantities}
    for quantity in model.observed:
        if quantity.name not in units:
            taken = FROM_POSITIONS if {"x", "z"} <= units.keys() else ""
            raise FitError(
                f"model {model.name!r} observes {', '.join(q.name for q in model.observed)}, but the trajectory has "
                f"{', '.join(units)}: name the columns so, or choose another model{taken}"
            )
        if quantity.unit != "1" and units[quantity.name] not in (quantity.unit, METRE.sub("px", quantity.unit)):
            raise FitError(
                f"model {model.name!r} needs {quantity.name} in {quantity.unit}, but it is in {units[quantity.name]}"
            )


def prepare(
    trajectory: Trajectory,
    model: OdeModel,
    selection: Selection,
    known: Mapping[str, Estimate],
    priors: Mapping[str, Estimate] = NO_PRIORS,
) -> PreparedFit:
    """Combine data and model into a fit that is ready to run.

    Parameters
    ----------
    trajectory, model, selection
        The data, the model, and the samples to use.
    known
        Values held; everything else is free.
    priors
        Values that are estimated and were also measured elsewhere.
    """
    span, used = selection.span, selection.used[selection.span]
    columns = [trajectory.column(quantity.name) for quantity in model.observed]
    observed, given = trajectory.position[span][:, columns], trajectory.sigma[span][:, columns]
    t_s = trajectory.t_s[span]
    clean = used.copy()
    clean[used] = ~outliers_in_motion(t_s[used], observed[used])
    noise = np.array([_noise(t_s[clean], observed[clean, c], given[clean, c]) for c in range(observed.shape[1])])
    sigma = _relative(given, used) * _usable(noise, observed[clean])
    free = tuple(name for name in value_names(model) if name not in known)
    return PreparedFit(
        trajectory=trajectory,
        model=model,
        selection=selection,
        known=known,
        priors=priors,
        free=free,
        problem=initial_value_problem(model, t_s, known_inputs(trajectory, model, span), trajectory.hold),
        target=Target(observed, sigma, clean),
        unknowns=_unknowns(model, free, priors),
        noise=noise,
        systematic={source: errors[:, span][:, :, columns] for source, errors in trajectory.systematic.items()},
    )


def _noise(t_s: Array, values: Array, sigma: Array) -> float:
    noise = noise_from_differences(t_s, values)
    finite = sigma[np.isfinite(sigma)]
    return float(np.median(finite)) if np.isnan(noise) and finite.size else noise


def _relative(sigma: Array, used: Mask) -> Array:
    """Standard errors (n, d) relative to their median; 1 where one of them is not known."""
    relative = np.ones_like(sigma)
    for column in range(sigma.shape[1]):
        inside = sigma[used, column]
        if np.all(np.isfinite(inside)) and np.all(inside > 0):
            relative[used, column] = inside / np.median(inside)
    return relative


def _usable(noise: Array, observed: Array) -> Array:
    """The noise as the unit of the residuals: never zero, also for exact data."""
    size = np.std(observed, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.where(np.isfinite(noise), np.maximum(noise, 1e-9 * size), 1e-2 * size))


def _unknowns(model: OdeModel, free: Sequence[str], priors: Mapping[str, Estimate]) -> Unknowns:
    names = value_names(model)
    bounds = {parameter.name: (parameter.lower, parameter.upper) for parameter in model.parameters}
    lower, upper = np.array([bounds.get(name, (-np.inf, np.inf)) for name in free]).reshape(-1, 2).T
    which, nothing = np.array([names.index(name) for name in free], dtype=np.intp), np.zeros(len(free))
    return with_priors(Unknowns(which, tuple(free), lower, upper, nothing, nothing), priors)


def with_priors(unknowns: Unknowns, priors: Mapping[str, Estimate]) -> Unknowns:
    """The unknowns with normal priors by name, weighted by their standard errors alone."""
    expected = np.array([priors[name].value if name in priors else 0.0 for name in unknowns.names])
    precision = np.array([1.0 / priors[name].stderr if name in priors else 0.0 for name in unknowns.names])
    return replace(unknowns, expected=expected, precision=precision)


def guesses(task: PreparedFit, start: Mapping[str, float]) -> dict[str, float] | None:
    """What the model guesses, and defaults, by name; None where the start and the priors give every free value."""
    return None if set(task.free) <= {*start, *task.priors} else _guess(task, needed=True)


def starting_values(
    task: PreparedFit, start: Mapping[str, float], guessed: Mapping[str, float] | None
) -> Iterator[Array]:
    """Full vectors of starting values: the model's guess overridden by the caller's values, then the guess alone.

    Each vector is (p + s,), every value in its own unit. A parameter that has neither a start, nor a guess, nor a
    default starts from the middle of its bounds, or 1; see :func:`without_start`.

    Parameters
    ----------
    task, start
        The prepared fit, and the caller's values by name.
    guessed
        Of :func:`guesses`: a guess from a long record is made once.
    """
    known = {name: estimate.value for name, estimate in task.known.items()}
    start = {**{name: estimate.value for name, estimate in task.priors.items()}, **start}
    complete = guessed is None
    if complete:
        yield _vector(task, {**start, **known})
    guessed = _guess(task, needed=False) if guessed is None else guessed
    middles = {name: _middle(task.model, name) for name in task.free}
    if not complete:
        yield _vector(task, {**middles, **guessed, **start, **known})
    if start and set(task.free) <= set(guessed):
        yield _vector(task, {**guessed, **known})


def without_start(task: PreparedFit, start: Mapping[str, float], guessed: Mapping[str, float] | None) -> list[str]:
    """The free parameters that have neither a start, nor a prior, nor a finite guess, nor a default.

    Parameters
    ----------
    task, start, guessed
        As for :func:`starting_values`.
    """
    given = {*task.free} if guessed is None else {*guessed, *start, *task.priors}
    return [name for name in task.free if name not in given]


def _vector(task: PreparedFit, values: Mapping[str, float]) -> Array:
    return np.array([values[name] for name in value_names(task.model)])


def _guess(task: PreparedFit, *, needed: bool) -> dict[str, float]:
    """Defaults, then first samples for initial states, then what the model guesses from the clean samples."""
    values = {p.name: p.default for p in task.model.parameters if p.default is not None}
    seen = [quantity.name for quantity in task.model.observed]
    for state in task.model.states:
        column = seen.index(state.name) if state.name in seen else None
        values[f"{state.name}_0"] = 0.0 if column is None else float(task.target.observed[0, column])
    clean = np.zeros(task.trajectory.n, dtype=np.bool_)
    clean[task.selection.span] = task.target.used
    try:
        guessed = _guessed(task, task.trajectory.with_(valid=clean, segments=(), smoothed=None))
    except FitError:
        if needed:
            raise
        return values  # the caller gave every start
    return {**values, **{name: value for name, value in guessed.items() if np.isfinite(value)}}


def _guessed(task: PreparedFit, trajectory: Trajectory) -> dict[str, float]:
    """What the model guesses; FitError when that fails or is not starting values by name."""
    model, remedy = task.model, f"give a start for {', '.join(task.free)}"
    try:
        with np.errstate(all="ignore"):
            made: Any = model.guess(trajectory)
    except Exception as error:
        raise FitError(f"guess of model {model.name!r} raises {type(error).__name__}: {error}; {remedy}") from error
    try:
        guessed = {name: float(value) for name, value in made.items()}
    except (AttributeError, TypeError, ValueError) as error:
        raise FitError(
            f"guess of model {model.name!r} must return numbers by name, e.g. {{{value_names(model)[0]!r}: 1.0}}, "
            f"not {repr(made)[:80]}; {remedy}"
        ) from error
    check_names(model, guess=list(guessed))
    return guessed


def _middle(model: OdeModel, name: str) -> float:
    """A starting value inside the bounds where the model has no finite guess: 1 if that lies inside."""
    bounds = {parameter.name: (parameter.lower, parameter.upper) for parameter in model.parameters}
    lower, upper = bounds.get(name, (-np.inf, np.inf))
    return 1.0 if lower < 1.0 < upper else float(np.clip(0.5 * (lower + upper), lower, upper))
