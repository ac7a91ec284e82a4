"""One clip of a data set, from the video to its document; finished steps of an earlier run are kept."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from iris_sysid.benchmark.dataset import Clip
from iris_sysid.benchmark.groundtruth.boards import NAME
from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.calibration.plane import check_image_size
from iris_sysid.errors import IrisError, OutputError
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_track, write_trajectory
from iris_sysid.io.files import origin_of, sha256_of
from iris_sysid.io.json_documents import checked, entries_of, plain_origin, read_document, write_document
from iris_sysid.io.schemas.groundtruth import ClipDocument
from iris_sysid.pipeline.one_clip import accepted_settings, from_source, observe_and_fit, track
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.types import Calibration, Estimate, FitResult, Phenomenon, Track, TrackOptions, Trajectory, Transfer
from iris_sysid.video.reader import open_video

FOCAL = 9  # index of the focal lengths among the values of a calibration
RADIUS, GRAVITY, PROJECTED = "ball_radius", "gravity", "r0_f"
KNOWN = (GRAVITY, RADIUS, "h0")  # values that fits may use; all others are estimated


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions of every clip: true frame rate, its relative error, and whether damaged files are used in part.

    ``trials``: at most this many clips of each setting, in the order of their names; None for all. ``phenomenon``:
    only its clips; None for all. ``transfer``: the camera's curve from light to grey levels; None takes
    the files' tags.
    """

    fps: float | None = None
    clock_stderr: float = 0.0
    keep_partial: bool = False
    trials: int | None = None
    phenomenon: str | None = None
    transfer: Transfer | None = None


@dataclass(frozen=True, eq=False, slots=True)
class ClipJob:
    """One clip to measure, its known values, and the folder of its files.

    ``calibrated``: whether its class has a calibration.json in the folder.
    """

    clip: Clip
    folder: Path
    calibrated: bool
    known: Mapping[str, Estimate]
    conditions: Conditions

    def path(self, suffix: str) -> Path:
        """One of the clip's files."""
        return self.folder / f"{self.clip.place}{suffix}"

    @property
    def calibration(self) -> Path | None:
        """The calibration.json of its class; None without a scale."""
        return self.folder / self.clip.class_name / NAME if self.calibrated else None

    def options(self) -> dict[str, Any]:
        """The options that the track depends on."""
        phenomenon, transfer = PHENOMENA[self.clip.phenomenon], self.conditions.transfer
        return {
            "phenomenon": phenomenon.name,
            "tracker": phenomenon.tracker,
            "bodies": phenomenon.bodies,
            "fps": self.conditions.fps,
            "keep_partial": self.conditions.keep_partial,
            "transfer": None if transfer is None else [transfer.text, transfer.stderr],
        }


def measure_clip(job: ClipJob) -> tuple[bool, str]:
    """Measure one clip and write its files, unless they are up to date.

    Returns whether it was measured now, and the reason of a failure, else empty. OutputError when a file cannot be
    written.
    """
    origin: dict[str, Any] = {}
    try:
        origin = _origin(job)
        earlier = _earlier(job, origin)
        if earlier is not None:
            return False, earlier.message if earlier.status == "failed" else ""
        return True, _measured(job, origin)
    except OutputError:
        raise
    except IrisError as error:
        return True, _failed(job, origin, str(error))
    except Exception as error:  # one clip must not end the run of all
        return True, _failed(job, {}, f"unexpected {type(error).__name__}: {error}")  # no origin: the next run retries


def _origin(job: ClipJob) -> dict[str, Any]:
    known = {
        name: {"value": estimate.value, "stderr": estimate.stderr, "unit": estimate.unit}
        for name, estimate in job.known.items()
    }
    calibration = None if job.calibration is None else sha256_of(job.calibration)
    inputs = {"known": known, "calibration_sha256": calibration, "clock_stderr": job.conditions.clock_stderr}
    return plain_origin(origin_of(job.clip.path, {**job.options(), **inputs}))


def _earlier(job: ClipJob, origin: Mapping[str, Any]) -> ClipDocument | None:
    """The document of an earlier run with the same input, when all its files exist; else None."""
    try:
        document = read_document(job.path(".json"), ClipDocument)
    except IrisError:
        return None
    complete = all(
        (job.path(".json").parent / name).is_file() for name in (document.track, document.trajectory) if name
    )
    return document if complete and document.origin == origin else None


def _measured(job: ClipJob, origin: Mapping[str, Any]) -> str:
    phenomenon = PHENOMENA[job.clip.phenomenon]
    tracks = _tracks(job, origin)
    calibration = _calibration(job)
    settings, free = known_to_fit(phenomenon, job.known, calibration)
    try:
        _, trajectory, fit = observe_and_fit(
            tracks, calibration, phenomenon, settings, free, clock_stderr=job.conditions.clock_stderr
        )
    except IrisError as error:
        return _failed(job, origin, str(error), tracks)
    write_trajectory(trajectory.with_(origin=origin), job.path(".trajectory.csv"), overwrite=True)
    write_document(_document(job, origin, tracks, trajectory, fit), job.path(".json"), overwrite=True)
    return ""


def _tracks(job: ClipJob, origin: Mapping[str, Any]) -> list[Track]:
    """The tracks of the clip: from an earlier run on the same file with the same options, else made now."""
    expected = {**origin, "options": plain_origin(origin_of(None, job.options()))["options"]}
    path = job.path(".track.csv")
    try:
        earlier = read_track(path)
        if all(body.origin.get(key) == value for body in earlier for key, value in expected.items()):
            return earlier
    except IrisError:
        pass  # missing or incomplete
    video = open_video(job.clip.path, fps=job.conditions.fps, keep_partial=job.conditions.keep_partial)
    options = TrackOptions(bodies=PHENOMENA[job.clip.phenomenon].bodies, transfer=job.conditions.transfer)
    tracks = track(video, PHENOMENA[job.clip.phenomenon].tracker, options)
    write_track(from_source(tracks, job.clip.path, job.options()), path, overwrite=True)
    return read_track(path)  # as stored, so that a new and a kept track give the same fit


def _calibration(job: ClipJob) -> Calibration:
    if job.calibration is None:
        return uncalibrated()
    calibration = read_calibration(job.calibration)
    video = open_video(job.clip.path, keep_partial=job.conditions.keep_partial)
    check_image_size(calibration.image_size, (video.width, video.height))
    return calibration


def known_to_fit(
    phenomenon: Phenomenon, known: Mapping[str, Estimate], calibration: Calibration
) -> tuple[dict[str, Estimate], list[str]]:
    """The ``known`` values that the fit of a clip uses, and what it estimates in addition.

    Only gravity, the ball's radius and its initial distance are used. A ball's radius times the focal length of a
    calibrated camera is the constant of its apparent size; with this constant the fall determines gravity.
    """
    estimated = {parameter.name for parameter in MODELS[phenomenon.model].parameters if not parameter.constant}
    accepted = accepted_settings(phenomenon)
    in_px = calibration.unit == "px" and any(quantity.unit == "m" for quantity in MODELS[phenomenon.model].observed)
    usable = () if in_px else KNOWN  # values in metres cannot be used for a motion in px
    settings = {name: known[name] for name in usable if name in known and name in accepted and name not in estimated}
    if PROJECTED not in accepted or RADIUS not in known or "camera" not in calibration.budget:
        return settings, []
    constant = _projected(known[RADIUS], calibration)
    return {name: value for name, value in settings.items() if name != GRAVITY} | {PROJECTED: constant}, [GRAVITY]


def _projected(radius: Estimate, calibration: Calibration) -> Estimate:
    """Radius times focal length, px m."""
    focal = float(np.mean(calibration.values[FOCAL : FOCAL + 2]))
    covariance = calibration.budget["camera"][FOCAL : FOCAL + 2, FOCAL : FOCAL + 2]
    relative_stderr = math.hypot(radius.stderr / radius.value, math.sqrt(float(np.mean(covariance))) / focal)
    source = f"ball of {radius.value:g} m ({radius.source}) by a camera of {focal:.6g} px"
    return Estimate(radius.value * focal, radius.value * focal * relative_stderr, "px m", "direct", source)


def _document(
    job: ClipJob, origin: Mapping[str, Any], tracks: Sequence[Track], trajectory: Trajectory, fit: FitResult
) -> ClipDocument:
    return checked(
        ClipDocument,
        **_head(job, tracks),
        status=fit.status,
        message=". ".join(filter(None, [*(doubt.text for doubt in fit.doubts), fit.message])),
        verdict=fit.verdict,
        parameters=entries_of(fit.estimates, fit.status),
        free=fit.free,
        budget=fit.budget,
        geometry=entries_of(trajectory.geometry),
        noise=fit.noise,
        rms=fit.rms,
        n=fit.n,
        trajectory=job.path(".trajectory.csv").name,
        origin=origin,
    )


def _head(job: ClipJob, tracks: Sequence[Track]) -> dict[str, Any]:
    model = MODELS[PHENOMENA[job.clip.phenomenon].model]
    return {
        "class_name": job.clip.class_name,
        "setting": job.clip.setting,
        "clip": job.clip.clip,
        "phenomenon": job.clip.phenomenon,
        "model": model.name,
        "equation": model.equation,
        "frames": len(tracks[0].t_s) if tracks else 0,
        "track": job.path(".track.csv").name if tracks else None,
    }


def _failed(job: ClipJob, origin: Mapping[str, Any], reason: str, tracks: Sequence[Track] = ()) -> str:
    """Write a document of a failed clip with the reason; returns the message."""
    message = reason.replace(str(job.clip.path), job.clip.path.name)  # the same on every machine
    document = checked(ClipDocument, **_head(job, tracks), status="failed", message=message, origin=origin)
    write_document(document, job.path(".json"), overwrite=True)
    return message


def record_failure(job: ClipJob, reason: str) -> str:
    """Write that a clip failed, without an origin, so that the next run tries again; returns the message."""
    return _failed(job, {}, f"unexpected end: {reason}")
