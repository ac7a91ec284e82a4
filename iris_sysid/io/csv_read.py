"""Read tracks and trajectories from CSV files, typed by hand or written by :mod:`iris_sysid.io.csv_write`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.io.csv_cells import Sheet, is_own_table, read_sheet
from iris_sysid.io.csv_columns import Column, Key, covariance_columns, parse_column
from iris_sysid.io.dataframes import segment_labels
from iris_sysid.io.files import origin_of, sha256_of
from iris_sysid.io.formula_cells import unguarded
from iris_sysid.io.group_column import names_groups, several_groups
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.rounded_times import unrounded
from iris_sysid.io.schemas import OriginDocument, number
from iris_sysid.io.table_cells import Cells, read_cells
from iris_sysid.io.table_headers import example_of, parse_headers, states_unit, titles_of
from iris_sysid.types import (
    TRACK_MASKS,
    TRACK_MEASURES,
    TRACK_SIGMAS,
    Array,
    Mask,
    Quantity,
    Segment,
    SegmentLabel,
    Smoothed,
    Track,
    Trajectory,
    View,
)
from iris_sysid.units import rate_of

TRACK_COLUMNS = (
    "frame",
    "t_s",
    "body",
    "x_px",
    "y_px",
    "sigma_x_px",
    "sigma_y_px",
    "radius_px",
    "angle_rad",
    "intensity",
    "valid",
    "area_px",
    *TRACK_MASKS,
    *TRACK_SIGMAS,
)
SORTED = "sort the rows by time, without duplicates"
SIDE_CAR = ".origin.json"  # after the name of a table: what a CSV cannot store
SPECIAL_COLUMNS = ("t_s", "valid", "segment")
NOTHING_BESIDE = OriginDocument(table="", table_sha256="0" * 64)


def side_car_of(path: str | Path) -> Path:
    """Path of the origin file of the table ``path``, which holds what a CSV cannot store."""
    return Path(f"{path}{SIDE_CAR}")


def _read_beside(path: str | Path) -> tuple[OriginDocument, dict[str, Any]]:
    """The content of the origin file, which may say nothing, and the origin of the table."""
    if not side_car_of(path).exists():
        return NOTHING_BESIDE, origin_of(path, {})
    try:
        document = read_document(side_car_of(path), OriginDocument)
    except DataError as error:
        raise DataError(f"{error}; delete that file to read the table without it") from error
    edited = {} if document.table_sha256 == sha256_of(path) else {"edited": True}
    return document, {**document.origin, **edited}


def _times(sheet: Sheet, rows: Sequence[int] | None = None) -> Array:
    """Times (n,), increasing; of the given rows only, where only these belong together."""
    times = sheet.numbers("t_s", gaps=False)
    own = times if rows is None else times[list(rows)]
    late = np.flatnonzero(np.diff(own) <= 0)
    if late.size:
        rows = range(times.size) if rows is None else rows
        before, row = rows[late[0]], rows[late[0] + 1]
        problem = f"is not later than {float(times[before])!r} in line {sheet.lines[before]}"
        again = times[row] <= times[rows[0]] + abs(times[rows[-1]]) * 1e-3
        remedy = "several runs below each other? write each to a separate table" if again else SORTED
        sheet.refuse("t_s", row, f"{problem}; {remedy}")
    return own


def _even_times(sheet: Sheet) -> tuple[Array, str]:
    """Times (n,), increasing, unrounded where they are rounded; and what was done to them."""
    even, text = unrounded(sheet.numbers("t_s", gaps=False))
    return (even, text) if text else (_times(sheet), "")


def _require(sheet: Sheet, columns: Sequence[str], example: str) -> None:
    missing = [name for name in columns if name not in sheet]
    if missing:
        have = ", ".join(list(sheet.columns)[:12])
        raise DataError(f"{sheet.label:.200} has no column {missing[0]}; it has {have:.300}; {example}")


# --------------------------------------------------------------------------- tracks


def read_track(path: str | Path) -> list[Track]:
    """Read ``track.csv``, or any CSV with at least ``t_s,x_px,y_px``, into one Track a body, in order of appearance.

    ``body`` is ``1`` and ``frame`` counts the times when these columns are absent; a sample without a position is a
    gap, and so is one whose ``valid`` is 0. Raises DataError that names line, column and cell.
    """
    sheet = read_sheet(path)
    _require(sheet, ("t_s", "x_px", "y_px"), "a track has t_s in s, and x_px and y_px, y down")
    unknown = [name for name in sheet.columns if name not in TRACK_COLUMNS]
    if unknown:
        raise DataError(
            f"{sheet.label}: a track has no column {unknown[0]!r:.60}; it may have {', '.join(TRACK_COLUMNS)}"
        )
    document, origin = _read_beside(path)
    columns = _track_columns(sheet)
    bodies: dict[str, list[int]] = {}
    for row, body in enumerate(sheet.columns.get("body", ["1"] * len(sheet.lines))):
        if not body.strip():
            sheet.refuse("body", row, "is blank; give the name of the body")
        bodies.setdefault(unguarded(body), []).append(row)
    beside = {body: _beside_body(document, origin, body) for body in bodies}
    if document.camera_motion is not None:
        for body, rows in bodies.items():
            beside[body]["camera_motion"] = document.camera_motion.maps(columns["frame"][rows])
    return [_track(sheet, columns, body, rows, beside[body]) for body, rows in bodies.items()]


def _beside_body(document: OriginDocument, origin: Mapping[str, Any], body: str) -> dict[str, Any]:
    """The fields of a Track that the origin file gives for one body."""
    stated = document.body_error_autocorrelation.get(body, document.error_autocorrelation)
    return {
        "origin": {**origin, **document.bodies.get(body, {})},
        "error_autocorrelation": stated.autocorrelation() if stated else None,
        "quality": document.body_quality[body].quality() if body in document.body_quality else None,
        **(document.body_brightness[body].fields() if body in document.body_brightness else {}),
    }


def _track_columns(sheet: Sheet) -> dict[str, Any]:
    """Every column that holds numbers, as an array over all rows."""
    times = sheet.numbers("t_s", gaps=False)
    columns: dict[str, Any] = {name: sheet.numbers(name) for name in ("x_px", "y_px")}
    columns |= {name: sheet.numbers(name) for name in ("angle_rad", "intensity") if name in sheet}
    for name in ("sigma_x_px", "sigma_y_px", "radius_px", "area_px", *TRACK_SIGMAS):
        if name in sheet:
            columns[name] = sheet.amounts(name)
    columns["frame"] = (
        sheet.whole_numbers("frame") if "frame" in sheet else np.unique(times, return_inverse=True)[1].astype(np.int64)
    )
    columns["valid"] = _valid(sheet, {name: columns[name] for name in ("x_px", "y_px")})
    columns |= {name: sheet.flags(name) for name in TRACK_MASKS if name in sheet}
    return columns


def _track(sheet: Sheet, columns: Mapping[str, Any], body: str, rows: list[int], beside: Mapping[str, Any]) -> Track:
    own = {name: values[rows] for name, values in columns.items()}
    unknown = np.full(len(rows), np.nan)
    optional = {name: own[name] for name in TRACK_MEASURES if name in own and not np.isnan(own[name]).all()}
    for name in TRACK_MASKS:
        if name in own and not np.isnan(own[name]).all():
            optional[name] = own[name] == 1
    return Track(
        t_s=_times(sheet, rows),
        xy_px=np.column_stack([own["x_px"], own["y_px"]]),
        sigma_px=np.column_stack([own.get("sigma_x_px", unknown), own.get("sigma_y_px", unknown)]),
        valid=own["valid"],
        frame=own["frame"],
        body=body,
        **beside,
        **optional,
    )


def _valid(sheet: Sheet, positions: Mapping[str, Array]) -> Mask:
    """Where every position is known, and a ``valid`` column does not exclude it."""
    known = np.all([np.isfinite(values) for values in positions.values()], axis=0)
    if "valid" not in sheet:
        return known
    stated = sheet.flags("valid")
    for header, values in positions.items():
        contradiction = (stated == 1) & np.isnan(values)
        if contradiction.any():
            sheet.refuse(header, int(np.argmax(contradiction)), "is blank although valid is 1; set valid to 0")
    return known & (stated != 0)


# --------------------------------------------------------------------------- trajectories


def read_trajectory(path: str | Path, columns: Mapping[str, str] | None = None) -> Trajectory:
    """Read ``trajectory.csv``, any CSV with ``t_s`` and columns ``<name>_<unit>``, or a table of another program.

    A blank cell is a gap. Columns in another unit of the same kind (deg, cm, mm, ms, mV, ...) are converted to rad, m,
    s, V, ..., which ``origin["converted"]`` says. The table of another program is text with any separator, with
    decimal commas, comments, several header rows or none, or an Excel file (``FILE.xlsx:SHEET``); what was made of its
    columns is in ``origin["read_as"]``. Raises DataError that names line, column and cell, and where a unit is missing.

    Parameters
    ----------
    path
        The table.
    columns
        Column of each quantity where the header does not tell, by its title or its number from 1:
        ``{"t": "Zeit (s)", "theta[deg]": "Winkel"}``; ``t[1/60 s]`` counts frames of 60 a second.

    Examples
    --------
    >>> from pathlib import Path
    >>> from iris_sysid import read_trajectory
    >>> text = "t_s,theta_rad\\n0.0,0.2\\n0.1,0.15\\n0.2,\\n0.3,-0.05\\n"
    >>> _ = Path("angles.csv").write_text(text)
    >>> trajectory = read_trajectory("angles.csv")
    >>> trajectory.quantities[0].name, trajectory.valid.tolist()
    ('theta', [True, True, False, True])
    """
    if columns is not None or not is_own_table(path):
        return _of_another_program(path, columns)
    sheet = read_sheet(path)
    if any(_foreign(header) for header in sheet.columns) and not side_car_of(path).exists():
        return _of_another_program(path, None)  # t_s, but y [V] or v_km/h beside it
    for title, cells in sheet.columns.items():
        _refuse_groups(sheet.label, title, list(cells) if names_groups(title) else [])
    if "x_px" in sheet and ("body" in sheet or "frame" in sheet):
        raise DataError(f"{sheet.label} is a track, in pixels; it needs read_track and to_world, or iris-sysid run")
    document, origin = _read_beside(path)
    return trajectory_of_sheet(sheet, origin, document)


def _foreign(header: str) -> bool:
    """Whether a column states its unit as no table of this project does."""
    if header in SPECIAL_COLUMNS or header.startswith("cov_"):
        return False
    try:
        parse_column(header)
    except DataError:
        return states_unit(header)
    return False


def _of_another_program(path: str | Path, columns: Mapping[str, str] | None) -> Trajectory:
    cells = read_cells(path)
    for k, title in enumerate(titles_of(cells)):
        _refuse_groups(cells.label, title, [row[k] for row in cells.rows])
    return trajectory_of_cells(cells, columns, origin_of(cells.file, {}))


def trajectory_of_cells(cells: Cells, columns: Mapping[str, str] | None, origin: Mapping[str, Any]) -> Trajectory:
    """The trajectory that a table of another program holds; what was made of its columns is in ``read_as``."""
    sheet, read_as = parse_headers(cells, columns)
    return trajectory_of_sheet(sheet, {**origin, "read_as": list(read_as)})


def _refuse_groups(label: str, title: str, cells: Sequence[str]) -> None:
    """DataError where a column names several groups of rows: together they are not a trajectory."""
    names = several_groups(title, cells)
    if names:
        some = ", ".join(f"{name:.20}" for name in names[:4]) + (", ..." if len(names) > 4 else "")
        raise DataError(
            f"{label} holds the rows of {len(names)} groups ({some}), by its column {title!r:.40}: compare them with "
            "iris-sysid class, or keep the rows of one"
        )


def trajectory_of_sheet(
    sheet: Sheet, origin: Mapping[str, Any], document: OriginDocument = NOTHING_BESIDE
) -> Trajectory:
    """The trajectory that the columns of a table, under this project's names, and the file beside it hold.

    DataError when a column does not belong to a trajectory, or a cell does not hold what its column should.
    """
    _require(sheet, ("t_s",), "a trajectory has t_s in s and a column such as theta_rad or x_m")
    columns = _columns(sheet)
    plain = [column for column in columns.values() if column.part == "measured" and not column.is_sigma]
    measured = [column for column in plain if not column.is_input]
    inputs = [column for column in plain if column.is_input]
    if not measured:
        raise DataError(f"{sheet.label} has no quantity beside t_s; add a column such as theta_rad or x_m")
    converted = {column.header: column.unit for column in columns.values() if column.factor != 1}
    t_s, rounded = _even_times(sheet)
    origin = {**origin, "read_as": [*origin.get("read_as", ()), rounded]} if rounded else origin
    positions = {column.header: _values(sheet, column) for column in measured}
    stated = document.error_autocorrelation
    return Trajectory(
        t_s=t_s,
        quantities=_restored(measured, document),
        position=np.column_stack(list(positions.values())),
        sigma=_side_by_side(sheet, columns, [("measured", True, column.name) for column in measured]),
        valid=_some_valid(sheet, positions),
        input_quantities=_restored(inputs, document),
        inputs=np.column_stack([_values(sheet, column) for column in inputs]) if inputs else None,
        segments=_segments(sheet, document),
        geometry={name: entry.estimate() for name, entry in document.geometry.items()},
        smoothed=_smoothed(sheet, columns, measured, document),
        origin={**origin, "converted": converted} if converted else origin,
        systematic=_systematic(sheet, document, (t_s.size, len(measured))),
        error_autocorrelation=stated.autocorrelation() if stated else None,
        first_frame=document.first_frame,
        sensor=document.sensor,
        view=_view(sheet, document, measured),
        doubts=tuple(entry.doubt() for entry in document.doubts),
        known={name: entry.estimate() for name, entry in document.known.items()},
        free=_open_constants(measured, document),
        hold=document.hold,
    )


def _open_constants(columns: Sequence[Column], document: OriginDocument) -> tuple[str, ...]:
    """Constants to estimate; without a file that states them, the zero of every angle, which nothing says."""
    if document.free is not None:
        return tuple(document.free)
    angles = [re.fullmatch(r"theta_?(\d*)", column.name) for column in columns if column.unit == "rad"]
    return tuple(f"vertical_{match[1]}".rstrip("_") for match in angles if match)


def _view(sheet: Sheet, document: OriginDocument, columns: Sequence[Column]) -> View | None:
    """How the quantities lie in the image; DataError where the origin file states the view of other quantities."""
    if document.view is None:
        return None
    remedy = f"{side_car_of(sheet.label)}: view: {{}}; delete that file, or write the table again"
    try:
        view = document.view.view()
    except DataError as error:
        raise DataError(remedy.format(error)) from error
    if not view.shows([column.quantity for column in columns]):
        raise DataError(remedy.format(f"{view.kind} is not what this table holds"))
    return view


def _systematic(sheet: Sheet, document: OriginDocument, shape: tuple[int, int]) -> dict[str, Array]:
    """Systematic error patterns by source (r, n, d); DataError when the shape is not that of the table (n, d)."""
    by_source = {}
    for source, patterns in document.systematic.items():
        if any(len(rows) != shape[0] or any(len(row) != shape[1] for row in rows) for rows in patterns):
            raise DataError(
                f"{sheet.label}: systematic[{source!r}] in the file beside it does not have {shape[1]} numbers for "
                f"each of {shape[0]} samples; delete that file, or write the table again"
            )
        by_source[source] = np.array(patterns, dtype=np.float64).reshape(len(patterns), *shape)
    return by_source


def _columns(sheet: Sheet) -> dict[Key, Column]:
    """The columns with their meaning, checked against one another."""
    columns: dict[Key, Column] = {}
    for header in sheet.columns:
        if header in SPECIAL_COLUMNS or header.startswith("cov_"):
            continue
        try:
            column = parse_column(header)
        except DataError as error:
            said = {"t": "t_s", **example_of([header])}
            raise DataError(f"{sheet.label}: {error}; or say what it holds", columns=said) from error
        if column.key in columns:
            raise DataError(f"{sheet.label}: {columns[column.key].header} and {header} hold the same; delete one")
        columns[column.key] = column
    for column in columns.values():
        _check_companion(sheet, columns, column)
    return columns


def _check_companion(sheet: Sheet, columns: Mapping[Key, Column], column: Column) -> None:
    """A standard error or a smoothed state belongs to a measured quantity, and has a unit that fits it."""
    quantity = columns.get(("measured", False, column.name))
    if quantity is None:
        raise DataError(f"{sheet.label}: {column.header} belongs to a quantity {column.name!r}, which has no column")
    if column.is_input and column is not quantity:
        raise DataError(f"{sheet.label}: {column.header} belongs to an input; inputs are known, delete the column")
    unit = rate_of(quantity.unit) if column.part == "rate" else quantity.unit
    if column.unit != unit:
        raise DataError(f"{sheet.label}: {column.header} does not have the unit {unit}, as {quantity.header} requires")


def _values(sheet: Sheet, column: Column) -> Array:
    """A column in its own unit's SI unit; standard errors must not be below zero."""
    stated = sheet.amounts(column.header) if column.is_sigma else sheet.numbers(column.header)
    with np.errstate(over="ignore"):
        values: Array = stated * column.factor
    if np.isinf(values).any():
        sheet.refuse(column.header, int(np.argmax(np.isinf(values))), f"is too large for a number in {column.unit}")
    return values


def _side_by_side(sheet: Sheet, columns: Mapping[Key, Column], keys: Sequence[Key]) -> Array:
    """The columns of these keys (n, len(keys)), NaN where there is none."""
    unknown = np.full(len(sheet.lines), np.nan)
    return np.column_stack([_values(sheet, columns[key]) if key in columns else unknown for key in keys])


def _some_valid(sheet: Sheet, positions: Mapping[str, Array]) -> Mask:
    valid = _valid(sheet, positions)
    if valid.size < 2:
        raise DataError(f"{sheet.label} holds one sample; a trajectory needs at least 2")
    if not valid.any():
        raise DataError(f"{sheet.label}: no line has a value for {' and '.join(positions)}; there is nothing to use")
    return valid


def _restored(columns: Sequence[Column], document: OriginDocument) -> tuple[Quantity, ...]:
    """The quantities of the columns, with the symbols that the origin file gives them."""
    entries = (*document.quantities, *document.inputs)
    known = {entry.quantity().column: entry.quantity() for entry in entries}
    return tuple(known.get(column.quantity.column, column.quantity) for column in columns)


def _segments(sheet: Sheet, document: OriginDocument) -> tuple[Segment, ...]:
    """The segments of the table; with their reasons where the origin file has the same segments."""
    if "segment" not in sheet:
        return ()
    labels = [cell.strip() or None for cell in sheet.columns["segment"]]
    known: tuple[str, ...] = get_args(SegmentLabel)
    for row, label in enumerate(labels):
        if label is not None and label not in known:
            sheet.refuse("segment", row, f"is not a segment; there are {', '.join(known)}, or blank")
    stated = tuple(entry.segment() for entry in document.segments)
    inside = all(segment.start < segment.stop <= len(labels) for segment in stated)
    if inside and segment_labels(stated, len(labels)) == labels:
        return stated
    edges = [0, *(row for row in range(1, len(labels)) if labels[row] != labels[row - 1]), len(labels)]
    runs = ((labels[start], start, stop) for start, stop in pairwise(edges))
    return tuple(Segment(cast("SegmentLabel", label), start, stop) for label, start, stop in runs if label is not None)


def _smoothed(
    sheet: Sheet,
    columns: Mapping[Key, Column],
    measured: Sequence[Column],
    document: OriginDocument,
) -> Smoothed | None:
    names = [column.name for column in measured]
    values, rates = ([(part, False, name) for name in names] for part in ("smooth", "rate"))
    missing = [key for key in (*values, *rates) if key not in columns]
    covariances = [header for header in sheet.columns if header.startswith("cov_")]
    if len(missing) == 2 * len(names) and not covariances:
        return None
    if missing:
        start = {"smooth": "smooth_", "rate": "d_"}[missing[0][0]]
        raise DataError(f"{sheet.label} has part of a smoothed state; {start}{missing[0][2]}_<unit> is missing")
    psd, nis = _smoothing(sheet, len(names), document)
    return Smoothed(
        position=_side_by_side(sheet, columns, values),
        velocity=_side_by_side(sheet, columns, rates),
        covariance=_covariance(sheet, columns, measured, covariances),
        psd=psd,
        nis=nis,
    )


def _covariance(
    sheet: Sheet,
    columns: Mapping[Key, Column],
    measured: Sequence[Column],
    headers: Sequence[str],
) -> Array:
    """Covariance (n, 2d, 2d) of the smoothed state: squares of its ``sigma_`` columns, and the ``cov_`` columns."""
    keys = [(part, True, column.name) for part in ("smooth", "rate") for column in measured]
    variance = np.square(_side_by_side(sheet, columns, keys))
    covariance = np.zeros((variance.shape[0], len(keys), len(keys)))
    covariance[:, range(len(keys)), range(len(keys))] = variance
    pairs = covariance_columns([column.quantity for column in measured])
    for header in headers:
        if header not in pairs:
            raise DataError(
                f"{sheet.label}: {header} is not a covariance of this table; there could be {', '.join(pairs)}"
            )
        first, second = pairs[header]
        covariance[:, first, second] = covariance[:, second, first] = sheet.numbers(header)
    return covariance


def _smoothing(sheet: Sheet, d: int, document: OriginDocument) -> tuple[Array, Array]:
    """Process noise and NIS of each quantity, NaN where the origin file does not state them."""
    smoothing = document.smoothing
    if smoothing is None:
        return np.full(d, np.nan), np.full(d, np.nan)
    if not len(smoothing.psd) == len(smoothing.nis) == d:
        raise DataError(
            f"{side_car_of(sheet.label)} is of another table: smoothing of {d} quantities is wanted; delete it"
        )
    return np.array([number(value) for value in smoothing.psd]), np.array([number(value) for value in smoothing.nis])
