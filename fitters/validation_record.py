"""A fitted model on a record that was not used: simulated from its inputs, and compared with what was measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fitters.ode import FitOptions, fit
from iris_sysid.errors import FitError
from iris_sysid.types import Array, FitResult, Quantity, Trajectory


@dataclass(frozen=True, eq=False, slots=True)
class Validation:
    """How well a fitted model simulates a record that was not used.

    ``rms`` (d,): simulation error, root mean square, in the units of the ``quantities`` (d,). ``fit_percent`` (d,):
    100 (``1 - |error| / |observed - mean|``), 100 for a perfect simulation and 0 for one no better than the mean.
    ``simulated`` has the predicted motion and its residual.
    """

    quantities: tuple[Quantity, ...]
    rms: Array
    fit_percent: Array
    simulated: FitResult


def validate_fit(fitted: FitResult, record: Trajectory, options: FitOptions | None = None) -> Validation:
    """Simulate a record that was not used with a fitted model, and measure the simulation error.

    Every parameter is held at its estimate; only the initial states are estimated from the record. The simulation runs
    freely from them: no measurement corrects it on the way (Ljung 1999, System Identification, section 16.5).

    Parameters
    ----------
    fitted
        A usable fit.
    record
        Of the same quantities and inputs.
    options
        As for :func:`fit`, e.g. how inputs vary between samples.

    Raises
    ------
    FitError
        When the fit has no estimates, or the record cannot be simulated.
    """
    if not fitted.usable:
        raise FitError(f"the fit is {fitted.status} and has no estimates to validate: {fitted.message}")
    held = {parameter.name: fitted.estimates[parameter.name].value for parameter in fitted.model.parameters}
    known = {name: value for name, value in held.items() if np.isfinite(value)}
    starts = replace(options or FitOptions(), discrepancy=False)
    plain = record.with_(known={}, free=()) if record.known or record.free else record
    simulated = fit(plain, fitted.model, fixed=known, options=starts)
    if not np.all(np.isfinite(simulated.rms)):
        raise FitError(f"the validation record cannot be simulated: {simulated.message}")
    observed = (simulated.predicted + simulated.residual)[simulated.used]
    spread = np.std(observed, axis=0)
    share = 100.0 * (1.0 - simulated.rms / np.where(spread > 0, spread, np.nan))
    return Validation(simulated.model.observed, simulated.rms, np.asarray(share), simulated)
