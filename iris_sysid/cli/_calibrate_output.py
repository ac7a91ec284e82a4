"""Files, drawings and text output of ``iris-sysid calibrate``."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from iris_sysid.calibration.board.calibrate import BoardCalibration
from iris_sysid.calibration.calibration_json import calibration_document, write_calibration
from iris_sysid.calibration.plane import local_geometry
from iris_sysid.calibration.vertical import assumptions, fixed_by_data
from iris_sysid.io.files import write_atomic
from iris_sysid.io.json_documents import document_text
from iris_sysid.report.calibration_figure import camera_figure, grid_figure, view_figure
from iris_sysid.report.page import png_of
from iris_sysid.report.text import with_error
from iris_sysid.types import Calibration

MIN_TURN = 1e-6  # rad; below it the world is turned by definition, not by measurement
DRAWINGS = ("camera", "board", "grid")


def plot_paths(output: Path) -> tuple[Path, ...]:
    """The files that hold the drawings of a calibration written to ``output``."""
    return tuple(output.with_name(f"{output.stem}-{name}.png") for name in DRAWINGS)


def save(plane: BoardCalibration, output: Path, *, plot: bool = False, overwrite: bool = False) -> list[Path]:
    """Write calibration.json and, with ``plot``, drawings beside it: corners, residuals, the grid; their paths."""
    figures = _figures(plane) if plot else {}
    write_calibration(plane.calibration, output, overwrite=overwrite)
    paths = dict(zip(DRAWINGS, plot_paths(output), strict=True))
    for name, figure in figures.items():
        write_atomic(paths[name], png_of(figure), overwrite=overwrite)
    return [paths[name] for name in figures]


def _figures(plane: BoardCalibration) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    camera = plane.camera
    if camera is not None and camera.views:
        figures["camera"] = camera_figure(camera)
    if plane.fitted is not None:
        figures["board"] = view_figure(plane.fitted, plane.image)
    figures["grid"] = grid_figure(plane.calibration, plane.image if plane.over is None else plane.over)
    return figures


def text_of(calibration: Calibration, *, json: bool = False) -> str:
    """Doubts, then scale, stretch, shear and turn with their standard errors, what the data fix, assumptions, notes.

    The content of calibration.json instead with ``json``.
    """
    if json:
        return document_text(calibration_document(calibration)).rstrip("\n")
    geometry = local_geometry(calibration, calibration.centre_px)
    stated = {name: value for name, value in geometry.items() if name != "turn_rad" or value.stderr > MIN_TURN}
    shown = {name.removesuffix("_rad"): value for name, value in stated.items()}
    x, y = calibration.centre_px
    rows = [f"{name:<10} {with_error(value)}" for name, value in shown.items()] + [f"at ({x:.0f}, {y:.0f}) px"]
    statements = [f"fixed by the data: {', '.join(fixed_by_data(calibration))}"]
    statements += [f"assumed: {text}" for text in assumptions(calibration)]
    statements += [f"note: {text}" for text in calibration.notes]
    doubts = [f"doubtful: {doubt.text}" for doubt in calibration.doubts]
    return "\n".join([*doubts, calibration.source, *rows, *statements])
