"""What a fitted equation predicts at any times, with the error that comes from the errors of its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitters.ode.model_discrepancy import SOURCE
from fitters.ode.simulation import linearisation
from iris_sysid.errors import DataError, FitError
from iris_sysid.types import (
    NORMAL_975,
    Array,
    Diagnosis,
    Discovery,
    FitResult,
    Hold,
    OdeModel,
    Run,
    Shown,
    frozen_array,
)

TOLERANCE = 1e-9
SAME_TIME = 1e-6  # of a sample's interval: times this near are one, or their difference quotient is rounding error


@dataclass(frozen=True, eq=False, slots=True)
class Prediction(Shown):
    """Observed quantities (n, d) at times ``t_s`` (n,) s, and the standard error (n, d) of each.

    ``fitted`` is the fit that is continued.
    """

    t_s: Array
    observed: Array
    stderr: Array
    fitted: FitResult

    def __repr__(self) -> str:
        return f"Prediction of {self.fitted.model.name} at {self.t_s.size} times"

    @property
    def lower(self) -> Array:
        """Lower end of the 95 % band (n, d), in the observed units."""
        return self.observed - NORMAL_975 * self.stderr

    @property
    def upper(self) -> Array:
        """Upper end of the 95 % band (n, d), in the observed units."""
        return self.observed + NORMAL_975 * self.stderr


def predict(
    result: FitResult | Discovery | Diagnosis | Run,
    t_s: ArrayLike,
    *,
    inputs: ArrayLike | None = None,
    hold: Hold = "linear",
) -> Prediction:
    """Continue the motion that was fitted to any times, by integration from the first sample used.

    The band is that of the equation's own curve, for linearised errors of the fitted values: their random part, and
    what the equation may lack (``model discrepancy`` in the budget) with the same correlations. Errors that all samples
    share (scale, given constants) do not widen it: the fitted values have followed them. The noise of a new sample
    comes in addition, and so does an effect that acts only where nothing was measured.

    Parameters
    ----------
    result
        A fit; of a diagnosis the first clip's fit with the effects, of a discovery that of its first clip.
    t_s
        Time or times (n,) s, in any order, on the clock of the data.
    inputs
        (n, m) known inputs at these times, for a model that declares them; the times then increase and begin no later
        than ``t0_s`` of the fit.
    hold
        Inputs between samples: on a line (``linear``) or held until the next sample (``zero-order``).

    Returns
    -------
    Prediction
        ``t_s`` (n,) s, ``observed`` and ``stderr`` (n, d) in the observed units, ``lower`` and ``upper`` of the 95 %
        band; NaN before the fitted motion begins, and ``stderr`` NaN where the data do not determine it.

    Raises
    ------
    FitError
        When the fit has no estimates.
    DataError
        When a time is not a finite number, or the inputs do not fit the times.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, fit, predict, simulate
    >>> fall, t_s = MODELS["free-fall"], np.arange(60) / 60
    >>> z = simulate(fall, t_s, {"gravity": 9.81, "z_0": 5.0, "vz_0": 0.0}).observed
    >>> z += 1e-3 * np.random.default_rng(0).standard_normal(z.shape)
    >>> clip = Trajectory(t_s, fall.observed, z, np.full_like(z, np.nan), np.ones(60, bool))
    >>> later = predict(fit(clip, fall), [1.5])
    >>> bool(later.lower[0, 0] < 5.0 - 9.81 / 2 * 1.5**2 < later.upper[0, 0])
    True
    """
    fitted = _fit_of(result)
    if not fitted.usable:
        raise FitError(f"the fit has no estimates to predict with ({fitted.status}): {fitted.message}")
    times = frozen_array(np.atleast_1d(np.asarray(t_s, dtype=object)), (None,), "t_s")
    if not np.all(np.isfinite(times)):
        raise DataError("t_s holds a number that is not finite")
    after = times >= fitted.t0_s
    observed, stderr = np.full((2, times.size, len(fitted.model.observed)), np.nan)
    if after.any():
        grid, where = _grid(fitted, times[after])
        known = _inputs_on(grid, fitted.model, times, inputs, hold)
        found, error = _solved(fitted, grid, known, hold)
        observed[after], stderr[after] = found[where], error[where]
    return Prediction(times, observed, stderr, fitted)


def _fit_of(result: FitResult | Discovery | Diagnosis | Run) -> FitResult:
    if isinstance(result, Run):
        return result.fit
    if isinstance(result, Diagnosis):
        return result.final
    return result.fits[0] if isinstance(result, Discovery) else result


def _grid(fitted: FitResult, times: Array) -> tuple[Array, NDArray[np.intp]]:
    """Times from the begin of the fit on, its samples among them, and where the wanted ones stand.

    The samples are there because errors of a sensor may depend on the velocity, which is taken between times.
    """
    wanted = np.unique(np.append(times, fitted.t0_s))
    step = np.median(np.diff(fitted.t_s)) if fitted.t_s.size > 1 else 1.0
    own = fitted.t_s[(fitted.t_s > fitted.t0_s) & (fitted.t_s < wanted[-1])]
    right = np.minimum(np.searchsorted(wanted, own), wanted.size - 1)
    nearest = np.minimum(np.abs(wanted[right] - own), np.abs(wanted[np.maximum(right - 1, 0)] - own))
    grid = np.union1d(wanted, own[nearest > SAME_TIME * step])
    return grid, np.searchsorted(grid, times)


def _inputs_on(grid: Array, model: OdeModel, times: Array, inputs: ArrayLike | None, hold: Hold) -> Array | None:
    """Inputs (k, m) at the times of the grid (k,)."""
    if not model.inputs:
        return None
    if inputs is None:
        names = ", ".join(quantity.name for quantity in model.inputs)
        raise DataError(f"model {model.name!r} is driven: give inputs ({names}) at the times of the prediction")
    known = frozen_array(inputs, (times.size, len(model.inputs)), "inputs")
    if times[0] > grid[0] or np.any(np.diff(times) <= 0):
        raise DataError(f"with inputs the times must increase and begin at {grid[0]:g} s, where the fit begins")
    if hold == "zero-order":
        return known[np.searchsorted(times, grid, side="right") - 1]
    return np.column_stack([np.interp(grid, times, column) for column in known.T])


def _solved(fitted: FitResult, grid: Array, inputs: Array | None, hold: Hold) -> tuple[Array, Array]:
    """Observed quantities and their standard errors at the times of the grid, both (k, d)."""
    values = {name: estimate.value for name, estimate in fitted.estimates.items()}
    observed, slopes = linearisation(
        fitted.model, grid, values, fitted.free, inputs=inputs, hold=hold, tolerance=TOLERANCE
    )
    moving = np.any(slopes != 0, axis=(0, 1))
    covariance = _covariance(fitted)[np.ix_(moving, moving)]
    variance = np.einsum("ndk,kl,ndl->nd", slopes[:, :, moving], covariance, slopes[:, :, moving])
    return observed, np.sqrt(np.maximum(variance, 0.0))


def _covariance(fitted: FitResult) -> Array:
    """Covariance (k, k) of the free values: random, and that of what the equation may lack, correlated alike."""
    random = np.sqrt(np.diag(fitted.covariance))
    lacking = np.array([fitted.budget.get(name, {}).get(SOURCE, 0.0) for name in fitted.free])
    with np.errstate(all="ignore"):
        widened = np.hypot(1.0, np.where(lacking > 0, lacking / random, 0.0))
    return np.asarray(fitted.covariance * np.outer(widened, widened))
