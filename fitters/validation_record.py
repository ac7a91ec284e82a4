"""A fitted model on a record that was not used: simulated from its inputs, and compared with what was measured."""

from __future__ import annotations

import numpy as np

from fitters.linear_model import evenly_sampled, output_error_model
from fitters.ode import FitOptions, fit
from fitters.ode.fit_problem import known_inputs
from iris_sysid.errors import DataError, FitError
from iris_sysid.types import NORMAL_995, Array, FitResult, LinearModel, Mask, Trajectory, Validation

MAX_LAGS = 25  # samples over which residuals are correlated, as control engineers plot them
MIN_SAMPLES = 20  # of either part of a record that is split


def validate_fit(fitted: FitResult, record: Trajectory, estimation: Trajectory | None = None) -> Validation:
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

    Raises
    ------
    FitError
        When the fit has no estimates, or the record cannot be simulated.
    """
    if not fitted.usable:
        raise FitError(f"the fit is {fitted.status} and has no estimates to validate: {fitted.message}")
    held = {parameter.name: fitted.estimates[parameter.name].value for parameter in fitted.model.parameters}
    known = {name: value for name, value in held.items() if np.isfinite(value)}
    plain = record.with_(known={}, free=(), doubts=())
    simulated = fit(plain, fitted.model, fixed=known, options=FitOptions(discrepancy=False))
    if not np.all(np.isfinite(simulated.rms)):
        raise FitError(f"the validation record cannot be simulated: {simulated.message}")
    model, used = simulated.model, simulated.used
    observed = simulated.predicted + simulated.residual
    inputs = known_inputs(plain, model, slice(None))
    driven = np.zeros((plain.n, 0)) if inputs is None else inputs
    own, with_inputs = correlations(np.where(used[:, None], simulated.residual, np.nan), driven)
    return Validation(
        model.observed,
        model.inputs,
        simulated.rms,
        fit_percent(observed, simulated.predicted, used),
        own[:, 1:],
        NORMAL_995 / float(np.sqrt(used.sum())),
        with_inputs,
        _input_bands(own, driven[used], int(used.sum())),
        simulated,
        None if estimation is None else _linear(fitted, estimation, plain, simulated),
    )


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


def _linear(fitted: FitResult, estimation: Trajectory, record: Trajectory, simulated: FitResult) -> LinearModel | None:
    """The linear model of the same order, on the same samples; None without inputs, or at uneven times."""
    model, order = fitted.model, len(fitted.model.states)
    if not model.inputs or not (evenly_sampled(estimation.t_s) and evenly_sampled(record.t_s)):
        return None
    parts = []
    for clip, used in ((estimation, fitted.used), (record, simulated.used)):
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
