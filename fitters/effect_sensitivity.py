"""First-order sensitivity of a fitted model's prediction to each effect, without fitting it.

An effect that acts on the motion is a small force e(t) along the motion without it. The response of the linearised
motion is P(t) times the integral of P(t)^-1 e(t), where P(t) = d state(t) / d state(0): a few integrations for P serve
all effects. An effect that acts on the observation needs no integration.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline

from fitters.compose_effects import bodies_of, plain_observation, within
from fitters.image_effects import through, view_of
from fitters.integrator.codegen import generated, row
from fitters.ode import simulate
from iris_sysid.types import Array, Effect, FitResult, OdeModel, Quantity, Trajectory

REFINEMENT = 4  # points in a sample interval at which the force is given
RESPONSE = 1e-4  # size of a trial change, relative to the range of what is changed
WORST_CONDITION = 1e8  # of the transition matrix, which loses digits as initial conditions decay

_FORCED = """
def rhs(t, state, params, inputs):
    slopes = base(t, state, params{inputs})
    return {slopes}
"""


@dataclass(frozen=True, eq=False, slots=True)
class Motion:
    """A fitted motion on a grid finer than the samples, and its response to small forces.

    ``grid`` (m,) s, of which ``at_samples`` (n,) are the samples used; ``states`` and ``slopes`` (m, s);
    ``values`` of the parameters by name; ``inputs`` (m, i) or None; ``transition`` (m, s, s) d state / d initial
    state, and ``inverse`` (m, s, f) the columns of its inverse for the highest derivatives, None where it is
    too near singular to be used.
    """

    model: OdeModel
    grid: Array
    at_samples: NDArray[np.int_]
    values: Mapping[str, float]
    inputs: Array | None
    states: Array
    slopes: Array
    transition: Array
    inverse: Array | None

    def answer(self, force: Array) -> Array:
        """What is seen (n, d) of a unit of a small force (m, f) on the highest derivatives."""
        largest = float(np.max(np.abs(force), initial=0.0))
        if not largest > 0 or not np.all(np.isfinite(force)):
            return np.zeros((self.at_samples.size, len(self.model.observed)))
        if self.inverse is None:
            return self._integrated(force, largest)
        drawn = cumulative_simpson(np.einsum("msf,mf->ms", self.inverse, force), x=self.grid, axis=0, initial=0.0)
        change = np.einsum("mrs,ms->mr", self.transition[self.at_samples], drawn[self.at_samples])
        return self._seen(change)

    def _seen(self, change: Array) -> Array:
        """Observed change (n, d) of a small change (n, s) of the states."""
        params = np.array([self.values[parameter.name] for parameter in self.model.parameters])
        states, t_s = self.states[self.at_samples], self.grid[self.at_samples]
        step = RESPONSE * max(float(np.ptp(states)), 1e-12) / max(float(np.max(np.abs(change))), 1e-300)
        sides = [plain_observation(self.model, t_s, states + sign * step * change, params) for sign in (1.0, -1.0)]
        return np.asarray((sides[0] - sides[1]) / (2 * step))

    def _integrated(self, force: Array, largest: float) -> Array:
        """The same by integrating the model with the force, twice."""
        slopes = np.max(np.abs(self.slopes[:, -force.shape[1] :]), initial=0.0)
        factor = RESPONSE * max(float(slopes), 1e-12) / largest
        pushed = []
        for sign in (1.0, -1.0):
            push = sign * factor * force
            inputs = push if self.inputs is None else np.hstack([self.inputs, push])
            pushed.append(simulate(forced(self.model), self.grid, self.values, inputs=inputs)[1])
        return np.asarray((pushed[0] - pushed[1])[self.at_samples] / (2 * factor))


def motion_of(fitted: FitResult, trajectory: Trajectory) -> Motion:
    """The motion of a fit, with how it changes with each initial state.

    Parameters
    ----------
    fitted
        A model and its estimates.
    trajectory
        What it was fitted to, for its inputs.
    """
    model, values = fitted.model, {name: estimate.value for name, estimate in fitted.estimates.items()}
    used_s = fitted.t_s[fitted.used]
    before = [fitted.t0_s] if fitted.t0_s < used_s[0] else []  # the first samples may be outliers
    grid, at_samples = refined(np.array([*before, *used_s]))
    at_samples = at_samples[len(before) :]
    known = _inputs_at(trajectory, grid)
    states, _ = simulate(model, grid, values, inputs=known)
    columns = []
    for k, state in enumerate(model.states):
        step, name = RESPONSE * max(float(np.ptp(states[:, k])), 1e-9), f"{state.name}_0"
        sides = [
            simulate(model, grid, {**values, name: values[name] + sign * step}, inputs=known)[0] for sign in (1, -1)
        ]
        columns.append((sides[0] - sides[1]) / (2 * step))
    transition = np.stack(columns, axis=2)
    slopes = rates(model, grid, states, values, known)
    return Motion(model, grid, at_samples, values, known, states, slopes, transition, _inverse(model, transition))


def _inverse(model: OdeModel, transition: Array) -> Array | None:
    """Columns (m, s, f) of the inverse that forces act through; None where a matrix is too near singular."""
    count = len(model.states) // 2 if model.second_order else len(model.states)
    if not np.all(np.isfinite(transition)) or np.max(np.linalg.cond(transition)) > WORST_CONDITION:
        return None
    return np.asarray(np.linalg.inv(transition)[:, :, -count:])


def sensitivity(effect: Effect, fitted: FitResult, trajectory: Trajectory, motion: Motion | None = None) -> Array:
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
    sizes = np.array([parameter.default or 0.0 for parameter in effect.parameters])
    if effect.acceleration is not None:
        motion = motion or motion_of(fitted, trajectory)
        return motion.answer(force_along(effect, sizes, fitted.model, motion.grid, motion.states, motion.slopes))
    effect = through(effect, fitted.model, view_of(trajectory, fitted.model))
    t_s, seen = fitted.t_s[fitted.used], fitted.predicted[fitted.used]
    velocity = CubicSpline(t_s, seen).derivative()(t_s)
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


def effect_change(effect: Effect, t_s: Array, motion: Array, velocity: Array, sizes: Array, size: float) -> Array:
    """What an effect of a given size changes in what is seen (n, d).

    Parameters
    ----------
    effect
        One that acts on what is seen.
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
    """The size at which an effect changes what is seen by as much as it moves."""
    per_unit = float(np.max(np.abs(change(1e-6)), initial=0.0)) * 1e6
    return float(np.ptp(motion)) / per_unit if per_unit > 0 else 1.0


def refined(t_s: Array) -> tuple[Array, NDArray[np.int_]]:
    """Times with REFINEMENT points in each interval, and where the samples are among them.

    ``t_s`` (n,), s; the finer times (m,), s, and indices (n,).
    """
    inner = np.arange(REFINEMENT) / REFINEMENT
    grid = np.append((t_s[:-1, None] + inner * np.diff(t_s)[:, None]).ravel(), t_s[-1])
    return np.asarray(grid), np.arange(t_s.size) * REFINEMENT


def _inputs_at(trajectory: Trajectory, grid: Array) -> Array | None:
    if trajectory.inputs is None or not trajectory.input_quantities:
        return None
    return np.column_stack([np.interp(grid, trajectory.t_s, column) for column in trajectory.inputs.T])


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
    params = tuple(values[parameter.name] for parameter in model.parameters)
    mode = (0.0,) if model.events else ()  # as in the first mode: an effect is judged by what it adds there
    known = [()] * len(t_s) if inputs is None else [(tuple(row),) for row in inputs.tolist()]
    rows = zip(t_s.tolist(), states.tolist(), known, strict=True)
    with np.errstate(all="ignore"):  # one by one: a right-hand side takes numbers
        return np.array([model.rhs(t, (*state, *mode), params, *more) for t, state, more in rows])


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
        (n, s) the motion and its derivatives.
    """
    assert effect.acceleration is not None
    count = len(model.states) // 2 if model.second_order else len(model.states)
    velocity = states[:, count:] if model.second_order else base
    slopes = base[:, count:] if model.second_order else base
    unit = (1.0, *sizes[1:])
    force = np.zeros((t_s.size, count))
    with np.errstate(all="ignore"):
        for body in bodies_of(model):
            speed = np.sqrt(np.sum(velocity[:, body] ** 2, axis=1))
            for k in body:
                force[:, k] = effect.acceleration(t_s, states[:, k], velocity[:, k], speed, slopes[:, k], unit)
    return force


@functools.lru_cache(maxsize=64)
def _forced_rhs(rhs: Callable[..., Any], n_states: int, n_forced: int, n_inputs: int) -> Callable[..., Any]:
    free = n_states - n_forced
    lines = [f"slopes[{k}]" for k in range(free)]
    lines += [f"slopes[{free + k}] + inputs[{n_inputs + k}]" for k in range(n_forced)]
    own = f", {row('inputs', n_inputs)}" if n_inputs else ""
    source = _FORCED.format(inputs=own, slopes=f"({', '.join(lines)},)")
    return generated(source, {"base": register_jitable(rhs)})


def forced(model: OdeModel) -> OdeModel:
    """The model with a force on each of its highest derivatives as further inputs."""
    count = len(model.states) // 2 if model.second_order else len(model.states)
    pushes = tuple(Quantity(f"force{k}", "1") for k in range(count))
    rhs = _forced_rhs(model.rhs, len(model.states), count, len(model.inputs))
    inputs = (*model.inputs, *pushes)
    return replace(model, name=f"{model.name}, forced", rhs=rhs, inputs=inputs, events=within(model))
