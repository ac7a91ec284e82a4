"""The probability that a detection is of a body: fitted to clips with marks, tested on recordings left out.

``python -m validation.detection_odds`` runs every detector on the marked frames of the recordings of
:mod:`validation.track_verdict` (open real clips, drawn phone clips, rendered clips), fits a logistic regression of each
to whether a detection is at a mark, and prints what is said against what is found on recordings left out; ``--write``
puts the weights into ``trackers/detectors/_weights.py``. ``--keep TABLE.csv`` keeps the detections, ``--table`` reads
them again.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.special import expit

from iris_sysid.errors import IrisError
from iris_sysid.registry import DETECTORS
from iris_sysid.types import Array, Detections, Frame, TrackOptions
from trackers._auto.sampled_once import SampledOnce
from trackers.detectors._weights import WEIGHTS
from validation.pages import ROOT
from validation.track_verdict import DRAWN, MADE_UP, RENDERED, Recording, recordings

FILE = ROOT / "trackers" / "detectors" / "_weights.py"
RIDGE = 0.003  # on the weights, over the number of recordings
MIN_PX, OF_WIDTH = 6.0, 640.0  # a body smaller than this in an image so wide is met within this, px
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
FOLDS = 10
IN_VIEW = ("free", "held", "edge")


@dataclass(eq=False)
class MarkedFrames(SampledOnce):
    """A clip of which only the marked frames are read, from memory."""

    kept: Sequence[Frame] = ()

    @property
    def n_expected(self) -> int:
        """Number of marked frames."""
        return len(self.kept)

    def frames(self) -> Iterator[Frame]:
        """The marked frames."""
        return iter(self.kept)


def measured(recording: Recording) -> Iterator[pd.DataFrame]:
    """The detections of every detector in the marked frames: evidence, and whether each is of a body."""
    marks, video = recording.marks(), recording.video()
    wanted = set(marks["frame"])
    frames = MarkedFrames(video, kept=[frame for frame in video.frames() if frame.index in wanted])
    for name, detector in DETECTORS.items():
        try:
            found = detector.detect(frames, TrackOptions(bodies=recording.bodies))
        except IrisError as error:
            print(f"{recording.name}: {name}: {error}", flush=True)
            continue
        body = on_body(found, marks, video.width)
        yield pd.DataFrame({"recording": recording.name, "detector": name, "body": body, **found.evidence})


def on_body(found: Detections, marks: pd.DataFrame, width: int) -> Array:
    """1 for each detection (n,) within a radius of a mark of its frame, else 0."""
    hit = np.zeros(len(found))
    for mark in marks[marks["state"].isin(IN_VIEW)].itertuples():
        reach = max(float(np.nan_to_num(mark.radius_px)), MIN_PX * width / OF_WIDTH)
        hit[(found.frame == mark.frame) & (np.hypot(*(found.xy_px - (mark.x_px, mark.y_px)).T) < reach)] = 1.0
    return hit


def fitted(rows: pd.DataFrame, names: Sequence[str]) -> tuple[float, Array]:
    """Intercept and weights of a ridge logistic regression; each recording weighs the same, made-up ones less."""
    evidence, body = rows[list(names)].to_numpy(), rows["body"].to_numpy()
    made_up = rows["recording"].str.startswith((DRAWN, RENDERED)).to_numpy()
    weight = np.where(made_up, MADE_UP, 1.0) / rows.groupby("recording")["body"].transform("size").to_numpy()
    recordings_there = rows["recording"].nunique()

    def loss(values: Array) -> tuple[float, Array]:
        odds = values[0] + evidence @ values[1:]
        off = weight * (expit(odds) - body)
        total = weight @ (np.logaddexp(0, odds) - body * odds) + RIDGE * recordings_there * values[1:] @ values[1:] / 2
        slope = evidence.T @ off + RIDGE * recordings_there * values[1:]
        return float(total), np.concatenate([[off.sum()], slope])

    best = minimize(loss, np.zeros(len(names) + 1), jac=True, method="L-BFGS-B")
    return float(best.x[0]), best.x[1:]


def left_out(rows: pd.DataFrame, names: Sequence[str]) -> Array:
    """The probability (n,) of each detection, by a fit to the recordings of the other tenths."""
    fold = rows["recording"].map({name: k % FOLDS for k, name in enumerate(sorted(rows["recording"].unique()))})
    said = np.empty(len(rows))
    for k in range(FOLDS):
        intercept, weights = fitted(rows[fold != k], names)
        said[fold == k] = expit(intercept + rows.loc[fold == k, list(names)].to_numpy() @ weights)
    return said


def report(rows: pd.DataFrame) -> Iterator[str]:
    """What is said of detections against what is found, on real recordings left out."""
    yield "| detector | detections | said | of a body |\n|---|---:|---:|---:|"
    for detector, of_detector in rows.groupby("detector"):
        names = list(WEIGHTS[str(detector)])
        said = left_out(of_detector, names)
        real = ~of_detector["recording"].str.startswith((DRAWN, RENDERED)).to_numpy()
        for low, high in pairwise(BINS):
            chosen = real & (said >= low) & (said <= high)
            if chosen.any():
                found = of_detector["body"].to_numpy()[chosen].mean()
                yield f"| {detector} | {chosen.sum()} | {said[chosen].mean():.2f} | {found:.2f} |"


def written(rows: pd.DataFrame) -> str:
    """The file of weights by the fit to all recordings."""
    fits = {str(name): (list(WEIGHTS[str(name)]), part) for name, part in rows.groupby("detector")}
    found = {name: (names, *fitted(part, names)) for name, (names, part) in fits.items()}
    title = "Weights of the evidence of each detector; written by ``python -m validation.detection_odds --write``."
    lines = [f'"""{title}"""']
    lines += ["", "from __future__ import annotations", "", "from collections.abc import Mapping", ""]
    lines += ["INTERCEPTS: Mapping[str, float] = {"]
    lines += [f'    "{name}": {intercept:.3f},' for name, (_, intercept, _) in found.items()]
    lines += ["}", "WEIGHTS: Mapping[str, Mapping[str, float]] = {"]
    for name, (names, _, weights) in found.items():
        lines += [
            f'    "{name}": {{',
            *(f'        "{key}": {w:.3f},' for key, w in zip(names, weights, strict=True)),
            "    },",
        ]
    return "\n".join([*lines, "}", ""])


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure or read the detections, and print or write what follows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, help="read the detections instead of measuring them")
    parser.add_argument("--keep", type=Path, help="keep the detections in this table")
    parser.add_argument("--write", action="store_true", help=f"write the weights to {FILE.name}")
    options = parser.parse_args(arguments)
    if options.table:
        rows = pd.read_csv(options.table)
    else:
        warnings.simplefilter("ignore")
        with tempfile.TemporaryDirectory() as folder:
            rows = pd.concat([part for one in recordings(Path(folder)) for part in measured(one)])
    if options.keep:
        rows.to_csv(options.keep, index=False)
    print("\n".join(report(rows)))
    if options.write:
        FILE.write_text(written(rows), "utf-8")


if __name__ == "__main__":
    main()
