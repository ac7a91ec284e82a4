"""Inputs of the benchmark other than a data set: files of latent runs and of predictions, as flat rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from iris_sysid.benchmark.sources.latent import DAMAGED, latent_rows, read_latent_runs, unread_rows
from iris_sysid.benchmark.sources.predictions import prediction_rows
from iris_sysid.benchmark.sources.rows import joined
from iris_sysid.io.files import sha256_of


def given_rows(latent: Mapping[str, Path], predictions: Mapping[str, Path]) -> tuple[pd.DataFrame, list[str]]:
    """The flat rows of all files by name, and one line per damaged or repeated run.

    Raises DataError when a file cannot be read at all.
    """
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


def hashes(files: Mapping[str, Path]) -> list[dict[str, Any]]:
    """Name, file name and sha256 of each file."""
    return [{"name": name, "file": path.name, "sha256": sha256_of(path)} for name, path in files.items()]
