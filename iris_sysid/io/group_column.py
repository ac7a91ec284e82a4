"""The column of a table that names the group of each row, by its title."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from iris_sysid.io.csv_cells import BLANK

GROUP_TITLES = (
    "group", "groups", "group_name", "gruppe", "groupe", "grupo", "gruppo", "team", "id", "run", "trial", "versuch",
    "lauf", "clip", "pupil", "student", "student_id", "series", "serie", "drop",
)  # fmt: skip
MIN_ROWS = 3  # of a group, on average: fewer are not a motion, so that the column does not name groups


def names_groups(title: str) -> bool:
    """Whether a column of that title names groups: group, team, id or the like."""
    return "_".join(title.strip().casefold().split()) in GROUP_TITLES


def names_in(cells: Iterable[str]) -> tuple[str, ...]:
    """The groups that the cells of a column name, each once, in the order of their first rows."""
    return tuple(dict.fromkeys(cell.strip() for cell in cells if cell.strip() not in BLANK))


def several_groups(title: str, cells: Sequence[str]) -> tuple[str, ...]:
    """The groups that a column names; empty where its title is another, or it does not name groups of rows."""
    if not names_groups(title):
        return ()
    names = names_in(cells)
    return names if 1 < len(names) <= len(cells) / MIN_ROWS else ()
