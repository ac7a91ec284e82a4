"""Measure every clip of a data set once: track, calibrate, fit, and keep the results on disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from iris_sysid.benchmark.dataset import BOARD, Clip, Listing, list_clips, places
from iris_sysid.benchmark.groundtruth.boards import (
    NAME,
    BoardJob,
    board_of,
    calibrate_board,
    scale_class,
)
from iris_sysid.benchmark.groundtruth.clip import KNOWN, ClipJob, Conditions, measure_clip, record_failure
from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.errors import DataError, IrisError, OutputError
from iris_sysid.io.csv_read import read_track, read_trajectory
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas.groundtruth import ClipDocument, MeasuredDocument
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.parallel import Workers, check_workers, run_parallel
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import Calibration, Progress, Track, Trajectory, with_progress

NOT_BY_BOARD = ("angle", "intensity")  # observables that need no scale
IS_IT = "is the file damaged, or memory full?"


@dataclass(frozen=True, eq=False, slots=True)
class ClipMeasurement:
    """The measurement of one clip of a data set, as kept on disk.

    ``clip`` identifies it (class, setting, name, path, phenomenon); ``document`` holds status, message, estimates with
    their budgets, geometry, noise and origin (source, sha256, options, versions). A clip that could not be tracked
    or fitted has the status ``failed`` and a message with the reason, but no estimates.
    """

    clip: Clip
    document: ClipDocument
    folder: Path

    def trajectory(self) -> Trajectory | None:
        """The fitted observable, read from disk; None for a clip that failed."""
        name = self.document.trajectory
        return None if name is None else read_trajectory(self.folder / name)

    def tracks(self) -> list[Track]:
        """The tracks in px, read from disk; empty for a clip that could not be tracked."""
        name = self.document.track
        return [] if name is None else read_track(self.folder / name)

    def calibration(self) -> Calibration:
        """The calibration of its class; the identity in px where the class has none."""
        path = self.folder.parent / NAME
        return read_calibration(path) if path.is_file() else uncalibrated()


@dataclass(frozen=True, eq=False, slots=True)
class Measurements:
    """All clips in the order of their names, the gaps of the data set, and the number of clips measured now."""

    clips: tuple[ClipMeasurement, ...]
    gaps: tuple[tuple[str, str], ...]
    now: int


def measure(
    dataset: str | Path,
    folder: str | Path,
    *,
    measured: MeasuredDocument | None = None,
    conditions: Conditions | None = None,
    workers: Workers = 0,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
) -> Measurements:
    """Track, calibrate and fit every clip of a data set, and write the results to a folder of the same structure.

    Per clip there are ``<Class>/<setting>/<clip>.json`` (a ``clip`` document, written last), ``<clip>.track.csv`` and
    ``<clip>.trajectory.csv``, and per class ``calibration.json`` from its ``checkerboard.mp4``. A clip whose file (by
    sha256), options, calibration and package versions are unchanged is not measured again, also after an interrupted
    run; a track is kept when only calibration or known values changed. The same input gives the same bytes.

    Parameters
    ----------
    dataset
        ``<Class>/<setting>/<clip>.mp4``; nothing is written there.
    folder
        Of the measurements; made when missing. One run at a time.
    measured
        Direct measurements: boards, gravity and the ball's radius are used; all other values are not, because the
        clips are compared with them.
    conditions
        Of the recording.
    workers
        Number of parallel processes, 0 for this one, or the address or file of a dask scheduler, whose workers find the
        clips and this folder under the same paths.
    progress
        Called with (clips done, total number of clips).
    tell
        Called with one line per clip that failed.

    Returns
    -------
    Measurements
        One per clip, failed clips included.

    Raises
    ------
    DataError
        When the folder is not a data set, or a number is out of range.
    OutputError
        When the measurements cannot be written.
    """
    conditions, measured, tell = conditions or Conditions(), measured or MeasuredDocument(), tell or _silent
    check_workers(workers)
    # absolute: each worker runs in its own folder
    listing, root = list_clips(Path(dataset).absolute()), Path(folder).absolute()
    gaps = {gap.place: gap.reason for gap in listing.gaps}
    chosen = [
        clip for clip in _chosen(listing.clips, conditions.trials) if conditions.phenomenon in (None, clip.phenomenon)
    ]
    calibrated = _calibrated(listing, root, measured, chosen, gaps, workers)
    jobs = [_job(clip, root, measured, conditions, clip.class_name in calibrated) for clip in chosen]
    # the first clip of every setting, then the second of every one: a run that ends early has some of each
    turns = zip(places(chosen), jobs, strict=True)
    in_turn = [job for _, job in sorted(turns, key=lambda pair: pair[0])]
    now, outcomes = 0, run_parallel(Batch(root, _measured, _lost), in_turn, workers)
    for job, (measured_now, reason) in with_progress(outcomes, progress, len(jobs)):
        now += measured_now
        if reason and measured_now:
            tell(f"{job.clip.place}: {reason}")
    return Measurements(tuple(_read(job, gaps) for job in jobs), tuple(sorted(gaps.items())), now)


def _silent(text: str) -> None:
    """Discard the text."""


def _chosen(clips: Sequence[Clip], trials: int | None) -> list[Clip]:
    """The first ``trials`` clips of each setting; all where it is None."""
    if trials is not None and trials < 1:
        raise DataError(f"trials must be at least 1, not {trials}")
    return [clip for clip, turn in zip(clips, places(clips), strict=True) if trials is None or turn < trials]


def _calibrated(
    listing: Listing,
    root: Path,
    measured: MeasuredDocument,
    clips: Sequence[Clip],
    gaps: dict[str, str],
    workers: Workers,
) -> set[str]:
    """Calibrate each class that needs a scale, and name those that have one; another becomes a gap with the reason."""
    calibrated, jobs = set(), []
    for name, phenomenon in dict.fromkeys((clip.class_name, clip.phenomenon) for clip in clips):
        if PHENOMENA[phenomenon].measures in NOT_BY_BOARD:
            continue
        board_place, scale = f"{name}/{BOARD}", measured.scale(name)
        if name not in listing.boards and scale is None:
            gaps[board_place] = "no clip of a checkerboard: lengths stay in px"
            continue
        try:
            if name in listing.boards:
                jobs.append(BoardJob(name, listing.boards[name], board_of(listing.boards[name], name, measured)))
            elif scale is not None:
                scale_class(scale, root / name)
                calibrated.add(name)
        except OutputError:
            raise
        except IrisError as error:
            gaps[board_place] = _no_scale(str(error), listing)
    batch = Batch(root, calibrate_board, _lost_board)
    for job, reason in run_parallel(batch, jobs, workers):
        if reason:
            gaps[f"{job.class_name}/{BOARD}"] = _no_scale(reason, listing)
        else:
            calibrated.add(job.class_name)
    return calibrated


def _no_scale(reason: str, listing: Listing) -> str:
    return f"lengths stay in px: {reason.replace(str(listing.folder), listing.folder.name)}"


def _job(clip: Clip, root: Path, measured: MeasuredDocument, conditions: Conditions, calibrated: bool) -> ClipJob:
    known = {name: value for name, value in measured.values_of(clip.class_name, clip.setting).items() if name in KNOWN}
    return ClipJob(clip, root, calibrated, known, conditions)


def _measured(folder: Path, job: ClipJob) -> tuple[bool, str]:
    return measure_clip(job)


def _lost(folder: Path, job: ClipJob) -> tuple[bool, str]:
    """The outcome of a clip whose process died."""
    return True, record_failure(job, f"the process that read it died; {IS_IT}")


def _lost_board(folder: Path, job: BoardJob) -> str:
    """The reason why a class whose process died has no scale."""
    return f"the process that read {job.path.name} died; {IS_IT}"


def _read(job: ClipJob, gaps: dict[str, str]) -> ClipMeasurement:
    document = read_document(job.path(".json"), ClipDocument)
    if document.status == "failed":
        gaps[job.clip.place] = f"failed: {document.message}"
    return ClipMeasurement(job.clip, document, job.path(".json").parent)
