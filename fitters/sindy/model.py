"""Build the model of a choice of terms from functions, for the ODE engine."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numba.extending import register_jitable

from fitters.integrator.compile_rhs import NEVER_RAISES
from fitters.sindy.library import COUPLED, INPUT, Library, Term, bare_model, term_value
from iris_sysid.types import Array, OdeModel, picklable

Function = TypeVar("Function", bound=Callable[..., Any])


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
    spec = tuple((term.equation, term.code, term.other) for term in terms)
    return bare_model(
        variables,
        rhs=_rhs(len(variables), variables[0].order, spec, library.partner, library.turnover, pushed),
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
) -> Callable[..., tuple[Any, ...]]:
    """The right-hand side for a choice of terms, built from functions; the same choice gives the same function."""
    slopes = _nothing
    for k in range(d if order == 2 else 0):
        slopes = _and(slopes, _state(d + k))
    for k in range(d):
        own = tuple((index, code, other) for index, (equation, code, other) in enumerate(spec) if equation == k)
        slopes = _and(slopes, _equation(k, d if order == 2 else 0, partner[k], own, turnover))

    def autonomous(t: Any, state: Any, params: Any) -> Any:
        return slopes(t, state, params, ())

    rhs = slopes if pushed else autonomous
    setattr(rhs, NEVER_RAISES, True)
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
            other = state[second] if code in COUPLED else velocity
            pushed = velocity
            if pushes:
                pushed = inputs[second] if code == INPUT else velocity
            slope += params[index] * _term_value(code, state[k], other, velocity, speed, pushed, turnover)
        return slope

    return total if own else nothing
