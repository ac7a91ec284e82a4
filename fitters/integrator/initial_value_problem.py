"""The initial value problem of one model at the samples of one trajectory, and its sensitivities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitters.integrator.compile_rhs import CompiledRhs, compiled_rhs, substeps_of
from fitters.integrator.dormand_prince import ORDER, slopes_along
from fitters.integrator.hidden_states import follow_hidden
from fitters.integrator.step_control import graded
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Hold, OdeModel

MAX_STEPS = (64, 20_000)  # for each sample, and in all if that is more; a problem that needs more is stiff
BATCH_NUMBERS = 4_000_000  # numbers in the states of one batch of columns: 32 MB
PLANNED = 2000  # samples by which steps of a model with events are chosen
SIZED = 1e-3  # error of the solution that tells the size of each state
STEPS_ADDING = 10  # of its steps, over which errors of the final ones add up to the largest of them
KINK = 0.05  # of what all kinks together may be off, the error of the step at one
FAR = 0.1  # change of the prediction by a first step, relative to the motion, that tells no derivative
SHORTENED, MAX_SHORTENED = 1e-3, 6  # factor on such a step, and how often it is applied
RESPONSE = 1e-4  # change of the prediction that a difference step aims at, relative to the motion


def value_names(model: OdeModel) -> tuple[str, ...]:
    """Names of everything that fixes a solution: the parameters, then the initial states ``<state>_0``."""
    return (*(p.name for p in model.parameters), *(f"{state.name}_0" for state in model.states))


@dataclass(frozen=True, eq=False, slots=True)
class InitialValueProblem:
    """A model at given times.

    ``t_s`` (n,) s, where the initial states hold at the first; ``inputs`` (n, m);
    ``ends`` (k + 1,) where each of k steps begins and the last one ends, in samples: 2.5 is in the middle between those
    of numbers 2 and 3. Vectors of values are in the order of :func:`value_names`.
    """

    model: OdeModel
    rhs: CompiledRhs
    t_s: Array
    inputs: Array
    hold: Hold
    ends: Array

    def states(self, columns: Array) -> Array:
        """States (n, s, c) for c columns of values (p + s, c)."""
        if self.model.warp is None and self.model.drive is None:
            return self._integrated(self.t_s, columns, self.inputs)
        states = np.empty((self.t_s.size, len(self.model.states), columns.shape[1]))
        for (times, inputs), alike in self._by_times_and_inputs(columns):
            states[:, :, alike] = self._warped(times, columns[:, alike], inputs)
        return states

    def _by_times_and_inputs(self, columns: Array) -> list[tuple[tuple[Array, Array], list[int]]]:
        """The times (n,) s and inputs (n, m) that act, each with the columns that they are of: few values move them."""
        groups: dict[tuple[bytes, bytes], tuple[tuple[Array, Array], list[int]]] = {}
        for c, params in enumerate(columns[: len(self.model.parameters)].T):
            known = self._times(params), self.acting(params)
            groups.setdefault((known[0].tobytes(), known[1].tobytes()), (known, []))[1].append(c)
        return list(groups.values())

    def _times(self, params: Array) -> Array:
        """The times (n,) s that the samples really show; ``params`` (p,), each in its own unit."""
        if self.model.warp is None:
            return self.t_s
        return np.ascontiguousarray(self.model.warp(self.t_s, params), dtype=np.float64)

    def _warped(self, times: Array, columns: Array, inputs: Array) -> Array:
        """States (n, s, c) at the times that the samples really show; NaN where time would run backwards."""
        if not np.all(np.diff(times) > 0):
            return np.full((self.t_s.size, len(self.model.states), columns.shape[1]), np.nan)
        return self._integrated(times, columns, inputs)

    def acting(self, params: Array) -> Array:
        """The inputs (n, m) that really act at the samples; ``params`` (p,), each in its own unit."""
        if self.model.drive is None:
            return self.inputs
        return np.ascontiguousarray(self.model.drive(self.t_s, self.inputs, params), dtype=np.float64)

    def driven(self, params: Array) -> InitialValueProblem:
        """The problem with the inputs that act for these ``params`` (p,), each in its own unit, as known ones."""
        return replace(self, model=replace(self.model, drive=None), inputs=self.acting(params))

    def _integrated(self, t_s: Array, columns: Array, inputs: Array) -> Array:
        n_params = len(self.model.parameters)
        params, initial = np.ascontiguousarray(columns[:n_params]), np.ascontiguousarray(columns[n_params:])
        out = np.empty((t_s.size, *initial.shape))
        linear = self.hold == "linear"
        self.rhs.integrate(self.rhs.columns, t_s, self.ends, initial, params, inputs, linear, out)
        return out

    def slopes(self, states: Array, params: Array) -> Array:
        """Derivatives by time (n, s) of states (n, s) at the samples, ``params`` (p,); with events, those at first."""
        return self.slopes_of(states, params[:, None])[:, :, 0]

    def slopes_of(self, states: Array, columns: Array) -> Array:
        """Derivatives as of :meth:`slopes` (n, s, c) for c columns of parameters (p, c)."""
        count = columns.shape[1]
        if self.model.drive is not None and count > 1:
            return np.concatenate([self.slopes_of(states, columns[:, c : c + 1]) for c in range(count)], axis=2)
        mode = np.zeros((self.t_s.size, 1 if self.model.events else 0))
        taken = np.repeat(np.hstack([states, mode])[:, :, None], count, axis=2)
        rhs, out = self.rhs.columns[1] if self.model.events else self.rhs.columns, np.zeros(taken.shape)
        along = slopes_along.py_func if self.rhs.note else slopes_along  # a note: it runs in plain Python
        along(rhs, self.t_s, taken, np.ascontiguousarray(columns), self.acting(columns[:, 0]), out)
        return out[:, : states.shape[1]]

    def with_hidden(self, own: Array, params: Array) -> Array:
        """States (n, s) whose hidden ones follow along the own ones (n, o), from zero; ``params`` (p,)."""
        if not self.model.hidden:
            return own
        states = np.hstack([own, np.zeros((len(own), self.model.hidden))])[:, :, None]
        along = follow_hidden.py_func if self.rhs.note else follow_hidden  # a note: it runs in plain Python
        with np.errstate(all="ignore"):
            along(self.rhs.columns, self.t_s, states, params[:, None].copy(), self.acting(params), own.shape[1])
        return states[:, :, 0]

    def observe(self, states: Array, values: Array) -> Array:
        """Observed quantities (n, d) of states (n, s)."""
        if self.model.observe is None:
            names = [state.name for state in self.model.states]
            return states[:, [names.index(quantity.name) for quantity in self.model.observed]]
        try:
            with np.errstate(all="ignore"):
                params = values[: len(self.model.parameters)]
                seen = np.asarray(self.model.observe(self.t_s, states, params), dtype=np.float64)
        except Exception as error:
            raise FitError(
                f"observe of model {self.model.name!r} raises {type(error).__name__}: {error}; it is called as "
                f"observe(t_s (n,), states (n, {states.shape[1]}), params ({len(self.model.parameters)},)) with arrays"
            ) from error
        shape = (states.shape[0], len(self.model.observed))
        if seen.shape != shape:
            raise FitError(f"observe of model {self.model.name!r} must return an array {shape}, not {seen.shape}")
        return seen

    def predicted(self, values: Array) -> Array:
        """Observed quantities (n, d) of the solution; not finite where it diverges.

        In the observed units; ``values`` (p + s,), each in its own unit.
        """
        return self.observe(np.ascontiguousarray(self.states(values[:, None])[:, :, 0]), values)

    def sensitivity(self, values: Array, which: NDArray[np.intp], steps: Array) -> Array:
        """Derivatives of the prediction by k values (n, d, k): central differences with the same time steps.

        In the observed unit per unit of the value; ``values`` (p + s,) and ``steps`` (k,), each in its own unit.

        The error is third order in the step: about RESPONSE^2 / 6 of the sensitivity when the steps are
        those of :func:`difference_steps`, and about 1e-15 / RESPONSE from rounding.
        """
        above, below = self._moved(values, which, steps), self._moved(values, which, -steps)
        with np.errstate(all="ignore"):
            return np.asarray((above - below) / (2.0 * steps))

    def rough_sensitivity(self, values: Array, which: NDArray[np.intp], steps: Array, predicted: Array) -> Array:
        """Derivatives of the prediction (n, d, k) at half the cost, from the prediction (n, d) on one side.

        The error is RESPONSE / 100 for a hundredth of the steps above: enough to find a minimum.

        Parameters
        ----------
        values
            (p + s,) parameters and initial states, each in its own unit.
        which
            (k,) indices of the values to vary.
        steps
            (k,) in the units of those values.
        predicted
            (n, d) at ``values``, in the observed units; the derivatives are in these per unit of a value.
        """
        with np.errstate(all="ignore"):
            return np.asarray((self._moved(values, which, steps / 100) - predicted[:, :, None]) / (steps / 100))

    def _moved(self, values: Array, which: NDArray[np.intp], steps: Array) -> Array:
        """Predictions (n, d, k), each with one value moved by its step."""
        columns = np.repeat(values[:, None], which.size, axis=1)
        columns[which, np.arange(which.size)] += steps
        return self.predictions(columns)

    def predictions(self, columns: Array) -> Array:
        """Observed quantities (n, d, c) for c columns of values (p + s, c), in batches."""
        count = columns.shape[1]
        out = np.empty((self.t_s.size, len(self.model.observed), count))
        batch = max(1, BATCH_NUMBERS // (self.t_s.size * len(self.model.states)))
        for start in range(0, count, batch):
            part = columns[:, start : start + batch]
            states = self.states(part)
            for c in range(part.shape[1]):
                out[:, :, start + c] = self.observe(np.ascontiguousarray(states[:, :, c]), part[:, c])
        return out

    def first(self, n: int) -> InitialValueProblem:
        """The problem up to its n-th sample, or to its last."""
        return self.part(0, min(n, self.t_s.size) - 1)

    def part(self, start: int, stop: int) -> InitialValueProblem:
        """The problem from one sample to another, both included, with the same steps."""
        inside = self.ends[(self.ends > start) & (self.ends < stop)]
        ends = np.concatenate([[start], inside, [stop]])[: stop - start + inside.size + 1] - start
        span = slice(start, stop + 1)
        return replace(self, t_s=self.t_s[span], inputs=self.inputs[span], ends=ends)

    def every(self, k: int) -> InitialValueProblem:
        """The problem at every k-th sample, for a model without inputs, with one step in each sample interval."""
        t_s = self.t_s[::k].copy()
        return replace(self, t_s=t_s, inputs=self.inputs[::k].copy(), ends=np.arange(t_s.size, dtype=np.float64))

    def halved(self) -> InitialValueProblem:
        """The problem with steps half as long."""
        middles = (self.ends[:-1] + self.ends[1:]) / 2
        return replace(self, ends=np.insert(self.ends, np.arange(1, self.ends.size), middles))

    @property
    def substeps(self) -> NDArray[np.int64]:
        """Number of steps (n - 1,) that begin in each sample interval."""
        return substeps_of(self.ends, self.t_s.size)

    def with_step(self, longest_step_s: float) -> InitialValueProblem:
        """The problem with the fewest equal steps in each sample interval that are no longer than this."""
        counts = np.ceil(np.diff(self.t_s) / longest_step_s * (1 - 1e-9))
        counts = np.clip(counts, 1, MAX_STEPS[1]).astype(np.int64)
        begin = np.repeat(np.arange(counts.size), counts)
        inside = np.arange(begin.size) - np.repeat(np.cumsum(counts) - counts, counts)
        return replace(self, ends=np.append(begin + inside / counts[begin], self.t_s.size - 1.0))

    def planned(self, values: Array, tolerance: float, negligible: float = 0.0) -> InitialValueProblem:
        """The problem with steps short enough for these values; they may span many samples where no input changes.

        Parameters
        ----------
        values
            (p + s,), each in its own unit.
        tolerance
            Error from the finite time step, relative to the size of each state.
        negligible
            Error that is enough at the kinks of the equation, as of a rim over which water runs; not where steps end
            at the events of the model.
        """
        if self.t_s.size < 2 or self.model.events:
            return self._planned_through_events(values, tolerance)
        times = self._times(values[: len(self.model.parameters)])
        if not np.all(np.diff(times) > 0):
            return self
        size = np.zeros(len(self.model.states))
        count = self._controlled(times, values, SIZED, SIZED, size).size - 1
        tolerance /= max(count / STEPS_ADDING, 1.0)  # errors of steps add up
        ends = self._controlled(times, values, tolerance, max(tolerance, KINK * negligible), size)
        return replace(self, ends=graded(ends))

    def _controlled(self, times: Array, values: Array, tolerance: float, enough: float, size: Array) -> Array:
        """Ends of the steps; one a sample from where the solution diverges, or would need too many."""
        ends = np.empty(max(MAX_STEPS[0] * times.size, MAX_STEPS[1]) + 1)
        limits = np.array([tolerance, enough, (times[-1] - times[0]) / ends.size])
        params, initial = np.split(values[:, None], [len(self.model.parameters)])
        known = self.acting(params[:, 0]), self.hold == "linear", self._latest_ends()
        count = self.rhs.choose(self.rhs.columns, times, initial, params, *known, limits, size, ends)
        return np.concatenate([ends[:count], np.arange(int(ends[count - 1]) + 1.0, times.size)])

    def _latest_ends(self) -> NDArray[np.int64]:
        """The sample (n - 1,) up to which a step that begins in each interval may last: inputs go on smoothly there.

        Where values change the inputs that act, one may jump at any sample; a long step would pass over a blow.
        """
        last = self.t_s.size - 1
        changing = self.inputs.size and (self.hold == "linear" or self.model.drive is not None)
        if changing or self.model.with_role("moment"):
            jumps = np.arange(1, last)
        else:
            jumps = 1 + np.flatnonzero(np.any(self.inputs[1:last] != self.inputs[: last - 1], axis=1))
        return np.append(jumps, last)[np.searchsorted(jumps, np.arange(last), side="right")]

    def _planned_through_events(self, values: Array, tolerance: float) -> InitialValueProblem:
        """The problem with equal steps in each sample interval, judged by its first PLANNED samples.

        The error is the difference between the states with these steps and with half of them, relative to
        the size of each state; it falls with the power ORDER of the step.
        """
        step_s = float(np.median(np.diff(self.t_s))) if self.t_s.size > 1 else 1.0
        shortest_s = float(self.t_s[-1] - self.t_s[0]) / max(MAX_STEPS[0] * self.t_s.size, MAX_STEPS[1])
        problem, runaways = self.with_step(step_s), 0
        for _ in range(12):
            error = problem.first(PLANNED).step_error(values)
            runaways += not np.isfinite(error)
            if error <= tolerance or step_s <= shortest_s or runaways == 3:
                break
            ratio = (error / tolerance) ** (1 / ORDER) if np.isfinite(error) else 4.0
            step_s = max(step_s / min(max(1.1 * ratio, 1.2), 4.0), shortest_s)
            problem = self.with_step(step_s)
        return problem

    def step_error(self, values: Array) -> float:
        """Largest error of the states from the finite time step, relative to each state's size.

        The error is dimensionless; ``values`` (p + s,), each in its own unit.
        """
        coarse = self.states(values[:, None])[:, :, 0]
        fine = self.halved().states(values[:, None])[:, :, 0]
        with np.errstate(all="ignore"):
            size = np.max(np.abs(fine), axis=0, initial=0.0)
            error = np.max(np.abs(coarse - fine) / np.where(size > 0, size, 1.0), initial=0.0)
        return float(error) if np.isfinite(error) else np.inf


def initial_value_problem(model: OdeModel, t_s: Array, inputs: Array | None, hold: Hold) -> InitialValueProblem:
    """Set up a model at given times, with one step in each sample interval.

    Parameters
    ----------
    model
        The governing equation; compiled here.
    t_s
        (n,) s, increasing.
    inputs
        (n, m) known inputs at these times; None when the model has none.
    hold
        How inputs vary between samples.
    """
    times = np.ascontiguousarray(t_s, dtype=np.float64).copy()
    known = np.zeros((times.size, 0)) if inputs is None else np.ascontiguousarray(inputs, dtype=np.float64).copy()
    return InitialValueProblem(model, compiled_rhs(model), times, known, hold, np.arange(times.size, dtype=np.float64))


def first_steps(values: Array, which: NDArray[np.intp]) -> Array:
    """Difference steps (k,) that need no knowledge of the response: 1e-5 of each value.

    Steps and ``values`` (p + s,) have the unit of each value.
    """
    return 1e-5 * np.maximum(np.abs(values[which]), 1e-3)


def adapted_steps(steps: Array, slopes: Array, size: Array) -> Array:
    """Difference steps (k,) that change the prediction by about RESPONSE times the size (d,) of the motion.

    Steps have the unit of each value, the prediction and its size the observed unit.

    Over many periods a small change of frequency adds up, so a step fixed relative to the value would leave the
    linear range. ``slopes`` (n, d, k) found with the ``steps`` so far say how strongly the prediction responds.
    """
    with np.errstate(all="ignore"):
        response = np.nanmax(np.abs(slopes), axis=0, initial=0.0) / np.where(size > 0, size, 1.0)[:, None]
        adapted = RESPONSE / np.max(response, axis=0)
    return np.where(np.isfinite(adapted) & (adapted > 0), np.clip(adapted, 1e-2 * steps, 1e5 * steps), steps)


def difference_steps(problem: InitialValueProblem, values: Array, which: NDArray[np.intp]) -> Array:
    """Difference steps (k,) for :meth:`InitialValueProblem.sensitivity`, adapted to the response at these values.

    Steps and ``values`` (p + s,) have the unit of each value.
    """
    steps, predicted = first_steps(values, which), problem.predicted(values)
    with np.errstate(all="ignore"):
        size = np.nan_to_num(np.nanmax(np.abs(predicted), axis=0, initial=0.0))
        slopes = problem.sensitivity(values, which, steps)
        for _ in range(MAX_SHORTENED if np.isfinite(predicted).all() else 0):
            moved = np.abs(slopes * steps) / np.where(size > 0, size, 1.0)[:, None]
            far = ~(np.max(moved, axis=(0, 1), initial=0.0) < FAR)
            if not far.any():
                break
            steps = np.where(far, SHORTENED * steps, steps)
            slopes[:, :, far] = problem.sensitivity(values, which[far], steps[far])
    return adapted_steps(steps, slopes, size)
