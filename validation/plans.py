"""Whether one more clip, made as planned, leaves the right name: cases of the independent generator, SciPy's clips.

Ambiguous cases only: those of which the diagnosis names two effects or more. Each is then filmed once more, as the plan
advises, as it was, and with a change drawn at random; the predicted power is compared with what happened.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid import MODELS, Diagnosis, FitError, Trajectory, decide, diagnose, plan
from iris_sysid.benchmark.sources.selection import wilson
from iris_sysid.diagnosis.planning.changes import SetUpChange
from iris_sysid.diagnosis.planning.plan import PRACTICAL, Proposal
from validation import pages
from validation.blind_independent import share, trajectory_of, view_through
from validation.independent.camera import Camera
from validation.independent.cases import SEALED, Case, draw_case
from validation.independent.effects import HIDDEN, camera_before, filmed_by
from validation.independent.motions import Motion, integrate
from validation.independent.noise import NOISES

WAYS = ("as advised", "the same again", "at random")
RANDOM = 3  # clips made at random of each case
ACCIDENTS = ("impact", "lost frames")
RECTIFIED = ("tilt_rad", "distortion", "aspect")
DRAG_POWERS = {"linear drag": (-1.0, 1.0), "quadratic drag": (-1.0, 2.0), "drag of another power": (-1.0, 1.5)}
BINS = 10
OTHER_FORMS = {effect.name for effect in HIDDEN if effect.own_form}  # than the library's
ATTEMPTS = 10  # seeds looked at for each ambiguous case


@dataclass(frozen=True, slots=True)
class Outcome:
    """One more clip of one case: the power that was predicted for it, and the names that it left."""

    seed: int
    model: str
    hidden: str
    way: str
    change: str
    names: int
    right_in_class: bool
    power: float
    right: bool
    single: bool
    jointly: bool
    right_of_both: bool


def changed_case(case: Case, change: SetUpChange, rng: np.random.Generator) -> Case:
    """The case filmed once more, with a change of its set-up; SciPy integrates it."""
    effect = case.hidden
    assert effect is not None
    motion = replace(
        case.motion, seconds=case.motion.seconds * change.longer, rate_hz=case.motion.rate_hz * change.faster
    )
    values = _changed_values(case, change)
    absent = effect.name in ACCIDENTS or (effect.fault in RECTIFIED and "camera-tilt" in change.without)
    absent = absent or effect.name.replace(" ", "-") in change.without  # by a tripod, or a plumb line
    size = 0.0 if absent else case.size * _scaling(effect.name, motion, change)
    t_s = motion.times()
    filmed = bool(effect.fault)
    clean = (
        filmed_by(_camera(case, size), motion, values, t_s)
        if filmed
        else effect.show(motion, values, t_s, size, case.shape)
    )
    return replace(
        case,
        motion=motion,
        values=values,
        t_s=t_s,
        clean=clean,
        observed=NOISES[case.noise](clean, motion.noise, rng),
        size=size,
    )


def _changed_values(case: Case, change: SetUpChange) -> dict[str, float]:
    """The generator's values of a changed set-up; the loss of a heavier or smaller body is guessed as drag's."""
    model, values = MODELS[case.motion.model], dict(case.values)
    names = {f"{state.name}_0": k for k, state in enumerate(model.states)}
    for name, value in change.start.items():
        k = names[name]
        values[f"x{k}" if k < case.motion.size else f"v{k - case.motion.size}"] = value
    if change.body and "damping" in values:
        values["damping"] *= change.body.get("radius", 1.0) / change.body.get("mass", 1.0)
    if "stiffness" in values:
        values["stiffness"] *= change.body.get("spring", 1.0)
    if "length" in values:
        values["length"] *= change.body.get("length", 1.0)
    if "acceleration" in values:
        values["acceleration"] *= change.steeper
    return values


def _scaling(name: str, motion: Motion, change: SetUpChange) -> float:
    """Drag by the mass, the width, and of a swing the cord's length; all else is taken to stay."""
    if name not in DRAG_POWERS:
        return 1.0
    mass, radius = DRAG_POWERS[name]
    longer = change.body.get("length", 1.0) ** (radius - 1.0) if motion.model == "pendulum" else 1.0
    return float(change.body.get("mass", 1.0) ** mass * change.body.get("radius", 1.0) ** radius * longer)


def _camera(case: Case, size: float) -> Camera:
    """The camera of a case, with its fault of this size."""
    assert case.hidden is not None
    undisturbed = integrate(case.motion, case.values, case.t_s)[:, : case.motion.size]
    fault = 1.0 + size if case.hidden.fault == "aspect" else size
    return camera_before(case.motion, case.values, undisturbed).with_(**{case.hidden.fault: fault})


def new_clip(case: Case, change: SetUpChange, rng: np.random.Generator) -> Trajectory:
    """The table of one more clip; its view is that of today's camera."""
    made = changed_case(case, change, rng)
    table = trajectory_of(replace(made, hidden=None))
    if case.hidden is None or not case.hidden.fault:
        return table
    undisturbed = integrate(made.motion, made.values, made.t_s)[:, : made.motion.size]
    view = view_through(_camera(case, made.size), made.motion, made.values, undisturbed)
    return table.with_(sensor="camera", view=view, geometry=trajectory_of(case).geometry)


def score_case(seed: int, jointly: bool = False, model: str = "") -> list[Outcome]:
    """Diagnose a case; where it is ambiguous, make one more clip in each way. Empty where it is not.

    Parameters
    ----------
    seed
        Of the case, and of the noise of the new clips.
    jointly
        Diagnose both clips together as well.
    model
        Name of the model; cases of others are left out. All by default.
    """
    case = draw_case(seed, alike=False)
    if model not in ("", case.motion.model):
        return []
    clip, equation = trajectory_of(case), MODELS[case.motion.model]
    try:
        found = diagnose(clip, equation)
        if all(not found.indistinguishable[effect.name] for effect in found.added):
            return []
        planned = plan(found, clip)
    except FitError:
        return []
    if len(planned.probabilities) < 2:
        return []
    rng = np.random.default_rng(seed)
    drawn = [planned.proposals[k] for k in rng.choice(len(planned.proposals), RANDOM, replace=False)]
    chosen = [(WAYS[0], planned.best), (WAYS[1], planned.repeat), *((WAYS[2], proposal) for proposal in drawn)]
    outcomes = []
    for way, proposal in chosen:
        new = [new_clip(case, proposal.change, rng) for _ in range(proposal.change.clips)]
        try:
            names = decide(found, clip, new, proposal.change).names
            both = diagnose([clip, *new], equation) if jointly else None
        except FitError:
            names, both = (), None
        outcomes.append(_outcome(case, way, proposal, planned.probabilities, names, both))
    return outcomes


def _outcome(
    case: Case,
    way: str,
    proposal: Proposal,
    names: Mapping[str, float],
    left: Sequence[str],
    both: Diagnosis | None,
) -> Outcome:
    assert case.hidden is not None
    right = case.hidden.right
    classes = [] if both is None else [{each.name, *both.indistinguishable[each.name]} for each in both.added]
    return Outcome(
        case.seed,
        case.motion.model,
        case.hidden.name,
        way,
        proposal.change.name,
        len(names),
        bool(right & set(names)),
        proposal.power,
        len(left) == 1 and left[0] in right,
        len(left) == 1,
        both is not None,
        any(len(each) == 1 and each <= right for each in classes),
    )


def ambiguous(first: int, cases: int, workers: int, jointly: bool, rows: Path | None, model: str = "") -> list[Outcome]:
    """The outcomes of the first ambiguous cases from a seed on.

    Parameters
    ----------
    first
        Seed.
    cases
        How many ambiguous ones.
    workers
        Processes.
    jointly, model
        As for :func:`score_case`.
    rows
        A line of JSON is appended to this file for each seed, and seeds that it holds are not scored again.
    """
    known = _read(rows)
    score = partial(score_case, jointly=jointly, model=model)
    with ProcessPoolExecutor(workers) as pool:
        for begin in range(first, first + ATTEMPTS * cases, workers):
            seeds = [seed for seed in range(begin, begin + workers) if seed not in known]
            for seed, found in zip(seeds, pool.map(score, seeds), strict=True):
                known[seed] = found
                _append(rows, seed, found)
            if sum(bool(known[seed]) for seed in sorted(known) if first <= seed < begin + workers) >= cases:
                break
    own = [seed for seed in sorted(known) if seed >= first and known[seed]][:cases]
    return [outcome for seed in own for outcome in known[seed]]


def _read(rows: Path | None) -> dict[int, list[Outcome]]:
    """What a file of rows holds, by seed."""
    if rows is None or not rows.exists():
        return {}
    lines = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
    return {line["seed"]: [Outcome(**outcome) for outcome in line["outcomes"]] for line in lines}


def _append(rows: Path | None, seed: int, outcomes: Sequence[Outcome]) -> None:
    if rows is not None:
        with rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"seed": seed, "outcomes": [asdict(outcome) for outcome in outcomes]}) + "\n")


def table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """A line for each way of making the clip: how often one name is left, the right one, and the predicted power."""
    likely = {each.seed for each in outcomes if each.way == WAYS[0] and each.power > PRACTICAL}
    known = [each for each in outcomes if each.right_in_class]
    decidable = [each for each in known if each.seed in likely]
    groups = {
        "all": list(outcomes),
        "right name in question": known,
        "and a clip that is likely to decide": decidable,
        "and a form that the library has": [each for each in decidable if each.hidden not in OTHER_FORMS],
    }
    return pd.DataFrame(
        [
            _row(way, f"{label}: {len({each.seed for each in own})}", [each for each in own if each.way == way])
            for label, own in groups.items()
            for way in WAYS
        ]
    )


def _row(way: str, cases: str, made: Sequence[Outcome]) -> dict[str, str]:
    return {
        "cases": cases,
        "one more clip": way,
        "predicted power": f"{100 * np.mean([each.power for each in made]):.0f} %" if made else "",
        "right single name": share([each.right for each in made]),
        "wrong single name": share([each.single and not each.right for each in made]),
        "right single name of diagnose": share([each.right_of_both for each in made if each.jointly]),
    }


def calibration(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Predicted power against the share of right single names, where the right name is in question."""
    known = [outcome for outcome in outcomes if outcome.right_in_class]
    rows = []
    for low, high in itertools.pairwise(np.linspace(0.0, 1.0, BINS + 1)):
        inside = [each for each in known if low <= each.power < high or (high == 1.0 and each.power == 1.0)]
        rows.append(
            {
                "predicted power": f"{100 * low:.0f} to {100 * high:.0f} %",
                "mean": f"{100 * np.mean([each.power for each in inside]):.0f} %" if inside else "",
                "happened": share([each.right for each in inside]),
                "its 95 % interval": _interval([each.right for each in inside]),
                "the library's forms alone": share([each.right for each in inside if each.hidden not in OTHER_FORMS]),
            }
        )
    return pd.DataFrame(rows)


def _interval(flags: Sequence[bool]) -> str:
    low, high = wilson(sum(flags), len(flags)) if flags else (0.0, 1.0)
    return f"{100 * low:.0f} to {100 * high:.0f} %"


def main() -> None:
    """Print both tables, and unless the seeds are sealed each outcome."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=120, help="ambiguous cases")
    parser.add_argument("--jointly", action="store_true", help="diagnose both clips together as well: slow")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="first seed; with --sealed counted from the sealed ones")
    parser.add_argument("--rows", type=Path, help="file to which each seed adds a line; those in it are not repeated")
    parser.add_argument("--sealed", action="store_true", help="score seeds that nobody looks at; prints no case")
    parser.add_argument("--model", default="", help="only cases of this model; a separate table")
    pages.add_option(parser)
    options = parser.parse_args()
    first = options.first + (SEALED if options.sealed else 0)
    with pages.table(f"plans-{options.model}" if options.model else "plans", options.write_docs):
        outcomes = ambiguous(first, options.cases, options.workers, options.jointly, options.rows, options.model)
        print(pages.markdown(table(outcomes)), "", pages.markdown(calibration(outcomes)), sep="\n")
    if not options.sealed:
        for each in outcomes:
            print(each)


if __name__ == "__main__":
    main()
