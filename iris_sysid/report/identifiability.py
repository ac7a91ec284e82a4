"""The identifiability of a fit as a section of its page: null directions, correlations, one-step residuals."""

from __future__ import annotations

import numpy as np

from iris_sysid.report.page import Section, numbers, words
from iris_sysid.report.text import as_sentence
from iris_sysid.types import FitResult, correlation_matrix

CORRELATED = 0.9  # above this correlation, two values are known only in combination
MAX_PAIRS = 5  # largest number of pairs shown


def identifiability_sections(fit: FitResult) -> list[Section]:
    """One section: undetermined or weakest directions, correlated values, and the one-step residual."""
    known = fit.identifiability
    if known is None or not known.names:
        return []
    lines = [f"Condition number of the scaled Fisher information: {known.condition:.3g}."]
    lines += [f"Not determined: {direction}." for direction in known.undetermined]
    lines += [as_sentence(known.weakest)] if known.weakest and not known.undetermined else []
    lines += _one_step_lines(fit)
    rows = [(first, second, f"{value:+.3f}") for value, first, second in correlations(fit)[:MAX_PAIRS]]
    columns = (*words("value", "correlates with"), *numbers("correlation")) if rows else ()
    return [Section("Identifiability", columns, rows, lines=lines)]


def correlations(fit: FitResult) -> list[tuple[float, str, str]]:
    """Pairs of free values whose errors correlate by more than 0.9, the strongest first."""
    matrix = correlation_matrix(fit.covariance)
    first, second = np.triu_indices(len(fit.free), 1)
    pairs = [(float(matrix[i, j]), fit.free[i], fit.free[j]) for i, j in zip(first, second, strict=True)]
    strong = [pair for pair in pairs if np.isfinite(pair[0]) and abs(pair[0]) > CORRELATED]
    return sorted(strong, key=lambda pair: -abs(pair[0]))


def _one_step_lines(fit: FitResult) -> list[str]:
    """The mean squared residual of one step of the equation from sample to sample, and the part due to noise."""
    known = fit.identifiability
    if known is None:
        return []
    triples = zip(fit.model.observed, known.ode_residual, known.ode_residual_noise, strict=True)
    return [
        f"One-step residual of the equation in {quantity.name}: {residual:.2g} {quantity.unit}² (mean square); the "
        f"noise alone gives {noise:.2g} {quantity.unit}²."
        for quantity, residual, noise in triples
        if np.isfinite(residual) and np.isfinite(noise)
    ]
