"""A fitted model on a record that was not used: simulated from its inputs, and compared with what was measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.integrator.initial_value_problem import value_names
from fitters.linear_model import evenly_sampled, output_error_model
from fitters.ode import FitOptions, fit, simulate
from fitters.ode.known_inputs import known_inputs
from iris_sysid.errors import DataError, FitError
from iris_sysid.types import NORMAL_995, Array, FitResult, LinearModel, Mask, OdeModel, Trajectory, Validation

MAX_LAGS = 25  # samples over which residuals are correlated, as control engineers plot them
MIN_SAMPLES = 20  # of either part of a record that is split


def validate_fit(
    fitted: FitResult,
    record: Trajectory,
    estimation: Trajectory | None = None,
    *,
    initial: int | None = None,
    continues: bool = False,
) -> Validation:
    """Simulate a record that was not used with a fitted model, and test the residual.

    Every parameter is held at its estimate; only the initial states are estimated from the record. The simulation runs
    freely from them: no measurement corrects it on the way (Ljung 1999, System Identification, section 16.5). The
    residual's correlations with itself and with the inputs come with bands of 99 % (section 16.6).

    Parameters
    ----------
    fitted
        A usable fit.
    record
        Of the same quantities and inputs.
    estimation
        What was fitted: a linear model of the same order is fitted to it, and simulates the record as well.
    initial
        The initial states are estimated from this number of first valid samples, which are not scored: the window of
        a benchmark. Without it they are estimated from all samples, and all are scored.
    continues
        The record follows the estimation record without a break: the simulation of that one, with its inputs, gives
        the initial states, and no sample of the record does.

    Raises
    ------
    FitError
        When the fit has no estimates, or the record cannot be simulated.
    DataError
        When the record has no samples after the first ones, or does not follow the estimation record.
    """
    if not fitted.usable:
        raise FitError(f"the fit is {fitted.status} and has no estimates to validate: {fitted.message}")
    values = {name: estimate.value for name, estimate in fitted.estimates.items()}
    return validate_model(
        fitted.model, values, record, estimation, used=fitted.used, initial=initial, continues=continues
    )


def validate_model(
    model: OdeModel,
    values: Mapping[str, float],
    record: Trajectory,
    estimation: Trajectory | None = None,
    *,
    used: Mask | None = None,
    initial: int | None = None,
    continues: bool = False,
) -> Validation:
    """As :func:`validate_fit`, of a model with given values.

    Parameters
    ----------
    model
        The equation.
    values
        Its parameters by name; where the record continues another, the initial states of that one as well.
    record, estimation, initial, continues
        As for :func:`validate_fit`.
    used
        Samples (n,) of the estimation record that were fitted; all valid ones if None.
    """
    held = {parameter.name: values.get(parameter.name, np.nan) for parameter in model.parameters}
    known = {name: value for name, value in held.items() if np.isfinite(value)}
    plain = record.with_(known={}, free=(), doubts=())
    scored = _after(plain, initial or 0)
    if continues:
        if estimation is None:
            raise DataError("a record that continues another needs that one")
        known |= _states_after(model, {**values, **known}, estimation, plain)
    elif initial is not None:
        window = _simulated(plain.with_(valid=plain.valid & ~scored), model, known)
        known |= {name: window.estimates[name].value for name in model.initial_names}
    simulated = _simulated(plain, model, known)
    counted = simulated.used & scored
    observed = simulated.predicted + simulated.residual
    error = np.where(counted[:, None], simulated.residual, np.nan)
    inputs = known_inputs(plain, simulated.model, slice(None))
    driven = np.zeros((plain.n, 0)) if inputs is None else inputs
    own, with_inputs = correlations(error, driven)
    linear = None
    if estimation is not None:
        linear = _linear(simulated.model, (estimation, estimation.valid if used is None else used), (plain, counted))
    return Validation(
        simulated.model.observed,
        simulated.model.inputs,
        np.sqrt(np.nanmean(error**2, axis=0)),
        fit_percent(observed, simulated.predicted, counted),
        own[:, 1:],
        NORMAL_995 / float(np.sqrt(counted.sum())),
        with_inputs,
        _input_bands(own, driven[counted], int(counted.sum())),
        simulated,
        linear,
    )


def _after(record: Trajectory, count: int) -> Mask:
    """The samples (n,) after the first ``count`` valid ones."""
    valid = np.flatnonzero(record.valid)
    if valid.size - count < MIN_SAMPLES:
        raise DataError(
            f"the record has {valid.size} valid samples: {count} first ones leave {valid.size - count} to score, "
            f"{MIN_SAMPLES} are needed"
        )
    return np.asarray(np.arange(record.n) > valid[count - 1] if count else np.ones(record.n, dtype=np.bool_))


def _simulated(record: Trajectory, model: OdeModel, known: Mapping[str, float]) -> FitResult:
    """The model on a record; initial states that are not known are estimated."""
    simulated = fit(record, model, fixed=known, options=FitOptions(discrepancy=False))
    if not np.all(np.isfinite(simulated.rms)):
        raise FitError(f"the validation record cannot be simulated: {simulated.message}")
    return simulated


def _states_after(
    model: OdeModel, values: Mapping[str, float], before: Trajectory, record: Trajectory
) -> dict[str, float]:
    """Initial states of a record that follows another, from a simulation of that one with its inputs."""
    steps = np.diff(before.t_s)
    break_s = float(record.t_s[0] - before.t_s[-1])
    if not 0 < break_s <= 2 * float(np.max(steps)):
        raise DataError(
            f"the record starts {break_s:.4g} s after the end of the one that it is to continue; it must follow it"
        )
    first = int(np.flatnonzero(before.valid)[0])
    span, start = slice(first, None), int(np.flatnonzero(record.valid)[0])
    parts = [known_inputs(clip, model, where) for clip, where in ((before, span), (record, slice(start + 1)))]
    inputs = np.concatenate([part for part in parts if part is not None]) if model.inputs else None
    t_s = np.concatenate([before.t_s[span], record.t_s[: start + 1]])
    own = {name: values[name] for name in value_names(model) if name in values}
    last = simulate(model, t_s, own, inputs=inputs, hold=before.hold).states[-1]
    return dict(zip(model.initial_names, last.tolist(), strict=True))


def split_record(record: Trajectory, share: float) -> tuple[Trajectory, Trajectory]:
    """The record with its last ``share`` of valid samples left out, and that part alone, for validation.

    Raises
    ------
    DataError
        When one of the parts would have too few samples.
    """
    valid = np.flatnonzero(record.valid)
    count = round(share * valid.size)
    if not 0.0 < share < 1.0 or min(count, valid.size - count) < MIN_SAMPLES:
        raise DataError(
            f"a share of {share:g} of {valid.size} valid samples leaves {count} to validate with and "
            f"{valid.size - count} to fit; both need {MIN_SAMPLES}: give another share, or a second table"
        )
    late = np.arange(record.n) >= valid[-count]
    return record.with_(valid=record.valid & ~late), record.with_(valid=record.valid & late)


def cut_record(record: Trajectory, count: int) -> tuple[Trajectory | None, Trajectory]:
    """The record before its last ``count`` valid samples, None if nothing is, and the rest: each with its rows alone.

    Raises
    ------
    DataError
        When one of the parts would have too few samples.
    """
    valid = np.flatnonzero(record.valid)
    rest = valid.size - count
    if count < MIN_SAMPLES or 0 < rest < MIN_SAMPLES or rest < 0:
        raise DataError(
            f"{count} of {valid.size} valid samples leave {rest}: both parts need {MIN_SAMPLES}, or one is all of it"
        )
    first = int(valid[-count]) if rest else 0
    return (_rows(record, slice(0, first)) if rest else None), _rows(record, slice(first, None))


def _rows(record: Trajectory, rows: slice) -> Trajectory:
    """What was measured in these rows."""
    return Trajectory(
        record.t_s[rows],
        record.quantities,
        record.position[rows],
        record.sigma[rows],
        record.valid[rows],
        record.input_quantities,
        None if record.inputs is None else record.inputs[rows],
        sensor=record.sensor,
        hold=record.hold,
        origin={"source": record.origin.get("source"), "sha256": record.origin.get("sha256")},
    )


def fit_percent(observed: Array, simulated: Array, used: Mask) -> Array:
    """100 (1 - |error| / |observed - mean|) of each quantity (d,), over the samples used.

    Parameters
    ----------
    observed, simulated
        (n, d) in the same unit.
    used
        (n,).
    """
    spread = np.std(observed[used], axis=0)
    error = np.sqrt(np.mean((observed - simulated)[used] ** 2, axis=0))
    return np.asarray(100.0 * (1.0 - error / np.where(spread > 0, spread, np.nan)))


def correlations(residual: Array, inputs: Array, lags: int = MAX_LAGS) -> tuple[Array, Array]:
    """Autocorrelation (d, l + 1) of a residual at lags 0 to l, and its correlation (d, m, 2 l + 1) with inputs.

    At a lag above zero the input comes first.

    Parameters
    ----------
    residual
        (n, d), NaN where there is none.
    inputs
        (n, m).
    lags
        l, in samples.
    """
    lags = min(lags, len(residual) - 1)
    left, given = _standardised(residual), _standardised(inputs)
    known = np.isfinite(residual).sum(axis=0)[:, None]
    own = np.stack([np.sum(left[lag:] * left[: len(left) - lag], axis=0) for lag in range(lags + 1)], axis=1) / known
    crossed = [_lagged(left, given, lag) for lag in range(-lags, lags + 1)]
    return np.asarray(own), np.stack(crossed, axis=2) / known[:, :, None]


def _standardised(values: Array) -> Array:
    """Values (n, k) about their mean, over their standard deviation, zero where not known."""
    if values.shape[1] == 0:
        return values
    spread = np.nanstd(values, axis=0)
    return np.asarray(np.nan_to_num((values - np.nanmean(values, axis=0)) / np.where(spread > 0, spread, 1.0)))


def _lagged(left: Array, given: Array, lag: int) -> Array:
    """Sum of residual (n, d) times input (n, m) that many samples before: (d, m)."""
    if lag < 0:
        return np.asarray(left[:lag].T @ given[-lag:])
    return np.asarray(left[lag:].T @ given[: len(given) - lag])


def _input_bands(own: Array, driven: Array, count: int) -> Array:
    """Bands (d, m) of 99 %: the sum over lags of both autocorrelations is the variance times the number of samples."""
    given = correlations(driven, driven[:, :0], own.shape[1] - 1)[0]
    both = own[:, :1] * given[:, 0] + 2.0 * own[:, 1:] @ given[:, 1:].T
    return np.asarray(NORMAL_995 * np.sqrt(np.maximum(both, 1.0) / count))


def _linear(
    model: OdeModel, estimation: tuple[Trajectory, Mask], validation: tuple[Trajectory, Mask]
) -> LinearModel | None:
    """The linear model of the same order, on the same samples of two records; None undriven, or at uneven times."""
    order = len(model.states)
    if not model.inputs or not (evenly_sampled(estimation[0].t_s) and evenly_sampled(validation[0].t_s)):
        return None
    parts = []
    for clip, used in (estimation, validation):
        span = slice(int(np.argmax(used)), int(np.flatnonzero(used)[-1]) + 1)
        inputs = known_inputs(clip, model, span)
        assert inputs is not None
        columns = [clip.column(quantity.name) for quantity in model.observed]
        parts.append((inputs, clip.position[span][:, columns], used[span]))
    (inputs, observed, used), (later, seen, counts) = parts
    found = [output_error_model(inputs, column, used, order) for column in observed.T]
    if any(each is None for each in found):
        return None
    linear = np.column_stack(
        [each.simulated(later, column, counts) for each, column in zip(found, seen.T, strict=True) if each is not None]
    )
    rms = np.sqrt(np.mean((seen - linear)[counts] ** 2, axis=0))
    return LinearModel(order, np.asarray(rms), fit_percent(seen, linear, counts))
