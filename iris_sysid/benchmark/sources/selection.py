"""Equation selection scored from per-video predictions: accuracy, per class, and the confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.folder import PREDICTIONS, PublishedFolder
from iris_sysid.benchmark.sources.reading import read_lines
from iris_sysid.errors import DataError
from iris_sysid.types import NORMAL_975

TRUTH_COLUMNS = ("gt", "gt_iris")
PREDICTED_COLUMNS = ("pred", "pred_iris")
NO_ANSWER = "no answer"


@dataclass(frozen=True, eq=False, slots=True)
class SelectionScore:
    """Accuracy of one method in naming the class of a video.

    ``confusion`` counts videos, true classes down, predicted classes across, in alphabetical order, with a column
    for each other answer. ``relabelled`` is the number of videos whose own ``correct`` flag disagrees
    with the comparison of truth and prediction.
    """

    dataset: str
    method: str
    confusion: pd.DataFrame
    source: str
    relabelled: int = 0

    @property
    def n(self) -> int:
        """Number of videos."""
        return int(self.confusion.to_numpy().sum())

    @property
    def correct(self) -> int:
        """Number of correctly classified videos."""
        shared = [name for name in self.confusion.index if name in self.confusion.columns]
        return int(sum(self.confusion.loc[name, name] for name in shared))

    @property
    def accuracy(self) -> float:
        """Fraction of correctly classified videos."""
        return self.correct / self.n

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the accuracy (Wilson 1927), as if the videos were independent."""
        return wilson(self.correct, self.n)

    @property
    def per_class(self) -> pd.DataFrame:
        """One row per true class: ``videos``, ``correct``, ``accuracy``."""
        videos = self.confusion.sum(axis=1)
        correct = [self.confusion.loc[name].get(name, 0) for name in self.confusion.index]
        return pd.DataFrame({"videos": videos, "correct": correct, "accuracy": correct / videos})


def wilson(correct: int, n: int) -> tuple[float, float]:
    """95 % interval of a proportion, ``correct`` of ``n`` (Wilson 1927, J. Am. Stat. Assoc. 22, 209)."""
    z, proportion = NORMAL_975, correct / n
    centre, scale = proportion + z**2 / (2 * n), 1 + z**2 / n
    half = z * np.sqrt(proportion * (1 - proportion) / n + z**2 / (4 * n**2))
    return float((centre - half) / scale), float((centre + half) / scale)


def score_selection(
    truth: Sequence[str], predicted: Sequence[str], *, dataset: str, method: str, source: str = "", relabelled: int = 0
) -> SelectionScore:
    """Score predicted classes against true ones.

    Parameters
    ----------
    truth, predicted
        One class name per video; an empty prediction counts as wrong, under ``no answer``.
    dataset, method, source
        Kept in the score.
    relabelled
        Number of videos whose own flag disagrees, kept in the score.

    Raises
    ------
    DataError
        When there is no video, the lengths differ, or a true class is empty.
    """
    if len(truth) != len(predicted) or not len(truth) or not all(truth):
        raise DataError(f"{method}: {len(truth)} true and {len(predicted)} predicted classes; each video needs one")
    answers = [name or NO_ANSWER for name in predicted]
    classes = sorted(set(truth))
    columns = [*classes, *sorted(set(answers) - set(classes))]
    counts = np.zeros((len(classes), len(columns)), dtype=np.int64)
    for true, answer in zip(truth, answers, strict=True):
        counts[classes.index(true), columns.index(answer)] += 1
    return SelectionScore(dataset, method, pd.DataFrame(counts, index=classes, columns=columns), source, relabelled)


def read_predictions(path: str | Path) -> pd.DataFrame:
    """Read a per-video prediction file: columns ``path``, ``truth``, ``predicted``, ``correct`` (the file's flag).

    Raises DataError when a column is absent, a line is damaged, or a video occurs twice.
    """
    (_, header), *lines = read_lines(path)
    names = [_first_of(candidates, header, path) for candidates in (("path",), TRUTH_COLUMNS, PREDICTED_COLUMNS)]
    names.append(_first_of(("correct",), header, path))
    for number, row in lines:
        if len(row) != len(header):
            raise DataError(f"{path} line {number} has {len(row)} fields where the header has {len(header)}")
    frame = pd.DataFrame([[row[header.index(name)] for name in names] for _, row in lines], dtype="str")
    frame.columns = pd.Index(["path", "truth", "predicted", "correct"])
    if frame["path"].duplicated().any():
        raise DataError(f"{path} names {frame['path'][frame['path'].duplicated()].iloc[0]} twice; one line a video")
    return frame


def _first_of(candidates: Sequence[str], header: Sequence[str], path: str | Path) -> str:
    for name in candidates:
        if name in header:
            return name
    raise DataError(f"{path} has no column {' or '.join(candidates)}; it has {', '.join(header)[:200]}")


def score_published(folder: PublishedFolder, dataset: str, method: str) -> SelectionScore:
    """Score one published prediction file (a key of ``PREDICTIONS``); DataError when it cannot be read.

    Parameters
    ----------
    folder
        The folder of published result files.
    dataset
        ``delfys75`` or ``iris``.
    method
        ``cnn``, ``vlm-temporal`` or ``vlm-describe``.
    """
    if (dataset, method) not in PREDICTIONS:
        raise DataError(f"no per-video predictions of {method} on {dataset} were released")
    source = PREDICTIONS[dataset, method]
    frame = read_predictions(folder.path / source)
    flags = frame["correct"].str.lower() == "true"
    relabelled = int((flags != (frame["truth"] == frame["predicted"])).sum())
    return score_selection(
        frame["truth"].tolist(),
        frame["predicted"].tolist(),
        dataset=dataset,
        method=method,
        source=source,
        relabelled=relabelled,
    )


def rescored_selection(published_folder: str | Path) -> tuple[list[SelectionScore], list[str]]:
    """Score the published VLM and CNN predictions again; also return one line per file where that failed."""
    folder = PublishedFolder(published_folder)
    scores, gaps = [], []
    for dataset, method in PREDICTIONS:
        try:
            scores.append(score_published(folder, dataset, method))
        except DataError as error:
            gaps.append(f"{method} on {dataset} cannot be re-scored: {error}")
    return scores, gaps
