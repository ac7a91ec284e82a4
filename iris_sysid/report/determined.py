"""What the data determine of a fit, for its page: directions in words, correlations, what one step of it misses."""

from __future__ import annotations

import numpy as np

from iris_sysid.report.page import Section
from iris_sysid.types import FitResult

CORRELATED = 0.9  # beyond that two values are said to be known only together
MOST = 5  # pairs shown


def determined_sections(fit: FitResult) -> list[Section]:
    """One section: what is undetermined or known least, which values hang together, and the misfit of one step."""
    known = fit.identifiability
    if known is None or not known.names:
        return []
    lines = [f"Condition number of the scaled Fisher information: {known.condition:.3g}."]
    lines += [f"Not determined: {text}." for text in known.undetermined]
    lines += [f"{known.weakest[:1].upper()}{known.weakest[1:]}."] if known.weakest and not known.undetermined else []
    lines += [_step_text(*one) for one in _steps(fit)]
    rows = [(first, second, f"{value:+.3f}") for value, first, second in correlations(fit)[:MOST]]
    columns = ("value", "with", "#correlation") if rows else ()
    return [Section("What the data determine", columns, rows, lines=lines)]


def correlations(fit: FitResult) -> list[tuple[float, str, str]]:
    """Pairs of free values whose errors correlate by more than 0.9, the strongest first."""
    size = np.sqrt(np.diag(fit.covariance))
    with np.errstate(all="ignore"):
        matrix = fit.covariance / np.outer(size, size)
    first, second = np.triu_indices(len(fit.free), 1)
    pairs = [(float(matrix[i, j]), fit.free[i], fit.free[j]) for i, j in zip(first, second, strict=True)]
    strong = [one for one in pairs if np.isfinite(one[0]) and abs(one[0]) > CORRELATED]
    return sorted(strong, key=lambda one: -abs(one[0]))


def _steps(fit: FitResult) -> list[tuple[str, str, float, float]]:
    known = fit.identifiability
    if known is None:
        return []
    triples = zip(fit.model.observed, known.ode_residual, known.ode_residual_noise, strict=True)
    return [
        (one.name, f"{one.unit}²", float(found), float(noise))
        for one, found, noise in triples
        if np.isfinite(found) and np.isfinite(noise)
    ]


def _step_text(name: str, unit: str, found: float, noise: float) -> str:
    return (
        f"From sample to sample the equation misses {name} by {found:.2g} {unit} (mean square); noise alone makes it "
        f"{noise:.2g} {unit}."
    )
