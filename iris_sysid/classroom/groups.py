"""Find the groups of a class: clips and tables in a folder, or the groups that one table holds."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from iris_sysid.errors import DataError
from iris_sysid.io.grouped_table import groups_of_table
from iris_sysid.io.windows_paths import RESERVED
from iris_sysid.pipeline.clip_folders import CLIP_SUFFIXES as CLIPS
from iris_sysid.pipeline.one_clip import RunRequest
from iris_sysid.types import Phenomenon

TABLES = (".csv", ".txt", ".tsv", ".dat", ".xlsx", ".xls")
GROUPS_FILE = "groups.csv"  # beside the clips: what is special about single groups
TRUTH = ".truth.csv"  # beside a clip that iris-sysid render made
RUN_TABLE = "trajectory.csv"  # in a folder that iris-sysid run wrote
MAX_GROUPS = 1000
MAX_NAME = 60


@dataclass(frozen=True, eq=False, slots=True)
class GroupRequest(RunRequest):
    """How a group is to be measured.

    ``columns`` names the columns of a table of another program. ``typed`` holds the options as a reader knows them, for
    the origin of the results.
    """

    phenomenon: Phenomenon
    columns: Mapping[str, str] | None = None
    typed: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Source:
    """The file of a group: a clip or a table; ``row`` is its name in the ``column`` of a table of many groups."""

    group: str
    path: Path
    column: str = ""
    row: str = ""

    @property
    def is_table(self) -> bool:
        """Whether it holds numbers rather than images."""
        return self.path.suffix.lower() in TABLES

    @property
    def folder(self) -> str:
        """A name for the folder of its results that every file system takes, and no other group has."""
        plain = re.sub(r"[^\w.-]+", "-", self.group).strip("-. ")[:MAX_NAME]
        if plain and plain == self.group == plain.lower() and not RESERVED.fullmatch(plain):
            return plain
        return f"{plain or 'group'}-{hashlib.sha256(self.group.encode('utf-8', 'surrogateescape')).hexdigest()[:6]}"


@dataclass(frozen=True, eq=False, slots=True)
class Group:
    """One group of a class: its file, and how it is to be measured."""

    source: Source
    request: GroupRequest

    @property
    def name(self) -> str:
        """As the teacher knows it."""
        return self.source.group


def sources_in(path: Path, column: str | None = None) -> list[Source]:
    """The files of all groups, in the order of their names; numbers count as numbers.

    The path is a folder with a clip, a table, or a folder of ``iris-sysid run`` for each group; or one table with a
    column that names the groups: ``column`` is its title, where it is not called group, team, id or the like. DataError
    when there is no group, two have one name, or there are more than a thousand.
    """
    if path.is_dir():
        found = list(_files_in(path))
        if not found:
            kinds = ", ".join(suffix.removeprefix(".") for suffix in (*CLIPS, *TABLES))
            raise DataError(f"{path} holds no group: put a clip or a table of each group into it ({kinds})")
    else:
        title, names = groups_of_table(path, column)
        found = [Source(name, path, title, name) for name in names]
    _check_names(found, path)
    return sorted(found, key=lambda source: in_order(source.group))


def in_order(name: str) -> tuple[tuple[bool, int, str], ...]:
    """A key by which group 9 comes before group 10."""
    parts = re.findall(r"[0-9]{1,15}|[^0-9]+", name.casefold())
    return tuple((not part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts)


def _files_in(folder: Path) -> Iterable[Source]:
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.name == GROUPS_FILE or path.name.endswith(TRUTH):
            continue
        if path.is_dir():
            yield from _of_a_folder(path)
        elif path.suffix.lower() in (*CLIPS, *TABLES):
            yield Source(path.stem, path)


def _of_a_folder(folder: Path) -> Iterable[Source]:
    """The group whose files are in a folder: what ``run`` wrote, or its only clip or table; none without one."""
    if (folder / RUN_TABLE).is_file():
        yield Source(folder.name, folder / RUN_TABLE)
        return
    files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() in (*CLIPS, *TABLES) and path.is_file()]
    if len(files) > 1:
        names = ", ".join(path.name for path in files[:4])
        raise DataError(f"{folder} holds several clips or tables ({names}): leave one of each group")
    yield from (Source(folder.name, path) for path in files)


def _check_names(found: Sequence[Source], path: Path) -> None:
    if len(found) > MAX_GROUPS:
        raise DataError(f"{path} holds {len(found)} groups; at most {MAX_GROUPS} are compared: is it one class?")
    seen: dict[str, Source] = {}
    for source in found:
        if source.group in seen:
            other = seen[source.group].path.name
            raise DataError(f"two groups are called {source.group!r:.80} ({other}, {source.path.name}): rename one")
        seen[source.group] = source
