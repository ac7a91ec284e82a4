"""Noise that is known beforehand to last over some samples, for fits too short to see it in their own residual.

Twenty-five samples less what a parabola takes out of them look white whatever they are. Where the tracker says how
long its errors last, that is where the autoregression starts from, and the residual moves it as far as it can.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
from scipy.optimize import minimize

from fitters.noise.autoregression import EDGE, Autoregression, Vector, minus_restricted
from iris_sysid.types import Array, Estimate

NAMES = ("error_memory_1", "error_memory_2")  # in the geometry of a trajectory
SHORT = 100  # samples; more tell each partial autocorrelation to 0.1 by themselves, better than the tracker does
MOST = 0.95  # of the unit circle, for a memory that is stated


def stated_memory(geometry: Mapping[str, Estimate]) -> tuple[Estimate, ...]:
    """Partial autocorrelations of the noise at one and two samples as measured on the way; none where it was not."""
    return tuple(geometry[name] for name in NAMES if name in geometry)


def remembered(residual: Array, basis: Array, memory: tuple[Estimate, ...], alone: Autoregression) -> Autoregression:
    """Autoregression of the largest restricted likelihood times the density of what is known of it beforehand.

    Known are the inverse hyperbolic tangents of the partial autocorrelations, with normal errors. That is for short
    residuals: others, and those whose own order is higher, keep what they tell alone.

    Parameters
    ----------
    residual, basis
        As for :func:`fitters.noise.autoregression.fit_autoregression`.
    memory
        One a partial autocorrelation; may be empty.
    alone
        What the residual tells without them.
    """
    if not memory or alone.n > SHORT or alone.partial.size > len(memory):
        return alone
    known = np.arctanh(np.clip([one.value for one in memory], -MOST, MOST))
    spread = np.array([one.stderr for one in memory]) / (1 - np.tanh(known) ** 2)

    def objective(unbounded: Vector) -> float:
        off = (unbounded - known) / spread
        return minus_restricted(residual, basis, EDGE * np.tanh(unbounded))[0] + float(off @ off)

    found = minimize(objective, cast("Vector", known), method="L-BFGS-B", jac="3-point")
    partial = np.asarray(EDGE * np.tanh(found.x), dtype=np.float64)
    return Autoregression.of(residual, basis, partial)
