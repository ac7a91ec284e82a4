"""A fit as text: the report that users of lmfit know, with the errors of this package."""

from __future__ import annotations

import numpy as np

from iris_sysid.errors import FitError
from iris_sysid.types import Estimate, FitResult, correlation_matrix

MIN_CORRELATION = 0.1  # as lmfit's default


def fit_report(fitted: FitResult, min_correl: float = MIN_CORRELATION) -> str:
    """Text with the statistics of a fit, its values with standard errors, and their correlations, as lmfit writes it.

    The errors are those of :class:`FitResult`, all sources of the budget together; the correlations belong to the same
    covariance (``total_covariance``).

    Parameters
    ----------
    fitted
        The fit.
    min_correl
        Smallest absolute correlation that is listed.

    Returns
    -------
    str
        Lines below the headings ``[[Model]]``, ``[[Fit Statistics]]``, ``[[Variables]]``, ``[[Constants]]`` and
        ``[[Correlations]]``.

    Raises
    ------
    FitError
        When the fit has no estimates.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, fit, fit_report, simulate
    >>> fall, t_s = MODELS["free-fall"], np.arange(60) / 60
    >>> z = simulate(fall, t_s, {"gravity": 9.81, "z_0": 5.0, "vz_0": 0.0}).observed
    >>> z += 1e-3 * np.random.default_rng(0).standard_normal(z.shape)
    >>> clip = Trajectory(t_s, fall.observed, z, np.full_like(z, np.nan), np.ones(60, bool))
    >>> print(fit_report(fit(clip, fall)).splitlines()[0])
    [[Model]]
    """
    if not fitted.usable:
        raise FitError(f"the fit has no estimates to report ({fitted.status}): {fitted.message}")
    variables = {name: fitted.estimates[name] for name in fitted.free}
    others = {name: estimate for name, estimate in fitted.estimates.items() if name not in variables}
    return "\n".join(
        [
            "[[Model]]",
            f"    {fitted.model.name}: {fitted.model.equation}",
            "[[Fit Statistics]]",
            *_statistics(fitted),
            "[[Variables]]",
            *_lines(variables),
            *(["[[Constants and derived values]]", *_lines(others)] if others else []),
            *_correlations(fitted, min_correl),
        ]
    )


def _statistics(fitted: FitResult) -> list[str]:
    quantities = zip(fitted.model.observed, fitted.rms, fitted.noise, strict=True)
    return [
        f"    # data points      = {fitted.n}",
        f"    # variables        = {len(fitted.free)}",
        *(
            f"    residual of {q.name:<6} = {rms:.4g} {q.unit} rms; noise {noise:.4g} {q.unit}"
            for q, rms, noise in quantities
        ),
        f"    Akaike info crit   = {fitted.aic:.6g}",
        f"    Bayesian info crit = {fitted.bic:.6g}",
        f"    verdict            = {fitted.verdict.text}",
    ]


def _lines(estimates: dict[str, Estimate]) -> list[str]:
    width = max(map(len, estimates), default=0) + 1
    return [f"    {f'{name}:':<{width}} {_value(estimate)}" for name, estimate in estimates.items()]


def _value(estimate: Estimate) -> str:
    unit = "" if estimate.unit in ("", "1") else f" {estimate.unit}"
    if np.isnan(estimate.value):
        return "not known"
    if not estimate.stderr > 0:
        return f"{estimate.value:.7g}{unit}" + ("" if estimate.stderr == 0 else " (not determined)")
    share = f" ({100 * abs(estimate.stderr / estimate.value):.2f}%)" if estimate.value else ""
    return f"{estimate.value:.7g} +/- {estimate.stderr:.3g}{unit}{share}"


def _correlations(fitted: FitResult, min_correl: float) -> list[str]:
    """Pairs of values from the most to the least correlated, below a heading with the smallest correlation listed."""
    matrix, names = correlation_matrix(fitted.total_covariance), fitted.free
    pairs = {(names[i], names[j]): matrix[i, j] for i, j in zip(*np.triu_indices(len(names), 1), strict=True)}
    listed = {pair: value for pair, value in pairs.items() if np.isfinite(value) and abs(value) >= min_correl}
    if not listed:
        return []
    ordered = sorted(listed.items(), key=lambda item: -abs(item[1]))
    return [
        f"[[Correlations]] (unreported correlations are < {min_correl:.3f})",
        *(f"    C({first}, {second}) = {value:+.4f}" for (first, second), value in ordered),
    ]
