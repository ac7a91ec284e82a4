"""A model from its equation of motion in text: ``theta'' = -g/L*sin(theta) - c*theta'``."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fitters.effects.input_delay import late
from fitters.integrator.codegen import generated
from fitters.own_model.expression import (
    FUNCTIONS,
    INPUT_NAME,
    POWER,
    TIME,
    Expression,
    ExpressionError,
    read_equations,
    symbol,
)
from iris_sysid.errors import DataError
from iris_sysid.types import Array, OdeModel, Parameter, Quantity, picklable
from iris_sysid.units import rate_of

MAX_STATES = 12
POSITIVE = ("sqrt", "log")
ANYTHING = (float("-inf"), float("inf"))
NO_UNITS: Mapping[str, str] = MappingProxyType({})
NO_BOUNDS: Mapping[str, tuple[float, float]] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class _System:
    """Equations solved for their highest derivatives: by the name of the quantity its order and its right side."""

    text: str
    sides: Mapping[str, tuple[int, Expression]]

    @property
    def second(self) -> list[str]:
        """Quantities whose second derivative is given."""
        return [name for name, (order, _) in self.sides.items() if order == 2]

    @property
    def states(self) -> list[str]:
        """As they stand in equations: positions, then velocities, then the quantities of first order."""
        return [*self.second, *(f"{name}'" for name in self.second), *(n for n in self.sides if n not in self.second)]

    @property
    def others(self) -> list[str]:
        """Names other than those of states, in the order in which they appear."""
        names = [part.head for _, side in self.sides.values() for part in side.names()]
        return list(dict.fromkeys(name for name in names if name not in self.states and name != TIME))

    @property
    def inputs(self) -> list[str]:
        """Names of known inputs."""
        return [name for name in self.others if INPUT_NAME.fullmatch(name)]

    @property
    def parameters(self) -> list[str]:
        """Names of parameters."""
        return [name for name in self.others if not INPUT_NAME.fullmatch(name)]

    @property
    def delays(self) -> dict[str, Expression]:
        """The delay of each input that has one, by its name: a parameter or a number."""
        return {given.head: delay for _, side in self.sides.values() for given, delay in side.delayed()}


def model_from_equation(
    text: str,
    *,
    units: Mapping[str, str] = NO_UNITS,
    observed: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] = NO_BOUNDS,
    name: str = "own-equation",
) -> OdeModel:
    """Make a model from its equation of motion in text; its parameters are the names that are nothing else.

    An equation is solved for the highest derivative, ``theta'' = ...`` or ``h' = ...``; several are separated by ``;``.
    On the right stand numbers, names, ``+ - * / ^``, brackets, and sin, cos, tan, exp, log, sqrt, abs, sign, tanh,
    atan, max, min. ``t`` is the time in s, ``u``, ``u1``, ... are known inputs, ``pi`` is the number. ``u(t - tau)``
    is an input that acts late, by a parameter or a number, in s; before the record it is taken at its first value.
    The text is parsed, not run.

    Parameters
    ----------
    text
        The equation or equations.
    units
        Units by name, of quantities, inputs and parameters; ``1`` where none is given, which fits any column.
    observed
        The quantities that are measured; all that have an equation if empty.
    bounds
        Smallest and largest value of parameters. What stands alone under a root or in a logarithm is above zero.
    name
        Of the model, in reports.

    Returns
    -------
    OdeModel
        Without a guess: a fit takes its starting values from the data. The initial values are ``theta_0`` and, for a
        second derivative, ``theta_rate_0``.

    Raises
    ------
    DataError
        When the text cannot be read, with the column; when bounds or observed name something else.

    Examples
    --------
    >>> from iris_sysid import model_from_equation, simulate
    >>> swing = model_from_equation("theta'' = -g/L*sin(theta) - c*theta'", units={"theta": "rad", "L": "m"})
    >>> [parameter.name for parameter in swing.parameters]
    ['g', 'L', 'c']
    >>> values = {"g": 9.81, "L": 0.5, "c": 0.1, "theta_0": 0.2, "theta_rate_0": 0.0}
    >>> simulate(swing, [0.0, 0.5, 1.0], values).observed[:, 0].round(4)
    array([ 0.2   , -0.1145, -0.0572])
    """
    system = _system(text)
    check_known("bounds", bounds, system.parameters)
    seen = [*observed] or [*system.sides]
    check_known("observed", seen, list(system.sides))
    return OdeModel(
        name=name,
        summary="an equation of the user's own",
        equation=_latex(system),
        source=f"given as text: {text}",
        states=tuple(_state(state, units) for state in system.states),
        parameters=tuple(_parameter(system, name, units, bounds) for name in system.parameters),
        observed=tuple(_state(name, units) for name in seen),
        rhs=_rhs(text),
        inputs=tuple(_state(name, units) for name in system.inputs),
        drive=_drive(text) if system.delays else None,
    )


def quantities_of_equation(text: str) -> tuple[str, ...]:
    """Names of the quantities whose derivatives an equation in text gives; DataError where it cannot be read."""
    return tuple(_system(text).sides)


def inputs_of_equation(text: str) -> tuple[str, ...]:
    """Names of the known inputs of an equation in text; DataError where it cannot be read."""
    return tuple(_system(text).inputs)


def rates_of_equation(text: str) -> dict[str, Expression]:
    """The rate of each state by its name, in the order of the model's states; DataError where it cannot be read.

    In the rates a velocity is called ``theta'``, as in the text; as a state it is ``theta_rate``.
    """
    system = _system(text)
    rates = {name: Expression(f"{name}'") for name in system.second}
    rates |= {f"{name}_rate": system.sides[name][1] for name in system.second}
    return rates | {name: side for name, (order, side) in system.sides.items() if order == 1}


def check_known(what: str, given: Iterable[str], known: Sequence[str], of: str = "the equation") -> None:
    """Raise DataError with the names that are ``known`` where one of those ``given`` is not.

    Parameters
    ----------
    what, of
        What the names are given for, and what has the known ones.
    given, known
        Names.
    """
    for name in given:
        if name not in known:
            raise DataError(f"{what}: {of} has no {name!r}; it has {', '.join(known) or 'none'}")


@functools.lru_cache(maxsize=64)
def _system(text: str) -> _System:
    sides: dict[str, tuple[int, Expression]] = {}
    for left, right in read_equations(text):
        name = left.head.rstrip("'")
        order = len(left.head) - len(name)
        if left.parts or not name or order not in (1, 2):
            reason = "the left side is the highest derivative alone, of first or second order, as theta'' or h'"
            raise ExpressionError(text, left.column, reason)
        if name in sides or name == TIME or name in FUNCTIONS or INPUT_NAME.fullmatch(name):
            reason = "has an equation already" if name in sides else "has another meaning"
            raise ExpressionError(text, left.column, f"{name} {reason}")
        sides[name] = order, right
    if len(sides) > MAX_STATES:
        raise ExpressionError(text, 0, f"more than {MAX_STATES} equations")
    system = _System(text, MappingProxyType(sides))
    for _, side in sides.values():
        for part in side.names():
            _check_derivative(system, part)
    _check_delays(system)
    _check_clash(system)
    return system


def _check_derivative(system: _System, part: Expression) -> None:
    if "'" not in part.head or part.head in system.states:
        return
    name = part.head.rstrip("'")
    if name in system.sides:
        reason = f"{part.head} must not stand on the right: solve for it, and put what it equals here"
    else:
        reason = f"{part.head} is a derivative, but no equation gives one of {name}"
    raise ExpressionError(system.text, part.column, reason)


def _check_delays(system: _System) -> None:
    """An input acts once: with one delay wherever it stands."""
    for name, delay in system.delays.items():
        if delay.head in system.states:
            raise ExpressionError(system.text, delay.column, "a delay is a parameter or a number")
        places = [part for _, side in system.sides.values() for part in side.names() if part.head == name]
        delays = [each for _, side in system.sides.values() for given, each in side.delayed() if given.head == name]
        if len(delays) < len(places) or len({(each.head, each.value) for each in delays}) > 1:
            reason = f"{name} has one delay wherever it stands; give the record a second column, as u2, for another"
            raise ExpressionError(system.text, places[-1].column, reason)


def _check_clash(system: _System) -> None:
    taken = [f"{_plain(state)}_0" for state in system.states] + [_plain(state) for state in system.states]
    for name in system.others:
        if name in taken:
            raise DataError(f"{name} is the name of a state or its initial value; give the parameter another one")


def _plain(state: str) -> str:
    """The name of a state in the model: velocities are ``theta_rate``."""
    return state.replace("'", "_rate")


def _state(name: str, units: Mapping[str, str]) -> Quantity:
    base = name.rstrip("'")
    unit = units.get(base, "1")
    return Quantity(name, unit, symbol(name)) if base == name else Quantity(_plain(name), rate_of(unit), _dotted(name))


def _dotted(name: str) -> str:
    base = name.rstrip("'")
    dots = {0: symbol(base), 1: rf"\dot{{{symbol(base)}}}", 2: rf"\ddot{{{symbol(base)}}}"}
    return dots[len(name) - len(base)]


def _parameter(
    system: _System, name: str, units: Mapping[str, str], bounds: Mapping[str, tuple[float, float]]
) -> Parameter:
    inside = [call.parts[0] for _, side in system.sides.values() for call in side.calls() if call.head in POSITIVE]
    delays = [delay.head for delay in system.delays.values()]
    positive = name in delays or any(part.head == name and not part.parts for part in inside)
    free = (0.0, ANYTHING[1]) if positive else ANYTHING
    lower, upper = bounds.get(name, free)
    if not lower < upper:
        raise DataError(f"the bounds of {name} must be a smaller and a larger number, not {lower:g} and {upper:g}")
    return Parameter(name, units.get(name, "s" if name in delays else "1"), symbol(name), lower, upper)


def _latex(system: _System) -> str:
    symbols = {name: _dotted(name) for name in (*system.states, *system.others, TIME)}
    lefts = [_dotted(name + "'" * order) for name, (order, _) in system.sides.items()]
    rights = [side.latex(symbols) for _, side in system.sides.values()]
    return r",\quad ".join(f"{left} = {right}" for left, right in zip(lefts, rights, strict=True))


@picklable
@functools.lru_cache(maxsize=64)
def _rhs(text: str) -> Callable[..., tuple[float, ...]]:
    """The right-hand side, written from the expressions that were read: indices, numbers and functions only."""
    system = _system(text)
    names = {TIME: "t"}
    for array, members in (("state", system.states), ("params", system.parameters), ("inputs", system.inputs)):
        names |= {name: f"{array}[{k}]" for k, name in enumerate(members)}
    velocities = [names[f"{name}'"] for name in system.second]
    sides = [system.sides[name][1].source(names) for name in system.second]
    sides += [side.source(names) for order, side in system.sides.values() if order == 1]
    arguments = "t, state, params, inputs" if system.inputs else "t, state, params"
    source = f"def rhs({arguments}):\n    return ({', '.join([*velocities, *sides])},)\n"
    return generated(source, {**FUNCTIONS, "power": POWER})


@picklable
@functools.lru_cache(maxsize=64)
def _drive(text: str) -> Callable[[Array, Array, Array], Array]:
    """What acts of the inputs, each late by its delay."""
    system = _system(text)
    columns = [system.inputs.index(name) for name in system.delays]
    delays = list(system.delays.values())
    which = [system.parameters.index(delay.head) if delay.head else None for delay in delays]

    def drive(t_s: Array, inputs: Array, params: Array) -> Array:
        acting = np.array(inputs, dtype=np.float64)
        for column, delay, k in zip(columns, delays, which, strict=True):
            delay_s = float(delay.value or 0.0) if k is None else float(params[k])
            acting[:, column] = late(t_s, np.ascontiguousarray(acting[:, column]), delay_s)
        return acting

    return drive
