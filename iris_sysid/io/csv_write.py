"""Tracks and trajectories as CSV files, read back exactly; what a CSV cannot say goes into ``<file>.origin.json``.

``track.csv`` is long, one row per frame and body; ``trajectory.csv`` is wide, ``t_s`` and a column per quantity, whose
names :mod:`iris_sysid.io.csv_columns` explains. A blank cell is a gap. The file beside it (where the data come from,
geometry, why each segment was cut) is optional: a table typed by hand reads as well.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iris_sysid.errors import OutputError
from iris_sysid.io.csv_read import SIDE_CAR, read_track, read_trajectory, side_car_of
from iris_sysid.io.dataframes import estimates_frame, to_frame, track_columns
from iris_sysid.io.files import check_writable, sha256_of, write_atomic
from iris_sysid.io.formula_cells import guarded
from iris_sysid.io.json_documents import checked, entries_of, plain_origin, write_document
from iris_sysid.io.schemas import (
    BrightnessEntry,
    CameraMotionEntry,
    OriginDocument,
    Smoothing,
)
from iris_sysid.types import TRACK_MASKS, Track, Trajectory

__all__ = ["estimates_frame", "read_track", "read_trajectory", "to_frame", "write_track", "write_trajectory"]


def write_track(tracks: Sequence[Track] | Track, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write tracks to a CSV file, one row per frame and body, in the order of time.

    Parameters
    ----------
    tracks
        One per body, each of another name.
    path
        File to write; ``<path>.origin.json`` is written beside it.
    overwrite
        Replace both where they exist.

    Returns
    -------
    Path
        The path as given.

    Raises
    ------
    DataError
        When there is no track, or two are of the same body.
    OutputError
        When it exists or cannot be written.
    """
    every = [tracks] if isinstance(tracks, Track) else list(tracks)
    table = _track_text(every)
    origins = {track.body: plain_origin(track.origin) for track in every}
    same = all(origin == origins[every[0].body] for origin in origins.values())
    beside: dict[str, Any] = {"origin": origins[every[0].body]} if same else {"bodies": origins}
    lasting = {track.body: track.error_autocorrelation for track in every}
    alike = all(entry == lasting[every[0].body] for entry in lasting.values())
    beside["error_autocorrelation"] = lasting[every[0].body] if alike else None
    known = {body: entry for body, entry in lasting.items() if entry is not None}
    beside["body_error_autocorrelation"] = {} if alike else known
    judged = {track.body: track.quality for track in every}
    beside["body_quality"] = {body: entry for body, entry in judged.items() if entry is not None}
    light = {track.body: BrightnessEntry.of_track(track) for track in every}
    beside["body_brightness"] = {body: entry for body, entry in light.items() if entry is not None}
    beside["camera_motion"] = CameraMotionEntry.of_tracks(every)
    return _write(table, path, beside, overwrite=overwrite)


def _track_text(tracks: Sequence[Track]) -> str:
    """The table of some tracks, as pandas would write it, which takes half a second to import."""
    columns = track_columns(tracks)
    cells = [map(_CELLS.get(name, _number), column.tolist()) for name, column in columns.items()]
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([tuple(columns), *zip(*cells, strict=True)])
    return text.getvalue()


def _number(value: float) -> str:
    return "" if value != value else repr(value)


def _flag(value: float) -> str:
    return "" if value != value else str(int(value))


_CELLS: Mapping[str, Callable[[Any], str]] = {"body": guarded, **dict.fromkeys(("valid", *TRACK_MASKS), _flag)}


def write_trajectory(trajectory: Trajectory, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a trajectory to a CSV file, one row per sample: the measurement, and the smoothed state where there is one.

    Parameters
    ----------
    trajectory
        Its quantities and inputs need names and units that a column name can carry; inputs are named u, u1, u2, ...
    path
        File to write; ``<path>.origin.json`` is written beside it, with origin, geometry and segments.
    overwrite
        Replace both where they exist.

    Returns
    -------
    Path
        The path as given.

    Raises
    ------
    DataError
        When a name or unit could not be read back.
    OutputError
        When it exists or cannot be written.
    """
    smoothed = trajectory.smoothed
    beside = {
        "quantities": trajectory.quantities,
        "inputs": trajectory.input_quantities,
        "segments": trajectory.segments,
        "geometry": entries_of(trajectory.geometry),
        "systematic": {source: np.nan_to_num(patterns).tolist() for source, patterns in trajectory.systematic.items()},
        "smoothing": None if smoothed is None else Smoothing.of(smoothed),
        "origin": plain_origin(trajectory.origin),
        "error_autocorrelation": trajectory.error_autocorrelation,
        "first_frame": trajectory.first_frame,
        "sensor": trajectory.sensor,
        "view": trajectory.view,
        "doubts": trajectory.doubts,
        "hold": trajectory.hold,
        "known": entries_of(trajectory.known),
        "free": trajectory.free,
    }
    frame = to_frame(trajectory)
    if "valid" in frame:
        frame["valid"] = frame["valid"].astype("Int8")
    return _write(frame.to_csv(index=False, lineterminator="\n"), path, beside, overwrite=overwrite)


def write_worlds(worlds: Mapping[str, Trajectory], path: str | Path, *, overwrite: bool = False) -> list[Path]:
    """Write x and z of each body in the plane of motion, one CSV file each, and return the paths.

    With several bodies their names are appended: ``world-1.csv``.
    """
    path = Path(path)
    alone = len(worlds) == 1
    paths = [path if alone else path.with_name(f"{path.stem}-{body}{path.suffix}") for body in worlds]
    for world, file in zip(worlds.values(), paths, strict=True):
        write_trajectory(world, file, overwrite=overwrite)
    return paths


def _write(table: str, path: str | Path, beside: Mapping[str, Any], *, overwrite: bool) -> Path:
    if str(path).endswith(SIDE_CAR):
        raise OutputError(f"cannot write {path}: a name that ends in {SIDE_CAR} is for what belongs to a table")
    side_car = check_writable(side_car_of(path), overwrite=True)  # it belongs to the table, whose presence decides
    write_atomic(path, table, overwrite=overwrite)
    document = checked(OriginDocument, table=Path(path).name, table_sha256=sha256_of(path), **beside)
    write_document(document, side_car, overwrite=True)
    return Path(path)
