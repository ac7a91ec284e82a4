"""The solution inside a step: the continuous extension of the method, for samples between the ends of its steps.

Where a motion is sampled more often than the method of order 8 needs steps, a step for every sample is waste. Within a
step the solution is the polynomial of order 7 of Hairer, Norsett and Wanner (1993, Solving Ordinary Differential
Equations I, section II.6).
"""

from __future__ import annotations

from fitters.integrator.dop853_coefficients import EXTENDED, POLYNOMIAL, STAGES
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

TERMS = 7  # of the polynomial


@kernel(inline="always")
def _polynomial(before: Array, after: Array, slopes: Array, step_s: float, out: Array) -> None:
    """Fill out (7, s, c) with the coefficients of the extension over a step."""
    for i in range(before.shape[0]):
        for c in range(before.shape[1]):
            change = after[i, c] - before[i, c]
            out[0, i, c] = change
            out[1, i, c] = step_s * slopes[0, i, c] - change
            out[2, i, c] = 2.0 * change - step_s * (slopes[STAGES, i, c] + slopes[0, i, c])
            for row in range(POLYNOMIAL.shape[0]):
                total = 0.0
                for j in range(EXTENDED):
                    total += POLYNOMIAL[row, j] * slopes[j, i, c]
                out[3 + row, i, c] = step_s * total


@kernel(inline="always")
def _evaluated(before: Array, terms: Array, x: float, out: Array) -> None:
    """Fill out (s, c) with the state at the fraction x of a step."""
    for i in range(before.shape[0]):
        for c in range(before.shape[1]):
            value = 0.0
            for k in range(TERMS - 1, -1, -1):
                value = (value + terms[k, i, c]) * (x if k % 2 == 0 else 1.0 - x)
            out[i, c] = before[i, c] + value
