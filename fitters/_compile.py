"""Turn a model's readable right-hand side into machine code that the integrator can call."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import cfunc, njit
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

from fitters._integrate import COLUMNS_SIGNATURE, integrate
from iris_sysid.errors import FitError
from iris_sysid.types import OdeModel

# The state and the parameters of one column reach the model as tuples of numbers, as it is written.
_LOOP = """
def columns(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        {slopes} = rhs(t, {states}, {params}{inputs})
"""


@dataclass(frozen=True, eq=False, slots=True)
class CompiledRhs:
    """A right-hand side ready to integrate.

    ``integrate`` is :func:`fitters._integrate.integrate` or, where numba cannot compile the model, the same
    steps in plain Python; ``columns`` is its first argument; ``note`` says so in words, empty when compiled.
    """

    integrate: Callable[..., None]
    columns: Any
    note: str = ""


def compiled_rhs(model: OdeModel) -> CompiledRhs:
    """Compile the model's right-hand side, once per function; FitError when it does not return what it must.

    A function that numba cannot compile runs in plain Python: slower, with the same steps.
    """
    _check_slopes(model)
    return _compile(model.rhs, len(model.states), len(model.parameters), len(model.inputs))


def callable_in_kernels(rhs: Callable[..., Any]) -> Any:
    """The right-hand side as a numba function, for use inside another one, e.g. a model with a term added."""
    return rhs if isinstance(rhs, Dispatcher) else _jitted(rhs)


@functools.lru_cache(maxsize=512)
def _jitted(rhs: Callable[..., Any]) -> Any:
    return njit(error_model="numpy")(rhs)


@functools.lru_cache(maxsize=512)
def _compile(rhs: Callable[..., Any], n_states: int, n_params: int, n_inputs: int) -> CompiledRhs:
    source = _loop_source(n_states, n_params, n_inputs)
    try:
        columns = cfunc(COLUMNS_SIGNATURE)(_loop(source, callable_in_kernels(rhs)))
    except (NumbaError, NotImplementedError, TypeError) as error:
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
        note = f"numba cannot compile the model's rhs ({reason[:120]}): it ran in plain Python, which is slower"
        return CompiledRhs(integrate.py_func, _quiet(_loop(source, rhs)), note)
    return CompiledRhs(integrate, columns)


def _loop_source(n_states: int, n_params: int, n_inputs: int) -> str:
    def row(name: str, count: int, index: str) -> str:
        return "(" + "".join(f"{name}[{i}{index}], " for i in range(count)) + ")"

    return _LOOP.format(
        slopes=row("out", n_states, ", c"),
        states=row("states", n_states, ", c"),
        params=row("params", n_params, ", c"),
        inputs=f", {row('inputs', n_inputs, '')}" if n_inputs else "",
    )


def _loop(source: str, rhs: Callable[..., Any]) -> Callable[..., None]:
    namespace: dict[str, Any] = {"rhs": rhs}
    exec(compile(source, "<columns>", "exec"), namespace)
    loop: Callable[..., None] = namespace["columns"]
    return loop


def _quiet(columns: Callable[..., None]) -> Callable[..., None]:
    """Plain Python raises where machine code gives inf or NaN; make both give NaN."""

    def quiet(t: float, states: Any, params: Any, inputs: Any, out: Any) -> None:
        try:
            with np.errstate(all="ignore"):
                columns(t, states, params, inputs, out)
        except (ArithmeticError, ValueError):
            out[:] = np.nan

    return quiet


def _check_slopes(model: OdeModel) -> None:
    """Call the right-hand side once, with ones, to see that it returns one number a state."""
    arguments: list[Any] = [0.0, (1.0,) * len(model.states), (1.0,) * len(model.parameters)]
    if model.inputs:
        arguments.append((1.0,) * len(model.inputs))
    try:
        with np.errstate(all="ignore"):
            slopes = model.rhs(*arguments)
    except ArithmeticError:
        return
    except Exception as error:
        raise FitError(
            f"rhs of model {model.name!r} raises {type(error).__name__}: {error}; it is called as "
            f"rhs(t, state, params{', inputs' if model.inputs else ''}) with tuples of numbers"
        ) from error
    if not isinstance(slopes, tuple) or len(slopes) != len(model.states):
        shown = f"{len(slopes)} values" if isinstance(slopes, tuple) else type(slopes).__name__
        names = ", ".join(state.name for state in model.states)
        raise FitError(
            f"rhs of model {model.name!r} must return a tuple with one derivative a state ({names}), not {shown}"
        )
