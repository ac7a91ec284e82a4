"""One table of many groups: a column names the group of each row, and each group's rows are a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.io.csv_read import trajectory_of_cells
from iris_sysid.io.files import origin_of
from iris_sysid.io.group_column import names_in, several_groups
from iris_sysid.io.table_cells import Cells, read_cells
from iris_sysid.io.table_headers import titles_of
from iris_sysid.types import Trajectory


def groups_of_table(path: str | Path, column: str | None = None) -> tuple[str, tuple[str, ...]]:
    """The title of the column that names the groups, and the names in the order of their first rows.

    Without a title it is the column that is called group, team, id or the like. DataError when there is no such column,
    or it does not name groups of rows.
    """
    cells = read_cells(path)
    k = _group_column(cells, titles_of(cells), column)
    return titles_of(cells)[k], names_in(row[k] for row in cells.rows)


def read_group(path: str | Path, column: str, name: str, columns: Mapping[str, str] | None = None) -> Trajectory:
    """The trajectory of one group of a table.

    Parameters
    ----------
    path
        The table.
    column
        Title of the column that names the groups.
    name
        The group.
    columns
        Column of each quantity, as for :func:`iris_sysid.read_trajectory`.

    Raises
    ------
    DataError
        When the column or the group is not there, or its rows are not a trajectory.
    """
    cells = read_cells(path)
    k = _group_column(cells, titles_of(cells), column)
    rows = [row for row, values in enumerate(cells.rows) if values[k].strip() == name]
    if not rows:
        raise DataError(f"{cells.label} has no group {name!r:.60} in its column {column!r:.60}")
    own = replace(
        cells,
        rows=tuple(cells.rows[row] for row in rows),
        lines=tuple(cells.lines[row] for row in rows),
    )
    return trajectory_of_cells(own, columns, origin_of(cells.file, {}))


def _group_column(cells: Cells, titles: Sequence[str], wanted: str | None) -> int:
    have = ", ".join(f"{title!r:.40}" for title in titles[:20])
    if wanted is None:
        found = [k for k, title in enumerate(titles) if several_groups(title, [row[k] for row in cells.rows])]
        if not found:
            raise DataError(f"{cells.label} has no column that names the groups; its columns are {have}; name it")
        return found[0]
    same = [k for k, title in enumerate(titles) if title.casefold() == wanted.casefold()]
    if len(same) != 1:
        problem = "more than one column" if same else "no column"
        raise DataError(f"{cells.label} has {problem} {wanted!r:.60}; its columns are {have}")
    return same[0]
