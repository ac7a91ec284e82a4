"""Robustness: degrade the pixels of a clip, then track, calibrate and fit it again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from iris_sysid.benchmark.groundtruth.clip import known_to_fit
from iris_sysid.benchmark.sources.rows import FAILED, ROBUSTNESS
from iris_sysid.benchmark.studies.degraded_clips import CHANGES, as_in, changed
from iris_sysid.benchmark.studies.studies import ODE, why
from iris_sysid.benchmark.studies.subjects import Subject
from iris_sysid.io.schemas.groundtruth import MeasuredDocument
from iris_sysid.pipeline import observe_and_fit, track
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import FitResult, TrackOptions
from iris_sysid.video.reader import open_video


def robustness_rows(
    subject: Subject, measured: MeasuredDocument, conditions: Sequence[str] = tuple(CHANGES), seed: int = 0
) -> list[dict[str, Any]]:
    """The parameters of a clip after each change; a change after which the fit fails gives failed rows with the reason.

    Parameters
    ----------
    subject
        The clip as it was measured.
    measured
        The direct measurements that the measurement of the clip used.
    conditions
        Keys of ``CHANGES``.
    seed
        Of noise and dropped frames.
    """
    rows = []
    for condition in conditions:
        study = {"study": ROBUSTNESS, "method": ODE, "condition": condition, "seed": seed}
        try:
            result = _refitted(subject, measured, condition, seed)
        except Exception as error:  # one change must not end the run of all
            rows += subject.records({}, FAILED, answer=why(error), **study)
            continue
        rows += subject.records(result.estimates, result.status, **study)
    return rows


def _refitted(subject: Subject, measured: MeasuredDocument, condition: str, seed: int) -> FitResult:
    phenomenon, clip = PHENOMENA[subject.clip.phenomenon], subject.clip
    original = open_video(clip.path)
    with changed(clip.path, CHANGES[condition], seed) as video:
        tracks = track(video, phenomenon.tracker, TrackOptions(bodies=phenomenon.bodies))
        tracks = as_in(video, tracks, (original.width, original.height))
    calibration = subject.measured.calibration()
    settings, free = known_to_fit(phenomenon, measured.values_of(clip.class_name, clip.setting), calibration)
    return observe_and_fit(tracks, calibration, phenomenon, settings, free)[2]
