"""Build the benchmark in one folder: rows from every source, then all tables from these rows."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from iris_sysid.benchmark.dataset_rows import DatasetRows
from iris_sysid.benchmark.sources.latent import DAMAGED, latent_rows, read_latent_runs, unread_rows
from iris_sysid.benchmark.sources.predictions import prediction_rows
from iris_sysid.benchmark.sources.rows import joined, read_rows
from iris_sysid.benchmark.tables.pages import PAGES, write_pages
from iris_sysid.errors import DataError
from iris_sysid.io.files import check_folder, origin_of, sha256_of

DOCUMENT = "benchmark"  # name of this kind of document in its manifest


@dataclass(frozen=True, slots=True)
class Inputs:
    """Inputs of the benchmark: files by the name of the method, earlier rows, and the rows of a data set."""

    latent: Mapping[str, Path] = field(default_factory=dict)
    predictions: Mapping[str, Path] = field(default_factory=dict)
    rows: Path | None = None
    dataset: DatasetRows | None = None


def build(
    inputs: Inputs,
    output: str | Path,
    *,
    options: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> dict[str, Path]:
    """Collect the flat rows and write every table that has rows.

    Parameters
    ----------
    inputs
        The rows of a data set, files of latent runs and of predictions, and earlier rows.
    output
        Folder of ``rows.csv``, the pages and the manifest; the files of an earlier benchmark in it are replaced.
    options
        Other settings that the rows depend on; kept in the manifest.
    overwrite
        Replace files that no benchmark wrote.

    Returns
    -------
    dict
        The path of each file by its name in the folder.

    Raises
    ------
    DataError
        When no input has any rows, or a file cannot be read.
    OutputError
        When the folder cannot be written.
    """
    folder = Path(output)
    replace = can_write(folder, overwrite=overwrite)
    rows, gaps = rows_of(inputs)
    if not len(rows):
        raise DataError("there is nothing to make a table from: give a data set, --latent, --predictions or --rows")
    manifest = manifest_of(inputs, rows, options or {})
    return write_pages(rows, folder, gaps=gaps, manifest=manifest, overwrite=replace)


def can_write(folder: Path, *, overwrite: bool) -> bool:
    """Whether the files in ``folder`` are to be replaced; raises OutputError when they must not be."""
    replace = overwrite or is_benchmark(folder)
    check_folder(folder, PAGES, overwrite=replace)
    return replace


def rows_of(inputs: Inputs) -> tuple[pd.DataFrame, list[str]]:
    """All flat rows (of the data set, earlier ones, of the files), and one line per gap."""
    earlier = [] if inputs.rows is None else [read_rows(inputs.rows)]
    measured = [] if inputs.dataset is None else [inputs.dataset.rows]
    given, gaps = _given_rows(inputs.latent, inputs.predictions)
    return joined([*measured, *earlier, given]), [*(inputs.dataset.gaps if inputs.dataset else ()), *gaps]


def _given_rows(latent: Mapping[str, Path], predictions: Mapping[str, Path]) -> tuple[pd.DataFrame, list[str]]:
    """The flat rows of all files by name, and one line per damaged or repeated run."""
    frames, gaps = [], []
    for name, path in latent.items():
        runs = read_latent_runs(path)
        frames += [latent_rows(runs, name, source=path.name), unread_rows(runs, name, source=path.name)]
        gaps += list(_remarks(path.name, runs))
    frames += [prediction_rows(path, name, source=path.name) for name, path in predictions.items()]
    return joined(frames), gaps


def _remarks(name: str, runs: pd.DataFrame) -> Iterator[str]:
    for row in runs[runs["status"] == DAMAGED].to_dict("records"):
        yield f"{name} line {row['line']}: {row['message']}"
    for row in runs[runs["duplicate_of"].notna()].to_dict("records"):
        yield f"{name} line {row['line']} repeats line {row['duplicate_of']}"


def _hashes(files: Mapping[str, Path]) -> list[dict[str, Any]]:
    """Name, file name and sha256 of each file."""
    return [{"name": name, "file": path.name, "sha256": sha256_of(path)} for name, path in files.items()]


def manifest_of(inputs: Inputs, rows: pd.DataFrame, options: Mapping[str, Any]) -> dict[str, Any]:
    """The origin of the rows: hashes of the files, the other options, versions, and the clips of each table."""
    return {
        "document": DOCUMENT,
        "version": 1,
        "clips": dict(inputs.dataset.clips) if inputs.dataset else {},
        "latent": _hashes(inputs.latent),
        "predictions": _hashes(inputs.predictions),
        "rows": None if inputs.rows is None else {"file": inputs.rows.name, "sha256": sha256_of(inputs.rows)},
        "splits": splits_of(rows),
        "seeds": sorted({int(seed) for seed in rows["seed"].dropna()}),
        "origin": origin_of(None, options),
    }


def splits_of(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """The clips on which each method was scored, by study, data set and method: the split in use."""
    by = ["study", "dataset", "method"]
    splits = []
    for (study, dataset, method), group in rows.groupby(by, sort=False):
        clips = (group["phenomenon"] + "/" + group["setting"] + "/" + group["clip"]).unique()
        splits.append(
            {"study": study, "dataset": dataset, "method": method, "n": len(clips), "clips": sorted(map(str, clips))}
        )
    return splits


def is_benchmark(folder: str | Path) -> bool:
    """Whether an earlier benchmark wrote the files in a folder, so that they may be replaced."""
    try:
        manifest = json.loads((Path(folder) / "manifest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and manifest.get("document") == DOCUMENT
