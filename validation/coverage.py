"""How often 95 % intervals contain the truth, and the scatter of estimates over the Cramer-Rao bound, by model.

``--clips N`` instead renders N clips of each setting of a fading lamp and of a draining vessel, and follows them from
the pixels to the interval: the lamp with the camera's curve known, told by the file's tag, told wrongly, and not told.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from iris_sysid import PHENOMENA
from iris_sysid.calibration.pixel_scale import scale
from iris_sysid.errors import IrisError
from iris_sysid.pipeline import one_clip
from iris_sysid.synthetic import SCENES, Look, Truth, render_clip
from iris_sysid.types import Estimate, TrackOptions, Transfer
from tests._experiments import EXPERIMENTS, repeated
from validation import pages


def row(name: str, rho: float, seeds: int) -> str:
    """Repeat one experiment and format its row of the table."""
    try:
        errors, stderrs, hits, bound = repeated(name, rho, range(seeds))
    except (AssertionError, IrisError) as error:
        return f"| {name} | {rho:g} | failed: {str(error)[:80]} | | | |"
    covered, shares = 100 * hits.mean(), 100 * hits.mean(axis=0)
    lowest, highest = shares.min(), shares.max()
    pull = errors.std(axis=0) / stderrs.mean(axis=0)
    efficiency = f"{(errors.std(axis=0) / bound).max():.3f}" if rho == 0 else "-"
    return f"| {name} | {rho:g} | {covered:.1f} | {lowest:.1f}-{highest:.1f} | {pull.mean():.3f} | {efficiency} |"


@dataclass(frozen=True, slots=True)
class Filmed:
    """A scene to film: the fitted parameter, frames a second, length, how the camera codes light, and what is told."""

    label: str
    scene: str
    parameter: str
    fps: float
    duration_s: float
    look: Look
    told: Transfer | None = None
    curves: tuple[str, ...] = ()


KNOWN = Transfer("bt709", stderr=0.0)
FILMED = (
    Filmed("LED, curve known", "led", "decay_rate", 30.0, 6.0, Look(), KNOWN),
    Filmed("LED, curve known, no compression", "led", "decay_rate", 30.0, 6.0, Look(codec="lossless"), KNOWN),
    Filmed("LED, tag bt709, which is right", "led", "decay_rate", 30.0, 6.0, Look()),
    Filmed("LED, tag bt709, camera sRGB or gamma 2", "led", "decay_rate", 30.0, 6.0, Look(transfer_tag="bt709"),
           curves=("srgb", "gamma=2.0")),
    Filmed("LED, no tag, camera bt709, sRGB or gamma 2.4", "led", "decay_rate", 30.0, 6.0, Look(transfer_tag=""),
           curves=("bt709", "srgb", "gamma=2.4")),
    Filmed("torricelli", "torricelli", "outflow", 15.0, 20.0, Look()),
)  # fmt: skip


def filmed(case: Filmed, clips: int, first: int, size: tuple[int, int]) -> Iterator[tuple[float, Estimate]]:
    """Truth and estimate of each clip of each setting; a clip that cannot be fitted raises."""
    for setting in SCENES[case.scene].settings:
        for seed in range(first, first + clips):
            curve = case.curves[seed % len(case.curves)] if case.curves else case.look.transfer
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "clip.mp4"
                look = replace(case.look, transfer=curve)
                truth = render_clip(
                    case.scene,
                    path,
                    setting=setting,
                    seed=seed,
                    size=size,
                    fps=case.fps,
                    duration_s=case.duration_s,
                    look=look,
                )
                yield truth.parameters[case.parameter].value, _estimate(path, truth, case)


def _estimate(path: Path, truth: Truth, case: Filmed) -> Estimate:
    """The fitted parameter; a length has the scale of the rendered camera."""
    calibration = None if PHENOMENA[case.scene].measures == "intensity" else scale(truth.pixels_per_metre, 1.0)
    run = one_clip.run(path, case.scene, calibration=calibration, options=TrackOptions(transfer=case.told))
    return run.fit.estimates[case.parameter]


def filmed_row(case: Filmed, clips: int, first: int, size: tuple[int, int]) -> str:
    """One row of the table of clips."""
    truth, found = zip(*filmed(case, clips, first, size), strict=True)
    error = np.array([estimate.value - true for true, estimate in zip(truth, found, strict=True)])
    stderr, true = np.array([estimate.stderr for estimate in found]), np.array(truth)
    half = np.array([(estimate.interval[1] - estimate.interval[0]) / 2 for estimate in found])
    inside = np.count_nonzero(np.abs(error) <= half)
    rms, off, wide = np.sqrt(np.mean((error / stderr) ** 2)), np.median(np.abs(error) / true), np.median(half / true)
    return f"| {case.label} | {error.size} | {inside} | {rms:.2f} | {100 * off:.2g} | {100 * wide:.2g} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=400, help="experiments for each model and noise")
    parser.add_argument("--models", nargs="*", default=list(EXPERIMENTS), help="names of models")
    parser.add_argument("--rho", nargs="*", type=float, default=[0.0, 0.9], help="correlation from sample to sample")
    parser.add_argument("--clips", type=int, default=0, help="clips of each setting: the table of rendered clips alone")
    parser.add_argument("--first", type=int, default=0, help="seed of the first of them")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), help="their width and height, px")
    parser.add_argument("--only", nargs="*", help="labels of the rows of the table of clips that are made")
    pages.add_option(parser)
    arguments = parser.parse_args()
    if arguments.clips:
        with pages.table("coverage-clips", arguments.write_docs):
            print(
                "| filmed | clips | truth in the 95 % interval | rms of error / standard error | "
                "median error / % | median half width / % |\n|---|---|---|---|---|---|"
            )
            for case in FILMED:
                if not arguments.only or case.label in arguments.only:
                    print(filmed_row(case, arguments.clips, arguments.first, tuple(arguments.size)), flush=True)
        return
    with pages.table("coverage", arguments.write_docs):
        print(f"{arguments.seeds} experiments for each row")
        print(
            "| model | rho | covered / % | each value / % | scatter / standard error | scatter / "
            "Cramer-Rao, worst value |"
        )
        print("|---|---|---|---|---|---|")
        for name in arguments.models:
            for rho in arguments.rho:
                print(row(name, rho, arguments.seeds), flush=True)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
