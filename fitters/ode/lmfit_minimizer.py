"""A finished fit as an lmfit problem: ties, expressions, other methods, confidence intervals and reports of lmfit."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from fitters.ode.simulation import predicted_by
from iris_sysid.errors import FitError
from iris_sysid.types import Array, FitResult, Trajectory, correlation_matrix

if TYPE_CHECKING:
    import lmfit

MAX_RESIDUAL = 1e50  # in units of the noise: a diverging solution stays comparable, and its square finite


def lmfit_minimizer(fitted: FitResult, trajectory: Trajectory) -> lmfit.Minimizer:
    """Convert a fit to an lmfit Minimizer that starts from the estimates, for use with lmfit's own tools.

    The residual is (predicted - observed) / noise at the samples that the fit used, so that ``scale_covar`` is off.
    White noise is assumed: where the residual is autocorrelated, lmfit's standard errors are smaller than those of the
    fit. ``params`` of the result may be changed before minimising: tied (``expr``), bounded, held. They have the
    standard errors and correlations of the fit: ``lmfit.report_fit(minimizer.params)`` prints the fit itself, and
    ``lmfit.conf_interval(minimizer, minimizer.minimize())`` and ``minimizer.emcee()`` go on from it.

    Parameters
    ----------
    fitted
        A usable fit.
    trajectory
        The fitted trajectory; it gives the inputs of a driven model.

    Returns
    -------
    lmfit.Minimizer
        With ``params`` by name: the free values vary within the model's bounds, tied ones follow their expression, all
        others are held.

    Raises
    ------
    FitError
        When the fit has no estimates.

    Examples
    --------
    >>> import lmfit
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Quantity, Trajectory, fit, lmfit_minimizer, simulate
    >>> t_s = np.arange(0, 4, 1 / 60)
    >>> true = {"length": 0.5, "damping": 0.1, "theta_0": 0.3, "omega_0": 0.0}
    >>> theta = simulate(MODELS["pendulum"], t_s, true).observed
    >>> theta = theta + 1e-3 * np.random.default_rng(1).standard_normal(theta.shape)
    >>> sigma, valid = np.full_like(theta, 1e-3), np.ones(t_s.size, dtype=bool)
    >>> clip = Trajectory(t_s, (Quantity("theta", "rad", "theta"),), theta, sigma, valid)
    >>> minimizer = lmfit_minimizer(fit(clip, MODELS["pendulum"]), clip)
    >>> result = minimizer.minimize()
    >>> print(f"{result.params['length'].value:.3f}")
    0.500
    """
    import lmfit

    if not fitted.usable:
        raise FitError(f"the fit is {fitted.status} and has no estimates to start from: {fitted.message}")
    residual = _residual_of(fitted, trajectory)
    parameters = lmfit.Parameters()
    bounds = {parameter.name: (parameter.lower, parameter.upper) for parameter in fitted.model.parameters}
    for name in (*bounds, *fitted.model.initial_names):
        lower, upper = bounds.get(name, (-np.inf, np.inf))
        value = fitted.estimates[name].value
        parameters.add(name, value=value, min=lower, max=upper, vary=name in fitted.free)
    for name, expression in fitted.model.ties:
        parameters.add(name, expr=expression)
    _state_errors(parameters, fitted)

    def lmfit_residual(parameters: lmfit.Parameters) -> Array:
        return residual({name: float(parameter.value) for name, parameter in parameters.items()})

    return lmfit.Minimizer(lmfit_residual, parameters, scale_covar=False)


def _state_errors(parameters: lmfit.Parameters, fitted: FitResult) -> None:
    """Give the parameters the standard errors of the fit, and the correlations that belong to them."""
    correlation = correlation_matrix(fitted.total_covariance)
    for name, _ in fitted.model.ties:
        parameters[name].stderr = float(fitted.estimates[name].stderr)
    for k, name in enumerate(fitted.free):
        if np.isfinite(fitted.estimates[name].stderr):
            parameters[name].stderr = float(fitted.estimates[name].stderr)
            others = {other: float(correlation[k, j]) for j, other in enumerate(fitted.free) if j != k}
            parameters[name].correl = {other: value for other, value in others.items() if np.isfinite(value)}


def _residual_of(fitted: FitResult, trajectory: Trajectory) -> Callable[[dict[str, float]], Array]:
    """Residual (n_used * d,) in units of the noise, as a function of all values by name."""
    observed = (fitted.predicted + fitted.residual)[fitted.used]
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    stop = int(np.flatnonzero(fitted.used)[-1]) + 1

    def residual(values: dict[str, float]) -> Array:
        predicted = predicted_by(fitted, trajectory, values, stop)[fitted.used[:stop]]
        distance = np.nan_to_num(
            (predicted - observed) / noise, nan=MAX_RESIDUAL, posinf=MAX_RESIDUAL, neginf=-MAX_RESIDUAL
        )
        return np.clip(distance, -MAX_RESIDUAL, MAX_RESIDUAL).ravel()

    return residual
