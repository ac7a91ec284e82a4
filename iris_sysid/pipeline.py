"""The whole chain on one clip: each step is one public function, and any box can be entered from disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from fitters.ode import fit
from iris_sysid.calibration.pixel_scale import MARK_SIGMA_PX, to_world, uncalibrated
from iris_sysid.calibration.plane import check_image_size
from iris_sysid.cli._parsing import units_of
from iris_sysid.errors import CalibrationError, DataError, UnknownNameError
from iris_sysid.io.csv_write import write_track, write_trajectory
from iris_sysid.io.files import check_writable, origin_of
from iris_sysid.io.json_documents import write_fit
from iris_sysid.registry import MODELS, PHENOMENA, TRACKERS
from iris_sysid.report.clip_page import write_report
from iris_sysid.trajectory import systematic_errors
from iris_sysid.trajectory.observables import measured, segmented
from iris_sysid.trajectory.smoothing import smooth
from iris_sysid.trajectory.vertical_and_scale import gravity_calibration, upright, vertical_said
from iris_sysid.types import (
    Array,
    Calibration,
    Estimate,
    FitResult,
    FrameSource,
    Phenomenon,
    Track,
    TrackOptions,
    Trajectory,
)
from iris_sysid.video.reader import open_video

FILES = ("track.csv", "trajectory.csv", "fit.json", "track.png", "fit.png", "report.html")
PASSES = 4  # of geometry and fit; each takes the error down by about theta_0^2 / 4


@dataclass(frozen=True, eq=False, slots=True)
class Run:
    """Everything that one clip gave, from the track to the fit; :func:`iris_sysid.write_report` draws it."""

    source: Path
    video: FrameSource
    phenomenon: Phenomenon
    calibration: Calibration
    tracks: list[Track]
    world: list[Trajectory]
    trajectory: Trajectory
    fit: FitResult
    notes: tuple[str, ...] = field(default=())


def track(video: FrameSource, tracker: str = "median-background", options: TrackOptions | None = None) -> list[Track]:
    """Follow the bodies of a clip with the tracker of that name.

    Parameters
    ----------
    video
        Frames with their times, from :func:`iris_sysid.open_video`.
    tracker
        Registered name; ``iris-sysid list`` shows them.
    options
        Region, colour, number of bodies, progress.

    Returns
    -------
    list of Track
        One a body, in px and s; a frame without the body is NaN and not valid.

    Raises
    ------
    UnknownNameError
        When no tracker has that name.
    TrackingError
        When nothing moves, or nothing that moves can be followed.
    """
    return TRACKERS[tracker].track(video, options or TrackOptions())


def from_source(tracks: Sequence[Track], source: str | Path, options: Mapping[str, Any]) -> list[Track]:
    """The tracks with the file they come from, its sha256, the options and the versions of packages as their origin."""
    origin = origin_of(Path(source), options)
    return [replace(one, origin={**one.origin, **origin}) for one in tracks]


def _numbers(estimates: Mapping[str, Estimate]) -> dict[str, dict[str, float | str]]:
    return {name: {"value": one.value, "stderr": one.stderr, "unit": one.unit} for name, one in estimates.items()}


def accepted_settings(phenomenon: Phenomenon) -> dict[str, str]:
    """The names of what a user may state for a phenomenon, each with its unit (empty: that of the positions)."""
    units = units_of(MODELS[phenomenon.model])
    return units | {name: "" for name in phenomenon.settings if name not in units}


def _check_request(
    phenomenon: Phenomenon,
    settings: Mapping[str, Estimate],
    free: Sequence[str],
    marks_px: Mapping[str, tuple[float, float]],
    scale_from_gravity: Estimate | None,
) -> None:
    """Refuse, before any frame is read, what this phenomenon cannot use."""
    names = accepted_settings(phenomenon)
    for name in (*settings, *free):
        if name not in names or (name in free and name in phenomenon.settings):
            raise UnknownNameError(f"{phenomenon.name} has nothing named {name!r}; it has {', '.join(names)}")
    both = sorted(set(settings) & set(free))
    if both:
        raise DataError(f"{', '.join(both)} cannot be both set and free")
    for name in marks_px:
        if not {f"{name}_x", f"{name}_z"} & names.keys():
            raise UnknownNameError(f"{phenomenon.name} has no use for the mark {name!r}")
    if scale_from_gravity is not None and (phenomenon.motion, phenomenon.measures) != ("flight", "position"):
        raise CalibrationError(f"gravity gives the scale of a free flight only, not of {phenomenon.name}")


def observe(
    tracks: Sequence[Track],
    calibration: Calibration,
    phenomenon: str,
    settings: Mapping[str, Estimate] | None = None,
    *,
    marks_px: Mapping[str, tuple[float, float]] | None = None,
    clock_stderr: float = 0.0,
) -> tuple[list[Trajectory], Trajectory]:
    """Turn tracks into the trajectory that the phenomenon's model observes, segmented and smoothed.

    Parameters
    ----------
    tracks
        One a body, in px.
    calibration
        Pixels to metres; :func:`iris_sysid.uncalibrated` where no scale is known.
    phenomenon
        Registered name, e.g. ``pendulum``.
    settings
        What is known beforehand, by name, e.g. ``ball_radius`` or ``pivot_x`` (world units).
    marks_px
        Points marked in the picture, (x, y) px by name.
    clock_stderr
        Relative standard error of the frame rate.

    Returns
    -------
    world : list of Trajectory
        x and z of each body, with segments.
    trajectory : Trajectory
        The observable, e.g. theta in rad, with segments, geometry and the smoothed state; ``systematic`` holds what the
        errors of calibration and clock do to all its samples alike.
    """
    chosen = PHENOMENA[phenomenon]
    if len(tracks) < chosen.bodies:
        raise DataError(f"{phenomenon} needs {chosen.bodies} bodies, but {len(tracks)} were tracked; see --bodies")
    world = [segmented(one, calibration, chosen) for one in tracks]

    def known(by: Calibration) -> dict[str, Estimate]:
        return {**(settings or {}), **_marks_in_world(marks_px or {}, tracks[0], by)}

    def positions(by: Calibration) -> Array:
        again = [
            measured(one, by, chosen).with_(segments=first.segments, valid=first.valid)
            for one, first in zip(tracks, world, strict=True)
        ]
        return chosen.observe(again, known(by)).position

    trajectory = smooth(chosen.observe(world, known(calibration)))
    seen_px = np.concatenate(
        [one.xy_px[one.valid] for one in tracks] + [[point] for point in (marks_px or {}).values()]
    )
    shared = {
        **systematic_errors.from_calibration(trajectory, positions, calibration, seen_px),
        **systematic_errors.from_edge(trajectory, chosen),
        **systematic_errors.from_axis(trajectory, chosen),
        **systematic_errors.from_pivots(trajectory),
        **systematic_errors.from_clock(trajectory, clock_stderr),
    }
    return world, trajectory.with_(systematic=shared)


def run(
    source: str | Path,
    phenomenon: str,
    *,
    calibration: Calibration | None = None,
    fps: float | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    keep_partial: bool = False,
    tracker: str | None = None,
    options: TrackOptions | None = None,
    settings: Mapping[str, Estimate] | None = None,
    free: Sequence[str] = (),
    marks_px: Mapping[str, tuple[float, float]] | None = None,
    scale_from_gravity: Estimate | None = None,
    plumb_px: tuple[float, float, float, float] | None = None,
    vertical: Literal["assumed", "motion"] = "assumed",
    clock_stderr: float = 0.0,
    progress: Callable[[int, int], None] | None = None,
) -> Run:
    """Run the chain on one clip: track, calibrate, segment, observe, smooth, fit.

    Parameters
    ----------
    source
        Video, image sequence, or ``.trz``/``.zip`` with one in it.
    phenomenon
        Registered name, e.g. ``pendulum``.
    calibration
        Pixels to metres; none gives results in px where a length is measured.
    fps
        True frame rate in 1/s, where the container's is that of the slow-motion playback.
    start_s, stop_s
        Part of the clip to read, in s.
    keep_partial
        Use what could be read of a damaged file.
    tracker
        Registered name; the phenomenon's own when not given.
    options
        Region, colour, number of bodies.
    settings
        Known values by name: constants of the model (``gravity``) and of the scene (``ball_radius``).
    free
        Constants of the model to estimate as well, e.g. ``("gravity",)``.
    marks_px
        Points marked in the picture, (x, y) px by name: ``pivot`` of a pendulum, ``launch`` of a throw.
    scale_from_gravity
        Known gravity in m/s^2 from which the scale is computed, for motion under gravity alone.
    plumb_px
        Two points x1, y1, x2, y2 of a plumb line, upper end first: gravity's direction.
    vertical
        ``motion`` takes gravity's direction from the flight; ``assumed`` as the calibration has it.
    clock_stderr
        Relative standard error of the frame rate, common to all times.
    progress
        Called with (frames done, frames expected).

    Returns
    -------
    Run
        Every box on the way. A fit that failed has a status and the remedy; it does not raise.
    """
    chosen = PHENOMENA[phenomenon]
    known = dict(settings or {})
    algorithm = TRACKERS[tracker or chosen.tracker].name
    _check_request(chosen, known, free, marks_px or {}, scale_from_gravity)
    video = open_video(source, fps=fps, start_s=start_s, stop_s=stop_s, keep_partial=keep_partial)
    if calibration is not None:
        check_image_size(calibration.image_size, (video.width, video.height))
    wanted = replace(options or TrackOptions(bodies=chosen.bodies), progress=progress)
    asked = {
        "phenomenon": phenomenon,
        "tracker": algorithm,
        "fps": fps,
        "start_s": start_s,
        "stop_s": stop_s,
        "keep_partial": keep_partial,
        "settings": _numbers(known),
        "scale_from_gravity": None if scale_from_gravity is None else scale_from_gravity.value,
        "free": list(free),
        "marks_px": dict(marks_px or {}),
        "plumb_px": plumb_px,
        "vertical": vertical,
        "clock_stderr": clock_stderr,
    }
    tracks = from_source(track(video, algorithm, wanted), source, asked)
    if scale_from_gravity is not None:
        calibration = gravity_calibration(tracks[0], chosen, scale_from_gravity)
        known["gravity"] = scale_from_gravity
        free = [*free, "magnification"]
    calibration = upright(calibration or uncalibrated(), tracks[0], chosen, plumb_px, vertical)
    world, trajectory, result = observe_and_fit(
        tracks, calibration, chosen, known, free, marks_px=marks_px, clock_stderr=clock_stderr
    )
    return Run(
        source=Path(source),
        video=video,
        phenomenon=chosen,
        calibration=calibration,
        tracks=tracks,
        world=world,
        trajectory=trajectory,
        fit=result,
        notes=tuple(filter(None, [getattr(video, "warning", ""), *calibration.notes, vertical_said(calibration)])),
    )


def observe_and_fit(
    tracks: Sequence[Track],
    calibration: Calibration,
    phenomenon: Phenomenon,
    settings: Mapping[str, Estimate],
    free: Sequence[str] = (),
    *,
    marks_px: Mapping[str, tuple[float, float]] | None = None,
    clock_stderr: float = 0.0,
) -> tuple[list[Trajectory], Trajectory, FitResult]:
    """Observe and fit, again where the fit knows part of the geometry better than the picture does.

    Parameters
    ----------
    tracks
        One a body, in px.
    calibration
        Pixels to metres.
    phenomenon
        How to observe, and what to fit.
    settings
        What is known beforehand, by name.
    free
        Constants of the model to estimate as well.
    marks_px, clock_stderr
        As for :func:`observe`.

    Returns
    -------
    world : list of Trajectory
        x and z of each body.
    trajectory : Trajectory
        The observable.
    fit : FitResult
        The model fitted to it.
    """
    model, known = MODELS[phenomenon.model], dict(settings)
    names = {parameter.name for parameter in model.parameters}
    for _ in range(PASSES):
        world, trajectory = observe(
            tracks, calibration, phenomenon.name, known, marks_px=marks_px, clock_stderr=clock_stderr
        )
        stated = {**known, **_marks_in_world(marks_px or {}, tracks[0], calibration)}
        fixed = {name: value for name, value in stated.items() if name in names}
        wanted = [name for name in dict.fromkeys((*phenomenon.free, *free)) if name not in fixed]
        result = fit(trajectory, model, fixed=fixed, free=wanted)
        better = phenomenon.refine(result, trajectory) if phenomenon.refine is not None else {}
        if all(_settled(known.get(name), value) for name, value in better.items()):
            break
        known.update(better)
    return world, trajectory, result


def _settled(before: Estimate | None, now: Estimate) -> bool:
    return before is not None and abs(now.value - before.value) < 0.1 * now.stderr


def check_folder(folder: str | Path, *, overwrite: bool = False) -> Path:
    """Raise OutputError when :func:`save` could not write into the folder: to be asked before the work is done."""
    for name in FILES:
        check_writable(Path(folder) / name, overwrite=overwrite)
    return Path(folder)


def save(result: Run, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write the track, the trajectory, the fit and the report of one clip into a folder.

    Parameters
    ----------
    result
        What :func:`run` returned.
    folder
        Made when it does not exist.
    overwrite
        Replace the files of an earlier run.

    Returns
    -------
    Path
        The page ``report.html``, written last.

    Raises
    ------
    OutputError
        When one of the files exists, before any is written.
    """
    folder = check_folder(folder, overwrite=overwrite)
    write_track(result.tracks, folder / "track.csv", overwrite=overwrite)
    write_trajectory(result.trajectory, folder / "trajectory.csv", overwrite=overwrite)
    write_fit(result.fit, result.trajectory, folder / "fit.json", overwrite=overwrite)
    return write_report(result, folder, overwrite=overwrite)


def _marks_in_world(
    marks_px: Mapping[str, tuple[float, float]], body: Track, calibration: Calibration
) -> dict[str, Estimate]:
    """Marked points as the settings ``<name>_x`` and ``<name>_z``."""
    found = [_mark_in_world(name, point, body, calibration) for name, point in marks_px.items()]
    return {name: value for one in found for name, value in one.items()}


def _mark_in_world(
    name: str, point_px: tuple[float, float], body: Track, calibration: Calibration
) -> dict[str, Estimate]:
    """A marked point as the settings ``<name>_x`` and ``<name>_z``."""
    marked = Track(
        t_s=body.t_s[:1],
        xy_px=np.array([point_px]),
        sigma_px=np.full((1, 2), MARK_SIGMA_PX),
        valid=np.ones(1, dtype=np.bool_),
        frame=body.frame[:1],
    )
    world = to_world(marked, calibration)
    source = f"marked at {point_px[0]:g}, {point_px[1]:g} px"
    return {
        f"{name}_{axis}": Estimate(float(world.position[0, k]), float(world.sigma[0, k]), unit, "direct", source)
        for k, (axis, unit) in enumerate((("x", calibration.unit), ("z", calibration.unit)))
    }
