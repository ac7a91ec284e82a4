"""Equation selection scored from per-video predictions: accuracy, per class, and the confusion matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.selection import NO_ANSWER, read_predictions, wilson
from iris_sysid.errors import DataError
from validation.audit.folder import PREDICTIONS, PublishedFolder


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
