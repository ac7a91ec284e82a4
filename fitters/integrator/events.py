"""Integrate through events: the step in which one falls is taken again, exactly as long as it takes to reach it.

An event is where its crossing function falls through zero. The root is found over the length of the step, each trial
being a step of the integrator itself (:mod:`fitters.integrator.dormand_prince`), so that the state at the event has
the order of the method, and the solution beyond is a smooth function of the parameters: differences of columns, each
with its own time
of the event, carry the jump of the sensitivities (the saltation matrix: Leine and Nijmeijer 2004, Dynamics and
Bifurcations of Non-Smooth Mechanical Systems, section 7.2) without its being formed.

A state is followed by its mode, a whole number that says which equation holds; its derivative is zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import boolean, int64, types
from numpy.typing import NDArray

from fitters.integrator.dop853_coefficients import NODES, STAGES
from fitters.integrator.dormand_prince import _COLUMNS, _CUBE, _MATRIX, _VECTOR, _inputs_at, _weighted
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

_FUNCTIONS = types.Tuple((int64, _COLUMNS, _COLUMNS, _COLUMNS))

# After an event steps begin this much shorter and double, so that a flight from bounce to bounce is not stepped over.
FIRST_STEP = 2.0**-10
MAX_EVENTS = 1000  # in one sample interval: more pile up without end
ROUNDING = 1e-9  # of a step: the remainder of an interval is not worth a step of its own
ROOT_TRIALS = 60  # the root is there to rounding after 10; a crossing function that jumps is halved to nothing
BESIDE_ZERO = 1e-10  # of the largest crossing value so far: below, it cannot be told from zero


@kernel()
def _step(
    functions: Any, t: float, length: float, state: Array, params: Array, around: Any, slopes: Array, out: Array
) -> None:
    """Write the state after one step of the given length; ``around`` are the inputs at the ends of the interval."""
    start_s, stop_s, before, after, linear, now = around
    for stage in range(STAGES):
        _weighted(state, slopes, stage, length, out)
        moment = t + NODES[stage] * length
        if now.size > 0:
            _inputs_at((moment - start_s) / (stop_s - start_s), before, after, linear, now)
        functions[1](moment, out, params, now, slopes[stage])
    _weighted(state, slopes, STAGES, length, out)


@kernel()
def _crossings(functions: Any, t: float, state: Array, params: Array, around: Any, out: Array) -> None:
    """Write the crossing functions (e, 1) of a state."""
    start_s, stop_s, before, after, linear, now = around
    if now.size > 0:
        _inputs_at((t - start_s) / (stop_s - start_s), before, after, linear, now)
    functions[2](t, state, params, now, out)


@kernel()
def _length_to_root(
    functions: Any,
    which: int,
    t: float,
    length: float,
    values: tuple[float, float],
    state: Array,
    params: Array,
    around: Any,
    work: Any,
) -> float:
    """Length of the step at whose end a crossing function is zero; ``values`` at length 0 and at ``length``.

    Illinois' variant of false position (Dowell and Jarratt 1971, BIT 11, 168).
    """
    slopes, trial, crossing, _ = work
    low, high = 0.0, length
    at_low, at_high = values
    nearest, smallest, side = length, abs(at_high), 0
    for _ in range(ROOT_TRIALS):
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < middle < high:
            break
        _step(functions, t, middle, state, params, around, slopes, trial)
        _crossings(functions, t + middle, trial, params, around, crossing)
        value = crossing[which, 0]
        if abs(value) < smallest:
            nearest, smallest = middle, abs(value)
        if value > 0:
            low, at_low = middle, value
            at_high = 0.5 * at_high if side == 1 else at_high
            side = 1
        else:
            high, at_high = middle, value
            at_low = 0.5 * at_low if side == -1 else at_low
            side = -1
    return nearest


@kernel()
def _first_event(
    functions: Any, t: float, length: float, crossing: Any, state: Array, params: Array, around: Any, work: Any
) -> tuple[int, float]:
    """Which event comes first within the step, -1 for none, and the length of the step up to it."""
    before, after, armed, noise = crossing
    first, earliest = -1, length
    for which in range(before.shape[0]):
        if armed[which] and after[which, 0] <= 0.0:
            values = (before[which, 0], after[which, 0])
            root = _length_to_root(functions, which, t, length, values, state, params, around, work)
            if first < 0 or root < earliest:
                first, earliest = which, root
        elif not armed[which] and after[which, 0] < min(-noise[which], before[which, 0]) and first < 0:
            first = which  # it never came up, and falls again: it happens without a root, at the end of a short step
    return first, earliest


@kernel()
def _arm(crossing: Any) -> None:
    """Arm the events whose crossing function is above zero."""
    before, _, armed, noise = crossing
    for which in range(before.shape[0]):
        noise[which] = max(noise[which], BESIDE_ZERO * abs(before[which, 0]))
        armed[which] = before[which, 0] > noise[which] or (armed[which] and before[which, 0] > 0.0)


@kernel()
def _happen(
    functions: Any, first: int, t: float, crossing: Any, state: Array, params: Array, around: Any, work: Any
) -> None:
    """Put the state after the event in place of the one at it, and look anew at what may come next."""
    _, trial, _, reset = work
    before, _, armed, _ = crossing
    reset[-1, 0] = first
    functions[3](t, trial, params, around[5], reset)
    state[:, 0] = reset[:-1, 0]
    _crossings(functions, t, state, params, around, before)
    armed[:] = False
    _arm(crossing)
    armed[first] = False


@kernel()
def _begin(functions: Any, crossing: Any, state: Array, params: Array, around: Any, work: Any) -> None:
    """Let happen at once what is beyond its crossing at the start."""
    before, _, _, noise = crossing
    _, trial, _, _ = work
    _crossings(functions, around[0], state, params, around, before)
    _arm(crossing)
    for which in range(before.shape[0]):
        if before[which, 0] < -noise[which]:
            trial[:] = state
            _happen(functions, which, around[0], crossing, state, params, around, work)


@kernel()
def _interval(
    functions: Any,
    usual: float,
    length: float,
    crossing: Any,
    state: Array,
    params: Array,
    around: Any,
    work: Any,
    happened: Array,
    logged: int,
) -> tuple[float, int]:
    """Bring the state to the end of a sample interval; gives the length of the last step, and the events so far.

    The state is NaN where it diverges or events pile up without end.
    """
    slopes, trial, _, _ = work
    before, after, _, _ = crossing
    t, left, most = around[0], around[1] - around[0], logged + MAX_EVENTS
    while logged < most:
        taken = min(length, usual)
        taken = left if left < (1 + ROUNDING) * taken else taken
        _step(functions, t, taken, state, params, around, slopes, trial)
        _crossings(functions, t + taken, trial, params, around, after)
        first, root = _first_event(functions, t, taken, crossing, state, params, around, work)
        if first < 0:
            state[:], before[:] = trial, after
            t, left, length = t + taken, left - taken, 2.0 * taken
            _arm(crossing)
        else:
            _step(functions, t, root, state, params, around, slopes, trial)
            t, left, length = t + root, left - root, FIRST_STEP * usual
            _happen(functions, first, t, crossing, state, params, around, work)
            if logged < happened.shape[0]:
                happened[logged, 0], happened[logged, 1] = t, first
            logged += 1
        if left <= 0.0 or not np.all(np.isfinite(state)):
            return max(length, FIRST_STEP * usual), logged
    state[:] = np.nan
    return length, logged


@kernel(types.void(_FUNCTIONS, _VECTOR, int64[::1], _MATRIX, _MATRIX, _MATRIX, boolean, _CUBE, _CUBE))
def integrate_through_events(
    functions: Any,
    t_s: Array,
    substeps: NDArray[np.int64],
    initial: Array,
    params: Array,
    inputs: Array,
    linear: bool,
    out: Array,
    happened: Array,
) -> None:
    """Fill ``out`` with the states at every sample, for every column, through the events on the way.

    Parameters
    ----------
    functions
        The number e of events, then three functions with the arguments ``(t, states (s + 1, 1), params (p, 1),
        inputs (m,), out)``, the mode being the last state: dstate/dt; the crossing functions (e, 1); the state right
        after the event of number ``out[-1]`` (s + 2, 1).
    t_s, substeps, initial, params, inputs, linear, out
        As for :func:`fitters.integrator.dormand_prince.integrate`.
    happened
        (k, 2, c), written: time and number of the first k events of each column; NaN where there were fewer.
    """
    n, n_events = initial.shape[0], functions[0]
    state, own = np.zeros((n + 1, 1)), np.zeros((params.shape[0], 1))
    work = (np.zeros((STAGES, n + 1, 1)), np.zeros((n + 1, 1)), np.zeros((n_events, 1)), np.zeros((n + 2, 1)))
    crossing = (np.zeros((n_events, 1)), np.zeros((n_events, 1)), np.zeros(n_events, np.bool_), np.zeros(n_events))
    now, log = np.zeros(inputs.shape[1]), np.empty(happened.shape[:2])
    for c in range(initial.shape[1]):
        own[:, 0], state[:n, 0], state[n, 0] = params[:, c], initial[:, c], 0.0
        crossing[2][:], crossing[3][:], log[:] = False, 0.0, np.nan
        length, logged = np.inf, 0
        out[0, :, c] = state[:n, 0]
        for k in range(t_s.size - 1):
            around = (t_s[k], t_s[k + 1], inputs[k], inputs[k + 1], linear, now)
            if k == 0:
                _begin(functions, crossing, state, own, around, work)
            usual = (t_s[k + 1] - t_s[k]) / substeps[k]
            length, logged = _interval(functions, usual, length, crossing, state, own, around, work, log, logged)
            out[k + 1, :, c] = state[:n, 0]
        happened[:, :, c] = log
