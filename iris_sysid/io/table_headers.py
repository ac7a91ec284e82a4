"""What the columns of a table mean: name and unit from its header in the words of any program, or as the user says.

The columns that are understood get the names of this project's own tables, ``theta_deg`` for ``Winkel (°)``, and a note
states what was understood. A unit is never assumed in silence: a position without one is refused with the option that
states it, a time without one is in seconds, with a note.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from iris_sysid.errors import DataError
from iris_sysid.io.csv_cells import BLANK, Sheet
from iris_sysid.io.csv_columns import COUNTS, INPUT, SUFFIXES, without_slash
from iris_sysid.io.table_cells import Cells, read_cells
from iris_sysid.types import Quantity
from iris_sysid.units import COLUMN_UNITS

EXAMPLE = {"t": "Time (s)", "theta[deg]": "Angle"}  # where the columns of the table are not known


class Spelled(NamedTuple):
    """The unit of a column of this project, the ``factor`` to it, and what a reading of zero is in it."""

    unit: str
    factor: float = 1.0
    zero: float = 0.0


# how programs and people spell a unit
SPELLED: Mapping[str, Spelled] = {
    **{name: Spelled(name) for name in (*COLUMN_UNITS, *SUFFIXES) if name != "1"},
    **dict.fromkeys(
        ("sec", "secs", "second", "seconds", "sek", "sekunden", "segundos", "secondes", "sek."), Spelled("s")
    ),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "millisekunden", "milisegundos"), Spelled("ms")),
    **dict.fromkeys(("µs", "us", "μs", "microseconds"), Spelled("ms", 1e-3)),
    **dict.fromkeys(("min", "minutes", "minuten", "minutos"), Spelled("s", 60.0)),
    **dict.fromkeys(("°", "º", "degree", "degrees", "grad", "graus", "grados", "degres", "gradi"), Spelled("deg")),
    **dict.fromkeys(("radian", "radians", "radiant", "radianes", "radianos"), Spelled("rad")),
    **dict.fromkeys(("meter", "meters", "metre", "metres", "metro", "metros"), Spelled("m")),
    **dict.fromkeys(("centimeter", "centimeters", "centimetre", "centimetres"), Spelled("cm")),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), Spelled("mm")),
    **dict.fromkeys(("in", "inch", "inches", "zoll"), Spelled("m", 0.0254)),
    **dict.fromkeys(("ft", "foot", "feet"), Spelled("m", 0.3048)),
    "km": Spelled("m", 1000.0),
    **dict.fromkeys(("pixel", "pixels", "pix", "pxl"), Spelled("px")),
    **dict.fromkeys(("volt", "volts"), Spelled("V")),
    **dict.fromkeys(("Nm", "N m", "N*m", "N·m"), Spelled("N_m")),
    **dict.fromkeys(
        ("rev", "revolution", "revolutions", "turn", "turns", "umdrehungen"), Spelled("rad", 2.0 * math.pi)
    ),
    "rpm": Spelled("rad_s", math.pi / 30.0),
    "mph": Spelled("m_s", 0.44704),
    **dict.fromkeys(("kmh", "kph"), Spelled("m_s", 1.0 / 3.6)),
    **dict.fromkeys(("degC", "°C", "celsius", "centigrade"), Spelled("K", 1.0, 273.15)),
    **dict.fromkeys(("degF", "°F", "fahrenheit"), Spelled("K", 5 / 9, 273.15 - 32 * 5 / 9)),
}
SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}  # in what a rate is per
TIMES = (
    "t",
    "time",
    "times",
    "zeit",
    "temps",
    "tiempo",
    "tempo",
    "tid",
    "tijd",
    "czas",
    "cas",
    "timestamp",
    "timestamps",
)
# words for a quantity -> its name here
QUANTITIES: Mapping[str, str] = {
    **dict.fromkeys(
        ("theta", "θ", "angle", "winkel", "angulo", "angolo", "vinkel", "hoek", "kat", "phi", "φ"), "theta"
    ),
    **dict.fromkeys(("z", "height", "hohe", "altura", "altezza", "hauteur", "elevation"), "z"),
    **dict.fromkeys(("level", "liquid_level", "fullhohe", "nivel"), "h"),
}
MAX_TITLE = 300  # characters; a longer one is not a name with a unit
FRAMES = ("frame", "frames", "bild", "image", "index", "step")
BRACKETED = re.compile(r"(?P<name>.*?)\s*[\(\[]\s*(?P<unit>[^()\[\]]*?)\s*[\)\]]\s*")
PER_TIME = r"/(?:s(?:\^?[23]|²)?|min|h)"
RATE = rf"(?:{PER_TIME})?"
DIVIDED = re.compile(rf"(?P<name>.*?)(?:\s*/\s*|\s+in\s+)(?P<unit>[^\s/]+{RATE})\s*")
ENDING = re.compile(rf"(?P<name>.*?)[_\s]+(?P<unit>(?![AVNKWL1]\b)[^\s/_]+{RATE})\s*")  # ball_A is not a current
SPEED = re.compile(rf"(?P<name>.*?)[_\s]+(?P<unit>[^\s/_]+{PER_TIME})\s*")  # v_m/s is not v_m in s
ENDS_IN_RATE = re.compile(rf".*?(?P<unit>[^\s/_(\[]+{PER_TIME})\s*[)\]]?\s*")
NAMED = re.compile(  # but this is
    r"(?P<name>(?:.*[_\s])?(?:force|voltage|current|power|temperature))[_\s]+(?P<unit>[AVNKW])\s*", re.IGNORECASE
)
OWN = re.compile(r"(?P<name>[uyi][0-9]*)_(?P<unit>\S+)")  # u_V is a voltage, as in a table of this project
RUN = re.compile(r"(?:[^:()\[\]]*:\s*)?(?P<title>.+?)(?:,?\s+run\s*#?\s*[0-9]+)?", re.IGNORECASE)  # Latest: Time (s)
STATED = re.compile(
    r"(?P<name>[A-Za-z]\w*)\s*(?:\[\s*(?:(?P<share>1/)?(?P<factor>-?[0-9]+\.?[0-9]*(?:[eE][-+]?[0-9]+)?)\s+)?(?P<unit>[^\]]*)\])?"
)
TIME_UNITS = ("s", "ms")
RECORDED = re.compile(r"[uy][0-9]*")  # inputs and outputs of a record
ROW = -1  # stands for the number of the row, as a column


@dataclass(frozen=True, slots=True)
class Meaning:
    """The ``column``, from 0, that holds the quantity ``name`` in ``unit`` (of COLUMN_UNITS) times ``factor``.

    ``zero``, in that unit, is what a reading of zero is.
    """

    column: int
    name: str
    unit: str
    factor: float = 1.0
    zero: float = 0.0

    @property
    def header(self) -> str:
        """Name of the column in a table of this project."""
        return f"{self.name}_{self.unit}"

    @property
    def unit_name(self) -> str:
        """Name and unit as the user may state them."""
        return f"{self.name}[{self.unit_text}]"

    @property
    def unit_text(self) -> str:
        """The unit with its factor, as the user may state it."""
        if self.zero:
            return next(text for text, each in SPELLED.items() if each.zero == self.zero)
        unit = self.unit.replace("_s", "/s")
        return f"{self.factor:g} {unit}" if self.factor != 1.0 else unit


def parse_headers(cells: Cells, stated: Mapping[str, str] | None = None) -> tuple[Sheet, tuple[str, ...]]:
    """The columns that a trajectory takes, under this project's names, and what was understood of the header.

    Parameters
    ----------
    cells
        The cells of the table.
    stated
        Header, or number from 1, of the column of each quantity: ``{"t": "Zeit (s)", "theta[deg]": "Winkel"}``.
        Only these columns are read; without it, or where it states the time alone, all that are understood.

    Raises
    ------
    DataError
        When a column is not there, has no unit that can be told, or is two quantities' at once.
    """
    titles = titles_of(cells)
    time = _stated_time(cells, titles, stated or {})
    meanings = _stated(cells, titles, stated) if stated and time is None else _guessed(cells, titles, time)
    _check_names(cells, titles, meanings)
    columns = {
        "t_s" if meaning.name == "t" else meaning.header: _column_of(cells, meaning.column) for meaning in meanings
    }
    factors = {
        "t_s" if meaning.name == "t" else meaning.header: factor
        for meaning in meanings
        if (factor := _factor(meaning)) != 1.0
    }
    zeros = {meaning.header: meaning.zero for meaning in meanings if meaning.zero}
    sheet = Sheet(cells.label, columns, list(cells.lines), cells.decimal_comma, factors, zeros)
    return sheet, (*cells.said, *_said(titles, meanings))


def _column_of(cells: Cells, column: int) -> list[str]:
    if column == ROW:
        return [str(k) for k in range(len(cells.rows))]
    return [row[column] for row in cells.rows]


def _factor(meaning: Meaning) -> float:
    """From the number in the file to the unit of the header: times are in seconds."""
    return meaning.factor * (1e-3 if meaning.name == "t" and meaning.unit == "ms" else 1.0)


def _said(titles: Sequence[str], meanings: Sequence[Meaning]) -> tuple[str, ...]:
    read = [f"{meaning.name} = {_source(titles, meaning)} in {meaning.unit_text}" for meaning in meanings]
    used = {meaning.column for meaning in meanings}
    left = [repr(title)[:60] for k, title in enumerate(titles) if k not in used and title]
    return (*read, *([f"left out: {', '.join(left[:8])}{', ...' if len(left) > 8 else ''}"] if left else ()))


def _source_title(titles: Sequence[str], meaning: Meaning) -> str:
    return "row" if meaning.column == ROW else f"{titles[meaning.column]:.60}"


def _source(titles: Sequence[str], meaning: Meaning) -> str:
    return "number of the row" if meaning.column == ROW else f"column {titles[meaning.column]!r:.60}"


# --------------------------------------------------------------------------- header rows


def titles_of(cells: Cells) -> list[str]:
    """One title a column of ``cells``: group and name joined, units put in brackets; its number without a title."""
    header = [row for row in cells.header if sum(map(bool, row)) > 1 or len(row) == 1]
    units: tuple[str, ...] = ()
    if len(header) > 1 and all(_unit(cell) for cell in header[-1] if cell):
        units, header = header[-1], header[:-1]
    if not header:
        return [f"{k}{_bracketed(units, k - 1)}" for k in range(1, len(cells.rows[0]) + 1)]
    names = list(header[-1])
    groups = _filled(header[-2]) if len(header) > 1 else [""] * len(names)
    joined = [f"{group}/{name}" if group and name else name for group, name in zip(groups, names, strict=True)]
    return [f"{title}{_bracketed(units, k)}" for k, title in enumerate(joined)]


def _bracketed(units: Sequence[str], k: int) -> str:
    return f" ({units[k].strip('()[] ')})" if units and units[k] else ""


def _filled(groups: Sequence[str]) -> list[str]:
    """Names of groups, each over the columns up to the next; none where all are of one group."""
    filled, last = [], ""
    for group in groups:
        last = group or last
        filled.append(last)
    return filled if len(set(filled)) > 1 else [""] * len(filled)


def _unit(text: str) -> Spelled | None:
    """What a unit is in a column of this project; None where it is not a unit."""
    plain = unicodedata.normalize("NFKD", text.strip().strip("()[] ").replace("²", "^2").replace("³", "^3"))
    plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
    forms = (text.strip(), plain, without_slash(plain), plain.lower())
    return next((SPELLED[form] for form in forms if form in SPELLED), None) or _rate(plain)


def _rate(text: str) -> Spelled | None:
    """The same of a spelled unit per s, min or h: ``km/h``."""
    above, _, below = text.rpartition("/")
    base, seconds = SPELLED.get(above) or SPELLED.get(above.lower()), SECONDS.get(below.lower())
    if base is None or seconds is None or f"{base.unit}_s" not in SUFFIXES:
        return None
    return Spelled(f"{base.unit}_s", base.factor / seconds)


def states_unit(title: str) -> bool:
    """Whether a title states a unit, as this project's tables or any program spell it."""
    return _taken_apart(title)[1] is not None


def _taken_apart(title: str) -> tuple[str, Spelled | None]:
    """Name and unit of a title; no unit where none can be told."""
    if len(title) > MAX_TITLE:
        return title, None
    rated = ENDS_IN_RATE.fullmatch(title)
    if "/" in title and _unit(title.rpartition("/")[2]) is None and not (rated and _unit(rated["unit"])):
        title = title.rpartition("/")[2]
    run = RUN.fullmatch(title)
    every = [_split(run["title"] if run else title), _split(title)]
    return next((each for each in every if each[1]), every[0])


def _split(title: str) -> tuple[str, Spelled | None]:
    """The same of a title without the name of its run or group."""
    for pattern in (OWN, NAMED, BRACKETED, SPEED, DIVIDED, ENDING):
        match = pattern.fullmatch(title)
        unit = _unit(match["unit"]) if match and match["name"] else None
        if match and unit:
            return match["name"], unit
    return title, None


def _plain(name: str) -> str:
    """A name in small letters without accents, words joined by underscores."""
    letters = unicodedata.normalize("NFKD", name.strip().lower())
    return re.sub(r"\W+", "_", "".join(c for c in letters if not unicodedata.combining(c))).strip("_")


# --------------------------------------------------------------------------- guess


def _guessed(cells: Cells, titles: Sequence[str], time: Meaning | None = None) -> list[Meaning]:
    """The time and every numeric column with a unit; DataError where that leaves no time or nothing to fit.

    An input needs no unit, and beside one an output y, y1, ... neither. A speed or an acceleration is read where
    nothing else is measured, or beside an input what it is the rate of is not.
    """
    numeric = _numeric(cells, titles)
    time = time or _time(cells, titles, numeric)
    driven = any(INPUT.fullmatch(_plain(_taken_apart(titles[k])[0])) for k in numeric)
    meanings: list[Meaning] = [time]
    rates: list[Meaning] = []
    unknown: list[str] = []
    for k in numeric:
        name, unit = _taken_apart(titles[k])
        counts = _plain(name) in (*TIMES, *FRAMES) and (unit is None or unit.unit in TIME_UNITS)  # T (°C) does not
        if k == time.column or counts or not name:
            continue
        if unit is None and (_plain(name) in COUNTS or (driven and RECORDED.fullmatch(_plain(name)))):
            unit = Spelled("1")
        named = QUANTITIES.get(_plain(name), "temperature" if _plain(name) == "t" else _plain(name))
        kept = meanings if unit is None or unit.unit in COLUMN_UNITS or INPUT.fullmatch(named) else rates
        if unit is None or not re.match(r"[a-z]", named) or any(meaning.name == named for meaning in kept):
            unknown.append(titles[k])
            continue
        kept.append(Meaning(k, named, *unit))
    measured = {SUFFIXES[each.unit][0] for each in meanings if each is not time and not INPUT.fullmatch(each.name)}
    if driven or not measured:
        meanings += [each for each in rates if SUFFIXES[each.unit][0].partition("/")[0] not in measured]
    if len(meanings) > 1:
        return _upwards(meanings)
    wanted = ", ".join(f"{title!r:.40}" for title in unknown[:4]) or "none besides the time"
    raise DataError(
        f"{cells.label}: no column states a position, an angle or a level with its unit (columns: {wanted}); say what "
        "they hold",
        columns={"t": titles[time.column], **example_of(unknown)},
    )


def _stated_time(cells: Cells, titles: Sequence[str], stated: Mapping[str, str]) -> Meaning | None:
    """The time where it is all that the user states; None otherwise."""
    names = [match["name"] for match in map(STATED.fullmatch, map(str.strip, stated)) if match]
    if names != ["t"] or len(stated) > 1:
        return None
    ((name, title),) = stated.items()
    return _one_stated(cells, titles, name, title)


def columns_for(path: str | Path, quantities: Sequence[Quantity]) -> dict[str, str]:
    """An example of the columns of a table that hold some quantities: its own titles in order, inputs called u last."""
    cells = read_cells(path)
    titles = titles_of(cells)
    numeric = _numeric(cells, titles)
    try:
        time = _time(cells, titles, numeric).column
    except DataError:
        time = 0
    others = [k for k in numeric if k != time]
    others.sort(key=lambda k: INPUT.fullmatch(_plain(_taken_apart(titles[k])[0])) is not None)
    shown = [titles[k] for k in others] or ["COLUMN"]
    asked = {}
    for quantity in quantities:
        units = {title: _unit_of(title, quantity) for title in shown}
        title = next((title for title, unit in units.items() if unit), shown[0])
        unit = units[title]  # a column in mm is not to be read in m
        name = Meaning(0, quantity.name, *unit).unit_name if unit else f"{quantity.name}[{quantity.unit}]"
        asked[name] = title[:60]
        shown = [other for other in shown if other != title] or shown
    return {"t": f"{titles[time]:.60}", **asked}


def _unit_of(title: str, quantity: Quantity) -> Spelled | None:
    """The unit that a column states, where it is of the kind that a quantity has; else None."""
    unit = _taken_apart(title)[1]
    return unit if unit is not None and quantity.unit and SUFFIXES[unit.unit][0] == quantity.unit else None


def example_of(titles: Sequence[str]) -> dict[str, str]:
    """How to name the column of a quantity, by one of these titles."""
    title = titles[-1] if titles else "NAME"
    name = QUANTITIES.get(_plain(_taken_apart(title)[0]), "x")
    return {f"{name}[{'rad' if name == 'theta' else 'm'}]": f"{title:.60}"}


def _upwards(meanings: list[Meaning]) -> list[Meaning]:
    """The same with y in a unit of length as z: outside of images y points upwards, which is called z here."""
    names = {meaning.name for meaning in meanings}
    if "x" not in names or "z" in names:
        return meanings
    return [replace(each, name="z") if each.name == "y" and each.unit != "px" else each for each in meanings]


def _time(cells: Cells, titles: Sequence[str], numeric: Sequence[int]) -> Meaning:
    """The column of the times; in seconds where it states no unit, which the notes on what was read state."""
    for k in numeric:
        name, unit = _taken_apart(titles[k])
        if _plain(name) in TIMES and (unit is None or unit.unit in TIME_UNITS):
            return Meaning(k, "t", *(unit or Spelled("s")))
    have = ", ".join(f"{title!r:.40}" for title in titles[:12])
    raise DataError(
        f"{cells.label} has no column t_s, nor one that is called a time; its columns are {have}; numbers of "
        "frames are t[1/60 s]=frame, rows at equal steps t[0.02 s]=row; say which it is",
        columns={"t": f"{titles[0]:.60}", **example_of(titles[1:2])},
    )


def _numeric(cells: Cells, titles: Sequence[str]) -> list[int]:
    """Indices of the columns whose cells are mostly numbers."""
    return [k for k in range(len(titles)) if _is_numeric(cells, k)]


def _is_numeric(cells: Cells, k: int) -> bool:
    """Whether most filled cells of a column are numbers."""
    filled = [row[k] for row in cells.rows if row[k] not in BLANK]
    numbers = sum(_reads(cell.replace(",", ".") if cells.decimal_comma else cell) for cell in filled)
    return bool(filled) and numbers > 0.9 * len(filled)


def _reads(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


# --------------------------------------------------------------------------- as the user says


def parse_columns(text: str) -> dict[str, str]:
    """Read ``t=Zeit (s),theta[deg]=Winkel`` into the title of each quantity's column; DataError otherwise."""
    stated: dict[str, str] = {}
    for part in re.split(r",(?=\s*+[A-Za-z]\w*+\s*+(?:\[[^\],=]*+\])?+\s*+=)", text):
        name, equals, title = part.partition("=")
        match = STATED.fullmatch(name.strip())
        if not equals or match is None or not title.strip():
            raise DataError(f"cannot read {part.strip()!r:.80}: write name[unit]=header", columns=EXAMPLE)
        if match["name"] in (STATED.fullmatch(other)["name"] for other in stated):  # type: ignore[index]  # matched
            raise DataError(f"the columns state {match['name']!r:.40} twice")
        stated[name.strip()] = title.strip().strip('"')
    return stated


def _stated(cells: Cells, titles: Sequence[str], stated: Mapping[str, str]) -> list[Meaning]:
    meanings = [_one_stated(cells, titles, name, title) for name, title in stated.items()]
    if not any(meaning.name == "t" for meaning in meanings):
        meanings.insert(0, _time(cells, titles, _numeric(cells, titles)))
    if len(meanings) < 2:
        others = [title for k, title in enumerate(titles) if k != meanings[0].column]
        example = {"t": titles[meanings[0].column] if meanings[0].column != ROW else "row", **example_of(others)}
        raise DataError(f"{cells.label}: the columns name the time only; name a quantity as well", columns=example)
    return meanings


def _one_stated(cells: Cells, titles: Sequence[str], name: str, title: str) -> Meaning:
    match = STATED.fullmatch(name.strip())
    if match is None:
        example = {"t": f"{titles[0]:.60}", **example_of(titles[1:2])}
        raise DataError(f"cannot read the column name {name!r:.60}: write name or name[unit]", columns=example)
    column = ROW if title == "row" and title not in titles else _column(cells, titles, title)
    titled = None if column == ROW else _taken_apart(titles[column])[1]
    unit = _unit(match["unit"]) if match["unit"] is not None else titled
    if unit is None and match["name"] == "t" and match["unit"] is None:
        unit = Spelled("s")
    if unit is None or (match["name"] == "t" and unit.unit not in TIME_UNITS):
        asked = f"no unit {match['unit']!r:.30}" if match["unit"] is not None else "no unit"
        raise DataError(
            f"column {title!r:.60} has {asked}; state it as {match['name']}[unit]={title:.60}; "
            f"units are {', '.join(COLUMN_UNITS)}"
        )
    meaning = Meaning(column, match["name"], *unit)
    if match["factor"]:
        number = float(match["factor"])
        if not math.isfinite(number) or number == 0 or (number < 0 and meaning.name == "t"):
            raise DataError(
                f"cannot read the unit of {name!r:.60}: write a factor as in t[1/60 s]=frame, z[-1 m]=depth"
            )
        meaning = replace(meaning, factor=meaning.factor * (1 / number if match["share"] else number))
    return meaning


def _column(cells: Cells, titles: Sequence[str], wanted: str) -> int:
    """The column of a title, of its name without the unit, of a field of a structure, or of its number from 1."""
    same = [k for k, title in enumerate(titles) if title == wanted]
    same = same or [k for k, title in enumerate(titles) if title.casefold() == wanted.casefold()]
    same = same or [k for k, title in enumerate(titles) if _plain(_taken_apart(title)[0]) == _plain(wanted)]
    same = same or [k for k, title in enumerate(titles) if title.casefold().endswith(f".{wanted.casefold()}")]
    if not same and wanted.isdigit() and 1 <= int(wanted) <= len(titles):
        return int(wanted) - 1
    if len(same) == 1:
        return same[0]
    have = ", ".join(f"{title!r:.40}" for title in titles[:20])
    problem = "more than one column" if same else "no column"
    raise DataError(f"{cells.label} has {problem} {wanted!r:.60}; its columns are {have}; a number counts from 1")


def _check_names(cells: Cells, titles: Sequence[str], meanings: Sequence[Meaning]) -> None:
    seen: dict[str, Meaning] = {}
    for meaning in meanings:
        if meaning.name in seen:
            example = {other.unit_name: _source_title(titles, other) for other in (*seen.values(), meaning)}
            raise DataError(f"{cells.label}: two columns hold {meaning.name!r:.40}; name one", columns=example)
        seen[meaning.name] = meaning
