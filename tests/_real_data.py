"""Real recordings as trajectories: the files of ../shared/data that are tables, not videos."""

import re
import zipfile
from xml.etree import ElementTree

import numpy as np

from iris_sysid.types import Quantity, Trajectory
from tests._project import recording

_CELL = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"


def trajectory_of(t_s, position, *quantities: Quantity, **more) -> Trajectory:
    position = np.asarray(position, dtype=float).reshape(len(t_s), -1)
    return Trajectory(t_s, quantities, position, np.full_like(position, np.nan), np.ones(len(t_s), bool), **more)


def spreadsheet_rows(path) -> np.ndarray:
    """The numbers of the first sheet of an xlsx file, which is a zip of XML."""
    with zipfile.ZipFile(path) as archive:
        sheet = ElementTree.fromstring(archive.read("xl/worksheets/sheet1.xml"))
    rows = []
    for row in sheet.iter(f"{_CELL}row"):
        cells = {re.sub(r"\d", "", cell.get("r")): cell.find(f"{_CELL}v") for cell in row.iter(f"{_CELL}c")}
        values = [cells[key].text for key in ("A", "B") if cells.get(key) is not None]
        if len(values) == 2:
            rows.append([float(value) for value in values])
    return np.array(rows)


def wooden_bob() -> Trajectory:
    """Angle of a wooden bob on a 0.334 m pendulum, one outlier near row 16."""
    t_s, theta_deg = spreadsheet_rows(recording("wooden_bob") / "damping_angle.xlsx").T
    return trajectory_of(t_s, np.deg2rad(theta_deg), Quantity("theta", "rad"))


def alexiev_length_68() -> Trajectory:
    """Angle of a pendulum on a 0.68 m string, about the centre of a circle fitted to positions in whole pixels."""
    folder = recording("alexiev_pendulum")
    t_s, x_px, y_px = (np.loadtxt(folder / f"length_68_{name}.csv") for name in "txy")
    pivot_x_px, pivot_y_px = circle_centre(x_px, y_px)
    return trajectory_of(t_s, np.arctan2(x_px - pivot_x_px, y_px - pivot_y_px), Quantity("theta", "rad"))


def schmidt_lipson_linear() -> Trajectory:
    """Position of a single oscillator on an air track, in mm in the file."""
    _, t_s, x_mm, _ = np.loadtxt(recording("schmidt_lipson") / "real_linear_h_1.txt", comments="%").T
    return trajectory_of(t_s, x_mm / 1000, Quantity("z", "m"))


def circle_centre(x, y) -> tuple[float, float]:
    """Centre of the circle nearest to points (Kasa's linear fit)."""
    columns = np.column_stack([x, y, np.ones_like(x)])
    a, b, _ = np.linalg.lstsq(columns, x**2 + y**2, rcond=None)[0]
    return a / 2, b / 2
