"""Which model of the bank has the discovered structure, and what its parameters then are.

Nothing about a model is written down here: its right-hand side is expanded in the library at random states and
parameters, which gives its terms and, as a function of the parameters, their coefficients. An origin that is off (a
rest position, a vertical) is allowed for: z - z_0 in place of z.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from fitters.compose_effects import plain_observation
from fitters.models.contact_chain import contact_chain
from fitters.sindy.library import Kind, Library, evaluated, library_of, value_of
from iris_sysid.errors import FitError, IrisError
from iris_sysid.registry import MODELS
from iris_sysid.types import Array, Estimate, Match, OdeModel, chi2_sf

Rank = tuple[int, int, bool]
Key = tuple[int, int, int]  # equation, code, other: a term whatever the quantities are called

SAMPLES = 60
LIE_STEP = 1e-4  # s: derivatives along the flow by central differences; errors about 1e-8
EXPRESSED = 1e-5  # of the size of the left side: larger misfits mean that the library cannot express it
PRESENT = 1e-4  # of the same, for a term to be there
DISAGREE = 1e-3  # probability below which coefficients contradict the model's relations between them
RANGES: dict[Kind, tuple[float, float]] = {
    "angle": (-1.5, 1.5), "position": (-1.0, 1.0), "size": (1.0, 3.0), "amount": (0.3, 2.0),
}  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class Structure:
    """A model's terms in the library: those that are ``always`` there, and ``sometimes``, with all damping in.

    ``shifted`` are those that are there when the origin is off as well.
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


# --------------------------------------------------------------------------- expanding a model


def structures(library: Library) -> Iterator[Structure]:
    """Models of the bank that observe quantities of the same kinds, with what they are made of."""
    kinds = tuple(variable.kind for variable in library.variables)
    models = list(MODELS.values())
    if kinds == ("position",) * len(kinds) and len(kinds) > 1:
        models = [model for model in models if model.name != "contact-chain"] + [contact_chain(len(kinds))]
    for model in models:
        structure = _structure(model)
        if structure is None or structure.library.partner != library.partner:
            continue
        if tuple(variable.kind for variable in structure.library.variables) == kinds:
            yield structure


def terms_of(library: Library, name: str) -> tuple[int, ...]:
    """Indices in the library of all terms that a model of the bank can have; FitError when it has no such model."""
    for structure in structures(library):
        if structure.model.name == name:
            return tuple(k for k in range(len(library.terms)) if key_of(library, k) in structure.sometimes)
    names = ", ".join(sorted(structure.model.name for structure in structures(library)))
    quantities = ", ".join(variable.quantity.name for variable in library.variables)
    raise FitError(f"{name!r} is no model of {quantities} that the library can express; there are: {names or 'none'}")


@functools.lru_cache(maxsize=64)
def _structure(model: OdeModel) -> Structure | None:
    """The terms of a model; None where the library cannot express it."""
    if getattr(model, "events", ()) or model.inputs:
        return None
    try:
        library = library_of(model.observed)
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
        values[parameter.name] = 0.0 if still and parameter.name in model.dissipative else known or drawn
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
        (d,) added to the variables: where the origin is.
    strict
        Give None where the library cannot express the model; otherwise the nearest.
    """
    states = _states(model, library, values)
    params = np.array([values[parameter.name] for parameter in model.parameters])
    position, rate, slope = _along_the_flow(model, library, states, params)
    left = slope if library.variables[0].order == 2 else rate
    terms = evaluated(library, position + offsets, rate, None)
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


def _along_the_flow(model: OdeModel, library: Library, states: Array, params: Array) -> tuple[Array, Array, Array]:
    """The library's variables with their first and second derivative in time (n, d)."""

    def flow(at: Array, step_s: float) -> Array:
        return at + step_s * _slopes(model, at, tuple(params))

    def variables(at: Array) -> Array:
        seen = plain_observation(model, np.zeros(len(at)), at, params)
        return np.column_stack([value_of(variable, seen[:, k]) for k, variable in enumerate(library.variables)])

    def rates(at: Array) -> Array:
        return _richardson(lambda step_s: variables(flow(at, step_s)))

    first = rates(states)
    if library.variables[0].order == 1:
        return variables(states), first, first
    return variables(states), first, _richardson(lambda step_s: rates(flow(states, step_s)))


def _slopes(model: OdeModel, states: Array, params: tuple[float, ...]) -> Array:
    """Derivatives of the states (n, s): of all at once, or one by one where the model takes numbers only."""
    try:
        return np.column_stack([np.broadcast_to(rate, len(states)) for rate in model.rhs(0.0, tuple(states.T), params)])
    except ValueError:
        return np.array([model.rhs(0.0, tuple(state), params) for state in states.tolist()])


def _richardson(function: Callable[[float], Array]) -> Array:
    """Derivative at zero by central differences of two steps, the error of the second order removed."""
    fine, coarse = ((function(step) - function(-step)) / (2 * step) for step in (LIE_STEP, 2 * LIE_STEP))
    return (4 * fine - coarse) / 3


# --------------------------------------------------------------------------- comparing


def match(
    library: Library,
    kept: tuple[int, ...],
    values: Array,
    errors: Array,
    covariance: Array,
    known: Mapping[str, Estimate],
) -> tuple[Match | None, Match | None]:
    """The model of the bank with this structure, or None, and the nearest one.

    Each coefficient has the unit of its term.

    Parameters
    ----------
    library
        Of the trajectories.
    kept
        Indices of the discovered terms.
    values, errors
        (k,) coefficients of all terms, and their standard errors; of a term that is not kept, if it were added.
    covariance
        Of the coefficients of the kept terms.
    known
        Constants with their errors, e.g. gravity.
    """
    discovered = frozenset(key_of(library, k) for k in kept)
    exact: list[tuple[Rank, Structure, bool]] = []
    others: list[tuple[Rank, Structure, bool]] = []
    for structure in structures(library):
        missing, extra = structure.always - discovered, discovered - structure.sometimes
        off = bool(extra) and not discovered - structure.shifted
        ranked = (len(missing) + (0 if off else len(extra)), _strangers(structure, library), off)
        (exact if not missing and (not extra or off) else others).append((ranked, structure, off))
    if exact:
        exact.sort(key=lambda item: (item[0][1], len(item[1].sometimes - discovered), item[2], item[1].model.name))
        _, structure, off = exact[0]
        same = tuple(other.model.name for _, other, _ in exact[1:] if other.sometimes == structure.sometimes)
        made = _parameters(structure, library, kept, values, errors, covariance, known, off)
        return Match(structure.model.name, made[0], same=same, note=made[1]), None
    if not others:
        return None, None
    others.sort(key=lambda item: (item[0], item[1].model.name))
    structure = others[0][1]
    texts = {key_of(library, k): f"{library.terms[k].text} in {library.variables[library.terms[k].equation].left}"
             for k in range(len(library.terms))}  # fmt: skip
    lists = structure.always - discovered, discovered - structure.sometimes
    absent, added = (tuple(texts[key] for key in sorted(keys)) for keys in lists)
    return None, Match(structure.model.name, {}, missing=absent, extra=added)


def _strangers(structure: Structure, library: Library) -> int:
    """How many quantities have another name or unit than the model's."""
    pairs = zip(structure.library.variables, library.variables, strict=True)
    return sum((a.quantity.name != b.quantity.name) + (a.quantity.unit != b.quantity.unit) for a, b in pairs)


def _parameters(
    structure: Structure,
    library: Library,
    kept: tuple[int, ...],
    values: Array,
    errors: Array,
    covariance: Array,
    known: Mapping[str, Estimate],
    off: bool,
) -> tuple[dict[str, Estimate], str]:
    """Parameters whose coefficients are nearest to those discovered, with errors, and a note where none are near."""
    keys = structure.shifted if off else structure.sometimes
    indices = [k for k in range(len(library.terms)) if key_of(library, k) in keys]
    own = {key_of(structure.library, k): k for k in range(len(structure.library.terms))}
    columns = [own[key_of(library, k)] for k in indices]
    discovered = np.array([values[k] if k in kept else 0.0 for k in indices])
    weight = np.linalg.inv(np.linalg.cholesky(_joint_covariance(indices, kept, errors, covariance)))
    problem = _Inversion.of(structure, known, off)

    def residual(vector: Array) -> Array:
        made = problem.coefficients(vector)[columns]
        return np.concatenate([weight @ (made - discovered), problem.prior(vector)])

    start = problem.start(discovered, columns)
    # coefficients are good to 1e-8 (see LIE_STEP): differences must be over larger steps than usual
    scale = np.maximum(np.abs(start), 1e-3)
    solved = least_squares(
        residual, start, jac="3-point", x_scale=scale, diff_step=np.full(start.size, 1e-3), xtol=1e-10, ftol=1e-10
    )
    jacobian = np.asarray(solved.jac)
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-150)
    spread = np.linalg.norm(np.linalg.pinv(jacobian / size), axis=1) / size
    freedom = residual(start).size - start.size
    note = ""
    if freedom > 0 and chi2_sf(2 * solved.cost, freedom) < DISAGREE:
        note = f"coefficients contradict its relations between them (chi-squared {2 * solved.cost:.0f} for {freedom})"
    return problem.estimates(solved.x, spread), note


def _joint_covariance(indices: list[int], kept: tuple[int, ...], errors: Array, covariance: Array) -> Array:
    joint = np.diag([errors[k] ** 2 for k in indices]) + 0.0
    inside = [k for k, index in enumerate(indices) if index in kept]
    among = [kept.index(indices[k]) for k in inside]
    joint[np.ix_(inside, inside)] = covariance[np.ix_(among, among)]
    return joint * (1 + 1e-9 * np.eye(len(indices))) + 1e-300 * np.eye(len(indices))


def _first_that_matters(structure: Structure) -> str:
    """Of a model all of whose parameters are constants, the first on which its coefficients depend."""
    values = {parameter.name: parameter.default or 1.0 for parameter in structure.model.parameters}
    none = np.zeros(len(structure.library.variables))
    base = coefficients_of(structure.model, structure.library, values, none, strict=False)
    for name, value in values.items():
        moved = coefficients_of(structure.model, structure.library, values | {name: 1.1 * value}, none, strict=False)
        if base is not None and moved is not None and np.max(np.abs(moved - base)) > PRESENT:
            return name
    return ""


@dataclass(frozen=True, eq=False, slots=True)
class _Inversion:
    """From a vector of parameters (free ones, uncertain constants, offsets) to coefficients, and back to estimates."""

    structure: Structure
    constants: Mapping[str, Estimate]
    names: tuple[str, ...]
    offsets: int

    @classmethod
    def of(cls, structure: Structure, known: Mapping[str, Estimate], off: bool) -> _Inversion:
        constants = {}
        open_ = _first_that_matters(structure) if not structure.free else ""
        for parameter in structure.model.parameters:
            if parameter.name == open_:
                continue
            if parameter.name in known:
                constants[parameter.name] = known[parameter.name]
            elif parameter.constant:
                value = 1.0 if parameter.default is None else parameter.default
                constants[parameter.name] = Estimate(
                    value, parameter.stderr, parameter.unit, "assumed", parameter.source
                )
        free = tuple(parameter.name for parameter in structure.model.parameters if parameter.name not in constants)
        unsure = tuple(name for name, value in constants.items() if value.stderr > 0)
        return cls(structure, constants, (*free, *unsure), len(structure.library.variables) if off else 0)

    def coefficients(self, vector: Array) -> Array:
        """The coefficients (k,) of the model's own library."""
        values = {name: constant.value for name, constant in self.constants.items()}
        values |= dict(zip(self.names, vector[: len(self.names)].tolist(), strict=True))
        offsets = vector[len(self.names) :] if self.offsets else np.zeros(len(self.structure.library.variables))
        made = coefficients_of(self.structure.model, self.structure.library, values, offsets, strict=False)
        assert made is not None
        return made

    def prior(self, vector: Array) -> Array:
        """How far uncertain constants are from their values, in standard errors."""
        pairs = [(value, self.constants.get(name)) for name, value in zip(self.names, vector, strict=False)]
        return np.array(
            [(value - constant.value) / constant.stderr for value, constant in pairs if constant is not None]
        )

    def start(self, discovered: Array, columns: list[int]) -> Array:
        """The best of powers of ten for each free parameter in turn, twice."""
        sizes = np.concatenate([10.0 ** np.arange(-4, 5), -(10.0 ** np.arange(-4, 5)), [0.0]])
        vector = np.array([self.constants[n].value if n in self.constants else 1.0 for n in self.names])
        vector = np.concatenate([vector, np.zeros(self.offsets)])
        scale = np.maximum(np.abs(discovered), 1e-3 * max(float(np.max(np.abs(discovered), initial=0.0)), 1e-9))

        def cost(trial: Array) -> float:
            made = self.coefficients(trial)[columns]
            return float(np.sum(np.arcsinh((made - discovered) / scale) ** 2))

        for _ in range(2):
            for k, name in enumerate(self.names):
                if name in self.constants:
                    continue
                limits = self.structure.model.parameter(name)
                trials = [np.concatenate([vector[:k], [v], vector[k + 1 :]])
                          for v in sizes if limits.lower <= v <= limits.upper]  # fmt: skip
                vector = min(trials, key=cost)
        return vector

    def estimates(self, vector: Array, spread: Array) -> dict[str, Estimate]:
        """The parameters by name; constants that are known exactly have no error."""
        model, made = self.structure.model, {}
        for k, name in enumerate(self.names):
            kind = self.constants[name].measurement_type if name in self.constants else "fitted"
            error = float(spread[k]) if spread[k] > 0 else np.nan
            made[name] = Estimate(float(vector[k]), error, model.parameter(name).unit, kind)
        for k in range(self.offsets):
            variable = self.structure.library.variables[k]
            index = len(self.names) + k
            # the library sees z_measured = z + offset, so the rest position is where z = 0
            made[f"origin_{variable.quantity.name}"] = Estimate(
                float(vector[index]), float(spread[index]), variable.state.unit, "fitted", "where it would rest"
            )
        for name, constant in self.constants.items():
            if name not in made and model.parameter(name).default is not None and constant.value not in (0.0,):
                made[name] = constant
        return made
