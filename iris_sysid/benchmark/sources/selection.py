"""Per-video predictions of a class as files hold them, and the interval of a proportion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.reading import columns_of, read_lines
from iris_sysid.errors import DataError
from iris_sysid.types import NORMAL_975

TRUTH_COLUMNS = ("gt", "gt_iris")
PREDICTED_COLUMNS = ("pred", "pred_iris")
NO_ANSWER = "no answer"


def wilson(correct: int, n: int) -> tuple[float, float]:
    """95 % interval of a proportion, ``correct`` of ``n`` (Wilson 1927, J. Am. Stat. Assoc. 22, 209)."""
    z, proportion = NORMAL_975, correct / n
    centre, scale = proportion + z**2 / (2 * n), 1 + z**2 / n
    half = z * np.sqrt(proportion * (1 - proportion) / n + z**2 / (4 * n**2))
    return float((centre - half) / scale), float((centre + half) / scale)


def read_predictions(path: str | Path) -> pd.DataFrame:
    """Read a per-video prediction file: columns ``path``, ``truth``, ``predicted``, ``correct`` (the file's flag).

    Raises DataError when a column is absent, a line is damaged, or a video occurs twice.
    """
    lines = read_lines(path)
    header = lines[0][1]
    names = [_first_of(candidates, header, path) for candidates in (("path",), TRUTH_COLUMNS, PREDICTED_COLUMNS)]
    names.append(_first_of(("correct",), header, path))
    frame = columns_of(lines, names, path)
    frame.columns = pd.Index(["path", "truth", "predicted", "correct"])
    if frame["path"].duplicated().any():
        raise DataError(f"{path} names {frame['path'][frame['path'].duplicated()].iloc[0]} twice; one line a video")
    return frame


def _first_of(candidates: Sequence[str], header: Sequence[str], path: str | Path) -> str:
    for name in candidates:
        if name in header:
            return name
    raise DataError(f"{path} has no column {' or '.join(candidates)}; it has {', '.join(header)[:200]}")
