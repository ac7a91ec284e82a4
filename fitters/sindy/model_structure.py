"""The structure of a model of the bank: its terms in the library, and their coefficients.

The right-hand side of the model is expanded in the library at random states and parameters. This gives its terms and,
as a function of the parameters, their coefficients. No structure is written down by hand.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitters.compose_effects import plain_observation
from fitters.models.contact_chain import contact_chain
from fitters.sindy.library import Kind, Library, evaluated, library_of, value_of
from iris_sysid.errors import FitError, IrisError
from iris_sysid.registry import MODELS
from iris_sysid.types import Array, OdeModel

Key = tuple[int, int, int]  # equation, code, other: identifies a term without the names of the quantities

LENGTHS = {"m", "px"}  # units of a length with a scale or without
READINGS = ("V", "1", "")  # of a sensor, which may stand for anything
SAMPLES = 60
LIE_STEP = 1e-4  # s: derivatives along the flow by central differences; errors about 1e-8
EXPRESSED = 1e-5  # fraction of the size of the left side: a larger misfit means that the library cannot express it
PRESENT = 1e-4  # a term with a larger coefficient is present
RANGES: dict[Kind, tuple[float, float]] = {
    "angle": (-1.5, 1.5), "position": (-1.0, 1.0), "size": (1.0, 3.0), "amount": (0.3, 2.0),
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """A model's terms in the library: those ``always`` present, those ``sometimes``, with all damping and offsets.

    ``shifted`` are those present with a shifted origin.
    """

    model: OdeModel
    library: Library
    free: tuple[str, ...]
    always: frozenset[Key]
    sometimes: frozenset[Key]
    shifted: frozenset[Key]


def key_of(library: Library, index: int) -> Key:
    """A term without the names of its quantities."""
    term = library.terms[index]
    return term.equation, term.code, term.other


def structures(library: Library) -> Iterator[Structure]:
    """Structures of the models of the bank that observe quantities of the same kinds, by the same inputs or none."""
    kinds = tuple(variable.kind for variable in library.variables)
    models = list(MODELS.values())
    if kinds == ("position",) * len(kinds) and len(kinds) > 1:
        models = [model for model in models if model.name != "contact-chain"] + [contact_chain(len(kinds))]
    for model in models:
        structure = _structure(model)
        if structure is None or structure.library.partner != library.partner:
            continue
        if len(model.inputs) not in (0, len(library.inputs)):
            continue
        if tuple(variable.kind for variable in structure.library.variables) == kinds and _is_alike(structure, library):
            yield structure


def _is_alike(structure: Structure, library: Library) -> bool:
    """Whether amounts may be those of a model: in its unit, or what a sensor reads; a temperature is not a speed."""
    pairs = zip(structure.library.variables, library.variables, strict=True)
    units = [(own.state.unit, seen.state.unit) for own, seen in pairs if own.kind == "amount"]
    may = structure.model.may_be_of
    return all(seen in (own, *READINGS) or {own, seen} <= LENGTHS or may(seen) for own, seen in units)


def terms_of(library: Library, name: str) -> tuple[int, ...]:
    """Indices in the library of all terms that a model of the bank can have; FitError when it has no such model."""
    for structure in structures(library):
        if structure.model.name == name:
            return tuple(k for k in range(len(library.terms)) if key_of(library, k) in structure.sometimes)
    names = ", ".join(sorted(structure.model.name for structure in structures(library)))
    quantities = ", ".join(variable.quantity.name for variable in library.variables)
    raise FitError(
        f"{name!r} is not a model of {quantities} that the library can express; there are: {names or 'none'}"
    )


@functools.lru_cache(maxsize=64)
def _structure(model: OdeModel) -> Structure | None:
    """The terms of a model; None where the library cannot express it."""
    if getattr(model, "events", ()):
        return None
    try:
        library = library_of(model.observed, model.inputs)
    except IrisError:
        return None
    free = tuple(parameter.name for parameter in model.parameters if not parameter.constant)
    draws_by_kind = {}
    for name, still, shift in (("always", True, False), ("sometimes", False, False), ("shifted", False, True)):
        draws = [_drawn(model, library, seed, still, shift) for seed in range(2)]
        draws_by_kind[name] = draws
    if any(draw is None for draw in [*draws_by_kind["always"], *draws_by_kind["sometimes"]]):
        return None
    sometimes = _present(library, draws_by_kind["sometimes"])
    shifted = (
        sometimes
        if any(draw is None for draw in draws_by_kind["shifted"])
        else _present(library, draws_by_kind["shifted"])
    )
    return Structure(model, library, free, _present(library, draws_by_kind["always"]), sometimes, shifted)


def _present(library: Library, draws: list[Array | None]) -> frozenset[Key]:
    sizes = np.max([np.abs(draw) for draw in draws if draw is not None], axis=0)
    return frozenset(key_of(library, int(k)) for k in np.flatnonzero(sizes > PRESENT))


def _drawn(model: OdeModel, library: Library, seed: int, still: bool, shift: bool) -> Array | None:
    rng = np.random.default_rng(seed)
    values = {}
    for parameter in model.parameters:
        drawn = float(np.clip(rng.uniform(0.5, 2.0), parameter.lower, parameter.upper))
        known = parameter.default if parameter.constant else None
        may_be_none = parameter.name in model.dissipative or parameter.role == "offset"
        values[parameter.name] = 0.0 if still and may_be_none else known or drawn
        if parameter.constant and parameter.default == 0.0:
            values[parameter.name] = 0.0
    offsets = rng.uniform(0.05, 0.2, len(library.variables)) if shift else np.zeros(len(library.variables))
    return coefficients_of(model, library, values, offsets)


def coefficients_of(
    model: OdeModel, library: Library, values: Mapping[str, float], offsets: Array, *, strict: bool = True
) -> Array | None:
    """The coefficients (k,) of the library's terms that make the model with these parameters.

    Each coefficient has the unit of its term, each offset that of its variable.

    Parameters
    ----------
    model
        The governing equation.
    library
        Of its observed quantities.
    values
        Parameters by name.
    offsets
        (d,) added to the variables: the position of the origin.
    strict
        Return None where the library cannot express the model; otherwise return the best approximation.
    """
    states = _states(model, library, values)
    params = np.array([values[parameter.name] for parameter in model.parameters])
    inputs = np.random.default_rng(8).uniform(-1.0, 1.0, (SAMPLES, len(model.inputs)))
    with np.errstate(all="ignore"):
        position, rate, slope = _along_the_flow(model, library, states, params, inputs)
    left = slope if library.variables[0].order == 2 else rate
    if not np.isfinite(left).all():  # a mass of zero
        return None if strict else np.full(len(library.terms), np.inf)
    terms = evaluated(library, position + offsets, rate, inputs)
    coefficients = np.zeros(len(library.terms))
    for equation in range(len(library.variables)):
        own = library.of_equation(equation)
        size = np.maximum(np.linalg.norm(terms[:, own], axis=0), 1e-300)
        solved = np.linalg.lstsq(terms[:, own] / size, left[:, equation], rcond=1e-10)[0] / size
        misfit = np.sqrt(np.mean((left[:, equation] - terms[:, own] @ solved) ** 2))
        if strict and not misfit < EXPRESSED * max(float(np.sqrt(np.mean(left**2))), 1e-6):
            return None
        coefficients[own] = solved
    return coefficients


def _states(model: OdeModel, library: Library, values: Mapping[str, float]) -> Array:
    rng = np.random.default_rng(7)
    names = [state.name for state in model.states]
    columns = [rng.uniform(-1.0, 1.0, SAMPLES) for _ in names]
    for k, variable in enumerate(library.variables):
        index = names.index(variable.quantity.name) if variable.quantity.name in names else k
        columns[index] = rng.uniform(*RANGES[variable.kind], SAMPLES)
    return np.column_stack(columns)


def _along_the_flow(
    model: OdeModel, library: Library, states: Array, params: Array, inputs: Array
) -> tuple[Array, Array, Array]:
    """The library's variables with their first and second derivative in time (n, d), the inputs (n, m) held."""

    def flow(at: Array, step_s: float) -> Array:
        return at + step_s * _slopes(model, at, tuple(params), inputs)

    def variables(at: Array) -> Array:
        seen = plain_observation(model, np.zeros(len(at)), at, params)
        return np.column_stack([value_of(variable, seen[:, k]) for k, variable in enumerate(library.variables)])

    def rates(at: Array) -> Array:
        return _richardson(lambda step_s: variables(flow(at, step_s)))

    first = rates(states)
    if library.variables[0].order == 1:
        return variables(states), first, first
    return variables(states), first, _richardson(lambda step_s: rates(flow(states, step_s)))


def _slopes(model: OdeModel, states: Array, params: tuple[float, ...], inputs: Array) -> Array:
    """Derivatives of the states (n, s): all samples at once, or one by one where the model takes numbers only."""

    def rates(state: Iterable[Any], known: Iterable[Any]) -> Any:
        return model.rhs(0.0, tuple(state), params, *([tuple(known)] if model.inputs else []))

    try:
        return np.column_stack([np.broadcast_to(rate, len(states)) for rate in rates(states.T, inputs.T)])
    except ValueError:
        return np.array([rates(*row) for row in zip(states.tolist(), inputs.tolist(), strict=True)])


def _richardson(function: Callable[[float], Array]) -> Array:
    """Derivative at zero by central differences of two steps, the error of the second order removed."""
    fine, coarse = ((function(step) - function(-step)) / (2 * step) for step in (LIE_STEP, 2 * LIE_STEP))
    return (4 * fine - coarse) / 3
