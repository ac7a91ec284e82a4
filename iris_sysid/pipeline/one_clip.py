"""The whole chain on one clip: each step is one public function, and every result on the way can be read from disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from iris_sysid.calibration.pixel_scale import MARK_SIGMA_PX, scale, scale_from_text, to_world, uncalibrated
from iris_sysid.calibration.plane import check_image_size
from iris_sysid.errors import CalibrationError, DataError, UnknownNameError
from iris_sysid.io.clip_place import CLIP_PLACE, write_clip_place
from iris_sysid.io.files import check_folder, origin_of
from iris_sysid.registry import MODELS, PHENOMENA, TRACKERS
from iris_sysid.types import (
    Array,
    Calibration,
    ClipOptions,
    Estimate,
    FitResult,
    FrameSource,
    GeometryOptions,
    Phenomenon,
    Run,
    Track,
    Tracker,
    TrackOptions,
    Trajectory,
)
from iris_sysid.video.reader import Video, open_video

FILES = (CLIP_PLACE, "track.csv", "trajectory.csv", "fit.json", "track.png", "fit.png", "report.html")
AUTO = "auto"  # the tracker that chooses another one, and binds tracks to marks
WHOLE_CLIP = ClipOptions()
NO_GEOMETRY = GeometryOptions()


@dataclass(frozen=True, eq=False, slots=True)
class RunRequest:
    """The options of a run of one clip; see :func:`run`. ``phenomenon`` is None until it is chosen."""

    phenomenon: Phenomenon | None = None
    _: KW_ONLY
    calibration: Calibration | None = None
    settings: Mapping[str, Estimate] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    tracking: TrackOptions = field(default_factory=TrackOptions)
    clip: ClipOptions = WHOLE_CLIP
    geometry: GeometryOptions = NO_GEOMETRY

    @property
    def chosen(self) -> Phenomenon:
        """The phenomenon; DataError where none was chosen."""
        if self.phenomenon is None:
            raise DataError("no phenomenon was chosen, so that nothing can be fitted")
        return self.phenomenon

    def values(self) -> dict[str, Any]:
        """The values by name, without those that a more special request adds."""
        return {item.name: getattr(self, item.name) for item in fields(RunRequest)}


# Fitting, smoothing, tables and reports are imported where they are used: tracking alone, and a request that is
# refused, must not wait for them.


def track(
    video: str | Path | FrameSource, tracker: str | Tracker = AUTO, options: TrackOptions | None = None
) -> list[Track]:
    """Follow the bodies of a clip with a tracker; ``auto`` chooses one.

    Parameters
    ----------
    video
        A clip's file, or frames with their times, from :func:`iris_sysid.open_video`.
    tracker
        Registered name, shown by ``iris-sysid list``, ``FILE.py:NAME``, or the tracker itself.
    options
        Region, colour, number of bodies, progress.

    Returns
    -------
    list of Track
        One per body, in px and s; a frame without the body is NaN and not valid. Where the camera moves, positions are
        in px of the first frame, and so are the options' region and every point marked in the image;
        ``camera_motion`` leads to the other frames.

    Raises
    ------
    UnknownNameError
        When no tracker has that name.
    TrackingError
        When nothing moves, or nothing that moves can be followed.
    VideoError
        When there are fewer than three frames.
    """
    from iris_sysid.video.camera_motion.reference import tracked
    from iris_sysid.video.camera_motion.steady import SAMPLES

    frames = open_video(video) if isinstance(video, str | Path) else video
    with ThreadPoolExecutor(1) as pool:  # frames are decoded while the tracker is imported; they are kept
        pool.submit(frames.sample, SAMPLES)
        chosen = TRACKERS.resolved(tracker)
    return tracked(frames, chosen, options or TrackOptions())


def from_source(
    tracks: Sequence[Track], source: str | Path, options: Mapping[str, Any], *, complete: bool = True
) -> list[Track]:
    """The tracks with the file they come from, its sha256, the options and the versions of packages as their origin.

    Parameters
    ----------
    tracks
        One per body.
    source
        The file.
    options
        The request, as it is to be recorded.
    complete
        False where the file says that a part of the clip is missing.
    """
    origin = {**origin_of(Path(source), options), "complete": complete}
    return [replace(body, origin={**body.origin, **origin}) for body in tracks]


def doubts_of(tracks: Sequence[Track]) -> list[str]:
    """The doubts about each track, with the option that helps, one line a doubt."""
    return [
        f"the track of body {body.body} is doubtful: {doubt.text}"
        for body in tracks
        if body.quality is not None
        for doubt in body.quality.doubts
    ]


def camera_note(tracks: Sequence[Track]) -> str:
    """What was done about the motion of the camera; empty where it stands still."""
    treated = [body.origin["camera_motion"] for body in tracks if "camera_motion" in body.origin]
    return f"the motion of the camera is {treated[0]}" if treated else ""


def accepted_settings(phenomenon: Phenomenon) -> dict[str, str]:
    """The names of what a user may state for a phenomenon, each with its unit (empty: that of the positions)."""
    units = MODELS.named(phenomenon.model).units()
    return units | {name: "" for name in phenomenon.settings if name not in units}


def observe(
    tracks: Sequence[Track],
    calibration: Calibration,
    phenomenon: str | Phenomenon,
    settings: Mapping[str, Estimate] | None = None,
    *,
    marks_px: Mapping[str, tuple[float, float]] | None = None,
    clock_stderr: float = 0.0,
    image_size: tuple[int, int] | None = None,
    world: Sequence[Trajectory] = (),
) -> tuple[list[Trajectory], Trajectory]:
    """Turn tracks into the trajectory that the phenomenon's model observes, segmented and smoothed.

    Parameters
    ----------
    tracks
        One per body, in px.
    calibration
        Pixels to metres; :func:`iris_sysid.uncalibrated` where no scale is known.
    phenomenon
        Registered name, e.g. ``pendulum``, ``FILE.py:NAME``, or the phenomenon itself.
    settings
        What is known beforehand, by name, e.g. ``ball_radius`` or ``pivot_x`` (world units).
    marks_px
        Points marked in the image, (x, y) px by name.
    clock_stderr
        Relative standard error of the frame rate.
    image_size
        Width and height of the video, px; that of the calibration where it is not given.
    world
        x and z of each body with their segments, from an earlier call with the same tracks and calibration.

    Returns
    -------
    world : list of Trajectory
        x and z of each body, with segments.
    trajectory : Trajectory
        The observable, e.g. theta in rad, with segments, geometry and the smoothed state; ``systematic`` holds the
        errors that calibration and clock cause in all its samples alike, ``view`` how it lies in the image.

    Raises
    ------
    DataError
        When fewer bodies were tracked than the phenomenon has, or nothing moves.
    """
    from iris_sysid.trajectory import systematic_errors
    from iris_sysid.trajectory.image_view import focal_ratio, image_view
    from iris_sysid.trajectory.observables import measured, observed, segmented
    from iris_sysid.trajectory.smoothing import smooth

    chosen, marks = PHENOMENA.resolved(phenomenon), marks_px or {}
    if len(tracks) < chosen.bodies:
        raise DataError(f"{chosen.name} needs {chosen.bodies} bodies, but {len(tracks)} were tracked; see --bodies")
    world = list(world) or [segmented(body, calibration, chosen) for body in tracks]

    def known(by: Calibration) -> dict[str, Estimate]:
        return {**(settings or {}), **_marks_in_world(marks, tracks[0], by)}

    def positions(by: Calibration) -> Array:
        again = [
            measured(body, by, chosen).with_(segments=first.segments, valid=first.valid)
            for body, first in zip(tracks, world, strict=True)
        ]
        return chosen.observe(again, known(by)).position

    trajectory = smooth(observed(chosen, world, known(calibration)))
    seen_px = np.concatenate([body.xy_px[body.valid] for body in tracks] + [[point] for point in marks.values()])
    shared = {
        **systematic_errors.from_calibration(trajectory, positions, calibration, seen_px),
        **systematic_errors.from_edge(trajectory, chosen),
        **systematic_errors.from_axis(trajectory, chosen),
        **systematic_errors.from_pivots(trajectory),
        **systematic_errors.from_brightness(tracks[0], chosen),
        **systematic_errors.from_surface(trajectory, tracks[0], chosen),
        **systematic_errors.from_clock(trajectory, clock_stderr),
    }
    view = image_view(trajectory, tracks[0], calibration, image_size) if chosen.bodies == 1 else None
    geometry = {**trajectory.geometry, **(focal_ratio(calibration) if view is not None else {})}
    doubts = tuple(dict.fromkeys(doubt for body in world for doubt in body.doubts))
    return world, trajectory.with_(systematic=shared, view=view, geometry=geometry, doubts=doubts)


def open_clip(source: str | Path, clip: ClipOptions) -> Video:
    """The part of a clip that a request asks for, as :func:`iris_sysid.open_video` opens it."""
    return open_video(source, fps=clip.fps, start_s=clip.start_s, stop_s=clip.stop_s, keep_partial=clip.keep_partial)


def run(
    source: str | Path,
    phenomenon: str | Phenomenon,
    *,
    calibration: str | Calibration | None = None,
    settings: Mapping[str, Estimate] | None = None,
    free: Sequence[str] = (),
    options: TrackOptions | None = None,
    clip: ClipOptions = WHOLE_CLIP,
    geometry: GeometryOptions = NO_GEOMETRY,
) -> Run:
    """Run the chain on one clip: track, calibrate, segment, observe, smooth, fit.

    Parameters
    ----------
    source
        Video, image sequence, or ``.trz``/``.zip`` with one in it.
    phenomenon
        Registered name, e.g. ``pendulum``, ``FILE.py:NAME``, or a phenomenon, e.g. with another tracker:
        ``replace(PHENOMENA["pendulum"], tracker="disc")``.
    calibration
        Pixels to metres, or a scale as text (``640px=1m``); without one, results are in px where a length is measured.
    settings
        Known values by name: constants of the model (``gravity``) and of the scene (``ball_radius``).
    free
        Constants of the model to estimate as well, e.g. ``("gravity",)``.
    options
        Region, colour, number of bodies, progress.
    clip
        Part of the clip to read, and its true frame rate.
    geometry
        Marked points, the direction of gravity, the scale from gravity.

    Returns
    -------
    Run
        Every result on the way. A fit that failed has a status and the remedy; it does not raise.

    Raises
    ------
    UnknownNameError
        When the phenomenon does not have what is named in ``settings``, ``free`` or ``geometry``.
    VideoError, TrackingError, CalibrationError, DataError
        When the clip cannot be read, followed, calibrated or observed.
    """
    chosen = PHENOMENA.resolved(phenomenon)
    request = RunRequest(
        chosen,
        calibration=scale_from_text(calibration) if isinstance(calibration, str) else calibration,
        settings=dict(settings or {}),
        free=tuple(free),
        tracking=options or TrackOptions(bodies=chosen.bodies),
        clip=clip,
        geometry=geometry,
    )
    return run_request(source, request)


def run_request(source: str | Path, request: RunRequest) -> Run:
    """Run the chain on one clip, as :func:`run` does, by a request."""
    video, tracks = track_clip(source, request)
    return run_tracked(video, tracks, request, source)


def track_clip(source: str | Path, request: RunRequest) -> tuple[Video, list[Track]]:
    """The first step of :func:`run`: open the clip, and follow its bodies by the tracker of the phenomenon.

    The request is checked before any frame is read, and recorded in the tracks' origin. Raises what :func:`run` raises.
    """
    check_request(request)
    video = open_clip(source, request.clip)
    if request.calibration is not None:
        check_image_size(request.calibration.image_size, (video.width, video.height))
    tracker = request.chosen.tracker
    if request.tracking.marks and tracker != AUTO:
        raise DataError(f"marks of bodies are for the tracker {AUTO}, not for {tracker}; add --tracker {AUTO}")
    tracks = track(video, tracker, request.tracking)
    return video, from_source(tracks, source, request_origin(request), complete=video.complete)


def run_tracked(video: Video, tracks: Sequence[Track], request: RunRequest, source: str | Path) -> Run:
    """Run the chain from the tracks on: calibrate, segment, observe, smooth, fit.

    Parameters
    ----------
    video
        The clip that the tracks are of.
    tracks
        One per body, in px, by a tracker or corrected by hand; their origin becomes that of the results.
    request
        How they are calibrated and fitted.
    source
        The file of the clip.
    """
    from iris_sysid.trajectory.vertical_and_scale import align_vertical, gravity_calibration, vertical_note

    check_request(request)
    chosen, geometry, free = request.chosen, request.geometry, request.free
    known, calibration = dict(request.settings), request.calibration
    if geometry.scale_from_gravity is not None:
        calibration = gravity_calibration(tracks[0], chosen, geometry.scale_from_gravity)
        known["gravity"] = geometry.scale_from_gravity
        free = (*free, "magnification")
    calibration = align_vertical(calibration or uncalibrated(), tracks[0], chosen, geometry.plumb_px, geometry.vertical)
    world, trajectory, result = observe_and_fit(
        tracks,
        calibration,
        chosen,
        known,
        free,
        marks_px=geometry.marks_px,
        clock_stderr=request.clip.fps_stderr,
        image_size=(video.width, video.height),
    )
    trajectory, result = _with_capture_rate(video, tracks[0], trajectory, result)
    of_calibration = [*calibration.notes]
    if trajectory.view is not None:  # a radius or a brightness has no direction
        of_calibration.append(vertical_note(calibration))
    return Run(
        source=Path(source),
        video=video,
        phenomenon=chosen,
        calibration=calibration,
        tracks=tracks,
        world=world,
        trajectory=trajectory,
        fit=result,
        notes=tuple(filter(None, [*doubts_of(tracks), camera_note(tracks), video.warning, *of_calibration])),
    )


def _with_capture_rate(
    video: Video, body: Track, trajectory: Trajectory, result: FitResult
) -> tuple[Trajectory, FitResult]:
    """Both with the doubt that the file itself gives of its times, in place of one about the clock that is guessed."""
    from iris_sysid.trajectory.consistency.capture_rate import capture_rate_doubt

    stated = capture_rate_doubt(video.facts, body.t_s)
    if stated is None:
        return trajectory, result
    doubts = (stated, *(doubt for doubt in result.doubts if doubt.kind not in ("clock", "scale")))
    return trajectory.with_(doubts=doubts), replace(result, doubts=doubts)


def check_request(request: RunRequest) -> None:
    """Refuse, before any frame is read, what the phenomenon of a request cannot use.

    UnknownNameError, CalibrationError or DataError when it has no use for a setting, a constant, a mark or gravity.
    """
    phenomenon, settings, free, geometry = request.chosen, request.settings, request.free, request.geometry
    names = accepted_settings(phenomenon)
    for name in (*settings, *free):
        if name not in names or (name in free and name in phenomenon.settings):
            raise UnknownNameError(f"{phenomenon.name} has nothing named {name!r}; it has {', '.join(names)}")
    both = sorted(set(settings) & set(free))
    if both:
        raise DataError(f"{', '.join(both)} cannot be both set and free")
    for name in geometry.marks_px:
        if not {f"{name}_x", f"{name}_z"} & names.keys():
            raise UnknownNameError(f"{phenomenon.name} has no use for the mark {name!r}")
    if geometry.scale_from_gravity is not None and not phenomenon.free_flight:
        raise CalibrationError(f"gravity gives the scale of a free flight only, not of {phenomenon.name}")


def request_origin(told: RunRequest) -> dict[str, Any]:
    """The request as the origin of a track holds it; ``iris-sysid review`` reads it back."""
    phenomenon, clip, geometry, options = told.chosen, told.clip, told.geometry, told.tracking
    gravity = geometry.scale_from_gravity
    return {
        "phenomenon": phenomenon.name,
        "tracker": phenomenon.tracker,
        "fps": clip.fps,
        "start_s": clip.start_s,
        "stop_s": clip.stop_s,
        "keep_partial": clip.keep_partial,
        "settings": {
            name: {"value": known.value, "stderr": known.stderr, "unit": known.unit}
            for name, known in told.settings.items()
        },
        "scale_from_gravity": None if gravity is None else gravity.value,
        "free": list(told.free),
        "marks_px": dict(geometry.marks_px),
        "plumb_px": geometry.plumb_px,
        "vertical": geometry.vertical,
        "clock_stderr": clip.fps_stderr,
        "scale_from_gravity_stderr": None if gravity is None else gravity.stderr,
        "scale": None if told.calibration is None else _scale_origin(told.calibration),
        "roi": options.roi,
        "colour": options.colour,
        "bodies": options.bodies,
        "body_marks": [[mark.body, mark.x_px, mark.y_px, mark.frame] for mark in options.marks],
    }


def _scale_origin(calibration: Calibration) -> dict[str, Any]:
    """The scale of a calibration, and whether it is all that there is to it."""
    stated = calibration.scale
    plain = scale(stated.value, 1.0) if stated.unit == "px/m" else uncalibrated()
    return {
        "px_per_unit": stated.value,
        "stderr": stated.stderr,
        "source": calibration.source,
        "plain": bool(np.allclose(calibration.values, plain.values, rtol=1e-12, atol=0.0)),
    }


def observe_and_fit(
    tracks: Sequence[Track],
    calibration: Calibration,
    phenomenon: Phenomenon,
    settings: Mapping[str, Estimate],
    free: Sequence[str] = (),
    *,
    marks_px: Mapping[str, tuple[float, float]] | None = None,
    clock_stderr: float = 0.0,
    image_size: tuple[int, int] | None = None,
) -> tuple[list[Trajectory], Trajectory, FitResult]:
    """Observe and fit, repeatedly where the fit determines part of the geometry better than the image does.

    Parameters
    ----------
    tracks
        One per body, in px.
    calibration
        Pixels to metres.
    phenomenon
        How to observe, and what to fit.
    settings
        What is known beforehand, by name.
    free
        Constants of the model to estimate as well.
    marks_px, clock_stderr, image_size
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
    from fitters.refined_geometry import fit_in_turns, with_constants
    from iris_sysid.trajectory.consistency.gravity_scale import gravity_doubts
    from iris_sysid.trajectory.consistency.path_shape import phenomenon_doubt

    world: list[Trajectory] = []

    def observing(known: Mapping[str, Estimate]) -> tuple[list[Trajectory], Trajectory]:
        nonlocal world
        world, trajectory = observe(
            tracks,
            calibration,
            phenomenon,
            known,
            marks_px=marks_px,
            clock_stderr=clock_stderr,
            image_size=image_size,
            world=world,
        )
        stated = {**known, **_marks_in_world(marks_px or {}, tracks[0], calibration)}
        return world, with_constants(trajectory, phenomenon, stated, free)

    world, trajectory, result = fit_in_turns(phenomenon, settings, observing)
    another = phenomenon_doubt(world[0], phenomenon)  # then gravity says nothing of clock and scale
    seen = (another,) if another else gravity_doubts(tracks, world, calibration, phenomenon, result, trajectory)
    # a track that may not be on the body says little of clock and scale: its doubts are first
    doubts = (*trajectory.doubts, *seen, *calibration.doubts)
    return world, trajectory.with_(doubts=doubts), replace(result, doubts=doubts)


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
    from iris_sysid.io.csv_write import write_track, write_trajectory
    from iris_sysid.io.json_documents import write_fit
    from iris_sysid.report.clip_page import write_report

    folder = check_folder(folder, FILES, overwrite=overwrite)
    write_clip_place(result.source, folder, overwrite=overwrite)
    write_track(result.tracks, folder / "track.csv", overwrite=overwrite)
    write_trajectory(result.trajectory, folder / "trajectory.csv", overwrite=overwrite)
    write_fit(result.fit, result.trajectory, folder / "fit.json", overwrite=overwrite)
    return write_report(result, folder, overwrite=overwrite)


def _marks_in_world(
    marks_px: Mapping[str, tuple[float, float]], body: Track, calibration: Calibration
) -> dict[str, Estimate]:
    """Marked points as the settings ``<name>_x`` and ``<name>_z``."""
    found = {}
    for name, point_px in marks_px.items():
        marked = Track(
            t_s=body.t_s[:1],
            xy_px=np.array([point_px]),
            sigma_px=np.full((1, 2), MARK_SIGMA_PX),
            valid=np.ones(1, dtype=np.bool_),
            frame=body.frame[:1],
        )
        world = to_world(marked, calibration)
        source = f"marked at {point_px[0]:g}, {point_px[1]:g} px"
        for k, axis in enumerate("xz"):
            value, stderr = float(world.position[0, k]), float(world.sigma[0, k])
            found[f"{name}_{axis}"] = Estimate(value, stderr, calibration.unit, "direct", source)
    return found
