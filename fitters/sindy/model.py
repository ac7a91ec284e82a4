"""Build the model of a choice of terms from functions, for the ODE engine."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numba.extending import register_jitable

from fitters.integrator.compile_rhs import NEVER_RAISES
from fitters.sindy.library import DIFFERENCE, FEATURE, INPUT, OTHER_ROOT, Library, Term, bare_model, term_value
from iris_sysid.types import Array, OdeModel, picklable

Function = TypeVar("Function", bound=Callable[..., Any])
Factor = tuple[Callable[..., Any], tuple[int, ...]]  # a function, and which of (*state, *inputs) it takes


def _in_kernels(function: Function) -> Function:
    """Let numba inline the function into compiled ones; in Python it is unchanged."""
    made: Function = register_jitable(function)
    return made


def model_of(library: Library, names: Sequence[str] | None = None) -> OdeModel:
    """The model with all terms of the library, or with those whose parameters are named."""
    variables = library.variables
    terms = tuple(term for term in library.terms if names is None or term.parameter.name in names)
    sizes = tuple(variable.kind == "size" for variable in variables)
    pushed = any(term.pushed for term in terms)
    functions = tuple(library.functions[term.other] if term.code == FEATURE else None for term in terms)
    spec = _spec(library, terms)
    return bare_model(
        variables,
        rhs=_rhs(len(variables), variables[0].order, spec, library.partner, library.turnover, pushed, functions),
        equation=r",\quad ".join(equation_latex(library, k, terms) for k in range(len(variables))),
        parameters=tuple(term.parameter for term in terms),
        inputs=library.inputs if pushed else (),
        observe=_reciprocal(sizes) if any(sizes) else None,
    )


def equation_latex(library: Library, equation: int, terms: Sequence[Term]) -> str:
    """One equation with the symbols of its coefficients, as LaTeX."""
    variable = library.variables[equation]
    parts = [rf"{term.parameter.symbol}\,{term.latex}" for term in terms if term.equation == equation]
    return f"{variable.left_latex} = {' + '.join(parts) or '0'}"


def _spec(library: Library, terms: tuple[Term, ...]) -> tuple[tuple[int, int, int], ...]:
    return tuple((term.equation, term.code, term.other) for term in terms)


@picklable
def _reciprocal(sizes: tuple[bool, ...]) -> Callable[[Array, Array, Array], Array]:
    def observe(t_s: Array, states: Array, params: Array) -> Array:
        seen = states[:, : len(sizes)]
        return np.where(sizes, 1.0 / seen, seen)

    return observe


@picklable
@functools.lru_cache(maxsize=256)
def _rhs(
    d: int,
    order: int,
    spec: tuple[tuple[int, int, int], ...],
    partner: tuple[int, ...],
    turnover: float,
    pushed: bool,
    functions: tuple[Callable[..., Any] | None, ...],
) -> Callable[..., tuple[Any, ...]]:
    """The right-hand side for a choice of terms, built from functions; the same choice gives the same function."""
    slopes = _nothing
    for k in range(d if order == 2 else 0):
        slopes = _and(slopes, _state(d + k))
    for k in range(d):
        own = [(index, code, other) for index, (equation, code, other) in enumerate(spec) if equation == k]
        coded = tuple(one for one in own if one[1] != FEATURE)
        total = _equation(k, d if order == 2 else 0, partner[k], coded, turnover)
        for index in (index for index, code, _ in own if code == FEATURE):
            total = _plus(total, index, functions[index])
        slopes = _and(slopes, total)

    def autonomous(t: Any, state: Any, params: Any) -> Any:
        return slopes(t, state, params, ())

    rhs = slopes if pushed else autonomous
    setattr(rhs, NEVER_RAISES, not any(functions))
    return rhs


@_in_kernels
def _nothing(t: Any, state: Any, params: Any, inputs: Any) -> Any:
    return ()


def _state(k: int) -> Callable[..., Any]:
    @_in_kernels
    def state_k(t: Any, state: Any, params: Any, inputs: Any) -> Any:
        return state[k]

    return state_k


def _and(before: Callable[..., Any], added: Callable[..., Any]) -> Callable[..., Any]:
    """The derivatives so far, and one more."""

    @_in_kernels
    def slopes(t: Any, state: Any, params: Any, inputs: Any) -> Any:
        return (*before(t, state, params, inputs), added(t, state, params, inputs))

    return slopes


_term_value = _in_kernels(term_value)


def _equation(
    k: int, shift: int, along: int, own: tuple[tuple[int, int, int], ...], turnover: float
) -> Callable[..., Any]:
    """The sum of one equation's terms: parameter ``index`` times the function ``code`` of variable ``k``.

    One loop over a table of whole numbers, so that numba has one function to compile, not one a term.
    """
    pushes = any(code == INPUT for _, code, _ in own)

    @_in_kernels
    def nothing(t: Any, state: Any, params: Any, inputs: Any) -> Any:
        return 0.0 * state[k]

    @_in_kernels
    def total(t: Any, state: Any, params: Any, inputs: Any) -> Any:
        slope, velocity = 0.0 * state[k], state[shift + k]
        speed = np.abs(velocity) if along == k else np.sqrt(velocity**2 + state[shift + along] ** 2)
        for index, code, second in own:
            other = state[second] if code in (DIFFERENCE, OTHER_ROOT) else velocity
            pushed = velocity
            if pushes:
                pushed = inputs[second] if code == INPUT else velocity
            slope += params[index] * _term_value(code, state[k], other, velocity, speed, pushed, turnover)
        return slope

    return total if own else nothing


# --------------------------------------------------------------------------- functions that the library was given


def _plus(before: Callable[..., Any], index: int, function: Callable[..., Any] | None) -> Callable[..., Any]:
    """The sum so far, and parameter ``index`` times a function of state and inputs."""
    assert function is not None  # of a FEATURE
    value = _in_kernels(function)

    @_in_kernels
    def total(t: Any, state: Any, params: Any, inputs: Any) -> Any:
        return before(t, state, params, inputs) + params[index] * value(state, inputs)

    return total


@picklable
@functools.lru_cache(maxsize=1024)
def feature_of(factors: tuple[Factor, ...], count: int) -> Callable[[Any, Any], Any]:
    """The product of functions of the state, of ``count`` numbers, and the inputs."""
    product: Callable[..., Any] = _one
    for function, taken in factors:
        arguments: Callable[..., Any] = _no_arguments
        for k in taken:
            arguments = _and_argument(arguments, k, count)
        product = _times(product, _in_kernels(function), arguments)
    return product


@_in_kernels
def _one(state: Any, inputs: Any) -> Any:
    return 1.0


@_in_kernels
def _no_arguments(state: Any, inputs: Any) -> Any:
    return ()


def _and_argument(before: Callable[..., Any], k: int, count: int) -> Callable[..., Any]:
    """The arguments so far, and number ``k`` of state and inputs."""

    @_in_kernels
    def of_state(state: Any, inputs: Any) -> Any:
        return (*before(state, inputs), state[k])

    @_in_kernels
    def of_inputs(state: Any, inputs: Any) -> Any:
        return (*before(state, inputs), inputs[k - count])

    return of_state if k < count else of_inputs


def _times(before: Callable[..., Any], function: Callable[..., Any], arguments: Callable[..., Any]) -> Any:
    @_in_kernels
    def product(state: Any, inputs: Any) -> Any:
        return before(state, inputs) * function(*arguments(state, inputs))

    return product
