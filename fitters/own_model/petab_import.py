"""A PEtab problem of one differential equation as a model in text and tables, one for each condition."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from fitters.own_model.equation import model_from_equation
from fitters.own_model.petab_export import petab_package
from fitters.own_model.sbml_equations import SbmlSystem, read_sbml
from iris_sysid.errors import DataError
from iris_sysid.io.csv_columns import SUFFIXES
from iris_sysid.io.files import read_file
from iris_sysid.types import Array, OdeModel, Quantity, Trajectory, symbol_of

MAX_FILE_BYTES = 20_000_000
IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,79}")
TITLE_UNIT = re.compile(r"[^\[\]]* \[([^\[\]]*)\]")
UNITS = {unit for unit, factor in SUFFIXES.values() if factor == 1.0}
COLUMNS = {
    "parameter": ("parameterId", "estimate"),
    "condition": ("conditionId",),
    "observable": ("observableId", "observableFormula", "noiseFormula"),
    "measurement": ("observableId", "simulationConditionId", "measurement", "time"),
}
# Columns that change the likelihood or the simulation in a way that a fit here does not: the values that do not.
PLAIN: Mapping[str, tuple[str, ...]] = {
    "objectivePriorType": ("uniform", "parameterScaleUniform"),
    "observableTransformation": ("lin",),
    "noiseDistribution": ("normal",),
    "preequilibrationConditionId": (),
    "observableParameters": (),
}

Row = Mapping[str, str]
Rows = Mapping[str, Row]  # by id


@dataclass(frozen=True, eq=False, slots=True)
class PetabProblem:
    """A PEtab problem as it is fitted here.

    ``equation`` in text, for :func:`iris_sysid.model_from_equation`; ``clips`` by condition; ``bounds`` of parameters;
    values ``fixed``, by condition, and to ``start`` from, by name.
    """

    equation: str
    clips: Mapping[str, Trajectory]
    bounds: Mapping[str, tuple[float, float]]
    fixed: Mapping[str, Mapping[str, float]]
    start: Mapping[str, float]

    def model(self) -> OdeModel:
        """The model of the equation, which observes what the tables have."""
        first = next(iter(self.clips.values()))
        units = {quantity.name: quantity.unit for quantity in first.quantities}
        return model_from_equation(self.equation, units=units, observed=list(units), bounds=self.bounds)

    def __repr__(self) -> str:
        return f"PetabProblem {self.equation}; conditions {', '.join(self.clips)}"


def read_petab(path: str | Path) -> PetabProblem:
    """Read a PEtab problem (version 1): an SBML model of rate rules or reactions, and its tables.

    Formulas are read as syntax trees and written as our text; nothing of a file is run. Times are taken as s.
    Parameters are estimated on a linear scale whatever the problem says, within its bounds; those that only give an
    initial value become that initial value, without bounds.

    Parameters
    ----------
    path
        The YAML file; the files that it names are beside it.

    Raises
    ------
    DataError
        When libsbml is not installed, a file cannot be read, or the problem has what a fit here has not: events,
        priors, preequilibration, transformed observables, formulas of observables or of noise, replicates.

    Examples
    --------
    >>> from iris_sysid import fit, read_petab
    >>> problem = read_petab("conversion/problem.yaml")  # doctest: +SKIP
    >>> fit(problem.clips["c0"], problem.model(), fixed=problem.fixed["c0"], start=problem.start)  # doctest: +SKIP
    """
    path = Path(path)
    try:
        return _read(path)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _read(path: Path) -> PetabProblem:
    sbml, tables = _files(path)
    parameters, conditions, observables = (
        _by_id(tables[what], what) for what in ("parameter", "condition", "observable")
    )
    observed = {name: row["observableFormula"] for name, row in observables.items()}
    changed = {name for row in conditions.values() for name in row}
    system = read_sbml(sbml, {*parameters, *changed}, set(observed.values()))
    for name, formula in observed.items():
        if formula not in system.states:
            raise DataError(f"{name} is the formula {formula[:40]}, not a state: only states are observed here")
    values = _Values(parameters, system)
    measured: dict[str, list[Row]] = {}
    for row in tables["measurement"]:
        measured.setdefault(row["simulationConditionId"], []).append(row)
    clips, fixed, late = {}, {}, False
    for name, rows in measured.items():
        if name not in conditions:
            raise DataError(f"measurements have the condition {name[:40]!r}, which is not in the table of conditions")
        clips[name], fixed[name] = _clip(rows, observables, system, parameters), values.fixed(conditions[name])
        late |= clips[name].t_s[0] > 0
        if clips[name].t_s[0] > 0 and {*fixed[name]} & {*values.initial}:
            raise DataError(f"an initial value holds at 0 s, but {name} is first measured later: add that time")
    start = {name: value for name, value in values.start().items() if not (late and name in values.initial)}
    return PetabProblem(system.equations, clips, values.bounds(), fixed, start)


# --------------------------------------------------------------------------- files


def _files(path: Path) -> tuple[str, dict[str, list[Row]]]:
    """The text of the SBML model, and the rows of the tables by kind."""
    yaml = petab_package("yaml")
    try:
        listed = yaml.safe_load(_text(path))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise DataError("it is not a YAML file") from error
    problems = listed.get("problems") if isinstance(listed, dict) else None
    if not isinstance(problems, list) or str(listed.get("format_version")).partition(".")[0] != "1":
        raise DataError("it is not a PEtab problem of version 1: it needs format_version: 1 and problems")
    if len(problems) != 1 or not isinstance(problems[0], dict):
        raise DataError("it must hold one problem: write each as a separate file")
    models = _beside(path, problems[0].get("sbml_files"))
    if len(models) != 1:
        raise DataError("it must have one SBML model")
    named = {"parameter": listed.get("parameter_file")}
    named |= {kind: problems[0].get(f"{kind}_files") for kind in COLUMNS if kind != "parameter"}
    files = {kind: _beside(path, names) for kind, names in named.items()}
    tables = {kind: [row for each in paths for row in _table(each, COLUMNS[kind])] for kind, paths in files.items()}
    return _text(models[0]), tables


def _beside(path: Path, names: Any) -> list[Path]:
    """Files that the problem names, which must be in its folder or below."""
    listed = names if isinstance(names, list) else [names]
    if not listed or not all(isinstance(name, str) for name in listed) or len(listed) > 20:
        raise DataError("it does not name its files as PEtab does: parameter_file, sbml_files, condition_files, ...")
    for name in listed:
        inside = PurePosixPath(name)
        if inside.is_absolute() or ".." in inside.parts or ":" in name or "\\" in name:
            raise DataError(f"the file {name[:80]!r} is not beside the problem: put it there")
    return [path.parent / name for name in listed]


def _text(path: Path) -> str:
    content = read_file(path)
    if len(content) > MAX_FILE_BYTES:
        raise DataError(f"{path.name} has {len(content) / 1e6:.0f} MB; at most {MAX_FILE_BYTES / 1e6:.0f} MB are read")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path.name} is not text in UTF-8") from error


def _table(path: Path, needed: Sequence[str]) -> list[Row]:
    reader = csv.DictReader(io.StringIO(_text(path)), delimiter="\t", restval="")
    try:
        rows: list[Row] = [
            {f"{name}".strip(): f"{text}".strip() for name, text in row.items() if name} for row in reader
        ]
    except csv.Error as error:
        raise DataError(f"{path.name} is not a table of columns separated by tabs: {error}") from error
    missing = [f"column {name}" for name in needed if rows and name not in rows[0]] if rows else ["row"]
    if missing:
        raise DataError(f"{path.name} has no {missing[0]}, which PEtab needs")
    for name, plain in PLAIN.items():
        other = [row[name] for row in rows if row.get(name, "") not in ("", *plain)]
        if other:
            raise DataError(f"{path.name}: {name} {other[0][:40]!r} is not supported; leave it out if that is right")
    return rows


def _by_id(rows: Sequence[Row], what: str) -> Rows:
    """The rows of a table by their id, without the columns that only name them."""
    found: dict[str, Row] = {}
    for row in rows:
        name = row[f"{what}Id"]
        if IDENTIFIER.fullmatch(name) is None or name in found:
            raise DataError(f"{name[:40]!r} is not an id of a {what}, or stands twice: use letters, digits and _")
        found[name] = {title: text for title, text in row.items() if title not in (f"{what}Id", "conditionName")}
    return found


def _number(text: str, what: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise DataError(f"{what[:60]} is {text[:40]!r}, not a number")
    return value


# --------------------------------------------------------------------------- values


@dataclass(frozen=True, eq=False, slots=True)
class _Values:
    """The table of parameters, by id, beside the equations."""

    table: Rows
    system: SbmlSystem

    def __post_init__(self) -> None:
        ids = [name for name in self.system.initial.values() if isinstance(name, str)]
        twice = [name for name in ids if ids.count(name) > 1 or name in self.system.parameters]
        if twice:
            raise DataError(f"{twice[0]} is an initial value and something else too: use two parameters")
        own = list(self.system.parameters.values())
        if len(set(own)) < len(own):
            raise DataError("two parameters would have one name in the equation: rename one")

    @property
    def initial(self) -> tuple[str, ...]:
        """Names of the initial values."""
        return tuple(self._initial_name(state) for state in self.system.states)

    def _initial_name(self, state: str) -> str:
        return f"{self.system.states[state]}_0".replace("'", "_rate")

    def _named(self) -> dict[str, str]:
        """What is called otherwise in the fit, by id: parameters, and those that give an initial value."""
        starts = {name: self._initial_name(state) for state, name in self.system.initial.items()}
        return {**self.system.parameters, **{name: own for name, own in starts.items() if isinstance(name, str)}}

    def _estimated(self, name: str) -> bool:
        return name in self.table and _is_estimated(name, self.table)

    def _nominal(self, name: str) -> str:
        """The nominal value of a parameter, which the SBML model gives where it is in the table of conditions only."""
        default = self.system.values.get(name)
        return (
            self.table[name].get("nominalValue", "") if name in self.table else "" if default is None else repr(default)
        )

    def fixed(self, condition: Row) -> dict[str, float]:
        """The values that are held in a condition, by name."""
        held = {self._initial_name(s): v for s, v in self.system.initial.items() if isinstance(v, float)}
        known = self._named()
        for name, own in known.items():
            if not self._estimated(name) and not condition.get(name):
                held[own] = _number(self._nominal(name), f"the nominal value of {name}")
        for name, text in condition.items():
            own = self._initial_name(name) if name in self.system.states else known.get(name, "")
            if own and text:
                held[own] = _number(text, f"{name} in the table of conditions")
        lost = [name for name, value in held.items() if not math.isfinite(value)]
        if lost:
            raise DataError(f"{lost[0]} has no finite value: give it one")
        return held

    def start(self) -> dict[str, float]:
        """The nominal values of what is estimated, by name."""
        found = {own: self._nominal(name) for name, own in self._named().items() if self._estimated(name)}
        return {own: _number(text, f"the nominal value of {own}") for own, text in found.items() if text}

    def bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds of the estimated parameters by name."""
        found = {}
        for name, own in self.system.parameters.items():
            if self._estimated(name):
                row = self.table[name]
                ends = [row.get("lowerBound") or "-inf", row.get("upperBound") or "inf"]
                lower, upper = (_number(end, f"a bound of {name}") for end in ends)
                if (lower, upper) != (-math.inf, math.inf):
                    found[own] = (lower, upper)
        return found


# --------------------------------------------------------------------------- measurements


def _clip(rows: Sequence[Row], observables: Rows, system: SbmlSystem, parameters: Rows) -> Trajectory:
    """The measurements of one condition as a table."""
    times: Array = np.unique([_number(row["time"], "a time") for row in rows])
    own: dict[str, dict[float, tuple[float, float]]] = {}
    for row in rows:
        name = row["observableId"]
        if name not in observables:
            raise DataError(f"measurements have the observable {name[:40]!r}, which is not in the table of observables")
        sigma = _sigma(observables[name]["noiseFormula"], row.get("noiseParameters", ""), name, parameters)
        time = _number(row["time"], "a time")
        if time in own.setdefault(name, {}):
            raise DataError(f"{name} is measured twice at {time:g} s: average replicates")
        own[name][time] = _number(row["measurement"], "a measurement"), sigma
    for name, values in own.items():
        if len(values) < times.size:
            raise DataError(f"{name} is not measured at each time of its condition: leave out the other times")
    quantities = tuple(_quantity(system, observables[name]) for name in own)
    if len({quantity.name for quantity in quantities}) < len(quantities):
        raise DataError("two observables are the same state: keep one")
    both = np.array([[values[time] for values in own.values()] for time in times.tolist()])
    return Trajectory(times, quantities, both[:, :, 0], both[:, :, 1], np.ones(times.size, dtype=np.bool_))


def _quantity(system: SbmlSystem, observable: Row) -> Quantity:
    name = system.states[observable["observableFormula"]]
    match = TITLE_UNIT.fullmatch(observable.get("observableName", ""))
    return Quantity(name, match[1] if match is not None and match[1] in UNITS else "1", symbol_of(name))


def _is_estimated(name: str, parameters: Rows) -> bool:
    return _number(parameters[name]["estimate"], f"estimate of {name}") != 0


def _sigma(formula: str, given: str, observable: str, parameters: Rows) -> float:
    """The standard error of a measurement; NaN where it is to be estimated."""
    text = given if formula == f"noiseParameter1_{observable}" else formula
    if text in parameters:
        if _is_estimated(text, parameters):
            return math.nan
        text = parameters[text].get("nominalValue", "")
    sigma = _number(text, f"the noise of {observable}")
    if not 0 < sigma < math.inf:
        raise DataError(f"the noise of {observable} is {sigma:g}; it must be above 0")
    return sigma
