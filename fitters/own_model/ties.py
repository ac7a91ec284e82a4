"""Parameters as lmfit states them: starts, bounds, values held, and ties between parameters by an expression."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numba.extending import register_jitable

from fitters.integrator.codegen import generated
from fitters.own_model.expression import FUNCTIONS, POWER, read_expression
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Estimate, OdeModel, Parameter, Quantity, Trajectory, picklable

if TYPE_CHECKING:
    import lmfit


@dataclass(frozen=True, eq=False, slots=True)
class Stated:
    """What lmfit ``Parameters`` state: a model with their bounds and ties, values to hold, to free, and to start at."""

    model: OdeModel
    fixed: Mapping[str, float | Estimate]
    free: tuple[str, ...]
    start: Mapping[str, float]


def stated_by(parameters: lmfit.Parameters, model: OdeModel) -> Stated:
    """Read lmfit ``Parameters`` for a model.

    Parameters
    ----------
    parameters
        By the model's names, and further ones that expressions use.
    model
        The governing equation.

    Raises
    ------
    FitError
        When a name is neither the model's nor used by an expression, or a tie cannot be kept.
    """
    ties = {name: one.expr for name, one in parameters.items() if one.expr}
    tied = tied_model(model, tuple(ties.items())) if ties else model
    limits = {name: (float(one.min), float(one.max)) for name, one in parameters.items()}
    known = {parameter.name: parameter for parameter in tied.parameters}
    for name in parameters:
        if name not in (*known, *tied.initial_names, *ties):
            names = ", ".join((*known, *tied.initial_names))
            raise FitError(f"parameters: model {model.name!r} has no parameter {name!r}; it has {names}")
    bounded = tuple(_bounded(parameter, limits.get(parameter.name)) for parameter in tied.parameters)
    own = {name: one for name, one in parameters.items() if name not in ties}
    return Stated(
        replace(tied, parameters=bounded),
        {name: float(one.value) for name, one in own.items() if not one.vary},
        tuple(name for name, one in own.items() if one.vary and name in known and known[name].constant),
        {name: float(one.value) for name, one in own.items() if one.vary and np.isfinite(one.value)},
    )


def _bounded(parameter: Parameter, limits: tuple[float, float] | None) -> Parameter:
    if limits is None:
        return parameter
    return replace(parameter, lower=max(parameter.lower, limits[0]), upper=min(parameter.upper, limits[1]))


def tied_model(model: OdeModel, ties: tuple[tuple[str, str], ...]) -> OdeModel:
    """The model with some parameters given by expressions of the others; they are among what it derives.

    Parameters
    ----------
    model
        The governing equation.
    ties
        Pairs of a parameter's name and its expression. A name that the model does not have becomes a parameter of
        the tied one.

    Raises
    ------
    FitError
        When an initial value is tied, an expression uses a tied parameter, or the model has events.
    """
    read = {name: read_expression(text) for name, text in ties}
    own = {parameter.name: parameter for parameter in model.parameters}
    for name, expression in read.items():
        if name not in own:
            raise FitError(f"{name} cannot be tied: it is not a parameter of the model {model.name!r}")
        for part in expression.names():
            if part.head in read or part.head in model.initial_names:
                raise FitError(f"{name} is tied to {part.head}, which is tied itself or an initial value")
    if model.events:
        raise FitError(f"parameters of the model {model.name!r} cannot be tied: it has events")
    used = dict.fromkeys(part.head for expression in read.values() for part in expression.names())
    added = [Parameter(name, "1", name) for name in used if name not in own]
    kept = (*(parameter for parameter in model.parameters if parameter.name not in read), *added)
    names, full = tuple(parameter.name for parameter in kept), tuple(own)
    return replace(
        model,
        name=f"{model.name} with {', '.join(f'{name} = {text}' for name, text in ties)}",
        parameters=kept,
        rhs=_rhs(model.rhs, full, names, ties, bool(model.inputs)),
        guess=_guess(model.guess, tuple(read)),
        observe=None if model.observe is None else _observe(model.observe, full, names, ties),
        warp=None if model.warp is None else _warp(model.warp, full, names, ties),
        drive=None if model.drive is None else _drive(model.drive, full, names, ties),
        derived=(*(Quantity(name, own[name].unit, own[name].symbol) for name in read), *model.derived),
        derive=_derive(model.derive, names, ties),
        first_integral=None,
        ties=ties,
    )


def _sources(full: tuple[str, ...], names: tuple[str, ...], ties: tuple[tuple[str, str], ...]) -> str:
    """The model's parameters as a tuple, written from those of the tied model."""
    places = {name: f"params[{k}]" for k, name in enumerate(names)}
    read = {name: read_expression(text).source(places) for name, text in ties}
    return f"({', '.join(read.get(name, places.get(name, '')) for name in full)},)"


@picklable
@functools.lru_cache(maxsize=64)
def _rhs(
    base: Callable[..., Any],
    full: tuple[str, ...],
    names: tuple[str, ...],
    ties: tuple[tuple[str, str], ...],
    takes_inputs: bool,
) -> Callable[..., tuple[float, ...]]:
    more = ", inputs" if takes_inputs else ""
    source = f"def rhs(t, state, params{more}):\n    return base(t, state, {_sources(full, names, ties)}{more})\n"
    return generated(source, {**FUNCTIONS, "power": POWER, "base": register_jitable(base)})


@functools.lru_cache(maxsize=64)
def _all(
    full: tuple[str, ...], names: tuple[str, ...], ties: tuple[tuple[str, str], ...]
) -> Callable[[Any], tuple[float, ...]]:
    source = f"def whole(params):\n    return {_sources(full, names, ties)}\n"
    return generated(source, {**FUNCTIONS, "power": POWER})


@picklable
def _observe(
    base: Callable[..., Array], full: tuple[str, ...], names: tuple[str, ...], ties: tuple[tuple[str, str], ...]
) -> Callable[[Array, Array, Array], Array]:
    return lambda t_s, states, params: base(t_s, states, np.array(_all(full, names, ties)(params)))


@picklable
def _warp(
    base: Callable[..., Array], full: tuple[str, ...], names: tuple[str, ...], ties: tuple[tuple[str, str], ...]
) -> Callable[[Array, Array], Array]:
    return lambda t_s, params: base(t_s, np.array(_all(full, names, ties)(params)))


@picklable
def _drive(
    base: Callable[..., Array], full: tuple[str, ...], names: tuple[str, ...], ties: tuple[tuple[str, str], ...]
) -> Callable[[Array, Array, Array], Array]:
    return lambda t_s, inputs, params: base(t_s, inputs, np.array(_all(full, names, ties)(params)))


@picklable
def _guess(
    base: Callable[[Trajectory], Mapping[str, float]], tied: tuple[str, ...]
) -> Callable[[Trajectory], Mapping[str, float]]:
    def guess(trajectory: Trajectory) -> Mapping[str, float]:
        return {name: value for name, value in base(trajectory).items() if name not in tied}

    return guess


@picklable
def _derive(
    base: Callable[..., Mapping[str, float]] | None, names: tuple[str, ...], ties: tuple[tuple[str, str], ...]
) -> Callable[[Mapping[str, float]], Mapping[str, float]]:
    tied = tuple(name for name, _ in ties)
    made = _all(tied, names, ties)

    def derive(values: Mapping[str, float]) -> Mapping[str, float]:
        found = dict(zip(tied, made([values[name] for name in names]), strict=True))
        return {**found, **(base({**values, **found}) if base is not None else {})}

    return derive
