"""Per-video predictions of a VLM or a classifier as flat rows: the predicted class, and whether it is correct."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd

from iris_sysid.benchmark.sources.rows import FAILED, OK, SELECTION, flat_rows
from iris_sysid.benchmark.sources.selection import NO_ANSWER, read_predictions

EQUATION = "equation"  # the parameter of the rows of the study ``selection``: the predicted class


def prediction_rows(path: str | Path, method: str, *, source: str = "") -> pd.DataFrame:
    """Read a prediction file as flat rows and score it again: value 1 where the answer is the true class, else 0.

    The CSV has a video's ``path``, its true class (``gt`` or ``gt_iris``) and the answer (``pred`` or ``pred_iris``). A
    row without an answer is a failed one. The file's own ``correct`` flag is not used. DataError when the file cannot
    be read, or names a video twice.
    """
    frame = read_predictions(path)
    return flat_rows(_record(row, method, source) for row in frame.to_dict("records"))


def _record(prediction: dict[Any, Any], method: str, source: str) -> dict[str, Any]:
    dataset, setting, clip = _clip_of(prediction["path"], prediction["truth"])
    answered = bool(prediction["predicted"])
    return {
        "study": SELECTION,
        "dataset": dataset,
        "phenomenon": prediction["truth"],
        "setting": setting,
        "clip": clip,
        "method": method,
        "parameter": EQUATION,
        "value": float(prediction["predicted"] == prediction["truth"]) if answered else None,
        "unit": "1",
        "truth": 1.0,
        "truth_source": "class folder",
        "status": OK if answered else FAILED,
        "answer": prediction["predicted"] or NO_ANSWER,
        "source": source,
    }


def _clip_of(path: str, truth: str) -> tuple[str, str, str]:
    """Data set, setting and clip from a path in a prediction file, with slashes or backslashes."""
    parts = [part for part in re.split(r"[\\/]+", path.rpartition(".")[0] or path) if part not in ("", ".", "..")]
    at = next((k for k, part in enumerate(parts) if part.lower() == truth.lower()), -1)
    if at < 0 or at + 2 >= len(parts):
        return "", "", "/".join(parts)
    return (parts[at - 1].lower() if at else ""), parts[at + 1], "/".join(parts[at + 2 :])
