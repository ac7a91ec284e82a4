"""A linear difference equation that simulates an output from its inputs: what a physical model must beat.

``y_k + a_1 y_{k-1} + ... + a_n y_{k-n} = sum_i (b_i0 u_{i,k} + ... + b_in u_{i,k-n}) + c``, with the smallest
simulation error (an output-error model, Ljung 1999, System Identification, section 4.2). It starts from least squares
on the equation itself, and from that on signals filtered by 1/A (Steiglitz and McBride 1965, IEEE Trans. AC-10, 461).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

from iris_sysid.types import Array, Mask

FILTERED = 8  # rounds of least squares on filtered signals
EVEN = 0.01  # largest change of the sample time, relative
RUNAWAY = 1e6  # times the spread of the output at which a simulation counts as diverged


@dataclass(frozen=True, eq=False, slots=True)
class OutputErrorModel:
    """The difference equation of one output: ``feedback`` (n,) a, ``forward`` (m, n + 1) b, ``constant`` c."""

    feedback: Array
    forward: Array
    constant: float

    def simulated(self, inputs: Array, observed: Array, valid: Mask) -> Array:
        """The output (n,) from the inputs (n, m) alone; what came before the record is fitted to the valid samples.

        Parameters
        ----------
        inputs
            (n, m), finite.
        observed, valid
            (n,) the measured output, and where it counts.
        """
        denominator = np.append(1.0, self.feedback)
        driven = sum(lfilter(b, denominator, u) for b, u in zip(self.forward, inputs.T, strict=True))
        driven = driven + lfilter([self.constant], denominator, np.ones(len(inputs)))
        at_rest = np.eye(self.feedback.size)
        free = np.column_stack([lfilter([0.0], denominator, np.zeros(len(inputs)), zi=zi)[0] for zi in at_rest])
        missing = np.linalg.lstsq(free[valid], (observed - driven)[valid], rcond=None)[0]
        return np.asarray(driven + free @ missing)


def output_error_model(inputs: Array, observed: Array, valid: Mask, order: int) -> OutputErrorModel | None:
    """Fit a linear model with the smallest simulation error; None where the record is too short or nothing is stable.

    Parameters
    ----------
    inputs
        (n, m) at even times, finite.
    observed
        (n,) the output.
    valid
        (n,) where it was measured.
    order
        Of the difference equation.
    """
    count = order + inputs.shape[1] * (order + 1) + 1
    if valid.sum() < 4 * count:
        return None
    bridged = np.interp(np.arange(valid.size), np.flatnonzero(valid), observed[valid])
    size = RUNAWAY * max(float(np.std(bridged)), 1e-300)

    def error(values: Array) -> Array:
        with np.errstate(all="ignore"):
            try:
                simulated = _unpacked(values, order).simulated(inputs, bridged, valid)
            except (np.linalg.LinAlgError, ValueError):  # a simulation that is not finite
                return np.full(int(valid.sum()), size)
        return np.clip(np.nan_to_num((bridged - simulated)[valid], nan=size), -size, size)

    starts = _starts(inputs, bridged, valid, order)
    best = min(starts, key=lambda values: float(np.sum(error(values) ** 2)))
    found = least_squares(error, best, x_scale=np.maximum(np.abs(best), 1e-6), max_nfev=100)
    return _unpacked(found.x, order) if np.max(np.abs(error(found.x))) < size else None


def evenly_sampled(t_s: Array) -> bool:
    """Whether all steps between times (n,) s are the same to one per cent."""
    steps = np.diff(t_s)
    return bool(steps.size and np.ptp(steps) <= EVEN * np.median(steps))


def _unpacked(values: Array, order: int) -> OutputErrorModel:
    return OutputErrorModel(values[:order], values[order:-1].reshape(-1, order + 1), float(values[-1]))


def _starts(inputs: Array, observed: Array, valid: Mask, order: int) -> list[Array]:
    """Least squares on the equation, then on the equation filtered by what was found before."""
    starts = [_equation_error(inputs, observed, valid, order, np.ones(1))]
    for _ in range(FILTERED):
        denominator = np.append(1.0, starts[-1][:order])
        if np.max(np.abs(np.roots(denominator)), initial=0.0) >= 1.0:
            break
        starts.append(_equation_error(inputs, observed, valid, order, denominator))
    return starts


def _equation_error(inputs: Array, observed: Array, valid: Mask, order: int, denominator: Array) -> Array:
    """Coefficients a, b, c by least squares on the equation of signals filtered by 1 / denominator."""
    output = lfilter([1.0], denominator, observed - observed[0])
    given = [lfilter([1.0], denominator, u - u[0]) for u in inputs.T]
    rows = np.arange(order, len(output))
    rows = rows[np.convolve(valid, np.ones(order + 1), "valid") == order + 1]
    late = [-output[rows - k] for k in range(1, order + 1)]
    pushed = [u[rows - k] for u in given for k in range(order + 1)]
    found = np.linalg.lstsq(np.column_stack([*late, *pushed, np.ones(rows.size)]), output[rows], rcond=None)[0]
    a, b = found[:order], found[order:-1].reshape(-1, order + 1)
    constant = found[-1] * np.sum(denominator) + (1.0 + np.sum(a)) * observed[0] - np.sum(b, axis=1) @ inputs[0]
    return np.array([*a, *b.ravel(), constant])
