"""First-order sensitivity of a fitted model's prediction to each effect, without fitting it.

An effect that acts on the motion is a small force e(t) along the motion without it. The response of the linearised
motion is carried from one sample to the next by d state / d state over the interval between them, to which the force
in the interval adds: a few integrations for these derivatives serve all effects. An effect that acts on the observation
needs no integration.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from fitters.compose_effects import at_rest, forced, is_at_rest, plain_observation, pushed_bodies
from fitters.image_effects import through, view_of
from fitters.integrator.codegen import generated
from fitters.integrator.initial_value_problem import InitialValueProblem, initial_value_problem
from fitters.ode import simulate
from fitters.ode.simulation import problem_at
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array, Effect, FitResult, Hold, OdeModel, Quantity, Trajectory

REFINEMENT = 4  # points in a sample interval at which the force is given; even, for Simpson's rule
SIMPSON = np.array([1.0, *(4.0, 2.0) * (REFINEMENT // 2 - 1), 4.0, 1.0])  # weights of these points and of the end
RESPONSE = 1e-4  # size of a trial change, relative to the range of what is changed
TOLERANCE = 1e-9  # error of the motion from its time step, relative
FORCES_AT_ONCE = 4_000_000  # numbers; more take memory, not less time
SMALL = 1e-6  # size of an effect with a memory at which its force is still in proportion to it
WORST_CONDITION = 1e5  # of the transition matrix of a block: its inverse loses five digits


@dataclass(frozen=True, eq=False, slots=True)
class Transitions:
    """What each sample interval makes of a small change of the state and of small forces.

    ``across`` (i, s, s): d state at its end / d state at its beginning. ``pushed`` (i, REFINEMENT + 1, s, f): what a
    unit of force on the highest derivatives at each point of the interval adds to the state at its end, by Simpson's
    rule.
    """

    across: Array
    pushed: Array


@dataclass(frozen=True, eq=False, slots=True)
class EffectMotion:
    """A fitted motion on a grid finer than the samples, and its response to small forces.

    ``grid`` (m,) s, whose items ``at_samples`` (n,) are the samples used; ``states`` and ``slopes`` (m, s);
    ``values`` of the parameters by name; ``inputs`` (m, i) or None; ``response`` to forces, None where events make the
    motion forget its state. ``hold`` says how the inputs vary between the points of the grid.
    """

    model: OdeModel
    grid: Array
    at_samples: NDArray[np.int_]
    values: Mapping[str, float]
    inputs: Array | None
    states: Array
    slopes: Array
    response: Transitions | None
    hold: Hold = "linear"

    def answer(self, force: Array) -> Array:
        """What is seen (n, d) of a unit of a small force (m, f) on the highest derivatives."""
        return np.asarray(self.answers(force[None])[0])

    def answers(self, forces: Array) -> Array:
        """What is seen (k, n, d) of a unit of each of k small forces (k, m, f) on the highest derivatives."""
        with np.errstate(all="ignore"):
            acts = np.any(forces, axis=(1, 2)) & np.isfinite(np.sum(forces, axis=(1, 2)))
        if self.response is not None:
            shown, ends = _shown(self), self.at_samples // REFINEMENT
            return np.asarray(_responses(self.response.across, self.response.pushed, shown, forces, acts, ends))
        seen = np.zeros((len(forces), self.at_samples.size, len(self.model.observed)))
        for k in np.flatnonzero(acts):
            seen[k] = self._integrated(forces[k])
        return seen

    def observed_by_state(self, at: NDArray[np.int_]) -> Array:
        """Derivative (r, d, s) of what is observed by each state, at r points of the grid."""
        params = np.array([self.values[parameter.name] for parameter in self.model.parameters])
        states, t_s = self.states[at], self.grid[at]
        spread, columns = np.ptp(states, axis=0), []
        steps = RESPONSE * np.where(spread > 0, spread, max(float(np.max(spread)), 1e-9))
        for step in np.diag(steps):
            sides = [plain_observation(self.model, t_s, states + sign * step, params) for sign in (1.0, -1.0)]
            columns.append((sides[0] - sides[1]) / (2 * step.sum()))
        return np.stack(columns, axis=2)

    def _integrated(self, force: Array) -> Array:
        """The same by integrating the model with the force, twice."""
        slopes = np.max(np.abs(self.slopes[:, self.model.forced_states]), initial=0.0)
        factor = RESPONSE * max(float(slopes), 1e-12) / float(np.max(np.abs(force)))
        pushed = []
        middles = np.vstack([(force[:-1] + force[1:]) / 2, force[-1:]]) if self.hold == "zero-order" else force
        for sign in (1.0, -1.0):
            push = sign * factor * middles
            inputs = push if self.inputs is None else np.hstack([self.inputs, push])
            pushed.append(simulate(forced(self.model), self.grid, self.values, inputs=inputs, hold=self.hold)[1])
        return np.asarray((pushed[0] - pushed[1])[self.at_samples] / (2 * factor))


@functools.lru_cache(maxsize=2)
def _shown(motion: EffectMotion) -> Array:
    """Derivative (n, d, s) of what is observed in the samples by each state."""
    return motion.observed_by_state(motion.at_samples)


@kernel()
def _responses(across: Array, pushed: Array, shown: Array, forces: Array, acts: Array, ends: NDArray[np.int_]) -> Array:
    """What is seen (k, n, d) of forces (k, m, f) on a grid of intervals with REFINEMENT steps.

    ``across`` and ``pushed`` are those of :class:`Transitions`, ``shown`` (n, d, s) is what a change of the state
    changes in each sample; ``ends`` (n,) are the numbers of intervals before each sample. Forces that do not act (k,)
    have no response.
    """
    seen = np.zeros((len(forces), *shown.shape[:2]))
    state, after = np.zeros(shown.shape[2]), np.zeros(shown.shape[2])
    for k in np.flatnonzero(acts):
        state[:] = 0.0
        done = 0
        for n in range(ends.size):
            for interval in range(done, ends[n]):
                first = interval * REFINEMENT
                _carry(across[interval], pushed[interval], forces[k, first : first + REFINEMENT + 1], state, after)
                state, after = after, state
            done = max(done, ends[n])
            for quantity in range(shown.shape[1]):
                for i in range(state.size):
                    seen[k, n, quantity] += shown[n, quantity, i] * state[i]
    return seen


@kernel(inline="always")
def _carry(across: Array, pushed: Array, forces: Array, state: Array, after: Array) -> None:
    """Fill ``after`` with a change of the state (s,) at the end of an interval, from its beginning and the forces."""
    for i in range(state.size):
        after[i] = 0.0
        for j in range(state.size):
            after[i] += across[i, j] * state[j]
        for point in range(REFINEMENT + 1):
            for body in range(forces.shape[1]):
                after[i] += pushed[point, i, body] * forces[point, body]


def motion_of(fitted: FitResult, trajectory: Trajectory) -> EffectMotion:
    """The motion of a fit, with how it changes with each initial state.

    Parameters
    ----------
    fitted
        A model and its estimates.
    trajectory
        What it was fitted to, for its inputs.
    """
    model, values = fitted.model, {name: estimate.value for name, estimate in fitted.estimates.items()}
    grid, at_samples = _grid(fitted, trajectory)
    known = trajectory.inputs_at(grid)
    problem, vector = problem_at(model, grid, values, known, trajectory.hold)
    problem = problem.planned(vector, TOLERANCE)
    states = problem.states(vector[:, None])[:, :, 0]
    slopes = rates(model, grid, states, values, known)
    response = _transitions(problem.driven(vector[: len(model.parameters)]), vector, states)
    return EffectMotion(model, grid, at_samples, values, known, states, slopes, response, trajectory.hold)


def _grid(fitted: FitResult, trajectory: Trajectory) -> tuple[Array, NDArray[np.int_]]:
    """Times (m,) s with REFINEMENT points in each interval, and where the samples used (n,) are among them.

    With inputs, samples that are not used count as well: the input changes at each of them.
    """
    used_s = fitted.t_s[fitted.used]
    driven = trajectory.t_s if trajectory.input_quantities else used_s
    inside = driven[(driven > fitted.t0_s) & (driven <= used_s[-1])]  # the first samples may be outliers
    grid, at_samples = refined(np.array([fitted.t0_s, *inside]))
    return grid, at_samples[np.searchsorted(grid[at_samples], used_s)]


def _transitions(problem: InitialValueProblem, vector: Array, states: Array) -> Transitions | None:
    """What each sample interval makes of a change, from transitions over blocks as long as they can be inverted.

    A motion with events is one block, as it cannot begin anew in another mode; None where that cannot be inverted.
    """
    count, intervals = states.shape[1], (len(states) - 1) // REFINEMENT
    size = np.ptp(states, axis=0)
    from_points = np.empty((intervals, REFINEMENT + 1, count, count))  # d state at the end / d state at a point
    begin, tried = 0, intervals
    while begin < intervals:
        first, stop = begin * REFINEMENT, min(begin + tried, intervals) * REFINEMENT
        block = _block_transition(problem.part(first, stop), vector, states[first], size)
        invertible = _invertible(block)
        if problem.model.events and invertible < intervals:
            return None
        if invertible:
            points = np.arange(invertible)[:, None] * REFINEMENT + np.arange(REFINEMENT + 1)
            inverse = np.linalg.inv(block[: points[-1, -1] + 1])
            from_points[begin : begin + invertible] = block[points[:, -1:]] @ inverse[points]
        else:  # the motion forgets its state within the interval
            from_points[begin] = np.eye(count)
            for k in reversed(range(REFINEMENT)):
                step = problem.part(first + k, first + k + 1)
                over = _block_transition(step, vector, states[first + k], size)[-1]
                from_points[begin, k] = from_points[begin, k + 1] @ over
        begin += max(invertible, 1)
        tried = 2 * tried if invertible == tried else max(invertible, 1)
    weights = SIMPSON * np.diff(problem.t_s[::REFINEMENT])[:, None] / REFINEMENT / 3.0
    return Transitions(from_points[:, 0], from_points[:, :, :, problem.model.forced_states] * weights[:, :, None, None])


def _block_transition(problem: InitialValueProblem, vector: Array, begin: Array, size: Array) -> Array:
    """Derivatives (k, s, s) of the states at each time by those at the first, by central differences."""
    count = begin.size
    steps = RESPONSE * np.maximum(size, 1e-9)
    columns = np.repeat(vector[:, None], 2 * count, axis=1)
    columns[-count:] = begin[:, None] + np.hstack([np.diag(steps), -np.diag(steps)])
    moved = problem.states(columns)
    with np.errstate(all="ignore"):
        return np.asarray((moved[:, :, :count] - moved[:, :, count:]) / (2 * steps))


def _invertible(transition: Array) -> int:
    """Number of sample intervals from the first on over which transitions (k, s, s) can be inverted."""
    finite = np.asarray(np.isfinite(transition).all(axis=(1, 2)))
    condition = np.asarray(np.linalg.cond(np.where(finite[:, None, None], transition, 0.0)))
    followed = int(np.argmin(np.append(condition <= WORST_CONDITION, False)))  # 0: not even where it begins
    return max(followed - 1, 0) // REFINEMENT


def sensitivity(effect: Effect, fitted: FitResult, trajectory: Trajectory, motion: EffectMotion | None = None) -> Array:
    """How the prediction changes with the effect's size at size zero.

    Parameters
    ----------
    effect
        Applies to the fitted model.
    fitted
        The model without the effect.
    trajectory
        What it was fitted to, for its inputs.
    motion
        :func:`motion_of` the fit, to save time for many effects.

    Returns
    -------
    ndarray
        (n_used, d), in observed units per unit of the size.
    """
    return np.asarray(sensitivities(effect, [()], fitted, trajectory, motion)[0])


def _seen_change(effect: Effect, fitted: FitResult, sizes: Array) -> Array:
    """The same (n_used, d) of an effect on the observation, with its other parameters in ``sizes`` (p,)."""
    t_s, seen, velocity = _seen_motion(fitted)
    step = np.zeros_like(sizes)
    if effect.observe is not None:
        step[0] = 1e-4 * _scale_of(lambda size: effect_change(effect, t_s, seen, velocity, sizes, size), seen)
        upper = effect.observe(t_s, seen, velocity, sizes + step)
        lower = effect.observe(t_s, seen, velocity, sizes - step)
        return np.asarray((upper - lower) / (2 * step[0]))
    assert effect.warp is not None
    step[0] = 1e-6
    moved = (effect.warp(t_s, sizes + step) - effect.warp(t_s, sizes - step)) / (2 * step[0])
    return np.asarray(velocity * moved[:, None])


@functools.lru_cache(maxsize=4)
def _seen_motion(fitted: FitResult) -> tuple[Array, Array, Array]:
    """Times (n,) s of the samples of a fit, what it predicts there and how fast that changes, both (n, d)."""
    t_s, seen = fitted.t_s[fitted.used], fitted.predicted[fitted.used]
    return t_s, seen, CubicSpline(t_s, seen).derivative()(t_s)


def sensitivities(
    effect: Effect,
    shapes: Sequence[Sequence[float]],
    fitted: FitResult,
    trajectory: Trajectory,
    motion: EffectMotion | None = None,
) -> Array:
    """:func:`sensitivity` (k, n_used, d) to an effect in k shapes, in observed units per unit of the size.

    Parameters
    ----------
    effect
        Applies to the fitted model.
    shapes
        Values of its parameters after the first, or none for their defaults.
    fitted, trajectory, motion
        As for :func:`sensitivity`.
    """
    size, *others = (parameter.default or 0.0 for parameter in effect.parameters)
    sizes = np.array([[size, *(shape or others)] for shape in shapes], dtype=np.float64)
    if effect.drive is not None:
        motion = motion or motion_of(fitted, trajectory)
        return motion.answers(np.array([force_of_drive(effect, each, motion) for each in sizes]))
    if effect.acceleration is None:
        effect = through(effect, fitted.model, view_of(trajectory, fitted.model))
        return np.array([_seen_change(effect, fitted, each) for each in sizes])
    motion = motion or motion_of(fitted, trajectory)
    base = acted_on(effect, motion.model, motion.grid, motion.states, motion.slopes, motion.values)
    where = fitted.model, motion.grid, motion.states, base
    count = max(FORCES_AT_ONCE // motion.grid.size, 1)
    groups = (sizes[first : first + count] for first in range(0, len(sizes), count))
    return np.concatenate([motion.answers(forces_along(effect, group, *where)) for group in groups])


def force_of_drive(effect: Effect, sizes: Array, motion: EffectMotion) -> Array:
    """What a unit of an effect on the inputs adds to the highest derivatives (m, f) along a motion.

    Parameters
    ----------
    effect
        One that acts on the inputs.
    sizes
        Its parameters at size zero.
    motion
        Of the model without it.
    """
    assert effect.drive is not None
    assert motion.inputs is not None
    step = np.zeros_like(sizes)
    per_unit = effect.drive(motion.grid, motion.inputs, sizes + np.eye(sizes.size)[0] * 1e-6) - motion.inputs
    step[0] = RESPONSE * float(np.ptp(motion.inputs)) / max(float(np.max(np.abs(per_unit))) * 1e6, 1e-12)
    where = motion.model, motion.grid, motion.states, motion.values
    above, below = (
        rates(*where, effect.drive(motion.grid, motion.inputs, sizes + sign * step)) for sign in (1.0, -1.0)
    )
    return np.asarray((above - below)[:, motion.model.forced_states] / (2 * step[0]))


def shaped(effect: Effect, shape: Sequence[float]) -> Effect:
    """The effect with new defaults for its parameters after the first; unchanged when no values are given.

    Parameters
    ----------
    effect
        The effect.
    shape
        One value for each parameter after the first, or none.
    """
    if not shape:
        return effect
    size, *rest = effect.parameters
    changed = (replace(parameter, default=value) for parameter, value in zip(rest, shape, strict=True))
    return replace(effect, parameters=(size, *changed))


def effect_change(effect: Effect, t_s: Array, motion: Array, velocity: Array, sizes: Array, size: float) -> Array:
    """How an effect of a given size changes the observation (n, d).

    Parameters
    ----------
    effect
        One that acts on the observation.
    t_s
        (n,) s.
    motion, velocity
        (n, d) without the effect.
    sizes
        Its parameters at size zero.
    size
        The first of them.
    """
    assert effect.observe is not None
    return effect.observe(t_s, motion, velocity, np.concatenate([[size], sizes[1:]])) - motion


def _scale_of(change: Callable[[float], Array], motion: Array) -> float:
    """The size at which an effect changes the observed values by as much as they move."""
    per_unit = float(np.max(np.abs(change(1e-6)), initial=0.0)) * 1e6
    return float(np.ptp(motion)) / per_unit if per_unit > 0 else 1.0


def refined(t_s: Array) -> tuple[Array, NDArray[np.int_]]:
    """Times with REFINEMENT points in each interval, and where the samples are among them.

    ``t_s`` (n,), s; the finer times (m,), s, and indices (n,).
    """
    inner = np.arange(REFINEMENT) / REFINEMENT
    grid = np.append((t_s[:-1, None] + inner * np.diff(t_s)[:, None]).ravel(), t_s[-1])
    return np.asarray(grid), np.arange(t_s.size) * REFINEMENT


def rates(model: OdeModel, t_s: Array, states: Array, values: Mapping[str, float], inputs: Array | None) -> Array:
    """Derivatives of the states (n, s) along a motion.

    Parameters
    ----------
    model
        The governing equation.
    t_s
        (n,) s.
    states
        (n, s).
    values
        Parameters by name.
    inputs
        (n, m), None when the model has none.
    """
    params = np.array([values[parameter.name] for parameter in model.parameters])
    return initial_value_problem(model, t_s, inputs, "linear").slopes(states, params)


def acted_on(
    effect: Effect, model: OdeModel, t_s: Array, states: Array, slopes: Array, values: Mapping[str, float]
) -> Array:
    """The derivatives (n, s) along a motion on which an effect acts: as they are, or of one at rest at zero velocity.

    Parameters
    ----------
    effect
        One that acts on the motion.
    model, t_s, states, values
        As for :func:`rates`.
    slopes
        The derivatives of the states (n, s).
    """
    return rates(model, t_s, at_rest(states, model), values, None) if is_at_rest(effect, model) else slopes


def force_along(effect: Effect, sizes: Array, model: OdeModel, t_s: Array, states: Array, base: Array) -> Array:
    """What a unit of the effect adds to the highest derivatives (n, f) along a motion.

    Parameters
    ----------
    effect
        One that acts on the motion.
    sizes
        Its parameters at size zero.
    model
        The governing equation without it.
    t_s
        (n,) s.
    states, base
        (n, s) the motion, and the derivatives that the effect acts on (:func:`acted_on`).
    """
    return np.asarray(forces_along(effect, sizes[None], model, t_s, states, base)[0])


def forces_along(effect: Effect, sizes: Array, model: OdeModel, t_s: Array, states: Array, base: Array) -> Array:
    """:func:`force_along` (k, n, f) of the effect in k shapes; ``sizes`` (k, p) are its parameters in each of them.

    Parameters
    ----------
    effect, sizes, model, t_s, states, base
        As for :func:`force_along`.
    """
    assert effect.acceleration is not None
    count = model.degrees_of_freedom
    slopes = base[:, model.forced_states]
    velocity = model.velocities(states, base)
    if effect.memory is not None:
        return _forces_with_memory(effect, sizes, t_s, states[:, 0], velocity[:, 0], slopes[:, 0])
    unit = (1.0, *sizes.T[1:, :, None])
    force = np.zeros((len(sizes), t_s.size, count))
    with np.errstate(all="ignore"):
        for body in pushed_bodies(model):
            speed = np.sqrt(np.sum(velocity[:, body] ** 2, axis=1))
            for k in body:
                force[:, :, k] = effect.acceleration(t_s, states[:, k], velocity[:, k], speed, slopes[:, k], unit)
    return force


def _forces_with_memory(
    effect: Effect, sizes: Array, t_s: Array, position: Array, velocity: Array, base: Array
) -> Array:
    """The same (k, n, 1) of an effect with hidden states: first these along the motion (n,), then the force."""
    assert effect.acceleration is not None
    problem = initial_value_problem(_memory_of(effect), t_s, np.column_stack([position, velocity, base]), "linear")
    hidden = problem.states(np.vstack([sizes.T, np.zeros((len(effect.hidden), len(sizes)))])).transpose(1, 2, 0)
    small = (SMALL, *sizes.T[1:, :, None])
    with np.errstate(all="ignore"):
        force = effect.acceleration(t_s, position, velocity, np.abs(velocity), base, small, tuple(hidden))
    return np.asarray(force)[:, :, None] / SMALL


@functools.lru_cache(maxsize=64)
def _memory_of(effect: Effect) -> OdeModel:
    """The hidden states of an effect as a separate model, which position, velocity and own force drive."""
    assert effect.memory is not None
    return OdeModel(
        effect.name, effect.summary, "", "", effect.hidden, effect.parameters, effect.hidden,
        _memory_rhs(effect.memory),
        inputs=(Quantity("position", "1"), Quantity("velocity", "1"), Quantity("base", "1")),
    )  # fmt: skip


@functools.lru_cache(maxsize=64)
def _memory_rhs(memory: Callable[..., tuple[float, ...]]) -> Callable[..., tuple[float, ...]]:
    source = (
        "def rhs(t, state, params, inputs):\n    return memory(t, inputs[0], inputs[1], inputs[2], params, state)\n"
    )
    return generated(source, {"memory": register_jitable(memory)})
