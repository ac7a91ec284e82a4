"""Random effects: combine estimates of one value that may differ from clip to clip.

Each clip gives an estimate y_i with variance v_i; the true values scatter about a mean with variance tau^2. The
methods are those of meta-analysis; a clip corresponds to a trial.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from iris_sysid.errors import FitError
from iris_sysid.types import Array, Estimate, Population, chi2_ppf, chi2_sf, student_ppf

WIDEST = 1e3  # upper limit of tau in the search, in units of the scatter of the estimates
MIN_CLIPS = 2


def random_effects(values: Array, stderrs: Array, unit: str) -> Population:
    """Mean over clips and standard deviation between them, by restricted maximum likelihood.

    tau^2 maximises the restricted likelihood (Viechtbauer 2005, J. Educ. Behav. Stat. 30, 261); its interval is
    where the generalised Q has its quantiles (Q-profile: Viechtbauer 2007, Stat. Med. 26, 37). The mean's standard
    error is that of Hartung and Knapp (2001, Stat. Med. 20, 3875), never below the one for tau^2 known (Jackson et
    al. 2017, Stat. Med. 36, 3923), with Student's t for one degree of freedom less than there are clips.

    Parameters
    ----------
    values
        (c,) estimates, one a clip.
    stderrs
        (c,) their random standard errors.
    unit
        Of both.

    Raises
    ------
    FitError
        With fewer than two clips, or a standard error that is not positive.
    """
    y, v = np.asarray(values, dtype=np.float64), np.asarray(stderrs, dtype=np.float64) ** 2
    if y.size < MIN_CLIPS or not np.all(np.isfinite(y) & (v > 0) & np.isfinite(v)):
        raise FitError(f"a scatter between clips needs {MIN_CLIPS} clips with a value and its error each: {values}")
    low, tau, high = between_clips(y, v)
    weight = 1.0 / (v + tau**2)
    mean = float(np.sum(weight * y) / np.sum(weight))
    degrees = y.size - 1
    spread = float(np.sum(weight * (y - mean) ** 2) / degrees)
    stderr = float(np.sqrt(max(spread, 1.0) / np.sum(weight)))
    half = student_ppf(0.975, degrees) * stderr
    q = generalised_q(y, v, 0.0)
    return Population(
        mean=Estimate(mean, stderr, unit, "fitted", f"mean over {y.size} clips", ci95=(mean - half, mean + half)),
        between=Estimate(tau, (high - low) / 4, unit, "fitted", "standard deviation from clip to clip", (low, high)),
        within=float(np.sqrt(degrees / (np.sum(1 / v) - np.sum(1 / v**2) / np.sum(1 / v)))),
        q=q,
        degrees=degrees,
        p_value=chi2_sf(q, degrees),
    )


def generalised_q(y: Array, v: Array, tau_squared: float) -> float:
    """Sum of squared distances from the weighted mean over v + tau^2; chi-squared with c - 1 degrees at the true tau.

    Parameters
    ----------
    y, v
        (c,) estimates and their variances.
    tau_squared
        Variance between clips.
    """
    weight = 1.0 / (v + tau_squared)
    mean = np.sum(weight * y) / np.sum(weight)
    return float(np.sum(weight * (y - mean) ** 2))


def between_clips(y: Array, v: Array) -> tuple[float, float, float]:
    """Standard deviation between clips: lower end of its 95 % interval, estimate, upper end.

    Standard deviations in the unit of the estimates.

    Parameters
    ----------
    y, v
        (c,) estimates and their variances.
    """
    unit = float(np.sqrt(np.var(y, ddof=1) + np.mean(v)))
    y, v = (y - y.mean()) / unit, v / unit**2

    def minus_restricted(tau: float) -> float:
        weight = 1.0 / (v + tau**2)
        return float(-np.sum(np.log(weight)) + np.log(np.sum(weight)) + generalised_q(y, v, tau**2))

    grid = np.concatenate([[0.0], np.geomspace(1e-4, 10.0, 60)])
    best = int(np.argmin([minus_restricted(tau) for tau in grid]))
    around = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    minimum = minimize_scalar(minus_restricted, bounds=around, method="bounded", options={"xatol": 1e-8})
    tau = float(minimum.x) if minus_restricted(float(minimum.x)) < minus_restricted(0.0) - 1e-9 else 0.0
    low, high = (_where_q_is(y, v, chi2_ppf(level, y.size - 1)) for level in (0.975, 0.025))
    return low * unit, tau * unit, high * unit


def _where_q_is(y: Array, v: Array, level: float) -> float:
    """The tau at which the generalised Q falls to ``level``; 0 where Q is below it at tau = 0."""
    if generalised_q(y, v, 0.0) <= level:
        return 0.0
    return float(brentq(lambda tau: generalised_q(y, v, tau**2) - level, 0.0, WIDEST, xtol=1e-10))
