"""The folder of published result files: their names, a reader that reads each file once, and the absent ones."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.conversions import READINGS, LatentReading, Values
from iris_sysid.benchmark.sources.latent import read_latent_runs
from iris_sysid.benchmark.sources.reading import parse_number, read_columns
from iris_sysid.benchmark.sources.rows import FAILED
from iris_sysid.errors import DataError

RUNS = {
    "delfys75_baseline": "delfys75_baseline/delfys75_baseline.csv",
    "delfys75_unified": "delfys75_unified/delfys75_unified.csv",
    "iris_baseline": "iris_baseline/iris_baseline.csv",
    "iris_unified": "iris_unified/iris_unified.csv",
    "iris_unified_multistep": "iris_unified_multistep/iris_unified_multistep.csv",
    "iris_multi_clip": "iris_multi_clip/iris_multi_clip.csv",
    "per_clip_on_test_split": "iris_multi_clip/per_clip_on_test_split.csv",
}
ERRORS = {
    "delfys75_baseline": "delfys75_comparison/parameter_errors_baseline.csv",
    "delfys75_unified": "delfys75_comparison/parameter_errors_unified.csv",
    "iris_baseline": "iris_comparison/parameter_errors_baseline.csv",
    "iris_unified": "iris_comparison/parameter_errors_unified.csv",
    "iris_unified_multistep": "iris_comparison/parameter_errors_unified_multistep.csv",
}
PREDICTIONS = {
    ("delfys75", "cnn"): "video_classifier_eval/video_classifier_results.csv",
    ("delfys75", "vlm-temporal"): "vlm_temporal_reasoning/vlm_dynamics_results.csv",
    ("delfys75", "vlm-describe"): "vlm_describe_then_classify/vlm_dynamics_results.csv",
    ("iris", "cnn"): "video_classifier_eval_iris/video_classifier_results.csv",
    ("iris", "vlm-temporal"): "vlm_eval_iris/vlm_iris_results.csv",
    ("iris", "vlm-describe"): "vlm_eval_iris_describe_then/vlm_iris_results.csv",
}
KAPPA_STATISTICS = "hitting_cones_reconstruction/kappa_consistency.csv"
KAPPA_LOSSES = "hitting_cones_reconstruction/reconstruction_comparison.csv"
INTEGRATORS = "ablations/integrator_comparison.csv"

RELEASED = (
    *(*RUNS.values(), *ERRORS.values(), *PREDICTIONS.values()),
    *(KAPPA_STATISTICS, KAPPA_LOSSES, INTEGRATORS),
)

ERROR_NUMBERS = ("gt_mean", "est_mean", "abs_err_mean", "abs_err_std", "n")
# names in the error files that differ from those of the flat rows
PARAMETERS = {
    "g": "gravity",
    "rope_length": "length",
    "rope_length_1": "length_1",
    "rope_length_2": "length_2",
    "length_m": "length",
    "angular_stiffness": "stiffness",
    "angular_damping": "damping",
    "angle_deg": "angle",
    "decay": "decay_rate",
    "k": "outflow",
}


class PublishedFolder:
    """The result files of one publication, read on demand.

    An absent or damaged file raises DataError when it is read; other files are not affected.
    """

    def __init__(self, folder: str | Path) -> None:
        self.path = Path(folder)
        if not self.path.is_dir():
            raise DataError(f"{folder} is not a folder; give the folder that holds {RUNS['iris_baseline']}")
        self._read: dict[str, pd.DataFrame] = {}

    def runs(self, name: str) -> pd.DataFrame:
        """The runs of one of ``RUNS``, as :func:`read_latent_runs` gives them."""
        if name not in self._read:
            self._read[name] = read_latent_runs(self.path / RUNS[name])
        return self._read[name]

    def errors(self, name: str) -> pd.DataFrame:
        """One of the error files (``ERRORS``), parameters renamed to ours; phenomena there are in lower case."""
        path = ERRORS[name]
        if path not in self._read:
            frame = self.table(path, ("dynamics", "setting", "param"), ERROR_NUMBERS)
            self._read[path] = frame.assign(parameter=frame["param"].replace(PARAMETERS))
        return self._read[path]

    def table(self, path: str, texts: Sequence[str], numbers: Sequence[str]) -> pd.DataFrame:
        """Named columns of a file of the folder; DataError as :func:`read_columns` raises it, or for no number."""
        frame = read_columns(self.path / path, (*texts, *numbers))
        for name in numbers:
            values = frame[name].map(parse_number)
            wrong = frame.loc[~np.isfinite(values), name]
            if len(wrong):
                raise DataError(f"{self.path / path}: {name} is {wrong.iloc[0]!r:.40}, which is not a finite number")
            frame[name] = values
        return frame

    def relative(self, error: DataError | str) -> str:
        """The text of an error with paths relative to the folder, the same on every machine."""
        return str(error).replace(f"{self.path}{os.sep}", "")

    def present(self) -> list[str]:
        """The released files that this folder has, in the order of ``RELEASED``."""
        return [path for path in RELEASED if (self.path / path).is_file()]

    def absent(self) -> list[str]:
        """The released files that this folder lacks."""
        return [path for path in RELEASED if not (self.path / path).is_file()]


def select(runs: pd.DataFrame, phenomenon: str, setting: str = "") -> pd.DataFrame:
    """The readable runs of a phenomenon and, when given, of a setting; DataError when there is none."""
    chosen = runs[(runs["phenomenon"] == phenomenon) & (runs["status"] != "damaged")]
    if setting:
        chosen = chosen[chosen["setting"] == setting]
    if chosen.empty:
        raise DataError(f"no run of {phenomenon}/{setting or 'any setting'} in the file")
    return chosen


def reading_of(phenomenon: str, parameter: str, conversion: str = "") -> LatentReading:
    """The reading of a parameter: the published one, or the one of that conversion; DataError when there is none.

    Parameters
    ----------
    phenomenon
        As the result files name it.
    parameter
        ``length`` also finds ``length_1``, since both bodies have the same alpha.
    conversion
        E.g. ``alpha as length``; empty for the published one.
    """
    for reading in READINGS.get(phenomenon, ()):
        fits = reading.conversion == conversion if conversion else reading.published
        if reading.parameter in (parameter, f"{parameter}_1") and fits:
            return reading
    raise DataError(f"{phenomenon} has no {parameter} that alpha and beta give ({conversion or 'as published'})")


def estimates(runs: pd.DataFrame, reading: LatentReading, *, zeros: bool) -> Values:
    """Estimates of a parameter from runs, in the reading's unit.

    Parameters
    ----------
    runs
        From :func:`read_latent_runs`.
    reading
        The conversion of alpha and beta.
    zeros
        Follow the publication's comparison: a failed run, an alpha that gives no length and (for readings with
        ``floor_zero``) a negative value become 0. Otherwise a failed run is NaN and values are unchanged.
    """
    values = np.array(reading.convert(runs["alpha"].to_numpy(), runs["beta"].to_numpy()), dtype=np.float64)
    if zeros:
        values[~np.isfinite(values)] = 0.0
        if reading.floor_zero:
            values = np.maximum(values, 0.0)
    return values


def n_failed(runs: pd.DataFrame) -> int:
    """Number of runs that failed."""
    return int((runs["status"] == FAILED).sum())
