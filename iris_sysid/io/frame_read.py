"""Read a trajectory from a pandas DataFrame, by the rules by which tables are read from files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, get_args

from iris_sysid.errors import DataError
from iris_sysid.io.csv_cells import Sheet
from iris_sysid.io.csv_read import trajectory_of_cells, trajectory_of_sheet
from iris_sysid.io.files import origin_of
from iris_sysid.io.table_cells import Cells
from iris_sysid.types import Quantity, Sensor, Trajectory

if TYPE_CHECKING:
    import pandas as pd

LABEL = "data frame"
OWN_TIME = "t_s"


def from_frame(frame: pd.DataFrame, columns: Mapping[str, str] | None = None) -> Trajectory:
    """Make a trajectory of a pandas DataFrame with a column of times and columns of quantities, one row a sample.

    Columns are named as in the tables of :func:`iris_sysid.read_trajectory`: ``t_s`` and ``theta_rad``, ``sigma_`` for
    standard errors, ``u_V`` for inputs; or as other programs name them, ``time [s]`` and ``Winkel (deg)``. A unit may
    also stand in ``frame.attrs["units"]``, by column. Times may be the index, if it has a name, and may be pandas'
    dates or time spans. A missing value is a gap. ``frame.attrs["sensor"]`` says what measured.

    Parameters
    ----------
    frame
        One row a sample, in the order of time.
    columns
        Column of each quantity where the names do not tell: ``{"t": "when", "theta[deg]": "left arm"}``.

    Returns
    -------
    Trajectory
        What was made of the columns is in ``origin["read_as"]``, converted units in ``origin["converted"]``.

    Raises
    ------
    DataError
        When a unit is missing or unknown, a cell is not a number, or times do not increase.

    Examples
    --------
    >>> import pandas as pd
    >>> from iris_sysid import Trajectory
    >>> table = pd.DataFrame({"time [s]": [0.0, 0.1, 0.2], "angle [deg]": [10.0, 5.0, None]})
    >>> Trajectory.from_frame(table)
    Trajectory of theta (rad): 3 samples from 0 to 0.2 s, 1 of them gaps
    """
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise DataError(f"a pandas DataFrame is wanted, not {type(frame).__name__}")
    if frame.empty:
        raise DataError("the data frame is empty: it needs a column of times, one of a quantity, and a row a sample")
    table = frame.reset_index() if any(name is not None for name in frame.index.names) else frame
    lines = list(range(len(table)))
    origin = origin_of(
        None, {str(name): value for name, value in frame.attrs.items() if isinstance(value, str | int | float)}
    )
    if columns is None and OWN_TIME in table.columns and table.columns.nlevels == 1:
        own = {str(name): _cells(table.iloc[:, k])[1] for k, name in enumerate(table.columns)}
        if len(own) < table.shape[1]:
            raise DataError("the data frame has two columns of the same name; rename or delete one")
        trajectory = trajectory_of_sheet(Sheet(LABEL, own, lines), origin)
    else:
        trajectory = trajectory_of_cells(_as_cells(table, lines), columns, origin)
    return trajectory.with_(sensor=_sensor(frame.attrs))


def _sensor(attrs: Mapping[Any, Any]) -> Sensor:
    known: tuple[Sensor, ...] = get_args(Sensor)
    stated = attrs.get("sensor", "unknown")
    if stated not in known:
        raise DataError(f"attrs['sensor'] is {stated!r:.40}; it may be {', '.join(known)}")
    sensor: Sensor = stated
    return sensor


def _as_cells(table: pd.DataFrame, lines: list[int]) -> Cells:
    """The frame as the cells of a table with as many header rows as its columns have levels."""
    titles, cells = [], []
    units = {str(name): str(unit) for name, unit in dict(table.attrs.get("units", {})).items()}
    for k in range(table.shape[1]):
        levels = table.columns[k] if table.columns.nlevels > 1 else (table.columns[k],)
        *groups, name = (str(level) for level in levels)
        own, column = _cells(table.iloc[:, k])
        unit = own or units.get(name, units.get(name.removeprefix("sigma_"), ""))
        titles.append((*groups, Quantity(name, unit).title))
        cells.append(column)
    header = tuple(tuple(row) for row in zip(*titles, strict=True))
    rows = tuple(tuple(row) for row in zip(*cells, strict=True))
    return Cells(LABEL, LABEL, header, rows, tuple(lines), decimal_comma=False, said=())


def _cells(column: pd.Series[Any]) -> tuple[str, list[str]]:
    """The unit that the type of a column states, and its cells as text, exact for numbers, blank where missing."""
    import pandas as pd

    unit = ""
    if pd.api.types.is_datetime64_any_dtype(column):
        column = column - column.iloc[0]
    if pd.api.types.is_timedelta64_dtype(column):
        unit, column = "s", column.dt.total_seconds()
    if pd.api.types.is_bool_dtype(column):
        column = column.astype("Int64")
    missing = column.isna()
    if pd.api.types.is_numeric_dtype(column) and not missing.any():
        return unit, [repr(value) for value in column.tolist()]
    return unit, ["" if gap else str(value) for value, gap in zip(column.tolist(), missing.tolist(), strict=True)]
