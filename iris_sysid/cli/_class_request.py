"""The groups of a class with the options that hold for all of them, and those of ``groups.csv`` for single ones."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from iris_sysid.classroom.groups import GROUPS_FILE, Group, GroupRequest, Source, sources_in
from iris_sysid.cli import _parsing
from iris_sysid.cli.arguments import FilmArguments
from iris_sysid.errors import DataError, IrisError, UnknownNameError
from iris_sysid.io.files import read_file
from iris_sysid.io.table_headers import parse_columns
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate, Phenomenon

# columns of groups.csv beside the group: an option each; several values of one are divided by ;
ONE = ("scale", "scale_bar", "calibration", "fps", "start", "stop", "roi", "colour", "columns")
SEVERAL = ("mark", "set", "free")
NUMBERS = ("fps", "start", "stop")


@dataclass(frozen=True, slots=True)
class ClassOptions:
    """The options of ``class`` that say how a group is measured, as typed."""

    phenomenon: Phenomenon
    film: FilmArguments
    columns: str | None = None

    def request(self) -> GroupRequest:
        """The typed request; DataError or CalibrationError for what cannot be read."""
        request = self.film.request(self.phenomenon).values()
        columns = None if self.columns is None else parse_columns(self.columns)
        return GroupRequest(**{**request, "columns": columns, "typed": self._typed()})

    def _typed(self) -> dict[str, Any]:
        """The options as typed, for the origin of what is measured."""
        from iris_sysid.io.files import sha256_of

        options = {name: value for name, value in asdict(self.film).items() if value not in (None, [])}
        if self.film.calibration is not None:
            options["calibration"] = sha256_of(self.film.calibration)
        return {"phenomenon": self.phenomenon.name, "columns": self.columns, **options}

    def changed(self, given: Mapping[str, str], label: str) -> ClassOptions:
        """These options with those of one group in their place; ``label`` names its line in an error."""
        one = {name: given[name] for name in ONE if given.get(name)}
        several = {name: [part.strip() for part in given[name].split(";")] for name in SEVERAL if given.get(name)}
        own: dict[str, Any] = _scale_of(one) | {name: one[name] for name in ("roi", "colour") if name in one}
        own |= {name: _number(one[name], f"{label}, column {name}") for name in NUMBERS if name in one}
        film = replace(
            self.film,
            **own,
            mark=_with_own(self.film.mark, several.get("mark", ())),
            known=_with_own(self.film.known, several.get("set", ())),
            free=[*self.film.free, *several.get("free", ())],
        )
        return replace(self, film=film, columns=one.get("columns", self.columns))


def _with_own(common: Sequence[str], own: Sequence[str]) -> list[str]:
    """Texts ``name=value`` of all groups, with those of one group in place of the same names."""
    names = {text.partition("=")[0].strip() for text in own}
    return [*(text for text in common if text.partition("=")[0].strip() not in names), *own]


def _scale_of(given: Mapping[str, str]) -> dict[str, Any]:
    """The scale of one group, in place of any other; empty where the group states none."""
    own: dict[str, Any] = {name: given.get(name) for name in ("scale", "scale_bar", "calibration")}
    if own["calibration"] is not None:
        own["calibration"] = Path(own["calibration"])
    return own if any(own.values()) else {}


def references(phenomenon: Phenomenon, known: Sequence[str], value: str | None) -> dict[str, Estimate]:
    """What the class should find, by name; UnknownNameError for a name that the phenomenon's model does not have.

    ``value`` is the name of the value to compare, which is checked as well.
    """
    model = MODELS[phenomenon.model]
    units = model.units() | {quantity.name: quantity.unit for quantity in model.derived}
    stated = _parsing.settings(known, units)
    for name in (*stated, *([value] if value else [])):
        if name not in units:
            raise UnknownNameError(f"{phenomenon.name} has no value {name!r:.60}; it has {', '.join(units)}")
    return stated


def groups_of(
    path: Path, options: ClassOptions, column: str | None, teacher: str | None
) -> tuple[list[Group], Group | None]:
    """The groups of a class, and the teacher's own: one of the groups, or a file.

    Raises a DataError when there is no group, or groups.csv cannot be read.
    """
    sources = sources_in(path, column)
    given = _given(path, sources) if path.is_dir() else {}
    common = options.request()  # also refuses wrong options where every group has its own
    groups = [
        Group(source, _own(options, given[source.group]) if source.group in given else common) for source in sources
    ]
    if teacher is None:
        return groups, None
    own = next((group for group in groups if group.name == teacher), None)
    if own is not None:
        return [group for group in groups if group is not own], own
    if not Path(teacher).is_file():
        names = ", ".join(group.name for group in groups[:8])
        raise DataError(f"--teacher {teacher!r:.80} is neither a group ({names}) nor a file")
    return groups, Group(Source("teacher", Path(teacher)), common)


def _own(options: ClassOptions, line: tuple[Mapping[str, str], str]) -> GroupRequest:
    given, label = line
    try:
        return options.changed(given, label).request()
    except IrisError as error:
        raise DataError(f"{label}: {error}") from error


def _given(folder: Path, sources: Sequence[Source]) -> dict[str, tuple[Mapping[str, str], str]]:
    """The options of single groups in groups.csv, each with the place to name in an error."""
    file = folder / GROUPS_FILE
    if not file.is_file():
        return {}
    text = read_file(file).decode("utf-8-sig", "replace")
    first = text.splitlines()[0] if text.strip() else ""
    rows = list(csv.DictReader(io.StringIO(text), delimiter=";" if first.count(";") > first.count(",") else ","))
    titles = [title.strip() for title in (rows[0].keys() if rows else []) if title is not None]
    unknown = [title for title in titles if title not in ("group", *ONE, *SEVERAL)]
    if "group" not in titles or unknown:
        what = f"it has no column {unknown[0]!r:.40}" if unknown else "it needs a column group"
        raise DataError(f"{file}: {what}; columns are group, {', '.join((*ONE, *SEVERAL))}")
    names = {source.group for source in sources}
    found: dict[str, tuple[Mapping[str, str], str]] = {}
    for number, row in enumerate(rows, start=2):
        plain = {(key or "").strip(): (value or "").strip() for key, value in row.items() if isinstance(value, str)}
        name, label = plain.get("group", ""), f"{file} line {number}"
        if name not in names:
            raise DataError(f"{label}: there is no group {name!r:.60}; groups are {', '.join(sorted(names)[:12])}")
        if name in found:
            raise DataError(f"{label}: the group {name!r:.60} is there twice")
        found[name] = (plain, label)
    return found


def _number(text: str, label: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError as error:
        raise DataError(f"{label}: {text!r:.40} is not a number") from error
