"""A model in text and its table as a PEtab problem: an SBML model, and tables of parameters, observables and data."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, cast

import numpy as np
import pandas as pd

from fitters.own_model.equation import NO_BOUNDS, model_from_equation, rates_of_equation
from fitters.own_model.expression import TIME, Expression
from iris_sysid.errors import DataError
from iris_sysid.io.files import check_folder, write_atomic
from iris_sysid.types import Array, Estimate, OdeModel, Trajectory

NO_VALUES: Mapping[str, float] = MappingProxyType({})
CONDITION = "measured"
FILES = {
    "model": "model.xml",
    "condition": "conditions.tsv",
    "observable": "observables.tsv",
    "measurement": "measurements.tsv",
    "parameter": "parameters.tsv",
}
PROBLEM = "problem.yaml"
# Operations by the names that libsbml has for them; a square root has its degree as the first of two parts.
NODES = {
    "+": "AST_PLUS", "-": "AST_MINUS", "negative": "AST_MINUS", "*": "AST_TIMES", "/": "AST_DIVIDE",
    "^": "AST_FUNCTION_POWER", "sqrt": "AST_FUNCTION_ROOT", "log": "AST_FUNCTION_LN", "exp": "AST_FUNCTION_EXP",
    "abs": "AST_FUNCTION_ABS", "sin": "AST_FUNCTION_SIN", "cos": "AST_FUNCTION_COS", "tan": "AST_FUNCTION_TAN",
    "tanh": "AST_FUNCTION_TANH", "atan": "AST_FUNCTION_ARCTAN",
}  # fmt: skip
# SBML has these only as functions that a model defines.
DEFINED = {
    "sign": "lambda(x, piecewise(1, x > 0, piecewise(-1, x < 0, 0)))",
    "max": "lambda(x, y, piecewise(x, x >= y, y))",
    "min": "lambda(x, y, piecewise(x, x <= y, y))",
}


def petab_package(name: str) -> ModuleType:
    """The package ``libsbml`` or ``yaml``; DataError with the command that installs both where they are absent.

    Parameters
    ----------
    name
        Of the module.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise DataError(f"PEtab problems need the package {name}: pip install 'iris-sysid[petab]'") from error


def write_petab(
    trajectory: Trajectory,
    equation: str,
    folder: str | Path,
    *,
    bounds: Mapping[str, tuple[float, float]] = NO_BOUNDS,
    fixed: Mapping[str, float | Estimate] = NO_VALUES,
    start: Mapping[str, float] = NO_VALUES,
    overwrite: bool = False,
) -> Path:
    """Write a model in text and a trajectory as a PEtab problem (version 1), for other estimation programs.

    States become SBML parameters with rate rules, and initial values parameters of the problem. Each sample that is
    valid is a measurement. Its noise is the standard error of the sample where all of these are known, a parameter
    ``sigma_<quantity>`` to be estimated otherwise. Times count from the first sample.

    Parameters
    ----------
    trajectory
        Without inputs: SBML has no tables of them.
    equation
        As for :func:`iris_sysid.model_from_equation`, with ASCII names.
    folder
        Where problem.yaml, model.xml and four tables are written.
    bounds
        Of parameters and initial values; open without.
    fixed, start
        Values that are held, whose standard errors PEtab cannot hold, and values to start from.
    overwrite
        Replace files that exist.

    Returns
    -------
    Path
        Of problem.yaml.

    Raises
    ------
    DataError
        When libsbml is not installed, the equation has inputs or observes nothing of the trajectory, a name is unknown.
    OutputError
        When a file exists or cannot be written.
    """
    rates = rates_of_equation(equation)
    model = _model(trajectory, equation, rates, bounds)
    held = {name: value.value if isinstance(value, Estimate) else value for name, value in fixed.items()}
    names = [*(parameter.name for parameter in model.parameters), *model.initial_names]
    for name in (*bounds, *held, *start):
        if name not in names:
            raise DataError(f"the equation has no parameter {name!r}; it has {', '.join(names)}")
    limits = {parameter.name: (parameter.lower, parameter.upper) for parameter in model.parameters} | dict(bounds)
    values = {**start, **held}
    rows = [_parameter(name, limits.get(name), values.get(name), name not in held) for name in names]
    observables, measured = _data(trajectory, model)
    noise = [_parameter(f"sigma_{q.name}", (1e-12, math.inf), None, True) for q in model.observed]
    unknown = [row for row, noise_known in zip(noise, observables.pop("known"), strict=True) if not noise_known]
    sbml = _sbml(model, rates, values, float(trajectory.t_s[0]))
    tables = {
        "condition": pd.DataFrame({"conditionId": [CONDITION]}),
        "observable": observables,
        "measurement": measured,
        "parameter": pd.DataFrame([*rows, *unknown]),
    }
    folder = check_folder(folder, (PROBLEM, *FILES.values()), overwrite=overwrite)
    write_atomic(folder / FILES["model"], sbml, overwrite=overwrite)
    for what, table in tables.items():
        text = table.to_csv(sep="\t", index=False, lineterminator="\n")
        write_atomic(folder / FILES[what], text, overwrite=overwrite)
    return write_atomic(folder / PROBLEM, _yaml(), overwrite=overwrite)


def _model(
    trajectory: Trajectory, equation: str, rates: Iterable[str], bounds: Mapping[str, tuple[float, float]]
) -> OdeModel:
    states = [f"{name}_0" for name in rates]
    seen = [quantity.name for quantity in trajectory.quantities if f"{quantity.name}_0" in states]
    units = {quantity.name: quantity.unit for quantity in trajectory.quantities}
    own = {name: ends for name, ends in bounds.items() if name not in states}
    model = model_from_equation(equation, units=units, observed=seen, bounds=own)
    if not seen:
        raise DataError(f"the equation is about {model.states[0].name}, but the table has {', '.join(units)}")
    if model.inputs:
        inputs = ", ".join(quantity.name for quantity in model.inputs)
        raise DataError(
            f"a PEtab problem cannot hold the table of the input {inputs}: write the input as a function of t in the "
            "equation, e.g. sin(2*t) for u, or give the other program the table and the equation themselves"
        )
    for name in (*model.units(), *(state.name for state in model.states)):
        if not name.isascii():
            raise DataError(f"PEtab takes ASCII letters only: give {name!r} another name in the equation")
    return model


def _parameter(
    name: str, bounds: tuple[float, float] | None, value: float | None, estimated: bool
) -> dict[str, str | float | int | None]:
    lower, upper = bounds or (-math.inf, math.inf)
    row: dict[str, str | float | int | None] = {"parameterId": name, "parameterScale": "lin"}
    return row | {"lowerBound": lower, "upperBound": upper, "nominalValue": value, "estimate": int(estimated)}


def _data(trajectory: Trajectory, model: OdeModel) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The observables, with a column whether their noise is ``known``, and the measurements."""
    valid = trajectory.valid
    observables, tables = [], []
    for quantity in model.observed:
        column = trajectory.column(quantity.name)
        sigma: Array = trajectory.sigma[valid, column]
        known = bool(np.all(np.isfinite(sigma) & (sigma > 0)))
        named = f"observable_{quantity.name}"
        formula = f"noiseParameter1_{named}" if known else f"sigma_{quantity.name}"
        observables.append((named, quantity.title, quantity.name, formula, known))
        columns = {
            "observableId": named,
            "simulationConditionId": CONDITION,
            "measurement": trajectory.position[valid, column],
            "time": trajectory.t_s[valid] - trajectory.t_s[0],
            "noiseParameters": sigma if known else None,
        }
        tables.append(pd.DataFrame(columns))
    titles = ["observableId", "observableName", "observableFormula", "noiseFormula", "known"]
    measured = pd.concat([table.astype({"noiseParameters": float}) for table in tables], ignore_index=True)
    return pd.DataFrame(observables, columns=titles), measured


def _yaml() -> str:
    listed = [f"    {what}_files: [{FILES[what]}]\n" for what in ("condition", "observable", "measurement")]
    first = f"  - sbml_files: [{FILES['model']}]\n"
    return f"format_version: 1\nparameter_file: {FILES['parameter']}\nproblems:\n{first}{''.join(listed)}"


# --------------------------------------------------------------------------- SBML


def _sbml(model: OdeModel, rates: Mapping[str, Expression], values: Mapping[str, float], t0_s: float) -> str:
    """The SBML text: parameters, states with rate rules and initial assignments; times count from ``t0_s``."""
    libsbml = petab_package("libsbml")
    document = libsbml.SBMLDocument(3, 1)
    sbml = document.createModel()
    sbml.setId("equation")
    for name in sorted({call.head for rate in rates.values() for call in rate.calls()} & DEFINED.keys()):
        function = sbml.createFunctionDefinition()
        function.setId(name)
        function.setMath(libsbml.parseL3Formula(DEFINED[name]))
    initial = dict(zip(model.initial_names, rates, strict=True))
    for name in (*(parameter.name for parameter in model.parameters), *initial, *rates):
        parameter = sbml.createParameter()
        parameter.setId(name)
        parameter.setConstant(name not in rates)
        if name in values:
            parameter.setValue(values[name])
    for name, state in initial.items():
        assignment = sbml.createInitialAssignment()
        assignment.setSymbol(state)
        assignment.setMath(_named(libsbml, name))
        rule = sbml.createRateRule()
        rule.setVariable(state)
        rule.setMath(_node(libsbml, rates[state], t0_s))
    return cast(str, libsbml.writeSBMLToString(document))


def _node(libsbml: ModuleType, side: Expression, t0_s: float) -> Any:
    """The syntax tree of libsbml for an expression."""
    if side.value is not None:
        return _number(libsbml, side.value)
    if side.head == TIME and not side.parts:
        time = _named(libsbml, TIME, libsbml.AST_NAME_TIME)
        return time if t0_s == 0 else _operation(libsbml, libsbml.AST_PLUS, [time, _number(libsbml, t0_s)])
    if not side.parts:
        return _named(libsbml, side.head.replace("'", "_rate"))
    parts = [_node(libsbml, part, t0_s) for part in side.parts]
    if side.head in DEFINED:
        node = _operation(libsbml, libsbml.AST_FUNCTION, parts)
        node.setName(side.head)
        return node
    degree = [_number(libsbml, 2.0)] if side.head == "sqrt" else []
    return _operation(libsbml, getattr(libsbml, NODES[side.head]), [*degree, *parts])


def _number(libsbml: ModuleType, value: float) -> Any:
    node = libsbml.ASTNode(libsbml.AST_REAL)
    node.setValue(value)
    return node


def _named(libsbml: ModuleType, name: str, kind: int | None = None) -> Any:
    node = libsbml.ASTNode(libsbml.AST_NAME if kind is None else kind)
    node.setName(name)
    return node


def _operation(libsbml: ModuleType, kind: int, parts: Sequence[Any]) -> Any:
    node = libsbml.ASTNode(kind)
    for part in parts:
        node.addChild(part)
    return node
