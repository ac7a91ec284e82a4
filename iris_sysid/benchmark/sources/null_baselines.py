"""Null baselines: results of methods that use no video."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.conversions import GRAVITY, READINGS, LatentReading, beta_itself
from iris_sysid.benchmark.sources.rows import GROUP, OK, flat_rows

SOURCE = "null baseline"
INITIAL = "initial value only"
METADATA = "metadata only"

# initial values of the latent pipeline: (source, alpha, beta); NaN where the source gives none
STARTS = (
    ("10, code", 10.0, np.nan),  # main.py, init_phys
    ("0.5, 0.05, stated", 0.5, 0.05),  # app:physics_block
)

# parameters that no released result takes from alpha and beta, with the conversion that the publication states
# (tab:calibration), so that the initial value can be compared with an estimate
UNREAD: Mapping[str, tuple[LatentReading, ...]] = {
    "Pendulum": (LatentReading("damping", "1/s", "beta", beta_itself),),
    "Sliding_cone": (LatentReading("friction", "1", "beta", beta_itself),),
    **dict.fromkeys(
        ("Two_Moving_Pendulums", "Two_Moving_Pendulum_One_Static"),
        tuple(LatentReading(f"damping_{body}", "1/s", "beta", beta_itself) for body in (1, 2)),
    ),
}


def null_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """The null baselines of every phenomenon, setting and parameter in the flat rows.

    ``initial value only`` converts the latent pipeline's initial values like its results; ``metadata only`` takes the
    value from the setting's name (an angle, a Delfys75 rope length in cm) or from a table of constants (gravity).
    A parameter without such a value has no row. Unit and truth are those of the given rows: one row per group, or one
    per clip where the truth differs between clips.
    """
    varies = rows.groupby(list(GROUP))["truth"].transform("nunique") > 1
    clip = rows["clip"].where(varies, "none")
    first = rows.assign(clip=clip).drop_duplicates([*GROUP, "clip"]).to_dict("records")
    return flat_rows(
        {name: row[name] for name in (*GROUP, "clip", "unit", "truth", "truth_source")}
        | {"method": method, "value": value, "status": OK, "source": SOURCE}
        for row in first
        for method, value in _values(row)
    )


def _values(row: dict[Any, Any]) -> Iterator[tuple[str, float]]:
    for reading in (*READINGS.get(row["phenomenon"], ()), *UNREAD.get(row["phenomenon"], ())):
        if reading.parameter == row["parameter"] and reading.published:
            for start, alpha, beta in STARTS:
                value = float(reading.convert(alpha, beta))
                if np.isfinite(value):
                    yield f"{INITIAL} ({start})", value
    known = metadata_value(row["phenomenon"], row["setting"], row["parameter"])
    if known is not None:
        yield METADATA, known


def metadata_value(phenomenon: str, setting: str, parameter: str) -> float | None:
    """The value of a parameter that is known without video, in SI units (angles in degrees); None where unknown.

    Phenomenon and setting are named as in the result files. ``gravity`` is a constant; ``angle`` and the Delfys75
    pendulum's ``length`` are in the setting's name.
    """
    number = re.search(r"_(\d+)$", setting)
    if parameter == "gravity":
        return GRAVITY
    if parameter == "angle" and number:
        return float(number.group(1))
    if (phenomenon, parameter) == ("pendulum", "length") and number:  # Delfys75 names its ropes by length in cm
        return float(number.group(1)) / 100
    return None
