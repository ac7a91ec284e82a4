"""The posterior of a finished fit, sampled by emcee: the shape of what covariance and intervals summarise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType
from typing import TYPE_CHECKING, cast

import numpy as np
import pandas as pd

from fitters.ode.lmfit_minimizer import lmfit_minimizer
from iris_sysid.errors import DataError, FitError
from iris_sysid.types import Array, FitResult, Quantity, Trajectory

if TYPE_CHECKING:
    import lmfit

MIN_STEPS = 100
BURNT = 0.25  # share of the steps that are left out: the walkers begin as the fit's covariance has them
LONG_ENOUGH = 50  # autocorrelation times, below which emcee does not trust its estimate of them
STEP = 0.01  # standard errors by which a value is changed to find how the residual responds


@dataclass(frozen=True, eq=False, slots=True)
class PosteriorSample:
    """Draws from the posterior of the free values of a fit.

    ``names`` (k,) and ``units`` (k,) of the values, ``chain`` (n, k) in these units, and the integrated
    ``autocorrelation`` time (k,) in steps: n over it is the effective number of draws of a value. ``accepted``: share
    of the proposals; between 0.2 and 0.5 is good. ``converged`` tells whether each walker took more steps than
    LONG_ENOUGH autocorrelation times; if not, sample more steps.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    chain: Array
    autocorrelation: Array
    accepted: float
    converged: bool

    def summary(self, level: float = 0.95) -> pd.DataFrame:
        """Mean, standard deviation, central interval of this probability, effective number of draws; a row a value."""
        low, high = np.quantile(self.chain, [(1 - level) / 2, (1 + level) / 2], axis=0)
        columns = {
            "mean": self.chain.mean(axis=0),
            "stdev": self.chain.std(axis=0, ddof=1),
            "low": low,
            "high": high,
            "unit": self.units,
            "effective_draws": len(self.chain) / self.autocorrelation,
        }
        return pd.DataFrame(columns, index=pd.Index(self.names, name="parameter"))

    def frame(self) -> pd.DataFrame:
        """The draws (n, k), a column a value; its name ends with the unit."""
        titles = [Quantity(name, unit).title for name, unit in zip(self.names, self.units, strict=True)]
        return pd.DataFrame(self.chain, columns=titles)

    def __repr__(self) -> str:
        return f"PosteriorSample of {len(self.names)} values, {len(self.chain)} draws"


def sample_posterior(
    fitted: FitResult, trajectory: Trajectory, *, steps: int = 1000, walkers: int | None = None, seed: int = 0
) -> PosteriorSample:
    """Sample the posterior of the free values of a fit by emcee's affine-invariant ensemble.

    The prior is uniform within the model's bounds; values that the fit held stay. The likelihood is that of white
    noise, with its curvature adjusted to the fit's ``covariance`` (Ribatet, Cooley and Davison 2012, Statistica Sinica
    22, 813, section 2.2): where the residual is autocorrelated the draws scatter as widely as the fit's standard errors
    say, and keep the shape of the likelihood. Sampler: Foreman-Mackey et al. (2013), PASP 125, 306.

    Parameters
    ----------
    fitted
        A usable fit whose covariance is finite.
    trajectory
        The fitted trajectory; it gives the inputs of a driven model.
    steps
        Of each walker, at least MIN_STEPS; the first quarter is left out.
    walkers
        At least twice the number of free values; four times if None.
    seed
        Of the random numbers.

    Raises
    ------
    DataError
        When emcee is not installed, or steps or walkers are too few.
    FitError
        When the fit has no estimates, no free values, or a combination of values is undetermined.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import Quantity, Trajectory, fit, model_from_equation, sample_posterior
    >>> t_s = np.arange(40) / 40
    >>> z = (np.exp(-2 * t_s) + 1e-3 * np.random.default_rng(0).standard_normal(40))[:, None]
    >>> clip = Trajectory(t_s, (Quantity("z", "m"),), z, np.full_like(z, 1e-3), np.ones(40, bool))
    >>> fitted = fit(clip, model_from_equation("z' = -k*z"))
    >>> sampled = sample_posterior(fitted, clip, steps=200)
    >>> bool(abs(sampled.summary()["mean"]["k"] - fitted.estimates["k"].value) < fitted.estimates["k"].stderr)
    True
    """
    names = fitted.free
    count = 4 * len(names) if walkers is None else walkers
    if steps < MIN_STEPS or count < 2 * len(names):
        raise DataError(
            f"{steps} steps of {count} walkers are too few: give at least {MIN_STEPS} steps, "
            f"and {2 * len(names)} walkers for {len(names)} free values"
        )
    emcee = emcee_module()
    density = _Density.of(fitted, trajectory)
    lower, upper = _bounds(fitted, density)

    def within_bounds(deviation: Array) -> float:
        return density(deviation) if np.all((deviation >= lower) & (deviation <= upper)) else -np.inf

    drawn = np.random.default_rng(seed).multivariate_normal(np.zeros(len(names)), density.correlation, size=count)
    sampler = emcee.EnsembleSampler(count, len(names), within_bounds)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(np.clip(drawn, lower, upper), steps)
    burnt = int(BURNT * steps)
    times = sampler.get_autocorr_time(discard=burnt, tol=0)
    lasting = np.asarray(np.where(np.isfinite(times), np.maximum(times, 1.0), steps - burnt))
    chain = density.estimate + density.errors * np.asarray(sampler.get_chain(discard=burnt, flat=True))
    return PosteriorSample(
        tuple(names),
        tuple(fitted.estimates[name].unit for name in names),
        chain,
        lasting,
        float(np.mean(sampler.acceptance_fraction)),
        bool(np.all(LONG_ENOUGH * lasting <= steps - burnt)),
    )


def emcee_module() -> ModuleType:
    """The package emcee; DataError with the command that installs it where it is absent."""
    try:
        import emcee
    except ImportError as error:
        raise DataError("sampling needs emcee: pip install 'iris-sysid[posterior]'") from error
    return cast(ModuleType, emcee)


@dataclass(frozen=True, eq=False, slots=True)
class _Density:
    """The density of the free values ``names`` (k,) about the ``estimate``, in units of the standard ``errors``.

    ``correlation`` (k, k) is that of the fit, and ``adjustment`` (k, k) maps a deviation to the one at which white
    noise has the likelihood that the fit's covariance gives it.
    """

    minimizer: lmfit.Minimizer
    names: tuple[str, ...]
    estimate: Array
    errors: Array
    correlation: Array
    adjustment: Array

    @classmethod
    def of(cls, fitted: FitResult, trajectory: Trajectory) -> _Density:
        minimizer, names = lmfit_minimizer(fitted, trajectory), tuple(fitted.free)
        estimate = np.array([fitted.estimates[name].value for name in names])
        errors = np.sqrt(np.diag(fitted.covariance))
        missing = [name for name, error in zip(names, errors, strict=True) if not (np.isfinite(error) and error > 0)]
        if missing or not names:
            raise FitError(
                f"{', '.join(missing) or 'all values'} cannot be sampled: the fit gives no standard error; "
                "hold a value that is at its bound (fixed), and leave another free"
            )
        correlation = fitted.covariance / np.outer(errors, errors)
        plain = cls(minimizer, names, estimate, errors, correlation, np.eye(len(names)))
        return replace(plain, adjustment=plain.curvature_adjustment())

    def curvature_adjustment(self) -> Array:
        """C (k, k) with C' W C = inverse correlation, for the information W of white noise by differences."""
        steps = STEP * np.eye(len(self.names))
        response = np.array([(self.residual(step) - self.residual(-step)) / (2 * STEP) for step in steps])
        try:
            root = np.linalg.cholesky(response @ response.T)
            return np.asarray(np.linalg.solve(root.T, np.linalg.cholesky(np.linalg.inv(self.correlation)).T))
        except np.linalg.LinAlgError as error:
            raise FitError("a combination of values is undetermined and cannot be sampled: set one (fixed)") from error

    def residual(self, deviation: Array) -> Array:
        """Residual (n,) in units of the noise at a deviation (k,) in standard errors."""
        for name, value in zip(self.names, self.estimate + self.errors * deviation, strict=True):
            self.minimizer.params[name].set(value=float(value), min=-np.inf, max=np.inf)
        return np.asarray(self.minimizer.userfcn(self.minimizer.params))

    def __call__(self, deviation: Array) -> float:
        """Logarithm of the density, but for a constant."""
        return -0.5 * float(np.sum(self.residual(self.adjustment @ deviation) ** 2))


def _bounds(fitted: FitResult, density: _Density) -> tuple[Array, Array]:
    """The model's bounds (k,) of the free values, as deviations in standard errors."""
    ends = {parameter.name: (parameter.lower, parameter.upper) for parameter in fitted.model.parameters}
    lower, upper = np.array([ends.get(name, (-np.inf, np.inf)) for name in density.names]).T
    return (lower - density.estimate) / density.errors, (upper - density.estimate) / density.errors
