"""A model from a plain function, written as SciPy's solvers take it: ``f(t, y, a, b)``."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from numba.extending import register_jitable

from fitters.integrator.codegen import generated, row
from fitters.own_model.equation import ANYTHING, NO_BOUNDS, NO_UNITS, check_known
from iris_sysid.errors import DataError
from iris_sysid.types import OdeModel, Parameter, Quantity, picklable


def model_from_function(
    function: Callable[..., Any],
    states: Sequence[str],
    *,
    observed: Sequence[str] = (),
    inputs: Sequence[str] = (),
    units: Mapping[str, str] = NO_UNITS,
    bounds: Mapping[str, tuple[float, float]] = NO_BOUNDS,
) -> OdeModel:
    """Make a model from a plain function ``f(t, y, a, b, ...)`` that returns dy/dt, as SciPy's ``solve_ivp`` takes it.

    The arguments after the second are the parameters, by name; a default is a starting value. The function gets ``y``
    as a tuple of numbers and returns a tuple, list or array; what numba cannot compile runs in plain Python.

    Parameters
    ----------
    function
        The right-hand side.
    states
        Names of the components of y: positions first, then their velocities in the same order.
    observed
        The states that are measured; the first one if empty.
    inputs
        Arguments that are known inputs u(t) of the trajectory instead of parameters.
    units
        Units by name, of states and parameters; ``1`` where none is given, which fits any column. Give those of
        velocities too, e.g. rad/s: effects on the acceleration are tried only on positions with their velocities.
    bounds
        Smallest and largest value of parameters.

    Returns
    -------
    OdeModel
        Named like the function. Without defaults, a fit takes its starting values from the data.

    Raises
    ------
    DataError
        When the arguments cannot be read from the signature, or a name is not an argument of the function.

    Examples
    --------
    >>> from iris_sysid import model_from_function, simulate
    >>> def cooling(t, y, rate, room=20.0):
    ...     return [-rate * (y[0] - room)]
    >>> tea = model_from_function(cooling, ["temperature"])
    >>> [parameter.name for parameter in tea.parameters]
    ['rate', 'room']
    >>> simulate(tea, [0.0, 10.0], {"rate": 0.1, "temperature_0": 90.0}).observed[:, 0].round(2)
    array([90.  , 45.75])
    """
    defaults = _arguments(function)
    check_known("inputs", inputs, list(defaults), "the function")
    names = [name for name in defaults if name not in inputs]
    check_known("bounds", bounds, names, "the function")
    check_known("observed", observed, states, "the function")
    order = tuple(f"params[{names.index(n)}]" if n in names else f"inputs[{inputs.index(n)}]" for n in defaults)
    quantities = {name: Quantity(name, units.get(name, "1"), name) for name in (*states, *inputs)}
    return OdeModel(
        name=getattr(function, "__name__", "own-function").replace("_", "-").strip("-<>"),
        summary=((inspect.getdoc(function) or "").splitlines() or ["a function of the user's own"])[0],
        equation="",
        source="given as a function",
        states=tuple(quantities[name] for name in states),
        parameters=tuple(
            Parameter(name, units.get(name, "1"), name, *bounds.get(name, ANYTHING), default=defaults[name])
            for name in names
        ),
        observed=tuple(quantities[name] for name in observed or states[:1]),
        rhs=_rhs(function, len(states), order, bool(inputs)),
        inputs=tuple(quantities[name] for name in inputs),
    )


def _arguments(function: Callable[..., Any]) -> dict[str, float | None]:
    """The arguments after t and y, with their defaults."""
    given = list(inspect.signature(function).parameters.values())
    if len(given) < 2 or any(item.kind not in (item.POSITIONAL_ONLY, item.POSITIONAL_OR_KEYWORD) for item in given):
        raise DataError("a model is made from a function f(t, y, a, b, ...): name its parameters one by one")
    return {item.name: None if item.default is item.empty else float(item.default) for item in given[2:]}


@picklable
@functools.lru_cache(maxsize=64)
def _rhs(
    function: Callable[..., Any], n_states: int, arguments: tuple[str, ...], takes_inputs: bool
) -> Callable[..., tuple[float, ...]]:
    """The function as the engine calls it: parameters in a tuple, one number a state."""
    more = ", inputs" if takes_inputs else ""
    call = f"function({', '.join(('t', 'state', *arguments))})"
    source = f"def rhs(t, state, params{more}):\n    rates = {call}\n    return {row('rates', n_states)}\n"
    return generated(source, {"function": register_jitable(function)})
