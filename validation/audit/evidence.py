"""The parts of a finding, and calculations that several findings share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.conversions import Values
from iris_sysid.benchmark.sources.published import truth_of
from iris_sysid.errors import DataError
from validation.audit.folder import PublishedFolder, estimates, reading_of, select
from validation.audit.printed import PublishedValue, values_at
from validation.audit.reproduce import REPRODUCED, status_of

CONFIRMED = "confirmed"
NOT_CONFIRMED = "not confirmed"

IRIS_TABLE = "tab:iris_results"
DELFYS_TABLE = "tab:delfys75_baseline_unified"
PENDULUMS = ("Pendulum", "Two_Moving_Pendulums", "Two_Moving_Pendulum_One_Static")
BALLS = ("Dropping_ball", "Falling_ball")
PAIRS = ("Two_Moving_Pendulums", "Two_Moving_Pendulum_One_Static")


@dataclass(frozen=True, eq=False, slots=True)
class Outcome:
    """What the files show: whether the statement holds, the statement with its numbers, and the numbers as a table."""

    holds: bool
    statement: str
    evidence: pd.DataFrame


@dataclass(frozen=True, eq=False, slots=True)
class Finding:
    """One statement about the published numbers, computed from the files.

    ``point`` is its number in the project's notes. ``verdict`` is ``confirmed`` when the files show it, ``not
    confirmed`` when they show otherwise, ``cannot be derived`` when a file is absent or damaged (then the statement
    says which). ``evidence`` is what was computed; its columns name the quantities. ``sources`` are the files.
    """

    point: int
    title: str
    verdict: str
    statement: str
    evidence: pd.DataFrame
    sources: tuple[str, ...]


def facts(values: Mapping[str, float | str]) -> pd.DataFrame:
    """Single numbers as evidence: columns ``what`` and ``value``."""
    return pd.DataFrame({"what": list(values), "value": list(values.values())}, dtype="object")


def row_name(value: PublishedValue) -> str:
    """Name of the table row that prints a number, e.g. ``Pendulum/pendulum_45/length``."""
    return "/".join(part for part in (value.phenomenon, value.setting, value.parameter) if part)


def matches(value: PublishedValue, derived: float) -> bool:
    """Whether a derived number equals the printed one within its printed digits."""
    return status_of(derived - value.number, value.tolerance) == REPRODUCED


def run_errors(
    folder: PublishedFolder, run: str, value: PublishedValue, conversion: str = "", *, zeros: bool = True
) -> Values:
    """Absolute errors of the clips of a run, for the parameter of a published number.

    Parameters
    ----------
    folder
        The result files.
    run
        Key of ``RUNS``.
    value
        Says which phenomenon, setting and parameter.
    conversion
        Of alpha; the published one when empty.
    zeros
        Follow the publication: failed and invalid estimates count as 0.
    """
    runs = select(folder.runs(run), value.phenomenon, value.setting)
    values = estimates(runs, reading_of(value.phenomenon, value.parameter, conversion), zeros=zeros)
    return np.asarray(np.abs(values - truth_value(value)), dtype=np.float64)


def run_mae(folder: PublishedFolder, run: str, value: PublishedValue, conversion: str = "") -> float:
    """Mean of :func:`run_errors` by the publication's own rule.

    Parameters
    ----------
    folder
        The result files.
    run
        Key of ``RUNS``.
    value
        Says which phenomenon, setting and parameter.
    conversion
        Of alpha; the published one when empty.
    """
    return float(run_errors(folder, run, value, conversion).mean())


def truth_value(value: PublishedValue) -> float:
    """The published ground truth for a published number, in its unit; DataError when there is none."""
    for parameter in (value.parameter, f"{value.parameter}_1"):
        truth = truth_of(value.dataset, value.phenomenon, value.setting, parameter)
        if truth:
            return truth.value
    raise DataError(f"no ground truth is published for {value.key}")


def estimated(place: str, column: str) -> list[PublishedValue]:
    """The numbers of a column that are estimates, that is, not copied from the setting's name."""
    return [value for value in values_at(place, column) if value.parameter != "angle"]


def rounded(values: list[float]) -> str:
    """Numbers to three significant digits, joined by commas."""
    return ", ".join(f"{value:.3g}" for value in values)
