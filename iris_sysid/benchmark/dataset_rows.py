"""Rows of a data set: measure and study every clip once, and keep each study on disk for the next run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from iris_sysid.benchmark.dataset import places
from iris_sysid.benchmark.groundtruth.clip import Conditions
from iris_sysid.benchmark.groundtruth.measure import Measurements, measure
from iris_sysid.benchmark.sources.rows import (
    SELECTION,
    SHARING,
    flat_rows,
    joined,
    read_rows,
    rows_text,
)
from iris_sysid.benchmark.studies.model_selection import selection_rows
from iris_sysid.benchmark.studies.sharing import sharing_rows
from iris_sysid.benchmark.studies.studies import STUDY_OF, ode_rows, studied
from iris_sysid.benchmark.studies.subjects import Subject, subjects_of
from iris_sysid.errors import DataError, IrisError
from iris_sysid.io.files import json_text, write_atomic
from iris_sysid.io.schemas.groundtruth import MeasuredDocument
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.parallel import Workers, run_parallel
from iris_sysid.types import Progress, with_progress

PER_CLIP = (
    *STUDY_OF,
    SELECTION,
)  # studies of a single clip; sharing takes a setting
ALL_STUDIES = (*PER_CLIP, SHARING)
Say = Callable[[str], None]


@dataclass(frozen=True, eq=False, slots=True)
class RowPlan:
    """How to measure and study a data set.

    ``name`` of the data set in the tables; ``studies`` of ``ALL_STUDIES`` in addition to the bank's own fit;
    ``studied``: at most this many clips of each setting, None for all.
    """

    name: str
    measured: MeasuredDocument = field(default_factory=MeasuredDocument)
    conditions: Conditions = field(default_factory=Conditions)
    studies: tuple[str, ...] = ALL_STUDIES
    studied: int | None = None
    workers: Workers = 0


@dataclass(frozen=True, eq=False, slots=True)
class DatasetRows:
    """Flat rows, one line per gap, and the sha256 of each clip by its path (None where it could not be read)."""

    rows: pd.DataFrame
    gaps: tuple[str, ...]
    clips: Mapping[str, object]


@dataclass(frozen=True, eq=False, slots=True)
class Unit:
    """One study of one clip, the unit of parallel work, and the place of the file of its rows."""

    subject: Subject
    study: str
    place: str


def dataset_rows(
    dataset: str | Path,
    work: str | Path,
    plan: RowPlan,
    *,
    progress: Progress | None = None,
    tell: Say | None = None,
) -> DatasetRows:
    """Measure a data set, study its clips, and return their flat rows.

    A clip whose file, measurement and package versions are unchanged is neither measured nor studied again.

    Parameters
    ----------
    dataset
        ``<Class>/<setting>/<clip>.mp4``; nothing is written there.
    work
        Folder of the measurements and of the rows of each study.
    plan
        Name, studies and number of clips.
    progress
        Called with (steps done, total number of steps), first for the clips and then for their studies.
    tell
        Called with one line per clip that failed.

    Raises
    ------
    DataError
        When the folder is not a data set, or a study is unknown.
    OutputError
        When a file in ``work`` cannot be written.
    """
    unknown = [name for name in plan.studies if name not in ALL_STUDIES]
    if unknown:
        raise DataError(f"there is no study {unknown[0]!r}; there are {', '.join(ALL_STUDIES)}")
    measured: Measurements = measure(
        dataset,
        work,
        measured=plan.measured,
        conditions=plan.conditions,
        workers=plan.workers,
        progress=progress,
        tell=tell,
    )
    subjects = subjects_of(measured.clips, Path(dataset), plan.name)
    units = list(_units(subjects, plan))
    frames = [flat_rows(record for subject in subjects for record in ode_rows(subject))]
    studies, lost = _all_done(units, Path(work), plan.workers, progress)
    frames += studies
    if SHARING in plan.studies:
        frames.append(flat_rows(sharing_rows(subjects)))
    gaps = (*(f"{place}: {reason}" for place, reason in measured.gaps), *lost)
    clips = {clip.clip.place: clip.document.origin.get("sha256") for clip in measured.clips}
    return DatasetRows(joined(frames), gaps, clips)


def _units(subjects: Sequence[Subject], plan: RowPlan) -> Iterator[Unit]:
    """All units of work: the studies in the order of ``PER_CLIP``, each over the clips in order."""
    turns = places([subject.clip for subject in subjects])
    few = [
        subject for subject, turn in zip(subjects, turns, strict=True) if plan.studied is None or turn < plan.studied
    ]
    for study in (name for name in PER_CLIP if name in plan.studies):
        yield from (_unit(subject, study) for subject in few)


def _unit(subject: Subject, study: str) -> Unit:
    """The unit; a hash of the measurement (with versions and file hashes) and truth is part of its file name."""
    dependencies = {
        "measured": subject.measured.document.model_dump(mode="json"),
        "truth": {name: [true.value, true.source] for name, true in subject.truth.items()},
        "wanted": dict(subject.wanted),
        "dataset": subject.dataset,
    }
    key = hashlib.sha256(json_text(dependencies).encode()).hexdigest()[:12]
    place = f"{subject.clip.place}.{study.replace('+', '-')}.{key}.csv"
    return Unit(subject, study, place)


# --------------------------------------------------------------------------- running


def _all_done(
    units: Sequence[Unit], work: Path, workers: Workers, progress: Progress | None
) -> tuple[list[pd.DataFrame], list[str]]:
    """The rows of every unit, in the order of the units, and one line per unit whose process died.

    Rows of an earlier run are read from disk.
    """
    kept = {unit.place: _kept(work / unit.place) for unit in units}
    missing, lost = [unit for unit in units if kept[unit.place] is None], []
    batch = Batch(work, work_on, _lost)
    outcomes = run_parallel(batch, missing, workers)
    for unit, whole in with_progress(outcomes, progress, len(units), done=len(units) - len(missing)):
        kept[unit.place] = _kept(work / unit.place)
        if not whole:
            lost.append(f"{unit.subject.clip.place}: the process of study {unit.study} died; is there enough memory?")
    return [rows for rows in kept.values() if rows is not None], sorted(lost)


def _kept(path: Path) -> pd.DataFrame | None:
    """The complete rows of an earlier run; None when there are none."""
    if not path.is_file():
        return None
    if path.stat().st_size == 0:  # the study gives no rows for this clip
        return flat_rows([])
    try:
        return read_rows(path)
    except IrisError:
        return None


def _lost(folder: Path, unit: Unit) -> bool:
    """Write no file, so that the next run tries again."""
    return False


def work_on(folder: Path, unit: Unit) -> bool:
    """Run one study of one clip and write its rows, an empty file for no rows. True when the file is written."""
    subject = unit.subject
    records = selection_rows(subject) if unit.study == SELECTION else studied(subject, unit.study)
    write_atomic(folder / unit.place, rows_text(flat_rows(records)) if records else "", overwrite=True)
    return True
