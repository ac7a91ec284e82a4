"""Read the latent pipeline's result files, `run,alpha,beta,max_z,min_z,z0,z1`, with failed runs marked."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from iris_sysid.benchmark.sources.conversions import READINGS, LatentReading
from iris_sysid.benchmark.sources.published import truth_of, truths
from iris_sysid.benchmark.sources.reading import parse_number, read_lines
from iris_sysid.benchmark.sources.rows import FAILED, OK, flat_rows
from iris_sysid.errors import DataError

VALUES = ("alpha", "beta", "max_z", "min_z", "z0", "z1")
HEADERS = (("run", *VALUES), ("phenomenon", "setting", "clip_idx", *VALUES))
RUN_COLUMNS = ("line", "phenomenon", "setting", "clip", *VALUES, "status", "message", "duplicate_of")
DAMAGED = "damaged"
NOT_ESTIMATED = "not estimated"
SEED = 42  # of the runs, as the publication states it

Dataset = Literal["iris", "delfys75"]
DELFYS_CLASSES = ("dropped_ball", "free_fall", "led", "pendulum", "sliding_block", "torricelli")  # lower case there


def read_latent_runs(path: str | Path) -> pd.DataFrame:
    """Read a latent pipeline's result file: one row per run, in the file's order.

    The field ``run`` contains commas (``Pendulum,pendulum_45`` or ``pendulum,pendulum_45,01``), so that the header is
    shorter than the rows: the last six fields are the values, the fields before them name the run. The multi-clip
    files, with ``phenomenon,setting,clip_idx`` in the header, are read too.

    Parameters
    ----------
    path
        UTF-8 CSV file.

    Returns
    -------
    DataFrame
        ``line`` in the file; ``phenomenon, setting, clip`` as the file names them, where a run without a clip gets
        its number within the setting (``row01``: the file does not name the clip) and a repeated clip its count
        (``01#2``); ``alpha`` to ``z1``, dimensionless; ``status`` ``ok``, ``failed`` (all six values are 0, which the
        pipeline writes after an exception, or one is not finite) or ``damaged``, both with NaN and a ``message``;
        ``duplicate_of``, the line of an earlier run of the same setting with the same six values, else <NA>.

    Raises
    ------
    DataError
        When the file cannot be read, has another header, or holds no run that can be read.
    """
    (_, header), *lines = read_lines(path)
    if tuple(header) not in HEADERS:
        raise DataError(f"{path} begins with {','.join(header)!r:.80}; expected {','.join(HEADERS[0])}")
    counts: Counter[tuple[str, ...]] = Counter()
    runs = pd.DataFrame([_run(number, row, counts) for number, row in lines], columns=RUN_COLUMNS)
    if not (runs["status"] != DAMAGED).any():
        raise DataError(f"{path} holds no run that can be read; expected {','.join(HEADERS[0])}")
    runs["duplicate_of"] = _duplicates(runs)
    return runs


def _run(line: int, row: list[str], counts: Counter[tuple[str, ...]]) -> dict[str, Any]:
    names, values = row[: -len(VALUES)], [parse_number(field) for field in row[-len(VALUES) :]]
    phenomenon, setting, clip = (*names, "", "", "")[:3]
    counts[phenomenon, setting] += 1
    run: dict[str, Any] = {"line": line, "phenomenon": phenomenon, "setting": setting}
    run["clip"] = clip or f"row{counts[phenomenon, setting]:02d}"
    counts[phenomenon, setting, run["clip"]] += 1
    if counts[phenomenon, setting, run["clip"]] > 1:
        run["clip"] += f"#{counts[phenomenon, setting, run['clip']]}"
    run["status"], run["message"] = _judge(names, row, values)
    ok = run["status"] == OK
    return run | {
        name: value if ok else math.nan for name, value in zip(VALUES, [*values, *[math.nan] * 6], strict=False)
    }


def _judge(names: list[str], row: list[str], values: list[float]) -> tuple[str, str]:
    if len(names) not in (2, 3) or not all(names):
        return DAMAGED, f"{len(row)} fields, where 2 or 3 names and {len(VALUES)} values were expected"
    unreadable = [text for text, value in zip(row[-len(VALUES) :], values, strict=True) if math.isnan(value)]
    if any(text.lower() not in ("nan", "") for text in unreadable):
        return DAMAGED, f"{unreadable[0]!r:.40} is not a number"
    if not all(math.isfinite(value) for value in values):
        return FAILED, "a value is not finite"
    if not any(values):
        return FAILED, "all values are 0: the pipeline writes zeros after an exception"
    return OK, ""


def _duplicates(runs: pd.DataFrame) -> pd.Series:
    """For each run the line of the first run of the same phenomenon and setting with the same values."""
    first = runs.groupby(["phenomenon", "setting", *VALUES], dropna=False)["line"].transform("first")
    # multi-clip files repeat the one shared model for each clip by design: max_z to z1 are all 0 there
    independent = (runs["status"] == OK) & (runs[["max_z", "min_z", "z0", "z1"]] != 0).any(axis=1)
    return first.where(independent & (first < runs["line"])).astype("Int64")


def dataset_of(runs: pd.DataFrame) -> Dataset:
    """The benchmark of the runs: IRIS capitalises its classes, Delfys75 writes them in lower case."""
    names = set(runs.loc[runs["status"] != DAMAGED, "phenomenon"])
    return "delfys75" if names and names <= set(DELFYS_CLASSES) else "iris"


def latent_rows(runs: pd.DataFrame, method: str, *, source: str = "") -> pd.DataFrame:
    """Turn runs into flat rows under every reading of alpha and beta, each reading as a separate method.

    For a length both readings are given: ``g/alpha``, which the publication applies to every file, and
    ``alpha as length``, which the baseline's pendulum block fits. A failed run is a row with NaN; so is an alpha that
    gives no length (alpha <= 0 under ``g/alpha``), with status ``undefined``, and a damaged line whose phenomenon can
    be read.

    Parameters
    ----------
    runs
        From :func:`read_latent_runs`.
    method
        Name of the method; the reading is added in brackets, e.g. ``baseline (g/alpha)``.
    source
        Name of the file, kept in each row.

    Returns
    -------
    DataFrame
        Flat rows; ``truth`` is the published value, NaN where the publication gives none.
    """
    dataset = dataset_of(runs)
    records = [
        _record(run, reading, dataset) | {"method": f"{method} ({reading.conversion})", "seed": SEED, "source": source}
        for run in runs.to_dict("records")
        for reading in READINGS.get(run["phenomenon"], ())
    ]
    return flat_rows(records)


def unread_rows(runs: pd.DataFrame, method: str, *, source: str = "") -> pd.DataFrame:
    """Rows without a value for runs of phenomena whose published parameter neither alpha nor beta gives.

    They keep the incline's angle in the table: its published value is from metadata, and no run estimates it. Method
    and source are those of :func:`latent_rows`.
    """
    dataset = dataset_of(runs)
    known = truths()
    known = known[known["dataset"] == dataset]
    records: list[dict[str, Any]] = []
    for run in runs.to_dict("records"):
        if run["phenomenon"] in READINGS:
            continue
        setting_truths = known[(known["phenomenon"] == run["phenomenon"]) & (known["setting"] == run["setting"])]
        for truth in setting_truths.to_dict("records"):
            record = {name: run[name] for name in ("phenomenon", "setting", "clip")}
            record |= {"dataset": dataset, "method": method, "seed": SEED, "source": source, "status": NOT_ESTIMATED}
            records.append(
                record
                | {"parameter": truth["parameter"], "unit": truth["unit"]}
                | {"truth": truth["value"], "truth_source": truth["source"]}
            )
    return flat_rows(records)


def _record(run: dict[Any, Any], reading: LatentReading, dataset: Dataset) -> dict[str, Any]:
    truth = truth_of(dataset, run["phenomenon"], run["setting"], reading.parameter)
    value = float(reading.convert(run["alpha"], run["beta"]))
    status = "undefined" if run["status"] == OK and math.isnan(value) else run["status"]
    return {
        "dataset": dataset,
        "phenomenon": run["phenomenon"],
        "setting": run["setting"],
        "clip": run["clip"],
        "parameter": reading.parameter,
        "value": value,
        "unit": reading.unit,
        "truth": truth.value if truth else math.nan,
        "truth_source": truth.source if truth else "",
        "status": status,
    }
