"""Fit several clips with shared parameters and one by one, to measure the gain of a shared value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from fitters.ode.several_clips import fit_clips
from iris_sysid.benchmark.sources.rows import FAILED, OK, SHARING
from iris_sysid.benchmark.studies.studies import why
from iris_sysid.benchmark.studies.subjects import Subject
from iris_sysid.types import Estimate

PER_CLIP_METHOD, MEAN, SHARED = "clip by clip", "mean over clips", "one shared value"
MIN_CLIPS = 2  # clips


def sharing_rows(subjects: Sequence[Subject]) -> Iterator[dict[str, Any]]:
    """For every setting with two clips or more: each clip's value, their mean, and one value shared by all.

    Only parameters whose truth is the same in all clips of a setting can be shared; the others differ by design.
    """
    settings: dict[tuple[str, str], list[Subject]] = {}
    for subject in subjects:
        if subject.measured.document.usable:
            settings.setdefault((subject.clip.class_name, subject.clip.setting), []).append(subject)
    for clips in settings.values():
        common = _common(clips)
        if len(clips) >= MIN_CLIPS and common:
            yield from _of_setting(clips, common)


def _common(clips: Sequence[Subject]) -> list[str]:
    """Free parameters of the model that have the same known truth in all clips."""
    names = [parameter.name for parameter in clips[0].model.parameters]
    return [
        name
        for name in clips[0].wanted
        if name in names
        and all(name in clip.measured.document.free and name in clip.truth for clip in clips)
        and len({clip.truth[name].value for clip in clips}) == 1
    ]


def _of_setting(clips: Sequence[Subject], common: Sequence[str]) -> Iterator[dict[str, Any]]:
    for clip in clips:
        yield from _rows(clip, common, clip.measured.document.estimates(), PER_CLIP_METHOD)
    values = {name: [clip.measured.document.estimates()[name] for clip in clips] for name in common}
    units = {name: estimates[0].unit for name, estimates in values.items()}
    means = {
        name: Estimate(math.fsum(estimate.value for estimate in estimates) / len(estimates), math.nan, units[name])
        for name, estimates in values.items()
    }
    yield from (row | {"clip": "all"} for row in _rows(clips[0], common, means, MEAN))
    known, free = clips[0].known_and_free()
    per_clip = [name for name in free if name not in common]
    try:
        trajectories = [clip.trajectory() for clip in clips]
        pooled = fit_clips(trajectories, clips[0].model, shared=common, fixed=known, free=per_clip)
        shared, failure = dict(pooled.shared), {}
    except Exception as error:  # one setting must not end the run of all
        shared, failure = {}, {"answer": why(error)}
    yield from (row | {"clip": "all"} | failure for row in _rows(clips[0], common, shared, SHARED))


def _rows(
    subject: Subject, common: Sequence[str], estimates: dict[str, Estimate], method: str
) -> Iterator[dict[str, Any]]:
    status = OK if estimates else FAILED
    for row in subject.records(estimates, status, study=SHARING, method=method):
        if row["parameter"] in common:
            yield row
