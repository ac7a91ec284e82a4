"""The figures of the method pages, drawn from one synthetic clip by the package's own plots.

``python -m validation.method_figures`` writes ``docs/method/figures``: a pendulum with a hidden drag is rendered, run
and diagnosed, and its equation discovered; the curves of cameras are those that ``--transfer`` names. The corners of a
rendered board are drawn for the guide on calibration.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from iris_sysid import FitResult, Run, diagnose, discover, open_video, plot, render_clip, run
from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import calibrate_board
from iris_sysid.report.calibration_figure import view_figure
from iris_sysid.report.figures import track_figure
from iris_sysid.report.plots import figure_of
from iris_sysid.synthetic.board import render_checkerboard
from iris_sysid.types import transfer_tagged
from validation import pages

mpl.use("agg")

FOLDER = pages.ROOT / "docs" / "method" / "figures"
CORNERS = pages.ROOT / "docs" / "guide" / "calibrate.png"
SIZE, DURATION_S, HIDDEN = (480, 270), 5.0, {"quadratic-drag": 0.2}
MIN_SHARE = 1e-5  # of the standard error
CURVES = ("linear", "bt709", "srgb", "hlg", "pq")
DPI = 80


def main() -> None:
    """Draw all of them."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "swing.mp4"
        render_clip("pendulum", clip, effects=HIDDEN, size=SIZE, duration_s=DURATION_S)
        result = run(clip, "pendulum")
        figures = {
            "tracking": track_figure(open_video(clip), result.tracks, result.trajectory, result.calibration),
            "trajectory": figure_of(result.trajectory),
            "fitting": figure_of(result.fit),
            "uncertainty": budget_figure(result.fit),
            "diagnosis": figure_of(diagnose(result.trajectory, "pendulum")),
            "discovery": terms_figure(result),
            "brightness": curves_figure(),
        }
        for name, figure in figures.items():
            figure.savefig(FOLDER / f"{name}.png", dpi=DPI)
        corners_figure(Path(folder)).savefig(CORNERS, dpi=DPI)


def corners_figure(folder: Path) -> Figure:
    """The corners of a rendered board with their residuals, as ``calibrate --plot`` draws them."""
    clip = folder / "board.mp4"
    render_checkerboard("dropping-ball", clip, size=(960, 540), fps=2.0)
    square_m = json.loads(clip.with_suffix(".truth.json").read_text("utf-8"))["board"]["square_m"]
    found = calibrate_board([clip], Board(9, 6, square_m))
    assert found.fitted is not None
    figure = view_figure(found.fitted, found.image)
    figure.axes[0].set(xlim=(290, 670), ylim=(410, 130))
    return figure


def budget_figure(fitted: FitResult) -> Figure:
    """The parts of the standard error of the length by source; those that do not count are left out."""
    stderr = fitted.estimates["length"].stderr
    budget = {source: error for source, error in fitted.budget["length"].items() if error > MIN_SHARE * stderr}
    figure = Figure(figsize=(7.0, 0.6 + 0.35 * len(budget)), layout="constrained")
    axes = figure.add_subplot()
    names = sorted(budget, key=budget.__getitem__)
    axes.set_xscale("log")
    axes.barh(names, [budget[name] for name in names], color="#0072B2")
    axes.set_xlabel(f"part of the standard error of the length (m); all in squares: {stderr:.2g} m")
    return figure


def terms_figure(result: Run) -> Figure:
    """How often each term of the library is chosen, and the coefficients of those that are kept."""
    axes = plot(discover(result.trajectory), Figure(figsize=(8.0, 8.0), layout="constrained"))
    return axes[0].figure.figure


def curves_figure() -> Figure:
    """Light by grey level for each curve that a file may name."""
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    axes, codes = figure.add_subplot(), np.linspace(0.0, 1.0, 256)
    for name in CURVES:
        axes.plot(255 * codes, transfer_tagged(name).light(codes), label=name)
    axes.set(xlabel="grey level, 8 bits, full range", ylabel="light, 1 at white")
    axes.legend()
    return figure


if __name__ == "__main__":
    main()
