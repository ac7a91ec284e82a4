"""Open a review: of a clip, of the folder of a run, or where an earlier review was left."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from iris_sysid.calibration.calibration_json import read_calibration, write_calibration
from iris_sysid.errors import DataError
from iris_sysid.io.archives import member_of
from iris_sysid.io.clip_place import places_of, way_to
from iris_sysid.io.csv_read import SIDE_CAR, read_track, side_car_of
from iris_sysid.io.csv_write import write_track
from iris_sysid.io.files import check_writable, read_file, write_atomic
from iris_sysid.pipeline.one_clip import check_request
from iris_sysid.review.edits import Tracked
from iris_sysid.review.history import ReviewState
from iris_sysid.review.log import LOG_NAME, Entry, LogWriter, read_log
from iris_sysid.review.request import ReviewRequest, request_of
from iris_sysid.review.session import Session, check_same_clip, clip_stamp
from iris_sysid.types import Calibration, Track

TRACK, CALIBRATION = "track.csv", "review-calibration.json"


def is_result(path: Path) -> bool:
    """Whether a path is the folder of a run or of a review, rather than a clip."""
    return path.is_dir() and any((path / name).is_file() for name in (LOG_NAME, TRACK))


def open_clip(clip: Path, folder: Path, request: ReviewRequest) -> Session:
    """Begin a review of a clip; nothing is tracked yet.

    The folder takes the log and the results. VideoError when the clip cannot be read, DataError when the folder holds a
    review or the results of a run already.
    """
    if is_result(folder):
        raise DataError(f"{folder} holds results already: open them, iris-sysid review {folder}, or give another -o")
    check_writable(folder / LOG_NAME)
    if request.phenomenon is not None:
        check_request(request)
    session = Session(clip, folder, ReviewState(request))
    _begin(session, request)
    return session


def open_result(folder: Path, clip: Path | None = None, calibration: Calibration | None = None) -> Session:
    """Open the folder of a run or of an earlier review, with all that was done.

    Without a clip it is looked for where it was, and beside and in the folder; a calibration is that of a run that used
    a camera or a plane from a file. DataError when a file is damaged, or the clip is not there or another one.
    """
    log = folder / LOG_NAME
    if not log.is_file():
        return _open_run(folder, clip, calibration)
    logged = read_log(log)
    header = logged.header
    found = clip or _found(folder, str(header.get("clip", "")))
    _check_stamp(found, header, logged.entries, folder)
    if calibration is None and header.get("calibration"):
        calibration = read_calibration(folder / CALIBRATION)
    request = request_of(header.get("request") or {}, calibration)
    session = Session(found, folder, ReviewState(request))
    try:
        for number, entry in enumerate(logged.entries, start=2):
            try:
                session.replay(entry)
            except DataError as error:
                raise DataError(f"{log}, line {number}: {error}") from error
    except Exception:
        session.close()
        raise
    session.record_in(LogWriter(log, whole_bytes=logged.whole_bytes))
    session.fits.ask(session.version, session.state)
    return session


def _open_run(folder: Path, clip: Path | None, calibration: Calibration | None) -> Session:
    tracks = read_track(folder / TRACK)
    origin = {} if tracks[0].origin.get("source") == TRACK else tracks[0].origin  # a table that was typed by hand
    options = origin.get("options")
    request = request_of(options if isinstance(options, Mapping) else {}, calibration)
    found = clip or _found(folder, Path(str(origin.get("source") or "")).name)
    check_same_clip(found, origin)
    session = Session(found, folder, ReviewState(request))
    file = session.new_track_file()
    _copy_track(tracks, folder, file)
    session.keep_tracks(file, tracks)
    _begin(session, request)
    session.add_tracks_of(file)
    session.mark_saved()
    return session


def _copy_track(tracks: Sequence[Track], folder: Path, file: str) -> None:
    """Keep the tracks of a run, which a save replaces, in a separate ``file``."""
    if not side_car_of(folder / TRACK).is_file():
        write_track(tracks, folder / file)  # with the file beside it, which says that the table was typed by hand
        return
    for name in ("", SIDE_CAR):  # as they are: to write 54,000 rows anew takes half a second
        write_atomic(f"{folder / file}{name}", read_file(f"{folder / TRACK}{name}"))


def _begin(session: Session, request: ReviewRequest) -> None:
    """Write the first line of the log, and the calibration beside it."""
    session.folder.mkdir(parents=True, exist_ok=True)
    if request.calibration is not None:
        write_calibration(request.calibration, session.folder / CALIBRATION, overwrite=True)
    header = {
        "clip": way_to(session.clip, session.folder),
        "size": clip_stamp(session.clip)[1],
        "calibration": None if request.calibration is None else CALIBRATION,
        "request": _plain(request),
    }
    session.record_in(LogWriter(session.folder / LOG_NAME, header))


def _plain(request: ReviewRequest) -> dict[str, Any]:
    """The request as the log holds it; its scale is in a separate file."""
    if request.phenomenon is None:
        clip, tracking = request.clip, request.tracking
        times = {"fps": clip.fps, "start_s": clip.start_s, "stop_s": clip.stop_s, "keep_partial": clip.keep_partial}
        return {**times, "roi": tracking.roi, "colour": tracking.colour, "bodies": tracking.bodies}
    return {**request.recorded(), "scale": None}


def _found(folder: Path, recorded: str) -> Path:
    """The clip of a folder: where it was, beside the folder, in it, or here."""
    name = Path(recorded).name
    if not name:
        raise DataError(f"{folder} does not say which clip it is of; give it with --clip")
    found = next((place for place in places_of(folder, recorded) if member_of(place)[0].exists()), None)
    if found is None:
        raise DataError(f"the clip {name} of {folder} is neither beside it nor in it; say where it is with --clip")
    return Path(os.path.normpath(found))


def _check_stamp(clip: Path, header: Mapping[str, Any], entries: tuple[Entry, ...], folder: Path) -> None:
    """DataError when the clip is not that of the log: by its size, which costs nothing, and by the first track."""
    if clip_stamp(clip)[1] == header.get("size"):
        return
    tracked = next((entry.edit for entry in entries if isinstance(entry.edit, Tracked)), None)
    if tracked is None:
        raise DataError(f"{clip} is not the clip of this review: its size differs; give that one with --clip")
    check_same_clip(clip, read_track(folder / tracked.file)[0].origin)
