"""The initial value problem of one model at the samples of one trajectory, and its sensitivities."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fitters.integrator.compile_rhs import CompiledRhs, compiled_rhs
from fitters.integrator.dormand_prince import ORDER, integrate, restarted
from iris_sysid.errors import FitError
from iris_sysid.types import Array, OdeModel

Hold = Literal["linear", "zero-order"]

MOST_STEPS = (64, 20_000)  # for each sample, and in all if that is more; a problem that needs more is stiff
BATCH_NUMBERS = 4_000_000  # numbers in the states of one batch of columns: 32 MB
PLANNED = 2000  # samples by which steps are chosen
FEW, MOST_OF = 8, 0.99  # an eighth of the intervals has all but a hundredth of the error: there are kinks in them
KINK_TRIALS = 4  # of what each kink may be off, until all together are not off by too much
KINKED_ORDER = 4  # an error that falls with a lower power of the step is that of an equation with a kink
LONG = 20_000  # samples from which on steps over several of them are tried
WIDEST, NARROWEST = 64, 3  # samples in such a step, at most and at least
JUDGED = 7  # every seventh sample tells its error
RESPONSE = 1e-4  # change of the prediction that a difference step aims at, relative to the motion


def value_names(model: OdeModel) -> tuple[str, ...]:
    """Names of everything that fixes a solution: the parameters, then the initial states ``<state>_0``."""
    return (*(p.name for p in model.parameters), *(f"{state.name}_0" for state in model.states))


@dataclass(frozen=True, eq=False, slots=True)
class InitialValueProblem:
    """A model at given times.

    ``t_s`` (n,) s, the first of which is where the initial states hold; ``inputs`` (n, m);
    ``substeps`` (n - 1,) steps in each sample interval; where ``step_s`` is above 0, steps are of that length instead,
    over several samples each. Vectors of values are in the order of :func:`value_names`.
    """

    model: OdeModel
    rhs: CompiledRhs
    t_s: Array
    inputs: Array
    hold: Hold
    substeps: NDArray[np.int64]
    step_s: float = 0.0

    def states(self, columns: Array) -> Array:
        """States (n, s, c) for c columns of values (p + s, c)."""
        if self.model.warp is None:
            return self._integrated(self.t_s, columns)
        parts = [self._warped(columns[:, c : c + 1]) for c in range(columns.shape[1])]
        return np.concatenate(parts, axis=2)

    def _times(self, column: Array) -> Array:
        """The times (n,) s that the samples really show."""
        if self.model.warp is None:
            return self.t_s
        params = column[: len(self.model.parameters), 0]
        return np.ascontiguousarray(self.model.warp(self.t_s, params), dtype=np.float64)

    def _warped(self, column: Array) -> Array:
        """States (n, s, 1) at the times that the samples really show; NaN where time would run backwards."""
        times = self._times(column)
        if not np.all(np.diff(times) > 0):
            return np.full((self.t_s.size, len(self.model.states), 1), np.nan)
        return self._integrated(times, column)

    def _integrated(self, t_s: Array, columns: Array) -> Array:
        n_params = len(self.model.parameters)
        params, initial = np.ascontiguousarray(columns[:n_params]), np.ascontiguousarray(columns[n_params:])
        out = np.empty((t_s.size, *initial.shape))
        if self.step_s > 0:
            from fitters.integrator.continuous_extension import integrate_over_samples  # only long records need it

            integrate_over_samples(self.rhs.columns, t_s, self.step_s, initial, params, out)
            return out
        linear = self.hold == "linear"
        self.rhs.integrate(self.rhs.columns, t_s, self.substeps, initial, params, self.inputs, linear, out)
        return out

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

        The error is RESPONSE / 100 for steps as above, of which a hundredth is taken: enough to find a minimum.

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
        """The problem up to its n-th sample."""
        return replace(self, t_s=self.t_s[:n], inputs=self.inputs[:n], substeps=self.substeps[: n - 1])

    def every(self, k: int) -> InitialValueProblem:
        """The problem at every k-th sample, for a model without inputs."""
        substeps = np.ones((self.t_s.size - 1) // k, dtype=np.int64)
        return replace(self, t_s=self.t_s[::k].copy(), inputs=self.inputs[::k].copy(), substeps=substeps, step_s=0.0)

    def halved(self) -> InitialValueProblem:
        """The problem with steps half as long."""
        return replace(self, substeps=2 * self.substeps, step_s=0.5 * self.step_s)

    def is_as_fine_as(self, other: InitialValueProblem) -> bool:
        """Whether no step is longer than those of another plan for the same samples."""
        if self.step_s > 0:
            return other.step_s >= self.step_s
        return other.step_s > 0 or bool(np.all(other.substeps <= self.substeps))

    def with_step(self, longest_step_s: float) -> InitialValueProblem:
        """The problem with the fewest equal steps in each sample interval that are no longer than this."""
        counts = np.ceil(np.diff(self.t_s) / longest_step_s * (1 - 1e-9))
        return replace(self, substeps=np.clip(counts, 1, MOST_STEPS[1]).astype(np.int64), step_s=0.0)

    def planned(self, values: Array, tolerance: float, negligible: float = 0.0) -> InitialValueProblem:
        """The problem with steps short enough for these values, judged by its first PLANNED samples.

        ``values`` (p + s,), each in its own unit.

        The error is the difference between the states with these steps and with half of them, relative to
        the size of each state; it falls with the power ORDER of the step. Where the equation has a kink, as a rim
        over which water runs, it falls with a low power whatever the method, and ``negligible`` is enough; not where
        steps end at the events of the model. A long record gets steps over several samples where these are exact
        enough over all of it.
        """
        wide = self._over_samples(values, tolerance)
        if wide is not None:
            return wide
        negligible = 0.0 if self.model.events else negligible
        step_s = float(np.median(np.diff(self.t_s))) if self.t_s.size > 1 else 1.0
        shortest_s = float(self.t_s[-1] - self.t_s[0]) / max(MOST_STEPS[0] * self.t_s.size, MOST_STEPS[1])
        problem = self.with_step(step_s)
        runaways, smooth = 0, np.inf
        for _ in range(12):
            error = problem.first(PLANNED).step_error(values)
            runaways += not np.isfinite(error)
            enough = max(negligible, tolerance) if error > smooth else tolerance
            if error <= enough or step_s <= shortest_s or runaways == 3:
                break
            if self._can_restart and np.isfinite(error) and (smooth == np.inf or error > smooth):
                refined = problem._refined_at_kinks(values, max(negligible, tolerance), shortest_s)
                if refined is not None:
                    return refined
            ratio = (error / tolerance) ** (1 / ORDER) if np.isfinite(error) else 4.0
            shorter = max(step_s / min(max(1.1 * ratio, 1.2), 4.0), shortest_s)
            smooth = error * (shorter / step_s) ** KINKED_ORDER
            step_s, problem = shorter, self.with_step(shorter)
        return problem

    def _over_samples(self, values: Array, tolerance: float) -> InitialValueProblem | None:
        """The problem with steps over several samples each; None where its record is short, or steps must be too."""
        if self.t_s.size < LONG or self.inputs.size or not self._can_restart:
            return None
        sample_s, sparse = float(np.median(np.diff(self.t_s))), self.every(JUDGED)
        step_s = WIDEST * sample_s
        while step_s >= NARROWEST * sample_s:
            error = replace(sparse, step_s=step_s).step_error(values)
            if error <= tolerance:
                return replace(self, step_s=step_s)
            ratio = (error / tolerance) ** (1 / (ORDER - 1)) if np.isfinite(error) else 4.0
            step_s /= min(max(1.1 * ratio, 1.2), 4.0)
        return None

    @property
    def _can_restart(self) -> bool:
        """Whether the equation is compiled, and one from the first sample to the last."""
        return self.rhs.integrate is integrate

    def _refined_at_kinks(self, values: Array, enough: float, shortest_s: float) -> InitialValueProblem | None:
        """The problem with more steps in those intervals alone in which the equation has a kink; None if it has none.

        They are told by the difference between the usual steps and a third of them, each interval begun anew from the
        same states; the next one on each side gets as many steps, because kinks move when values change.
        """
        states = np.ascontiguousarray(self.states(values[:, None])[:, :, 0])
        most = np.maximum(np.ceil(np.diff(self.t_s) / shortest_s), self.substeps).astype(np.int64)
        every = np.arange(self.t_s.size - 1)
        error = self._errors_in(every, self.substeps, values, states)
        if not np.sum(np.sort(error)[-(error.size // FEW) :]) > MOST_OF * np.sum(error) > 0:
            return None
        allowed = enough / 2.0 / np.sqrt(max(int(np.sum(error > enough / error.size)), 1))
        problem = self
        for _ in range(KINK_TRIALS):
            substeps = self.substeps.copy()
            open_at = every[error > allowed]
            while open_at.size:
                substeps[open_at] *= 2
                left = self._errors_in(open_at, substeps[open_at], values, states)
                open_at = open_at[(left > allowed) & (2 * substeps[open_at] <= most[open_at])]
            problem = replace(self, substeps=_spread_to_neighbours(substeps))
            if problem.first(PLANNED).step_error(values) <= enough:
                break
            allowed /= 4.0
        return problem

    def _errors_in(self, which: NDArray[np.int64], substeps: NDArray[np.int64], values: Array, states: Array) -> Array:
        """Largest error (k,) of a state from the finite time step in each of these intervals, relative to its size."""
        times, params = self._times(values[:, None]), np.ascontiguousarray(values[: len(self.model.parameters), None])
        ends = np.empty((2, which.size, states.shape[1]))
        for k, out in enumerate(ends):
            more = substeps * (1 + 2 * k)
            restarted(self.rhs.columns, times, more, which, states, params, self.inputs, self.hold == "linear", out)
        size = np.max(np.abs(states), axis=0, initial=0.0)
        with np.errstate(all="ignore"):
            error = np.max(np.abs(ends[0] - ends[1]) / np.where(size > 0, size, 1.0), axis=1, initial=0.0)
        return np.asarray(np.where(np.isfinite(error), error, np.inf))

    def prediction_error(self, values: Array, predicted: Array) -> float:
        """Largest error of a prediction (n, d) from the finite time step, relative to each quantity's size.

        The error is dimensionless; ``values`` (p + s,), each in its own unit.
        """
        fine = self.halved().predicted(values)
        with np.errstate(all="ignore"):
            size = np.max(np.abs(fine), axis=0, initial=0.0)
            error = np.max(np.abs(predicted - fine) / np.where(size > 0, size, 1.0), initial=0.0)
        return float(error) if np.isfinite(error) else np.inf

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


def _spread_to_neighbours(substeps: NDArray[np.int64]) -> NDArray[np.int64]:
    """The largest number of steps in each interval and the one on each side."""
    padded = np.pad(substeps, 1, mode="edge")
    return np.max([padded[:-2], padded[1:-1], padded[2:]], axis=0)


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
    substeps = np.ones(max(times.size - 1, 0), dtype=np.int64)
    return InitialValueProblem(model, compiled_rhs(model), times, known, hold, substeps)


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
    steps = first_steps(values, which)
    with np.errstate(all="ignore"):
        size = np.nan_to_num(np.nanmax(np.abs(problem.predicted(values)), axis=0, initial=0.0))
    return adapted_steps(steps, problem.sensitivity(values, which, steps), size)
