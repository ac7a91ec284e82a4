"""Blind test through video: diagnose effects that are hidden in rendered clips from the tracked motion.

``python -m validation.blind_video --clips 40 --folder WORK`` renders clips of three phenomena with 0, 1 or 2 effects
in them, random in kind, sign and size, tracks them, and diagnoses each trajectory. The truth is in the clip's
``.hidden.json``, which nothing reads. Clips, trajectories and outcomes stay in the folder, and a later run reuses them;
it diagnoses a clip again when its ``.outcome.json`` is gone.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from fitters.effect_sensitivity import sensitivity, shaped
from fitters.ode import fit
from iris_sysid.calibration.pixel_scale import scale
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.score_test import critical_value, screen
from iris_sysid.diagnosis.screening import SINGLE_LEVEL
from iris_sysid.errors import IrisError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.io.csv_write import write_trajectory
from iris_sysid.io.files import json_text, write_atomic
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.one_clip import run
from iris_sysid.pipeline.parallel import run_parallel
from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA
from iris_sysid.synthetic import SCENES, render_clip
from iris_sysid.synthetic.effects import FORCING_HZ
from iris_sysid.synthetic.plan import ClipPlan, plan_clip
from iris_sysid.types import Effect, FitResult, OdeModel, Score, Trajectory
from validation import pages
from validation.blind import FACTORS, Outcome, outcome_of, share_apart, table, wrong_cases

SIZE, FPS, DURATION_S = (960, 540), 60.0, 5.0
STATED_PX = 0.06  # standard error that the tracker states for a ball of 27 px in such a clip
# by scene: name of its trajectory in the clip's truth, and the lever arm in m that converts px to it (1 for lengths)
TRUTHS: Mapping[str, tuple[str, float]] = {
    "pendulum": ("theta_rad", 0.5),
    "rotating-cone": ("phi_rad", 0.24),
    "sliding-cone": ("s_m", 1.0),
}
MAX_CHANGE = 0.2  # largest change by an effect, over the motion's range: no swing that friction stops at once
ROOM = 5.0  # least ratio of the largest to the smallest detectable size of an effect that can be hidden
LOST = "dropped-frame"  # the clip lacks one frame; all other effects have the same size in the scene and the library
OTHERWISE = ("slack-tether", "finite-bob", "velocity-weakening-friction")  # these are other numbers in the scene


@dataclass(frozen=True, eq=False, slots=True)
class Secret:
    """Setting of a clip, its hidden effects (``effects`` as the scene names them) and how detectable they are.

    ``sizes`` by parameter of the library's effects, ``factors`` those sizes over the smallest detectable.
    """

    scene: str
    setting: str
    seed: int
    effects: Mapping[str, float]
    sizes: Mapping[str, float]
    factors: tuple[float, ...]


def true_trajectory(plan: ClipPlan, model: OdeModel, lever_m: float) -> Trajectory:
    """The motion of a planned clip, from the release on, with errors of the size that the tracker states.

    Parameters
    ----------
    plan
        Plan of a clip without effects.
    model
        The equation, with its observed quantity.
    lever_m
        Lever arm: px over the scale and over this give the unit of the observed quantity.
    """
    seen = plan.truth.table
    moving = seen[seen["phase"] == "motion"]
    column = TRUTHS[plan.truth.phenomenon][0]
    error = STATED_PX / plan.truth.pixels_per_metre / lever_m
    noise = error * np.random.default_rng(plan.seed).standard_normal(len(moving))
    position = (moving[column].to_numpy() + noise)[:, None]
    ones = np.ones(len(moving), dtype=bool)
    return Trajectory(moving["t_s"].to_numpy(), model.observed, position, np.full_like(position, error), ones)


def secret(seed: int) -> Secret:
    """Choose the setting of a clip, and effects that its motion can show.

    Parameters
    ----------
    seed
        Random seed of the clip.
    """
    rng = np.random.default_rng([seed, 11])
    scene = list(TRUTHS)[seed % len(TRUTHS)]
    setting = str(rng.choice(list(SCENES[scene].settings)))
    plan = plan_clip(scene, size=SIZE, fps=FPS, duration_s=DURATION_S, seed=seed, setting=setting)
    model = MODELS[PHENOMENA[scene].model]
    clean = true_trajectory(plan, model, TRUTHS[scene][1])
    fitted = fit(clean, model, free=PHENOMENA[scene].free)
    ranges = _ranges(SCENES[scene].effects, fitted, clean, rng)
    possible = [effect for effect in ranges if effect.name == LOST or ROOM * ranges[effect][0] < ranges[effect][1]]
    chosen = [possible[k] for k in rng.permutation(len(possible))[: int(rng.integers(0, 3))]]
    screened = screen(chosen, fitted, clean)
    effects, sizes, factors = {}, {}, []
    for effect in chosen:
        size = _size(effect, *ranges[effect], rng)
        sizes[effect.parameters[0].name] = size
        effects[effect.name] = (
            float(round((effect.parameters[1].default or 0.0) * FPS)) if effect.name == LOST else size
        )
        factors.append(abs(size) / ranges[effect][0] * share_apart(effect.name, screened))
    return Secret(scene, setting, seed, effects, sizes, tuple(factors))


def _ranges(
    filmed: Collection[str], fitted: FitResult, clean: Trajectory, rng: np.random.Generator
) -> dict[Effect, tuple[float, float]]:
    """The effects that both the scene and the library have, with the smallest detectable and the largest size."""
    library = [effect for effect in EFFECTS.values() if effect.applies(fitted.model)]
    known = {LOST, *filmed} - set(OTHERWISE)
    possible = [_in_the_shape_of_the_scene(effect, clean, rng) for effect in library if effect.name in known]
    scores = screen(possible, fitted, clean).scores
    return {
        effect: (_detectable(effect, scores[effect.name], clean, len(library)), _largest(effect, fitted, clean))
        for effect in possible
    }


def _in_the_shape_of_the_scene(effect: Effect, clip: Trajectory, rng: np.random.Generator) -> Effect:
    """An effect of the library, with the only shape in which the scene can hide it."""
    fixed: dict[str, tuple[float, ...]] = {"periodic-forcing": (2 * np.pi * FORCING_HZ, 0.0, 0.0)}
    if effect.name == LOST:
        fixed[LOST] = (float(rng.uniform(*np.quantile(clip.t_s, (0.2, 0.8)))), 1.0 / FPS)
    return replace(shaped(effect, fixed.get(effect.name, ())), trials=None)


def _detectable(effect: Effect, score: Score, clip: Trajectory, library: int) -> float:
    """The smallest size that is significant among all effects tried, and larger than the stated errors."""
    own = EFFECTS[effect.name].trials
    tried = len(list(own(clip.t_s, clip.position))) if own is not None else 1
    smallest = max(critical_value(SINGLE_LEVEL / library, tried) * score.stderr, score.resolvable_size)
    return smallest if np.isfinite(smallest) else np.inf


def _largest(effect: Effect, fitted: FitResult, clip: Trajectory) -> float:
    """The size above which an effect is no longer a small addition to the motion."""
    change = float(np.max(np.abs(sensitivity(effect, fitted, clip))))
    return MAX_CHANGE * float(np.ptp(clip.position)) / change if change > 0 else 0.0


def _size(effect: Effect, detectable: float, largest: float, rng: np.random.Generator) -> float:
    if effect.name == LOST:
        return 1.0 / FPS
    sign = float(rng.choice([-1.0, 1.0])) if effect.parameters[0].lower < 0.0 else 1.0  # friction only brakes
    ends = np.log([FACTORS[0] * detectable, min(FACTORS[1] * detectable, largest)])
    return sign * float(np.exp(rng.uniform(*ends)))


def trajectory_of(hidden: Secret, folder: Path) -> Trajectory:
    """Trajectory that the tracker measures from a clip; renders the clip first, and reads an earlier result back.

    Parameters
    ----------
    hidden
        The clip to render.
    folder
        Folder of clips and trajectories.
    """
    clip = folder / f"{hidden.seed:03d}.mp4"
    kept = clip.with_suffix(".trajectory.csv")
    if kept.is_file():
        return read_trajectory(kept)
    truth = render_clip(
        hidden.scene,
        clip,
        effects=hidden.effects,
        size=SIZE,
        fps=FPS,
        duration_s=DURATION_S,
        seed=hidden.seed,
        setting=hidden.setting,
        overwrite=True,
    )
    calibration = scale(truth.pixels_per_metre, 1.0)
    measured = run(clip, hidden.scene, calibration=calibration).trajectory
    write_trajectory(measured, kept, overwrite=True)
    return read_trajectory(kept)


def case(folder: Path, seed: int) -> Outcome | None:
    """One clip rendered, tracked and diagnosed; None when that fails. Keeps the outcome, and reads an earlier one back.

    Parameters
    ----------
    seed
        Random seed of the clip.
    folder
        As for :func:`trajectory_of`.
    """
    kept = folder / f"{seed:03d}.outcome.json"
    if not kept.is_file():
        came = _case(seed, folder)
        write_atomic(kept, json_text(None if came is None else asdict(came)))
    fields = json.loads(kept.read_text(encoding="utf-8"))
    if fields is None:
        return None
    lists = {name: tuple(value) for name, value in fields.items() if isinstance(value, list)}
    off = tuple(float("nan") if value is None else value for value in lists["off"])
    return Outcome(**{**fields, **lists, "off": off})


def _case(seed: int, folder: Path) -> Outcome | None:
    hidden = secret(seed)
    try:
        measured = trajectory_of(hidden, folder)
        phenomenon = PHENOMENA[hidden.scene]
        diagnosis = diagnose(measured, MODELS[phenomenon.model], free=phenomenon.free)
    except IrisError:
        return None
    return outcome_of(diagnosis, tuple(hidden.effects), hidden.sizes, hidden.factors, diagnosis.noise_floor)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and the clips with a wrong result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument("--folder", type=Path, required=True, help="where clips and tracks stay")
    parser.add_argument("--workers", type=int, default=2)
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    with pages.table("blind-video", options.write_docs):
        outcomes = _print_outcomes(options.folder, options.clips, options.workers)
    print("\n".join(wrong_cases(outcomes)))


def _print_outcomes(folder: Path, clips: int, workers: int) -> list[Outcome]:
    """Diagnose every clip in parallel, and print the table."""
    every = dict(run_parallel(Batch(folder, case, lambda folder, seed: None), range(clips), workers))
    outcomes = [outcome for _, outcome in sorted(every.items()) if outcome is not None]
    print(f"{len(outcomes)} clips; {len(every) - len(outcomes)} could not be measured or fitted")
    print(pages.markdown(table(outcomes)))
    return outcomes


if __name__ == "__main__":
    main()
