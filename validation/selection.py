"""Choice of the governing equation on 240 synthetic trajectories, compared with the published classifiers.

``python -m validation.selection`` takes every setting of the benchmark's eight phenomena, ten trials each with the
scatter of real ones. Nothing is rendered: the true path of each body, in metres, gets white noise of the size that the
tracker has, 0.05 px. The choice is among the whole bank, from x and z of each body and, where a ball is seen from
above, its apparent radius; the name of the phenomenon, setting or quantity is not given.

With ``--dataset DATASET --tracks WORK`` the same is done on clips that were rendered, tracked and segmented by
``python -m validation.groundtruth DATASET --work WORK``.
"""

from __future__ import annotations

import argparse
import sys
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from fitters.selection.select import select_model
from iris_sysid.benchmark.dataset import list_clips
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.benchmark.studies.model_selection import choice_for
from iris_sysid.errors import IrisError
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas.groundtruth import ClipDocument
from iris_sysid.synthetic import SCENES
from iris_sysid.synthetic.plan import ClipPlan, plan_clip
from iris_sysid.trajectory.segmentation import segment
from iris_sysid.types import ModelChoice, Quantity, Trajectory
from validation import pages
from validation.audit.printed import values_at

NOISE_PX = 0.05  # of a tracked centre and radius: what the trackers reach on synthetic clips
SIZE = (1920, 1080)
MAX_DURATION_S = 30.0
ACCEPTED = {
    "dropping-ball": ("free-fall", "bouncing-ball"),
    "falling-ball": ("apparent-radius",),
    "sliding-cone": ("incline",),
    "pendulum": ("pendulum",),
    "rotating-cone": ("angular-oscillator",),
    "hitting-cones": ("coasting-ball", "contact-chain", "impact-chain"),  # the first is the ball's before it strikes
    "two-moving-pendulums": ("coupled-pendulums", "pendulum-impact"),
    "two-moving-pendulum-one-static": ("coupled-pendulums", "pendulum-impact"),
}


@dataclass(frozen=True, slots=True)
class Asked:
    """A synthetic clip, and the function that chooses its equation."""

    phenomenon: str
    setting: str
    clip: str
    choose: Callable[[], ModelChoice]


def trial(name: str, setting: str, number: int) -> ClipPlan:
    """One trial of a setting, with the parameter scatter of the scene."""
    scene = SCENES[name]
    rng = np.random.default_rng([number, zlib.crc32(f"{name}/{setting}".encode())])
    values = {parameter.name: float(parameter.default or 0.0) for parameter in scene.parameters} | dict(
        scene.settings[setting]
    )
    scattered = {
        parameter.name: float(
            np.clip(
                values[parameter.name] + scene.scatter[parameter.name] * rng.standard_normal(),
                parameter.lower,
                parameter.upper,
            )
        )
        for parameter in scene.parameters
        if parameter.name in scene.scatter
    }
    duration_s = min(scene.duration_s, MAX_DURATION_S)
    return plan_clip(name, setting=setting, size=SIZE, duration_s=duration_s, seed=number, overrides=scattered)


def tracked(plan: ClipPlan, seed: int) -> list[Trajectory]:
    """Noisy trajectories of the bodies: x and z in m, and the radius in px where it changes."""
    rng, scale = np.random.default_rng([seed, 5]), plan.camera.pixels_per_metre
    bodies = []
    for _, table in plan.truth.table.groupby("body", sort=False):
        columns = [table["x_m"], table["z_m"]]
        quantities = [Quantity("x", "m"), Quantity("z", "m")]
        sigma = [NOISE_PX / scale] * 2
        if np.ptp(table["radius_px"]) > 1.0:
            columns.append(table["radius_px"])
            quantities.append(Quantity("r", "px"))
            sigma.append(NOISE_PX)
        position = np.column_stack(columns) + np.array(sigma) * rng.standard_normal((len(table), len(columns)))
        noise = np.broadcast_to(sigma, position.shape)
        inside = table["inside"].to_numpy(copy=True)
        position = np.where(inside[:, None], position, np.nan)
        held = (table["phase"] == "hand").to_numpy()
        world = Trajectory(table["t_s"].to_numpy(copy=True), tuple(quantities), position, noise, inside)
        bodies.append((world, held))
    if len(bodies) == 1:
        return [cut(*bodies[0])]
    return [world.with_(valid=world.valid & ~held) for world, held in bodies]


def cut(world: Trajectory, held: np.ndarray) -> Trajectory:
    """The trajectory, cut to the flight from release to the first impact in the two channels that move most."""
    moves = np.nanstd(world.position, axis=0) / np.nanmean(world.sigma, axis=0)
    which = sorted(np.argsort(moves)[-2:].tolist())
    seen = world.with_(
        quantities=(Quantity("x", "m"), Quantity("z", "m")),
        position=world.position[:, which],
        sigma=world.sigma[:, which],
    )
    segmented = segment(seen, hand=held, kind="flight")
    return world.with_(segments=segmented.segments, valid=segmented.valid)


def chosen_for(name: str, setting: str, number: int) -> ModelChoice:
    """The choice for one trial."""
    return select_model(tracked(trial(name, setting, number), number))


def drawn(trials: int, phenomena: list[str]) -> Iterator[Asked]:
    """Every trial of every setting."""
    for name in phenomena:
        for setting in SCENES[name].settings:
            for number in range(1, trials + 1):
                yield Asked(name, setting, str(number), partial(chosen_for, name, setting, number))


def kept(dataset: Path, tracks: Path, trials: int, phenomena: list[str]) -> Iterator[Asked]:
    """Every clip of a measured synthetic data set."""
    names = {scene.folder: name for name, scene in SCENES.items()}
    for clip in list_clips(dataset).clips:
        path = tracks / f"{clip.place}.json"
        if int(clip.clip) <= trials and names[clip.class_name] in phenomena and path.exists():
            measured = ClipMeasurement(clip, read_document(path, ClipDocument), path.parent)
            yield Asked(names[clip.class_name], clip.setting, clip.clip, partial(choice_for, measured))


def rows(clips: Iterable[Asked]) -> pd.DataFrame:
    """One row a clip: phenomenon, the nearest model, whether it is adequate, margins, seconds."""
    lines = []
    for clip in clips:
        began = time.process_time()
        try:
            choice = clip.choose()
            nearest, adequate = choice.nearest.model, choice.chosen is not None
            margins = (choice.heldout_margin, choice.bic_margin)
        except IrisError as error:
            nearest, adequate, margins = f"no answer: {error}"[:60], False, (np.nan, np.nan)
        seconds = time.process_time() - began
        lines.append((clip.phenomenon, clip.setting, clip.clip, nearest, adequate, *margins, seconds))
        right = nearest in ACCEPTED[clip.phenomenon]
        print(
            f"  {clip.phenomenon}/{clip.setting}/{clip.clip}: {nearest}{'' if right else ', WRONG'}",
            file=sys.stderr,
            flush=True,
        )
    columns = ["phenomenon", "setting", "trial", "model", "adequate", "heldout_margin", "bic_margin", "seconds"]
    return pd.DataFrame(lines, columns=columns)


def print_result(table: pd.DataFrame) -> None:
    """Print the confusion matrix and the accuracies."""
    right = np.array([model in ACCEPTED[name] for name, model in zip(table["phenomenon"], table["model"], strict=True)])
    print("\nConfusion: phenomena down, equations across (first of the ranking)")
    print(pages.markdown(pd.crosstab(table["phenomenon"], table["model"]).reset_index()))
    both = right & table["adequate"].to_numpy()
    none = ~table["adequate"].to_numpy()
    print(f"\nright equation first: {right.sum()} of {len(right)} ({100 * right.mean():.1f} %)")
    print(f"right equation, and it fits: {both.sum()} ({100 * both.mean():.1f} %); 'none of these': {none.sum()}")
    print("\n| phenomenon | clips | right equation first | right, and it fits |\n|---|---|---|---|")
    for name in dict.fromkeys(table["phenomenon"]):
        of_phenomenon = (table["phenomenon"] == name).to_numpy()
        print(f"| {name} | {of_phenomenon.sum()} | {right[of_phenomenon].sum()} | {both[of_phenomenon].sum()} |")
    print(f"median processor time a clip: {table['seconds'].median():.2f} s")


def print_published() -> None:
    """Print what the benchmark published for its classifiers, which saw the pixels."""
    print("\n| published on 240 IRIS clips | right / % |\n|---|---|")
    for value in values_at("tab:summary_vlm_methods"):
        if value.dataset == "iris":
            print(f"| {value.column} | {value.printed} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=10, help="trials a setting")
    parser.add_argument("--phenomenon", action="append", choices=list(ACCEPTED), help="only these")
    parser.add_argument("--dataset", type=Path, help="measured synthetic data set")
    parser.add_argument("--tracks", type=Path, help="folder of what was measured")
    pages.add_option(parser)
    options = parser.parse_args()
    if (options.dataset is None) != (options.tracks is None):
        parser.error("--dataset and --tracks go together")
    with pages.table("selection", options.write_docs):
        phenomena = options.phenomenon or list(ACCEPTED)
        if options.dataset is None:
            print_result(rows(drawn(options.trials, phenomena)))
        else:
            print_result(rows(kept(options.dataset, options.tracks, options.trials, phenomena)))
        print_published()


if __name__ == "__main__":
    main()
