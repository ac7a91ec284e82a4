"""Candidates out of a feature library of pysindy, as functions that the integrator can follow.

A feature of pysindy is a product of functions of the inputs of its library: here the values of the equation, for
equations of second order then their rates, then the known inputs. A feature that is a candidate of our own library
(``sin(theta)``, ``|z'| z'``) becomes that one, with its unit, its effect, and its place in the models of the bank.
"""

from __future__ import annotations

import copy
import functools
import itertools
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitters.sindy.library import FEATURE, Library, Term, Variable, evaluated
from fitters.sindy.model import Factor, feature_of
from fitters.sindy.model_structure import RANGES
from iris_sysid.errors import DataError
from iris_sysid.types import Array, Parameter, picklable

SAMPLES = 40
SAME = 1e-9  # fraction of a feature's size: a larger difference makes it another function
SUPPORTED = "PolynomialLibrary, FourierLibrary, CustomLibrary, and their sums, products and GeneralizedLibrary"


@dataclass(frozen=True, slots=True)
class _Feature:
    """A product of functions, with its text and LaTeX."""

    factors: tuple[Factor, ...]
    text: str
    latex: str


def with_features(library: Library, given: Any) -> Library:
    """The library with the features of a pysindy library as candidates of every equation.

    Parameters
    ----------
    library
        Our own, for the same quantities.
    given
        A pysindy feature library; it is left as it is.

    Raises
    ------
    DataError
        When its features are not functions of the state at one time.
    """
    features = _features(library, given)
    functions = tuple(feature_of(feature.factors, _count(library)) for feature in features)
    candidates = replace(library, terms=(), functions=functions)
    terms: list[Term] = []
    for equation in range(len(library.variables)):
        own = [_term(library, equation, index, feature) for index, feature in enumerate(features)]
        terms += _distinct(_known(library, replace(candidates, terms=tuple(own)), equation))
    return replace(candidates, terms=tuple(terms))


def check_finite(library: Library, values: Array, rates: Array, inputs: Array | None) -> None:
    """DataError for candidates that have no value somewhere in the motion.

    Parameters
    ----------
    library
        The candidates.
    values, rates
        (n, d) of the variables.
    inputs
        (n, m), None where there are none.
    """
    with np.errstate(all="ignore"):
        finite = np.all(np.isfinite(evaluated(library, values, rates, inputs)), axis=0)
    if not np.all(finite):
        texts = dict.fromkeys(term.text for term, good in zip(library.terms, finite, strict=True) if not good)
        raise DataError(
            f"{', '.join(texts)}: not a finite number somewhere in this motion, so it cannot be in its equation; "
            "leave it out of the library (inputs_per_library of a GeneralizedLibrary chooses what a function is given)"
        )


def _count(library: Library) -> int:
    return len(library.variables) * library.variables[0].order


def _distinct(terms: Sequence[Term]) -> list[Term]:
    """The terms, those of one text once, each with a parameter of its own name."""
    once = {term.text: term for term in reversed(terms)}
    names, made = Counter[str](), []
    for term in (once[text] for text in dict.fromkeys(term.text for term in terms)):
        names[term.parameter.name] += 1
        again = names[term.parameter.name]
        name = term.parameter.name if again == 1 else f"{term.parameter.name}_{again}"
        made.append(replace(term, parameter=replace(term.parameter, name=name)))
    return made


def _known(library: Library, candidates: Library, equation: int) -> list[Term]:
    """The candidates of an equation, each as the term of our own library that has the same values."""
    rng, kind = np.random.default_rng(0), library.variables[equation].kind
    shape = SAMPLES, len(library.variables)
    values, rates = rng.uniform(*RANGES[kind], shape), rng.uniform(-2.0, 2.0, shape)
    inputs = rng.uniform(-2.0, 2.0, (SAMPLES, len(library.inputs)))
    with np.errstate(all="ignore"):
        ours, theirs = (evaluated(one, values, rates, inputs) for one in (library, candidates))
    own = library.of_equation(equation)
    return [
        next((library.terms[k] for k in own if _same(ours[:, k], column)), term)
        for term, column in zip(candidates.terms, theirs.T, strict=True)
    ]


def _same(one: Array, other: Array) -> bool:
    return bool(np.allclose(one, other, rtol=SAME, atol=SAME))


def _term(library: Library, equation: int, index: int, feature: _Feature) -> Term:
    own = library.variables[equation]
    label = re.sub(r"\W+", "_", re.sub(r"(\w+)'", r"d_\1", feature.text)).strip("_") or str(index)
    symbol = rf"c_{{{own.state.symbol},{index}}}"
    parameter = Parameter(f"{own.quantity.name}_{label}", _unit(library, own, feature), symbol, default=0.0)
    pushed = any(k >= _count(library) for _, inputs in feature.factors for k in inputs)
    return Term(equation, FEATURE, index, parameter, feature.text, feature.latex, pushed)


def _unit(library: Library, own: Variable, feature: _Feature) -> str:
    """The unit that makes coefficient times feature a rate of the variable; only powers have a unit of their own."""
    powers = Counter(_dimension(own.state.unit))
    powers["s"] -= own.order
    units = [variable.state.unit for variable in library.variables]
    units += [variable.rate.unit for variable in library.variables] if own.order == 2 else []
    units += [quantity.unit for quantity in library.inputs]
    for function, inputs in feature.factors:
        exponent = getattr(function, "exponent", 0)
        for base, power in _dimension(units[inputs[0]]).items():
            powers[base] -= exponent * power
    above = [base if power == 1 else f"{base}^{power}" for base, power in powers.items() if power > 0]
    below = [base if power == -1 else f"{base}^{-power}" for base, power in powers.items() if power < 0]
    return "/".join([" ".join(above) or "1", *below])


def _dimension(unit: str) -> dict[str, int]:
    """Powers of the bases of a unit such as ``1/px`` or ``m/s``; an angle has none."""
    above, *below = unit.split("/")
    powers = Counter({above: 1})
    powers.subtract(below)
    return {base: power for base, power in powers.items() if base not in ("", "1", "rad")}


# --------------------------------------------------------------------------- what pysindy's libraries hold


def _features(library: Library, given: Any) -> list[_Feature]:
    fitted = copy.deepcopy(given)
    variables = library.variables
    names = [variable.state.name for variable in variables]
    symbols = [variable.state.symbol or variable.state.name for variable in variables]
    if variables[0].order == 2:
        names += [f"{name}'" for name in names]
        symbols += [variable.rate.symbol or variable.rate.name for variable in variables]
    names += [quantity.name for quantity in library.inputs]
    symbols += [quantity.symbol or quantity.name for quantity in library.inputs]
    _check(fitted)
    fitted.fit(np.ones((2, len(names))))
    factors = _factors(fitted, tuple(range(len(names))))
    if not factors:
        raise DataError(f"the library that was given has no feature of {', '.join(names)}")
    texts, latex = (fitted.get_feature_names(list(said)) for said in (names, symbols))
    spelled = [re.sub(r"\b(sin|cos)\(1 ", r"\1(", text) for text in texts]
    shown = [re.sub(r"\b(sin|cos)\((1 )?", r"\\\1(", text) for text in latex]
    return [_Feature(*parts) for parts in zip(factors, spelled, shown, strict=True)]


def _check(library: Any) -> None:
    """Refuse what is not a function of the state at one time."""
    name = type(library).__name__
    if name not in READERS:
        raise DataError(
            f"library={name}: only features that are functions of values, rates and inputs at one time can be "
            f"integrated; give {SUPPORTED}"
        )
    for part in getattr(library, "libraries", ()):
        _check(part)


def _factors(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    """The factors of each feature of a fitted library of these inputs, in its order."""
    return READERS[type(library).__name__](library, inputs)


def _of_polynomials(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    return [tuple((power(int(n)), (k,)) for k, n in zip(inputs, row, strict=True) if n > 0) for row in library.powers_]


def _of_waves(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    waves = [sine] * library.include_sin + [cosine] * library.include_cos
    times = range(1, library.n_frequencies + 1)
    return [((wave(n), (k,)),) for n in times for k in inputs for wave in waves]


def _of_functions(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    combined = itertools.combinations if library.interaction_only else itertools.combinations_with_replacement
    bias: list[tuple[Factor, ...]] = [()] if library.include_bias else []
    return bias + [
        ((function, chosen),)
        for function in library.functions
        for chosen in combined(inputs, function.__code__.co_argcount)
    ]


def _of_sum(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    return [factors for part in library.libraries for factors in _factors(part, inputs)]


def _of_product(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    parts = zip(library.libraries, library.inputs_per_library, strict=True)
    each = [_factors(part, _taken(inputs, indices)) for part, indices in parts]
    return [tuple(itertools.chain(*factors)) for factors in itertools.product(*each)]


def _of_general(library: Any, inputs: tuple[int, ...]) -> list[tuple[Factor, ...]]:
    made: list[tuple[Factor, ...]] = []
    for index, part in enumerate(library.libraries_full_):
        plain = index < len(library.inputs_per_library)
        if plain and index in library.exclude_libraries:
            continue
        made += _factors(part, _taken(inputs, library.inputs_per_library[index]) if plain else inputs)
    return made


def _taken(inputs: tuple[int, ...], indices: Sequence[int]) -> tuple[int, ...]:
    return tuple(inputs[k] for k in dict.fromkeys(indices))


READERS: dict[str, Callable[[Any, tuple[int, ...]], list[tuple[Factor, ...]]]] = {
    "PolynomialLibrary": _of_polynomials,
    "FourierLibrary": _of_waves,
    "CustomLibrary": _of_functions,
    "ConcatLibrary": _of_sum,
    "TensoredLibrary": _of_product,
    "GeneralizedLibrary": _of_general,
}


# --------------------------------------------------------------------------- their functions


@picklable
@functools.lru_cache(maxsize=64)
def power(exponent: int) -> Callable[[Any], Any]:
    """The function x^exponent."""

    def raised(x: Any) -> Any:
        return x**exponent

    raised.exponent = exponent  # type: ignore[attr-defined]  # read for the unit of a coefficient
    return raised


@picklable
@functools.lru_cache(maxsize=64)
def sine(times: int) -> Callable[[Any], Any]:
    """The function sin(times x)."""

    def wave(x: Any) -> Any:
        return np.sin(times * x)

    return wave


@picklable
@functools.lru_cache(maxsize=64)
def cosine(times: int) -> Callable[[Any], Any]:
    """The function cos(times x)."""

    def wave(x: Any) -> Any:
        return np.cos(times * x)

    return wave
