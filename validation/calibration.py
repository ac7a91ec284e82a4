"""Accuracy of a calibration: OpenCV's reference, synthetic clips, coverage of the scale, g from two clips alone.

``python -m validation.calibration`` prints four tables; ``--part reference|plane|coverage|fall`` prints one. The first
needs the images in ``../shared/data``; the others draw their own.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import BoardPlacement, calibrate_board
from iris_sysid.calibration.board.detect import find_board
from iris_sysid.calibration.camera import FULL_LENS, calibrate_camera
from iris_sysid.calibration.plane import to_plane
from iris_sysid.synthetic import Look, render_checkerboard, render_clip
from iris_sysid.synthetic.plan import plan_clip
from tests.calibration._windows import find_by_window
from tests.calibration.test_camera import scored
from validation import pages

PICTURES = Path("..") / "shared" / "data" / "opencv_checkerboard"
PHONE_LENS = (0.10, -0.15)  # k1, k2 of a phone's main camera before its own correction
TILTS_DEG = ((0.0, 0.0), (10.0, 0.0), (0.0, 15.0), (10.0, -10.0))
OFFSETS_M = (0.0, 0.05)
GRAVITY = 9.80665  # m/s^2, of the synthetic clips


def reference() -> None:
    """Print OpenCV's shipped calibration beside ours, with its corner windows and with our corners."""
    board = Board(9, 6, 0.025)
    stored = cv2.FileStorage(str(PICTURES / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    theirs = stored.getNode("per_view_reprojection_errors").mat().ravel()
    files = sorted(PICTURES.glob("left*.jpg"))
    rms, fx = stored.getNode("avg_reprojection_error").real(), stored.getNode("camera_matrix").mat()[0, 0]
    print(
        "| corners | fx px | RMS px | worst view px | per view from the reference, at most px |\n|---|---|---|---|---|"
    )
    print(f"| shipped reference | {fx:.3f} | {rms:.5f} | {theirs.max():.3f} | |")
    for name, window, lens, drop in (
        ("11 px windows, its settings", 11, FULL_LENS, False),
        ("5 px windows, its settings", 5, FULL_LENS, False),
        ("ours, its settings", None, FULL_LENS, False),
        ("ours", None, None, True),
    ):
        views = [find_board(file, board) if window is None else find_by_window(file, board, window) for file in files]
        camera = calibrate_camera(views, board, lens=lens, drop_outliers=drop)
        rms_px = np.array([view.rms_px for view in camera.views])
        entry = camera.estimates["fx"]
        print(
            f"| {name} | {entry.value:.3f} ± {entry.stderr:.2f} | {camera.rms_px:.5f} | {rms_px.max():.3f} | "
            f"{np.abs(rms_px - theirs).max():.3f} |",
            flush=True,
        )


def plane_error(tilt_deg: tuple[float, float], offset_m: float, size: tuple[int, int], folder: Path) -> float:
    """Largest position error over a plane in front of the board, as a share of the field's width."""
    look = Look(tilt_deg=tilt_deg, roll_deg=0.5, distortion=PHONE_LENS)
    clip = folder / f"board_{tilt_deg[0]:g}_{tilt_deg[1]:g}.mp4"
    if not clip.exists():
        render_checkerboard("dropping-ball", clip, size=size, fps=4.0, look=look)
    square_m = json.loads(clip.with_suffix(".truth.json").read_text())["board"]["square_m"]
    placement = BoardPlacement(view=0, offset_m=offset_m, up="board")
    calibration = calibrate_board([clip], Board(9, 6, square_m), placement=placement).calibration
    camera = plan_clip("dropping-ball", size=size, fps=4.0, duration_s=1.0, look=look).camera
    width_m = size[0] / camera.pixels_per_metre
    across, down = np.meshgrid(np.linspace(-0.42, 0.42, 9), np.linspace(-0.42, 0.42, 7) * size[1] / size[0])
    places = width_m * np.column_stack([across.ravel(), down.ravel()])
    seen = camera.project_space(np.column_stack([places, np.full(len(places), -offset_m)]))
    inside = np.all((seen > 0) & (seen < np.array(size) - 1), axis=1)
    error = to_plane(calibration, seen[inside])[0] - places[inside] * [1, -1]
    return float(np.abs(error).max() / width_m)


def plane(size: tuple[int, int]) -> None:
    """Print the metric error on synthetic clips, by tilt and by the distance of the board from the plane."""
    print("| camera tilted by | board behind the plane | largest error of a place, of the field |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for tilt in TILTS_DEG:
            for offset_m in OFFSETS_M:
                error = plane_error(tilt, offset_m, size, Path(folder))
                print(f"| {tilt[0]:g}°, {tilt[1]:g}° | {100 * offset_m:g} cm | {100 * error:.4f} % |", flush=True)


def coverage(seeds: range) -> None:
    """Print how often the 95 % interval of the scale, and those of positions, contain the truth."""
    print("| scale from | seeds | scale | places, least | places, most |\n|---|---|---|---|---|")
    for name, options in (
        ("one picture", {"with_camera": False}),
        ("five views and a board 5 cm off", {"offset_m": 0.05}),
    ):
        inside = 100 * np.mean(np.abs([scored(seed, **options) for seed in seeds]) < 1.96, axis=0)
        print(
            f"| {name} | {seeds[0]} to {seeds[-1]} | {inside[0]:.1f} % | {inside[1:].min():.1f} % | "
            f"{inside[1:].max():.1f} % |",
            flush=True,
        )


def fall(size: tuple[int, int], seeds: range) -> None:
    """Print g from a checkerboard clip and a drop clip, by two commands, and its error over its standard error."""
    print("| seed | g m/s² | 95 % interval | off | scale px/m |\n|---|---|---|---|---|")
    pulls, held = [], 0
    for seed in seeds:
        look = Look(tilt_deg=(4.0, -5.0), roll_deg=0.5, distortion=(0.05, -0.05))
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            render_clip("dropping-ball", folder / "drop.mp4", size=size, seed=seed, look=look)
            square_m, _ = render_checkerboard(
                "dropping-ball", folder / "board.mp4", size=size, fps=4.0, seed=seed, look=look
            )
            _command(
                "calibrate board.mp4 --board 9x6 --square", f"{1000 * square_m:g}mm", "-o calibration.json", folder
            )
            _command("run drop.mp4 --phenomenon dropping-ball --calibration", "calibration.json", "-o out", folder)
            gravity = json.loads((folder / "out" / "fit.json").read_text())["parameters"]["gravity"]
            made = json.loads((folder / "calibration.json").read_text())["scale"]
        low, high = gravity["ci95"]
        off = 100 * (gravity["value"] / GRAVITY - 1)
        print(
            f"| {seed} | {gravity['value']:.4f} ± {gravity['stderr']:.4f} | {low:.4f} to {high:.4f} | {off:+.3f} % | "
            f"{made['value']:.3f} ± {made['stderr']:.3f} |",
            flush=True,
        )
        pulls.append((gravity["value"] - GRAVITY) / gravity["stderr"])
        held += low <= GRAVITY <= high
    print(f"\nerror over standard error: rms {np.sqrt(np.mean(np.square(pulls))):.2f}; ", end="")
    print(f"{held} of {len(pulls)} intervals hold the truth")


def _command(before: str, value: str, after: str, folder: Path) -> None:
    program = Path(sys.executable).parent / "iris-sysid"
    subprocess.run([program, *before.split(), value, *after.split()], cwd=folder, check=True, capture_output=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=("reference", "plane", "coverage", "fall"), help="one table only")
    parser.add_argument("--first", type=int, default=0, help="first seed of the coverage or of the falls")
    parser.add_argument("--seeds", type=int, default=200, help="seeds of the coverage")
    parser.add_argument("--falls", type=int, default=1, help="pairs of clips")
    parser.add_argument("--size", default="3840x2160", help="of those clips, px")
    pages.add_option(parser)
    options = parser.parse_args()
    width, height = (int(side) for side in options.size.split("x"))
    parts = {
        "reference": reference,
        "plane": lambda: plane((1280, 720)),
        "coverage": lambda: coverage(range(options.first, options.first + options.seeds)),
        "fall": lambda: fall((width, height), range(options.first, options.first + options.falls)),
    }
    tables = {name: f"calibration-{name}" for name in parts}
    tables["fall"] += "-4k" if (width, height) == (3840, 2160) else f"-{width}"
    for name, part in parts.items():
        if options.part in (None, name):
            with pages.table(tables[name], options.write_docs):
                part()
            print()


if __name__ == "__main__":
    main()
