"""What the readers of real recordings share: a row of the table, and tables as trajectories."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from iris_sysid import Estimate, OdeModel, Quantity, Trajectory
from iris_sysid.types import Array, Sensor

DATA = Path("..") / "shared" / "data"
WORLD, WORLD2 = DATA / "world", DATA / "world2"
DRAG = frozenset({"quadratic-drag", "linear-drag"})
QUADRATIC = frozenset({"quadratic-drag"})
UNEVEN = frozenset({"friction-change", "velocity-weakening-friction", "linear-drag"})
FRICTION = frozenset({"coulomb-friction", "velocity-weakening-friction"})
ZERO = frozenset({"zero-offset", "constant-force"})
NOTHING: frozenset[str] = frozenset()
LOCAL_GRAVITY = {"gravity": Estimate(9.81, 0.01, "m/s^2", "assumed")}
MAX_SAMPLES, MAX_DRIVEN = 5000, 1200  # of a table that are used, so that the whole table takes half an hour
TORQUE = Quantity("tau", "N m", r"\tau")
TURNING = ("pendulum", "linear-oscillator", "torsion-wheel", "driven-arm", "two-tanks")
SHEET = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"


@dataclass(frozen=True, slots=True)
class Recording:
    """One row of the table.

    ``known`` is what was known beforehand, and ``source`` says from where. ``right`` are the names of which one must be
    given (empty: nothing need be), ``plausible`` further ones that the physics allows. ``outside``: what is missing is
    known to be outside the library, so that the right answer is that the model is incomplete.
    """

    name: str
    source: str
    known: str
    model: OdeModel
    clips: Callable[[], Sequence[Trajectory]]
    sensor: Sensor
    right: frozenset[str] = NOTHING
    plausible: frozenset[str] = NOTHING
    outside: bool = False
    fixed: Mapping[str, float | Estimate] = field(default_factory=dict)
    free: Sequence[str] = ()

    @property
    def turns(self) -> bool:
        """Whether the motion comes back, so that a force and a reading can be told apart."""
        return self.model.name in TURNING


def series(t_s: Array, values: Array, quantity: Quantity, inputs: Array | None = None) -> Trajectory:
    """The beginning of a table of one quantity; samples whose time does not increase are dropped."""
    later = np.concatenate([[True], np.diff(np.maximum.accumulate(t_s)) > 0])
    later &= np.cumsum(later) <= (MAX_SAMPLES if inputs is None else MAX_DRIVEN)
    column = np.asarray(values, dtype=float)[later, None]
    more = {} if inputs is None else {"inputs": inputs[later, None], "input_quantities": (TORQUE,)}
    finite = np.isfinite(column[:, 0])
    return Trajectory(t_s[later], (quantity,), column, np.full_like(column, np.nan), finite, **more)


def columns(path: Path, *, delimiter: str = ",", comments: str = "#") -> Array:
    """The numbers (n, c) of a table with one line of headings."""
    return np.genfromtxt(path, delimiter=delimiter, skip_header=1, comments=comments)


def only(read: Callable[[], Trajectory]) -> Callable[[], Sequence[Trajectory]]:
    """A reader of one clip as a reader of clips."""
    return lambda: [read()]


def sheet_rows(path: Path, name: str) -> Array:
    """The numbers (n, c) of one sheet of a workbook, headings left out."""
    with zipfile.ZipFile(path) as archive:
        names = [
            sheet.get("name") for sheet in ElementTree.fromstring(archive.read("xl/workbook.xml")).iter(f"{SHEET}sheet")
        ]
        sheet = ElementTree.fromstring(archive.read(f"xl/worksheets/sheet{names.index(name) + 1}.xml"))
    rows = [[cell for cell in row.iter(f"{SHEET}c") if cell.get("t") != "s"] for row in sheet.iter(f"{SHEET}row")]
    return np.array([[float(cell.findtext(f"{SHEET}v", "nan")) for cell in row] for row in rows if len(row) >= 3])
