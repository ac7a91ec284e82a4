"""Measure every group of a class once: its clip or table to a fit, a page and a document; a second run keeps them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitters.ode.single_clip import fit
from fitters.positions import fit_positions, phenomenon_of
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.classroom.evidence import CAPTURE, diameter_of, evidence_of
from iris_sysid.classroom.groups import Group
from iris_sysid.errors import DataError, IrisError, OutputError, TrackingError
from iris_sysid.io.csv_cells import is_own_table
from iris_sysid.io.csv_read import read_track, read_trajectory
from iris_sysid.io.csv_write import write_track, write_trajectory
from iris_sysid.io.files import check_folder, origin_of, sha256_of
from iris_sysid.io.grouped_table import read_group
from iris_sysid.io.json_documents import checked, entries_of, plain_origin, read_document, write_document, write_fit
from iris_sysid.io.schemas import GroupDocument
from iris_sysid.io.table_headers import columns_for
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.one_clip import (
    FILES,
    accepted_settings,
    from_source,
    observe_and_fit,
    open_clip,
    request_origin,
    run_tracked,
    save,
    track_clip,
)
from iris_sysid.pipeline.parallel import Workers, check_workers, run_parallel
from iris_sysid.registry import MODELS
from iris_sysid.report.clip_page import table_page, write_page
from iris_sysid.trajectory.consistency.capture_rate import STATED
from iris_sysid.types import Calibration, Estimate, FitResult, Progress, Track, Trajectory, with_progress
from iris_sysid.video.empty_track import unfollowed
from iris_sysid.video.reader import Video

GROUPS = "groups"  # folder of the groups' folders
DOCUMENT, PAGE = "group.json", "report.html"  # of each group; the document is written last
TRACK, TRAJECTORY, FIT = "track.csv", "trajectory.csv", "fit.json"
FAILED = "failed"
RESULTS = (*FILES, DOCUMENT)


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """What was measured of one group before it is written.

    ``world`` is None where there are no positions, ``recorded_hz`` where the file states no rate.
    """

    trajectory: Trajectory
    fit: FitResult
    world: Trajectory | None = None
    track: Track | None = None
    calibration: Calibration | None = None
    recorded_hz: float | None = None


def measure_groups(
    groups: Sequence[Group],
    folder: str | Path,
    *,
    workers: Workers = 0,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
) -> tuple[list[GroupDocument], int]:
    """Measure the groups, and write ``groups/<group>/`` with page, trajectory, fit and ``group.json``.

    A group whose file (by sha256), options and package versions are unchanged is not measured again, also after an
    interrupted run. A corrected track of that file, saved by a review in the group's folder, is fitted instead of a
    new one. A group that cannot be measured has the status ``failed`` and a message with the reason.

    Parameters
    ----------
    groups
        No two have the same name.
    folder
        Of the results; made when missing. One run at a time.
    workers
        Number of parallel processes, 0 for this one, or the address or file of a dask scheduler.
    progress
        Called with (groups done, groups in all).
    tell
        Called with one line a group that failed.

    Returns
    -------
    documents : list of GroupDocument
        One a group, in the order given.
    now : int
        How many were measured now.

    Raises
    ------
    DataError
        When the number of workers is out of range.
    OutputError
        When a file cannot be written.
    """
    check_workers(workers)
    root, now = Path(folder), 0
    batch = Batch(root, _measured_now, _lost)
    for group, (measured_now, reason) in with_progress(run_parallel(batch, groups, workers), progress, len(groups)):
        now += measured_now
        if reason and tell is not None:
            tell(f"{group.name}: {reason}")
    return [read_document(root / _place(group, DOCUMENT), GroupDocument) for group in groups], now


def page_of(group: Group) -> str:
    """The path of a group's own page below the folder of the results, with slashes."""
    return _place(group, PAGE)


def _place(group: Group, name: str) -> str:
    return f"{GROUPS}/{group.source.folder}/{name}"


def _measured_now(root: Path, group: Group) -> tuple[bool, str]:
    """Whether a group was measured now, and the reason of a failure; empty where there is none."""
    folder = root / GROUPS / group.source.folder
    try:
        corrected = _corrected(group, folder)
        origin = _origin(group, corrected)
        earlier = _earlier(folder, origin)
        if earlier is not None:
            return False, earlier.message if earlier.status == FAILED else ""
        _write(group, folder, origin, corrected)
    except OutputError:
        raise
    except IrisError as error:
        return True, _failed(group, folder, _said(error))
    except Exception as error:  # one group must not end the run of all
        return True, _failed(group, folder, f"unexpected {type(error).__name__}: {error}", retry=True)
    return True, ""


def _origin(group: Group, corrected: Sequence[Track] = ()) -> dict[str, Any]:
    row = {"column": group.source.column, "group": group.source.row} if group.source.column else {}
    origin = plain_origin(origin_of(group.source.path, {**group.request.typed, **row}))
    places = [np.where(track.valid[:, None], track.xy_px, np.nan).tobytes() for track in corrected]
    return {**origin, "track": [hashlib.sha256(place).hexdigest() for place in places]} if places else origin


def _corrected(group: Group, folder: Path) -> list[Track]:
    """The tracks of the group's clip that a person has corrected and saved in its folder; [] where there are none."""
    if group.source.is_table or not (folder / TRACK).is_file():
        return []
    try:
        tracks = read_track(folder / TRACK)
    except DataError:
        return []  # a file that was cut is written anew
    origin = tracks[0].origin
    same = origin.get("sha256") == sha256_of(group.source.path)
    return tracks if same and origin.get("review") is not None else []


def _earlier(folder: Path, origin: Mapping[str, Any]) -> GroupDocument | None:
    """The document of an earlier run with the same file, options and versions."""
    try:
        document = read_document(folder / DOCUMENT, GroupDocument)
    except IrisError:
        return None
    complete = document.status == FAILED or (folder / PAGE).is_file()
    return document if complete and document.origin == origin else None


def _write(group: Group, folder: Path, origin: Mapping[str, Any], corrected: Sequence[Track]) -> None:
    (folder / DOCUMENT).unlink(missing_ok=True)  # a document that is there belongs to the files beside it
    check_folder(folder, RESULTS, overwrite=True)
    measured = _of_a_table(group, folder) if group.source.is_table else _of_a_clip(group, folder, corrected)
    write_document(_document(group, measured, origin), folder / DOCUMENT, overwrite=True)


def _of_a_clip(group: Group, folder: Path, corrected: Sequence[Track]) -> Measured:
    request, path, tracks = group.request, group.source.path, corrected
    if corrected:
        video = open_clip(path, request.clip)
    else:
        try:
            video, tracks = track_clip(path, request)
        except TrackingError:
            _write_unfollowed(group, folder)
            raise
        write_track(tracks, folder / TRACK, overwrite=True)  # for a review, also where it cannot be fitted
    result = run_tracked(video, tracks, request, path)
    save(result, folder, overwrite=True)
    world = result.world[0] if request.phenomenon.measures == "position" else None
    facts = result.video.facts if isinstance(result.video, Video) and request.clip.fps is None else {}
    rate = facts.get(STATED)
    recorded_hz = rate if isinstance(rate, float) else None
    return Measured(result.trajectory, result.fit, world, result.tracks[0], result.calibration, recorded_hz)


def _write_unfollowed(group: Group, folder: Path) -> None:
    """A track without positions, for a review of a clip that no tracker follows."""
    request, path = group.request, group.source.path
    nothing = unfollowed(open_clip(path, request.clip))
    if nothing is not None:
        write_track(from_source([nothing], path, request_origin(request)), folder / TRACK, overwrite=True)


def _of_a_table(group: Group, folder: Path) -> Measured:
    measured = _fitted_track(group) if _is_track(group) else _fitted_table(group)
    write_trajectory(measured.trajectory, folder / TRAJECTORY, overwrite=True)
    write_fit(measured.fit, measured.trajectory, folder / FIT, overwrite=True)
    page = table_page(f"{group.name}: {group.source.path.name}", measured.trajectory, measured.fit)
    write_page(page, folder, overwrite=True)
    return measured


def _is_track(group: Group) -> bool:
    """Whether a table holds positions in px, as ``track`` writes them."""
    if group.source.column or group.request.columns is not None or not is_own_table(group.source.path):
        return False
    with group.source.path.open(encoding="utf-8", errors="replace") as file:
        header = file.readline(10_000).strip().split(",")
    return {"t_s", "x_px", "y_px"} <= set(header)


def _fitted_track(group: Group) -> Measured:
    request = group.request
    tracks = from_source(read_track(group.source.path), group.source.path, dict(request.typed))
    calibration = request.calibration or uncalibrated()
    world, trajectory, result = observe_and_fit(
        tracks,
        calibration,
        request.phenomenon,
        request.settings,
        request.free,
        marks_px=request.geometry.marks_px,
        clock_stderr=request.clip.fps_stderr,
    )
    return Measured(trajectory, result, world[0], tracks[0], calibration)


def _fitted_table(group: Group) -> Measured:
    request, source = group.request, group.source
    if source.column:
        table = read_group(source.path, source.column, source.row, request.columns)
    else:
        table = read_trajectory(source.path, request.columns)
    model = MODELS[request.phenomenon.model]
    table, _ = model.taken_from(table)
    if phenomenon_of(model, table) is not None:
        plane, trajectory, result = fit_positions(table, request.phenomenon, request.settings, request.free)
        return Measured(trajectory, result, plane)
    _check_observed(table, group)
    fixed = {name: value for name, value in request.settings.items() if name in accepted_settings(request.phenomenon)}
    result = fit(table, model, fixed=fixed, free=request.free)
    return Measured(table, result)


def _check_observed(table: Trajectory, group: Group) -> None:
    model = MODELS[group.request.phenomenon.model]
    names = [quantity.name for quantity in table.quantities]
    missing = [quantity for quantity in model.observed if quantity.name not in names]
    if missing:
        raise DataError(
            f"the table holds {', '.join(names)}, but {group.request.phenomenon.name} needs x and z, "
            f"or {', '.join(quantity.name for quantity in missing)}: say which columns they are",
            columns=columns_for(group.source.path, missing),
        )


def _document(group: Group, measured: Measured, origin: Mapping[str, Any]) -> GroupDocument:
    result, track = measured.fit, measured.track
    diameter = None
    if track is not None and measured.calibration is not None and group.request.phenomenon.measures == "position":
        diameter = diameter_of(track, measured.calibration)
    evidence = evidence_of(group.request.phenomenon, measured.world, measured.trajectory, result, diameter)
    if measured.recorded_hz is not None:
        evidence[CAPTURE] = Estimate(measured.recorded_hz, 0.0, "1/s", "metadata")
    doubts = () if track is None or track.quality is None else track.quality.doubts
    return checked(
        GroupDocument,
        **_head(group),
        status=result.status,
        message=result.message,
        verdict=result.verdict,
        parameters=entries_of(result.estimates, result.status),
        free=result.free,
        budget=result.budget,
        evidence=entries_of(evidence),
        track_doubts=doubts,
        origin=origin,
    )


def _head(group: Group) -> dict[str, Any]:
    model = MODELS[group.request.phenomenon.model]
    return {
        "group": group.name,
        "source": group.source.path.name,
        "model": model.name,
        "equation": model.equation,
    }


def _failed(group: Group, folder: Path, reason: str, *, retry: bool = False) -> str:
    """Write that a group failed, with the reason; ``retry``: the next run tries again. Returns the message."""
    message = reason.replace(str(group.source.path), group.source.path.name)
    try:
        origin = {} if retry else _origin(group)
    except IrisError:
        origin = {}
    document = checked(GroupDocument, **_head(group), status=FAILED, message=message, origin=origin)
    write_document(document, folder / DOCUMENT, overwrite=True)
    return message


def _said(error: IrisError) -> str:
    """The text of an error, with columns as the option and the file of the groups take them."""
    if isinstance(error, DataError) and error.columns:
        return f'{error.text}, e.g. columns "{error.typed_columns}"'
    return str(error)


def _lost(root: Path, group: Group) -> tuple[bool, str]:
    reason = "the process that read it died; is the file damaged, or memory full?"
    return True, _failed(group, root / GROUPS / group.source.folder, reason, retry=True)
