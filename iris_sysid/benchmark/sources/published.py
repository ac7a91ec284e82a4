"""The ground truth that the publication states (facts only)."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from importlib.resources import as_file, files
from typing import Any

import pandas as pd

from iris_sysid.benchmark.sources.reading import read_columns


@dataclass(frozen=True, slots=True)
class PublishedTruth:
    """The published ground truth of one parameter in one setting.

    ``uncertainty`` is the half-width that the publication states, NaN where it states none. ``measurement_type``
    is ``direct``, ``assumed`` or ``unstated``, from the publication's description.
    """

    dataset: str
    phenomenon: str
    setting: str
    parameter: str
    value: float
    uncertainty: float
    unit: str
    measurement_type: str
    source: str


def truths() -> pd.DataFrame:
    """The published ground truth as a table, a row for each parameter and setting; columns: :class:`PublishedTruth`."""
    return pd.DataFrame([asdict(truth) for truth in _all_truths().values()])


def truth_of(dataset: str, phenomenon: str, setting: str, parameter: str) -> PublishedTruth | None:
    """The published ground truth of one parameter in one setting, or None where the publication gives none.

    Parameters
    ----------
    dataset
        ``iris`` or ``delfys75``.
    phenomenon, setting
        As the result files name them, e.g. ``Pendulum`` and ``pendulum_45``.
    parameter
        E.g. ``length``; ``length_1`` and ``length_2`` for two bodies.
    """
    return _all_truths().get((dataset, phenomenon, setting, parameter))


@cache
def _all_truths() -> dict[tuple[str, str, str, str], PublishedTruth]:
    with as_file(files("iris_sysid.benchmark.sources") / "published" / "truth.csv") as path:
        frame = read_columns(path, [field.name for field in fields(PublishedTruth)])
    rows = (
        PublishedTruth(
            **{**_texts(row), "value": float(row["value"]), "uncertainty": float(row["uncertainty"] or math.nan)}
        )
        for row in frame.to_dict("records")
    )
    return {(row.dataset, row.phenomenon, row.setting, row.parameter): row for row in rows}


def _texts(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    return {str(name): value for name, value in row.items()}
