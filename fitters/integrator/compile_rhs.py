"""Turn a model's readable right-hand side into machine code that the integrator can call."""

from __future__ import annotations

import dis
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from fitters.integrator.chained_code import ChainedColumns
from fitters.integrator.codegen import generated, row
from fitters.integrator.dormand_prince import integrate
from fitters.integrator.machine_code import can_raise, compiled_columns
from fitters.integrator.step_control import controlled_steps
from iris_sysid.errors import FitError
from iris_sysid.types import Array, OdeModel

# The state and the parameters of one column reach the model as tuples of numbers, as it is written.
_LOOP = """
def columns(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        slopes = rhs(t, {states}, {params}{inputs})
        {slopes}
"""

# Crossing functions and resets of a model with events: its state ends with the mode, out with the event's number.
_CROSSINGS = """
def crossings(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        {crossings}
"""
_RESETS = """
def resets(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        {resets}
"""
# The same for a function that can raise: machine code that is called by its address cannot pass an exception on.
_GUARDED = """
def columns(t, states, params, inputs, out):
    for c in range(states.shape[1]):
        try:
            slopes = rhs(t, {states}, {params}{inputs})
            {slopes}
        except:
            out[:, c] = nan
"""
MAX_REPLAYS = 3
# Attribute of a right-hand side that only numba, not its author, takes for one that can raise (an index that is known
# to be one of the tuple): exceptions need no guard, which makes each step several times slower.
NEVER_RAISES = "never_raises"
# Attribute of a right-hand side that is another one and a step after it: see followed_by.
FOLLOWED = "followed"
RAISE = dis.opmap["RAISE_VARARGS"]


@dataclass(frozen=True, eq=False, slots=True)
class CompiledRhs:
    """A right-hand side ready to integrate.

    ``integrate`` is :func:`fitters.integrator.dormand_prince.integrate` or, where numba cannot
    compile the model, the same steps in plain Python; ``columns`` is its first argument; ``note`` says so in words,
    empty when compiled. ``choose`` is :func:`fitters.integrator.step_control.controlled_steps` alike. For a model with
    events it integrates through them, and ``columns`` is what that takes first.
    """

    integrate: Callable[..., None]
    choose: Callable[..., int]
    columns: Any
    note: str = ""


def compiled_rhs(model: OdeModel) -> CompiledRhs:
    """Compile the model's right-hand side, once per function; FitError when it does not return what it must.

    A function that numba cannot compile runs in plain Python: slower, with the same steps. Events must compile.
    """
    _check_slopes(model)
    if model.events:
        return _with_events(model)
    return _compile(model.rhs, len(model.states), len(model.parameters), len(model.inputs))


def callable_in_kernels(rhs: Callable[..., Any]) -> Any:
    """The right-hand side as a numba function, for use inside another one, e.g. a model with a term added."""
    return rhs if isinstance(rhs, Dispatcher) else _jitted(rhs)


def followed_by(
    rhs: Callable[..., Any],
    base: Callable[..., Any],
    takes: tuple[int, int],
    step: Callable[..., None] | None,
    hidden: int = 0,
) -> Callable[..., Any]:
    """Say that a right-hand side is that of a base, then a step, so that each of the two is compiled only once.

    Parameters
    ----------
    rhs
        The whole, as plain Python.
    base
        The right-hand side before the step.
    takes
        How many of the first parameters and of the first inputs the base takes.
    step
        ``(t, states (s, c), params (p, c), inputs (m,), out (s, c))``, changes the derivatives in ``out``; its
        parameters are those after the base's, its inputs all. None where nothing changes them.
    hidden
        How many of the last states the base does not have.
    """
    setattr(rhs, FOLLOWED, (base, takes, step, hidden))
    return rhs


@functools.lru_cache(maxsize=512)
def _jitted(rhs: Callable[..., Any]) -> Any:
    return njit(error_model="numpy")(rhs)


@functools.lru_cache(maxsize=512)
def _compile(rhs: Callable[..., Any], n_states: int, n_params: int, n_inputs: int) -> CompiledRhs:
    chained = _chained(rhs, n_states)
    if chained is not None:
        return CompiledRhs(integrate, controlled_steps, chained)
    source = _loop_source(n_states, n_params, n_inputs)
    plain = _quiet(generated(source, {"rhs": rhs}))
    try:
        values = {"rhs": callable_in_kernels(rhs)}
        columns = compiled_columns(generated(source, values))
        if can_raise(columns) and not getattr(rhs, NEVER_RAISES, False):
            guarded = _loop_source(n_states, n_params, n_inputs, loop=_GUARDED)
            columns = compiled_columns(generated(guarded, {**values, "nan": np.nan}), catches=True)
            return CompiledRhs(_Replaying(plain), _choose_or_stop, columns)
    except Exception as error:  # whatever numba raises: plain Python tells whether the function is at fault
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
        note = f"numba cannot compile the model's rhs ({reason[:120]}): it ran in plain Python, which is slower"
        return CompiledRhs(integrate.py_func, controlled_steps.py_func, plain, note)
    return CompiledRhs(integrate, controlled_steps, columns)


def _chained(rhs: Callable[..., Any], n_states: int) -> Any:
    """Machine code that calls that of the base and of the step; None where they must be compiled as one.

    That is so where one of them can raise, as only the whole catches it.
    """
    if not hasattr(rhs, FOLLOWED):
        return None
    base, takes, step, hidden = getattr(rhs, FOLLOWED)
    compiled = _compile(base, n_states - hidden, *takes)
    if compiled.note or compiled.integrate is not integrate:
        return None
    if step is None:
        return compiled.columns
    try:
        after = _compiled_step(step)
    except Exception:  # whatever numba raises: compiling the whole says it
        return None
    if can_raise(after):
        return None
    return ChainedColumns(compiled.columns, after, takes[0])


@functools.lru_cache(maxsize=512)
def _compiled_step(step: Callable[..., None]) -> Any:
    return compiled_columns(step)


class _Replaying:
    """Integrate; a solution that is not finite is integrated again in plain Python, which raises what was raised.

    After some of them without an exception, solutions of this function diverge by themselves: no more are replayed.
    """

    def __init__(self, plain: Callable[..., None]) -> None:
        self._plain = plain
        self._left = MAX_REPLAYS

    def __call__(self, columns: Any, *arguments: Any) -> None:
        *given, out = arguments
        try:
            integrate(columns, *given, out)
        except SystemError:  # one that numba itself sets, e.g. of a missing key, cannot be caught in machine code
            out[:] = np.nan
            self._left = max(self._left, 1)
        t_s, ends, initial, params, *rest = given
        for c in np.flatnonzero(~np.isfinite(out).all(axis=(0, 1)))[: self._left]:
            one = np.empty((*out.shape[:2], 1))
            integrate.py_func(self._plain, t_s, ends, initial[:, c : c + 1], params[:, c : c + 1], *rest, one)
            self._left -= 1


def _choose_or_stop(*arguments: Any) -> int:
    """Choose steps; none where the function raises: the integration then shows what."""
    try:
        return int(controlled_steps(*arguments))
    except SystemError:  # as above
        arguments[-1][0] = 0.0
        return 1


def substeps_of(ends: Array, n: int) -> NDArray[np.int64]:
    """Number of steps (n - 1,) that begin in each interval between n samples; ``ends`` (k + 1,) in samples."""
    return np.bincount(ends[:-1].astype(np.int64), minlength=n - 1)


def _arguments(n_states: int, n_params: int, n_inputs: int) -> dict[str, str]:
    return {
        "states": row("states", n_states, ", c"),
        "params": row("params", n_params, ", c"),
        "inputs": f", {row('inputs', n_inputs)}" if n_inputs else "",
    }


def _loop_source(n_states: int, n_params: int, n_inputs: int, modes: int = 0, loop: str = _LOOP) -> str:
    slopes = "; ".join(f"out[{k}, c] = slopes[{k}]" for k in range(n_states))
    return loop.format(slopes=slopes, **_arguments(n_states + modes, n_params, n_inputs))


def _with_events(model: OdeModel) -> CompiledRhs:
    """Compile a model with its events."""
    from fitters.integrator.events import (
        integrate_through_events,  # compiled when imported: only models with events pay for it
    )

    functions = (model.rhs, *(event.crossing for event in model.events), *(event.reset for event in model.events))
    try:
        three = _compile_events(functions, len(model.states), len(model.parameters), len(model.inputs))
    except (NumbaError, NotImplementedError, TypeError) as error:
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
        raise FitError(
            f"numba cannot compile the events of model {model.name!r} ({reason[:200]}): rhs, crossing and reset take "
            "(t, state, params), state ending with the mode, and return numbers and tuples of numbers only"
        ) from error

    def through(columns: Any, t_s: Any, ends: Any, initial: Any, params: Any, inputs: Any, *rest: Any) -> None:
        happened, substeps = np.empty((0, 2, initial.shape[1])), substeps_of(ends, t_s.size)
        integrate_through_events(columns, t_s, substeps, initial, params, inputs, *rest, happened)

    return CompiledRhs(through, _no_choice, (len(model.events), *three))


def _no_choice(*arguments: Any) -> int:
    """Steps are not chosen for a model with events: they end at those."""
    raise AssertionError("steps of a model with events are planned in equal parts, not chosen")


@functools.lru_cache(maxsize=512)
def _compile_events(functions: tuple[Callable[..., Any], ...], n_states: int, n_params: int, n_inputs: int) -> Any:
    """Three functions: dstate/dt, crossing functions, resets; from the model's rhs, its crossings and its resets."""
    rhs, *others = (callable_in_kernels(function) for function in functions)
    count = len(others) // 2
    call = "(t, {states}, {params}{inputs})".format(**_arguments(n_states + 1, n_params, n_inputs))
    after = row("out", n_states + 1, ", c")
    cases = [f"if out[{n_states + 1}, c] == {k}: {after} = reset_{k}{call}" for k in range(count)]
    crossings = "; ".join(f"out[{k}, c] = crossing_{k}{call}" for k in range(count))
    resets = "\n        ".join(cases)
    loops = (
        generated(_loop_source(n_states, n_params, n_inputs, modes=1), {"rhs": rhs}),
        generated(_CROSSINGS.format(crossings=crossings), _numbered("crossing", others[:count])),
        generated(_RESETS.format(resets=resets), _numbered("reset", others[count:])),
    )
    return tuple(compiled_columns(loop) for loop in loops)


def _numbered(name: str, functions: Sequence[Any]) -> dict[str, Any]:
    return {f"{name}_{k}": function for k, function in enumerate(functions)}


def _quiet(columns: Callable[..., None]) -> Callable[..., None]:
    """Plain Python raises where machine code gives inf or NaN; make both give NaN, and stop at any other exception."""

    def quiet(t: float, states: Any, params: Any, inputs: Any, out: Any) -> None:
        try:
            with np.errstate(all="ignore"):
                columns(t, states, params, inputs, out)
        except Exception as error:
            if not outside_domain(error):
                at = f"t = {t:.6g}, state {states[:, 0].tolist()}, params {params[:, 0].tolist()}"
                raise FitError(
                    f"the model's rhs raises {type(error).__name__}: {error} (at {at}); where the equation has no "
                    "solution let it return float('nan'), or give the parameter bounds"
                ) from error
            out[:] = np.nan

    return quiet


def outside_domain(error: BaseException) -> bool:
    """Whether an exception comes from arithmetic itself, as from ``math.sqrt(-1)``, and not from a ``raise``."""
    if not isinstance(error, ArithmeticError | ValueError):
        return False
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is None or trace.tb_frame.f_code.co_code[trace.tb_lasti] != RAISE


def _check_slopes(model: OdeModel) -> None:
    """Call the right-hand side once, with ones, to see that it returns one number a state."""
    mode = (0.0,) if model.events else ()
    arguments: list[Any] = [0.0, (1.0,) * len(model.states) + mode, (1.0,) * len(model.parameters)]
    if model.inputs:
        arguments.append((1.0,) * len(model.inputs))
    try:
        with np.errstate(all="ignore"):
            slopes = model.rhs(*arguments)
    except Exception as error:
        if outside_domain(error):
            return
        raise FitError(
            f"rhs of model {model.name!r} raises {type(error).__name__}: {error}; it is called as "
            f"rhs(t, state, params{', inputs' if model.inputs else ''}) with tuples of numbers"
        ) from error
    if not isinstance(slopes, tuple | list | np.ndarray) or np.shape(slopes) != (len(model.states),):
        shown = type(slopes).__name__ if np.ndim(slopes) != 1 else f"{len(slopes)} values"
        names = ", ".join(state.name for state in model.states)
        raise FitError(
            f"rhs of model {model.name!r} must return a tuple with one derivative a state ({names}), not {shown}"
        )
