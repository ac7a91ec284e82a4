"""Add effects to a model: the result is an ordinary model, which the engine fits like any other."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numba import types
from numba.extending import register_jitable

from fitters.image_effects import through
from fitters.integrator.codegen import generated, row
from fitters.integrator.compile_rhs import followed_by
from iris_sysid.errors import FitError
from iris_sysid.io.kernels import kernel
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Array, Effect, Event, OdeModel, Quantity, Trajectory, View, picklable

# One line a derivative, so that the composed function holds numbers and tuples only, as numba needs.
_SOURCE = """
def rhs(t, state, params{inputs}):
    slopes = base(t, {own}, {model_params}{inputs}){still}
    sizes = {effect_params}
    {remembered}
    return {slopes}
"""

# The same as a step after the base's machine code, which is compiled once for all the models that share it.
_STEP = """
def step(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        state, sizes, slopes = {state}, {sizes}, {slopes}
        {remembered}
        changed = {changed}
        {assigned}
"""

_FORCED = """
def rhs(t, state, params, inputs):
    slopes = base(t, state, params{inputs})
    return {slopes}
"""
_PUSHED = """
def step(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        {pushed}
"""


def with_effects(model: str | OdeModel, effects: Sequence[str | Effect], view: View | None = None) -> OdeModel:
    """The model with each effect added in turn; its parameters are the model's, then the effects'.

    Parameters
    ----------
    model
        The governing equation, or the name of a registered one.
    effects
        The effects, or their names, in the order in which they act; those that change the model's own force come first.
    view
        How the observed quantities lie in the image, for effects of a camera; where it is None, the picture is taken
        to lie about the motion.

    Raises
    ------
    FitError
        When an effect does not apply to the model, or brings a parameter that is there already.

    Examples
    --------
    >>> from iris_sysid import with_effects
    >>> dragged = with_effects("pendulum", ["quadratic-drag"])
    >>> dragged.name, dragged.parameter("quadratic_drag").unit
    ('pendulum + quadratic-drag', '1/rad')
    """
    model = MODELS.resolved(model)
    for effect in in_order(EFFECTS.all_resolved(effects), model):
        model = with_effect(model, effect, view)
    return model


def with_effect(model: OdeModel, effect: Effect, view: View | None = None) -> OdeModel:
    """The model with one effect added, absent at size zero; see :func:`with_effects`."""
    check_applies(effect, model)
    effect = through(effect, model, view)
    added = tuple(replace(each, unit=unit_in(model, effect, each.unit)) for each in effect.parameters)
    hidden = tuple(replace(each, unit=unit_in(model, effect, each.unit)) for each in effect.hidden)
    taken = {parameter.name for parameter in model.parameters} & {parameter.name for parameter in added}
    if taken:
        raise FitError(f"the model {model.name!r} already has {', '.join(sorted(taken))}; add {effect.name!r} once")
    return replace(
        model,
        name=f"{model.name} + {effect.name}",
        summary=f"{model.summary}, with {effect.summary}",
        equation=rf"{model.equation}\quad\mathrm{{with}}\quad {effect.equation}",
        states=(*model.states, *hidden),
        hidden=model.hidden + len(hidden),
        parameters=(*model.parameters, *added),
        rhs=_rhs(model, effect) if effect.acceleration is not None else _unchanged_rhs(model, effect),
        guess=_guess(model, effect),
        observe=_observe(model, effect),
        warp=_warp(model, effect),
        drive=_drive(model, effect),
        derive=model.derive,
        first_integral=None,
        events=within(model),
    )


def check_applies(effect: Effect, model: OdeModel) -> None:
    """Raise FitError with the registered effects that a model may lack where this one is not of them."""
    if effect.applies(model):
        return
    names = [name for name, each in EFFECTS.items() if each.applies(model)]
    others = f"these do: {', '.join(names)}" if names else "none does"
    raise FitError(f"the effect {effect.name!r} does not apply to the model {model.name!r}; {others}")


def within(model: OdeModel) -> tuple[Event, ...]:
    """The events of a model inside one that has further parameters or inputs after its own."""
    shape = len(model.parameters), len(model.inputs)
    return tuple(
        replace(event, crossing=_own(event.crossing, *shape), reset=_own(event.reset, *shape)) for event in model.events
    )


@picklable
@functools.lru_cache(maxsize=512)
def _own(function: Callable[..., Any], n_params: int, n_inputs: int) -> Callable[..., Any]:
    inputs = f", {row('inputs', n_inputs)}" if n_inputs else ""
    source = f"def own(t, state, params, inputs=()):\n    return base(t, state, {row('params', n_params)}{inputs})\n"
    return generated(source, {"base": register_jitable(function)})


def unit_in(model: OdeModel, effect: Effect, unit: str) -> str:
    """The unit of a parameter of an effect in a model, with its ``{x}`` written out: of a force, that of a place."""
    is_force_on_speed = model.of_speeds and effect.acceleration is not None
    return unit.replace("{x}", model.states[0].unit.removesuffix("/s") if is_force_on_speed else model.observed[0].unit)


@picklable
def _guess(model: OdeModel, effect: Effect) -> Callable[[Trajectory], Mapping[str, float]]:
    sizes = {parameter.name: parameter.default or 0.0 for parameter in effect.parameters}
    return lambda trajectory: {**model.guess(trajectory), **sizes}


def bodies_of(model: OdeModel) -> list[list[int]]:
    """Which positions (or, in a model of first order, states) belong to one body: x and z do, angles stand alone."""
    count = model.degrees_of_freedom
    groups: dict[str, list[int]] = {}
    for k, state in enumerate(model.own_states[:count]):
        letters = state.name.rstrip("0123456789")
        key = f"plane{state.name[len(letters) :]}" if letters in ("x", "z") else state.name
        groups.setdefault(key, []).append(k)
    return list(groups.values())


def pushed_bodies(model: OdeModel) -> list[list[int]]:
    """The degrees of freedom of each body on which the force of an effect acts: in a model of speeds, the speeds."""
    unit = model.states[0].unit
    return [body for body in bodies_of(model) if not model.of_speeds or model.states[body[0]].unit == unit]


def _rhs(model: OdeModel, effect: Effect) -> Callable[..., tuple[float, ...]]:
    count = model.degrees_of_freedom
    shift = count if model.second_order else 0
    still = _still(model) if is_at_rest(effect, model) else ""
    moving = "state" if model.has_velocity else "slopes"
    velocity = [f"{moving}[{shift + k}]" for k in range(count)]
    lines = [f"slopes[{k}]" for k in range(shift + count)]
    for body in pushed_bodies(model):
        speed = f"root({' + '.join(f'{velocity[k]} * {velocity[k]}' for k in body)})"
        for k in body:
            base = f"slopes[{shift + k}]"
            own = f"still[{shift + k}]" if still else base
            more = ", hidden" if effect.hidden else ""
            lines[shift + k] = f"{base} + term(t, state[{k}], {velocity[k]}, {speed}, {own}, sizes{more})"
    lines += [f"slopes[{k}]" for k in range(len(model.own_states), len(model.states))]
    if effect.memory is None:
        return _compiled(model.rhs, effect.acceleration, _shape(model, effect), tuple(lines), None, "", still)
    if count != 1:
        raise FitError(f"the effect {effect.name!r} has a memory: it acts on one degree of freedom, not {count}")
    here = f"t, state[0], {velocity[0]}, slopes[{shift}], sizes"
    lines += [f"rates[{k}]" for k in range(len(effect.hidden))]
    remembered = f"hidden = {row('state', len(effect.hidden), first=len(model.states))}; rates = memory({here}, hidden)"
    return _compiled(model.rhs, effect.acceleration, _shape(model, effect), tuple(lines), effect.memory, remembered)


def is_at_rest(effect: Effect, model: OdeModel) -> bool:
    """Whether an effect changes what a model's own force is at zero velocity, and not the whole."""
    return effect.acts_at_rest is not None and effect.acts_at_rest(model)


def in_order(effects: Sequence[Effect], model: OdeModel) -> list[Effect]:
    """Effects in the order in which they act: first those on the model's own force at rest, which no other changes."""
    return sorted(effects, key=lambda effect: not is_at_rest(effect, model))


def at_rest(states: Array, model: OdeModel) -> Array:
    """The states (n, s) of a model with its velocities at zero."""
    still = states.copy()
    still[:, model.forced_states] = 0.0
    return still


def _still(model: OdeModel) -> str:
    """The state of a model with its velocities at zero, as source."""
    moving = range(*model.forced_states.indices(len(model.states)))
    each = ("0.0" if k in moving else f"state[{k}]" for k in range(len(model.states)))
    return f"({', '.join(each)},)"


def _unchanged_rhs(model: OdeModel, effect: Effect) -> Callable[..., tuple[float, ...]]:
    lines = tuple(f"slopes[{k}]" for k in range(len(model.states)))
    return _compiled(model.rhs, None, _shape(model, effect), lines)


def _shape(model: OdeModel, effect: Effect) -> tuple[int, int, int, int]:
    return len(model.parameters), len(effect.parameters), len(model.inputs), len(effect.hidden)


@picklable
@functools.lru_cache(maxsize=512)
def _compiled(
    base: Callable[..., Any],
    term: Callable[..., float] | None,
    shape: tuple[int, int, int, int],
    lines: tuple[str, ...],
    memory: Callable[..., tuple[float, ...]] | None = None,
    remembered: str = "",
    still: str = "",
) -> Callable[..., tuple[float, ...]]:
    """Make the function from numbers of states and parameters alone; nothing in it comes from a file.

    The same model with the same effect is the same function, so that it is compiled once.
    """
    count, added, inputs, hidden = shape
    source = _SOURCE.format(
        own=row("state", len(lines) - hidden) if hidden else "state",
        remembered=remembered,
        still=f"; still = base(t, {still}, {row('params', count)})" if still else "",
        inputs=", inputs" if inputs else "",
        model_params=row("params", count),
        effect_params=row("params", added, first=count),
        slopes=f"({', '.join(lines)},)",
    )
    values: dict[str, Any] = {"base": register_jitable(base), "root": np.sqrt}
    if term is None:
        return followed_by(generated(source, values), base, (count, inputs), None)
    values["term"] = register_jitable(term)
    if still:  # the base is called twice: the whole is compiled
        return generated(source, values)
    if memory is not None:
        values["memory"] = register_jitable(memory)
    step = _step(term, added, lines, memory, remembered)
    return followed_by(generated(source, values), base, (count, inputs), step, hidden)


@functools.lru_cache(maxsize=512)
def _step(
    term: Callable[..., float],
    added: int,
    lines: tuple[str, ...],
    memory: Callable[..., tuple[float, ...]] | None,
    remembered: str,
) -> Callable[..., None]:
    """What the term changes in the slopes of all columns."""
    uses = {} if memory is None else {"memory": register_jitable(memory)}
    states = len(lines)
    source = _STEP.format(
        state=row("states", states, ", c"),
        sizes=row("params", added, ", c"),
        slopes=row("out", states, ", c"),
        remembered=remembered,
        changed=f"({', '.join(lines)},)",
        assigned="; ".join(f"out[{k}, c] = changed[{k}]" for k in range(states)),
    )
    return generated(source, {"term": register_jitable(term), "root": np.sqrt, **uses})


@picklable
def _observe(model: OdeModel, effect: Effect) -> Callable[[Array, Array, Array], Array] | None:
    change, count = effect.observe, len(model.parameters)
    if change is None:
        if model.observe is None:
            return None
        base = model.observe
        return lambda t_s, states, params: base(t_s, states, params[:count])

    def observe(t_s: Array, states: Array, params: Array) -> Array:
        seen = plain_observation(model, t_s, states, params[:count])
        velocity = along_time(np.ascontiguousarray(seen), t_s)
        return change(t_s, seen, velocity, params[count:])

    return observe


@kernel(types.float64[:, ::1](types.float64[:, ::1], types.float64[::1]))
def along_time(values: Array, t_s: Array) -> Array:
    """Derivative by time of values (n, d) at times (n,) s, as ``np.gradient`` has it, and 0 of a single one.

    It is what a fit asks for most often, and takes numpy ten times as long.
    """
    n, slopes = t_s.size, np.zeros_like(values)
    for c in range(values.shape[1] if n > 1 else 0):
        slopes[0, c] = (values[1, c] - values[0, c]) / (t_s[1] - t_s[0])
        slopes[n - 1, c] = (values[n - 1, c] - values[n - 2, c]) / (t_s[n - 1] - t_s[n - 2])
        for k in range(1, n - 1):
            before, after = t_s[k] - t_s[k - 1], t_s[k + 1] - t_s[k]
            rise, fall = (values[k + 1, c] - values[k, c]) / after, (values[k, c] - values[k - 1, c]) / before
            slopes[k, c] = (before * rise + after * fall) / (before + after)
    return slopes


def plain_observation(model: OdeModel, t_s: Array, states: Array, params: Array) -> Array:
    """What the model observes (n, d): the states of those names, or its own map.

    Parameters
    ----------
    model
        The governing equation.
    t_s
        (n,) s.
    states
        (n, s).
    params
        (p,) in the model's order.
    """
    if model.observe is not None:
        return np.asarray(model.observe(t_s, states, params))
    names = [state.name for state in model.states]
    return states[:, [names.index(quantity.name) for quantity in model.observed]]


@picklable
def _warp(model: OdeModel, effect: Effect) -> Callable[[Array, Array], Array] | None:
    count, before, added = len(model.parameters), model.warp, effect.warp
    if added is None:
        return None if before is None else lambda t_s, params: before(t_s, params[:count])
    if before is None:
        return lambda t_s, params: added(t_s, params[count:])
    return lambda t_s, params: before(added(t_s, params[count:]), params[:count])


@picklable
def _drive(model: OdeModel, effect: Effect) -> Callable[[Array, Array, Array], Array] | None:
    count, before, added = len(model.parameters), model.drive, effect.drive
    if added is None:
        return None if before is None else lambda t_s, inputs, params: before(t_s, inputs, params[:count])
    if before is None:
        return lambda t_s, inputs, params: added(t_s, inputs, params[count:])
    return lambda t_s, inputs, params: added(t_s, before(t_s, inputs, params[:count]), params[count:])


@picklable
def _own_drive(model: OdeModel) -> Callable[[Array, Array, Array], Array] | None:
    """What acts of the first inputs; further ones are as they are."""
    own, count = model.drive, len(model.inputs)
    if own is None:
        return None
    return lambda t_s, inputs, params: np.hstack([own(t_s, inputs[:, :count], params), inputs[:, count:]])


@picklable
@functools.lru_cache(maxsize=64)
def _forced_rhs(
    rhs: Callable[..., Any], n_states: int, first: int, n_forced: int, n_params: int, n_inputs: int
) -> Callable[..., Any]:
    lines = [f"slopes[{k}]" for k in range(n_states)]
    for k in range(n_forced):
        lines[first + k] += f" + inputs[{n_inputs + k}]"
    own = f", {row('inputs', n_inputs)}" if n_inputs else ""
    whole = generated(_FORCED.format(inputs=own, slopes=f"({', '.join(lines)},)"), {"base": register_jitable(rhs)})
    return followed_by(whole, rhs, (n_params, n_inputs), _push(first, n_forced, n_inputs))


@functools.lru_cache(maxsize=64)
def _push(first: int, n_forced: int, n_inputs: int) -> Callable[..., None]:
    pushed = "; ".join(f"out[{first + k}, c] = out[{first + k}, c] + inputs[{n_inputs + k}]" for k in range(n_forced))
    return generated(_PUSHED.format(pushed=pushed), {})


def forced(model: OdeModel) -> OdeModel:
    """The model with a force on each of its highest derivatives as further inputs."""
    count = model.degrees_of_freedom
    pushes = tuple(Quantity(f"force{k}", "1") for k in range(count))
    first = model.forced_states.start
    rhs = _forced_rhs(model.rhs, len(model.states), first, count, len(model.parameters), len(model.inputs))
    inputs = (*model.inputs, *pushes)
    own = _own_drive(model)
    return replace(model, name=f"{model.name}, forced", rhs=rhs, inputs=inputs, drive=own, events=within(model))
