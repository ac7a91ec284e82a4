"""Measure every clip of a data set once: track, calibrate, fit, and keep the results on disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from iris_sysid.benchmark.dataset import BOARD, Clip, Listing, list_clips, places
from iris_sysid.benchmark.groundtruth.boards import NAME, board_of, calibrate_class, scale_class
from iris_sysid.benchmark.groundtruth.clip import KNOWN, Job, measure_clip, record_failure
from iris_sysid.benchmark.parallel import check_workers, side_by_side
from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.errors import DataError, IrisError, OutputError
from iris_sysid.io.csv_read import read_track, read_trajectory
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas.groundtruth import ClipDocument, MeasuredDocument
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import Calibration, Progress, Track, Trajectory, with_progress

NOT_BY_BOARD = ("angle", "intensity")  # what a phenomenon measures without any scale


@dataclass(frozen=True, eq=False, slots=True)
class ClipMeasurement:
    """The measurement of one clip of a data set, as kept on disk.

    ``clip`` says which (class, setting, name, path, phenomenon); ``document`` holds status, message, estimates with
    their budgets, geometry, noise and origin (source, sha256, options, versions). A clip that could not be tracked
    or fitted has the status ``failed`` and says why; nothing else in it is then set.
    """

    clip: Clip
    document: ClipDocument
    folder: Path

    def trajectory(self) -> Trajectory | None:
        """The observable that was fitted, read back; None for a clip that failed."""
        name = self.document.trajectory
        return None if name is None else read_trajectory(self.folder / name)

    def tracks(self) -> list[Track]:
        """The bodies in px, read back; empty for a clip that could not be tracked."""
        name = self.document.track
        return [] if name is None else read_track(self.folder / name)

    def calibration(self) -> Calibration:
        """That of its class by the board; without a board, pixels as they are."""
        path = self.folder.parent / NAME
        return read_calibration(path) if path.is_file() else uncalibrated()


@dataclass(frozen=True, slots=True)
class Conditions:
    """What holds for every clip: the true frame rate, its relative error, and whether damaged files are used in part.

    ``trials``: only so many clips of each setting, in the order of their names; None for all. ``phenomenon``: only
    its clips; None for all.
    """

    fps: float | None = None
    clock_stderr: float = 0.0
    keep_partial: bool = False
    trials: int | None = None
    phenomenon: str | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Measurements:
    """All clips in the order of their names, what the data set lacks, and how many clips were measured now."""

    clips: tuple[ClipMeasurement, ...]
    gaps: tuple[tuple[str, str], ...]
    now: int


def measure(
    dataset: str | Path,
    folder: str | Path,
    *,
    measured: MeasuredDocument | None = None,
    conditions: Conditions | None = None,
    workers: int = 1,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
) -> Measurements:
    """Track, calibrate and fit every clip of a data set, and keep what each gave in a folder of the same shape.

    Per clip there are ``<Class>/<setting>/<clip>.json`` (a ``clip`` document, written last), ``<clip>.track.csv`` and
    ``<clip>.trajectory.csv``, and per class ``calibration.json`` from its ``checkerboard.mp4``. A clip whose file (by
    sha256), options, calibration and package versions are as before is not measured again, also after an interrupted
    run; a track is kept when only calibration or known values changed. The same input gives the same bytes.

    Parameters
    ----------
    dataset
        ``<Class>/<setting>/<clip>.mp4``; nothing is written there.
    folder
        Of the measurements; made when missing. One run at a time.
    measured
        What was measured by hand: boards, gravity, and the ball's radius are used; the other values are what clips
        are to be compared with, and are not.
    conditions
        Of the recording.
    workers
        Processes side by side.
    progress
        Called with (clips done, clips in all).
    tell
        Called with a line about each class that has no scale, and each clip that failed.

    Returns
    -------
    Measurements
        One a clip, failed ones too.

    Raises
    ------
    DataError
        When the folder is no data set, or a number makes no sense.
    OutputError
        When the measurements cannot be written.
    """
    conditions, measured, tell = conditions or Conditions(), measured or MeasuredDocument(), tell or _silent
    check_workers(workers)
    listing, root = list_clips(dataset), Path(folder)
    gaps = {gap.place: gap.reason for gap in listing.gaps}
    chosen = [
        clip for clip in _chosen(listing.clips, conditions.trials) if conditions.phenomenon in (None, clip.phenomenon)
    ]
    calibrations = _calibrations(listing, root, measured, chosen, gaps)
    jobs = [_job(clip, root, measured, conditions, calibrations.get(clip.class_name)) for clip in chosen]
    now = 0
    outcomes = side_by_side(measure_clip, _in_turn(jobs), workers, _lost)
    for job, (fresh, why) in with_progress(outcomes, progress, len(jobs)):
        now += fresh
        if why and fresh:
            tell(f"{job.clip.place}: {why}")
    return Measurements(tuple(_read(job, gaps) for job in jobs), tuple(sorted(gaps.items())), now)


def _silent(text: str) -> None:
    """Say nothing of the text."""


def _chosen(clips: Sequence[Clip], trials: int | None) -> list[Clip]:
    """The first clips of each setting, all without a number."""
    if trials is not None and trials < 1:
        raise DataError(f"trials must be at least 1, not {trials}")
    return [clip for clip, place in zip(clips, places(clips), strict=True) if trials is None or place < trials]


def _in_turn(jobs: Sequence[Job]) -> list[Job]:
    """The first clip of every setting, then the second of every one: a run that ends early has some of each."""
    turns = places([job.clip for job in jobs])
    return [job for _, job in sorted(zip(turns, jobs, strict=True), key=lambda pair: pair[0])]


def _calibrations(
    listing: Listing, root: Path, measured: MeasuredDocument, clips: Sequence[Clip], gaps: dict[str, str]
) -> dict[str, Path]:
    """The calibration of each class that needs one; why there is none goes to the gaps."""
    calibrations = {}
    for name, phenomenon in dict.fromkeys((clip.class_name, clip.phenomenon) for clip in clips):
        if PHENOMENA[phenomenon].measures in NOT_BY_BOARD:
            continue
        board_place, scale = f"{name}/{BOARD}", measured.scale(name)
        if name not in listing.boards and scale is None:
            gaps[board_place] = "no clip of a checkerboard: lengths stay in px"
            continue
        try:
            if name in listing.boards:
                board = board_of(listing.boards[name], name, measured)
                calibrations[name] = calibrate_class(listing.boards[name], board, root / name)
            elif scale is not None:
                calibrations[name] = scale_class(scale, root / name)
        except OutputError:
            raise
        except IrisError as error:
            gaps[board_place] = f"lengths stay in px: {str(error).replace(str(listing.folder), listing.folder.name)}"
    return calibrations


def _job(clip: Clip, root: Path, measured: MeasuredDocument, conditions: Conditions, calibration: Path | None) -> Job:
    known = {name: one for name, one in measured.of(clip.class_name, clip.setting).items() if name in KNOWN}
    return Job(clip, root, calibration, known, conditions.fps, conditions.clock_stderr, conditions.keep_partial)


def _lost(job: Job) -> tuple[bool, str]:
    """What came of a clip whose process died."""
    return True, record_failure(job, "the process that read it died; is the file damaged, or memory short?")


def _read(job: Job, gaps: dict[str, str]) -> ClipMeasurement:
    document = read_document(job.path(".json"), ClipDocument)
    if document.status == "failed":
        gaps[job.clip.place] = f"failed: {document.message}"
    return ClipMeasurement(job.clip, document, job.path(".json").parent)
