"""Match a discovered structure with the models of the bank, and infer the parameters of the matching model.

An origin that is off (a rest position, a vertical) is allowed for: z - z_0 in place of z.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from fitters.sindy.library import Library
from fitters.sindy.model_structure import PRESENT, Key, Structure, coefficients_of, key_of, structures
from iris_sysid.types import Array, Estimate, Match, chi2_sf

Rank = tuple[int, int, bool]

DISAGREE = 1e-3  # probability below which coefficients contradict the model's relations between them


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
    texts = _texts(structure.library) | _texts(library)  # a library that was given may lack a term of the model
    lists = structure.always - discovered, discovered - structure.sometimes
    absent, added = (tuple(texts[key] for key in sorted(keys)) for keys in lists)
    return None, Match(structure.model.name, {}, missing=absent, extra=added)


def _texts(library: Library) -> dict[Key, str]:
    """Each term in words, e.g. ``sin(theta) in theta''``."""
    return {
        key_of(library, k): f"{term.text} in {library.variables[term.equation].left}"
        for k, term in enumerate(library.terms)
    }


def _strangers(structure: Structure, library: Library) -> int:
    """Number of quantities whose name or unit differs from the model's."""
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
    """Parameters whose coefficients are nearest to the discovered ones, with errors, and a note on a contradiction."""
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
    """The first constant on which the coefficients depend, for a model with constants only."""
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
        """Deviations of uncertain constants from their known values, in standard errors."""
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
