"""Blind test of the diagnosis on cases of an independent generator: names, classes, sizes, false alarms.

Seeds below 1,000,000 may be looked at while code is written; the others are sealed: scored once for a table.
Clean cases are scored as single clips, and as several clips of one motion.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from iris_sysid import MODELS, Estimate, FitError, Quantity, Trajectory, diagnose
from iris_sysid.types import View, kind_of
from validation import pages
from validation.independent.camera import SIZE_PX, Camera
from validation.independent.cases import SEALED, Case, draw_case, draw_clips
from validation.independent.effects import HIDDEN, camera_before, in_plane
from validation.independent.motions import Array, Motion, Values, integrate

HALF_AND_90 = (0.5, 0.9)
CLOSE = 1.3  # held-out error over noise
SEVERAL = (2, 5, 10)  # clips of one motion


@dataclass(frozen=True, slots=True)
class Score:
    """What the diagnosis made of one case.

    ``right`` are the names that are right, ``alike`` those of effects that would have given the same data: nothing can
    tell them from the hidden one. ``added`` are the names it gives, ``classes`` each with those it calls
    indistinguishable; ``groups`` are effects of which it says that one is there, but not which; ``covered`` is whether
    the 95 % interval of the size holds the truth, None where sizes cannot be compared; ``heldout`` is the error of
    samples never looked at over the noise.
    """

    seed: int
    model: str
    hidden: str
    kind: str
    own_form: bool
    noise: str
    factor: float
    right: frozenset[str]
    alike: frozenset[str]
    added: tuple[str, ...]
    classes: tuple[frozenset[str], ...]
    groups: tuple[frozenset[str], ...]
    covered: bool | None
    heldout: float
    failed: str = ""

    @property
    def exact(self) -> bool:
        """Whether a name given is a right one."""
        return bool(self.right & set(self.added))

    @property
    def exact_or_alike(self) -> bool:
        """Whether a name given is a right one, or one whose effect would have given the same data."""
        return bool((self.right | self.alike) & set(self.added))

    @property
    def in_class(self) -> bool:
        """Whether a right name is in the class of one given, or in a group."""
        return any(self.right & names for names in (*self.classes, *self.groups))

    @property
    def wrong_group(self) -> bool:
        """Whether no right name is in a group."""
        return any(not names & (self.right | self.alike) for names in self.groups)

    @property
    def extra(self) -> tuple[str, ...]:
        """Names given in whose class no right one is."""
        return tuple(
            name for name, names in zip(self.added, self.classes, strict=True) if not names & (self.right | self.alike)
        )

    @property
    def class_size(self) -> int:
        """Names in the class or group that holds a right one; 0 where none does."""
        return next((len(names) for names in (*self.classes, *self.groups) if names & self.right), 0)


def trajectory_of(case: Case) -> Trajectory:
    """The table of a case, without stated errors; of a filmed case it says how the camera was thought to look."""
    quantities = tuple(Quantity(name, unit, name) for name, unit in case.motion.observed)
    unknown = np.full_like(case.observed, np.nan)
    table = Trajectory(case.t_s, quantities, case.observed, unknown, np.ones(case.t_s.size, dtype=bool))
    if case.hidden is None or not case.hidden.fault:
        return table
    undisturbed = integrate(case.motion, case.values, case.t_s)[:, : case.motion.size]
    camera = camera_before(case.motion, case.values, undisturbed)
    size = 1.0 + case.size if case.hidden.fault == "aspect" else case.size
    view = view_through(camera.with_(**{case.hidden.fault: size}), case.motion, case.values, undisturbed)
    known = {"focal_ratio": Estimate(1.0, 0.0, "1", "direct", "the camera's own")}
    return table.with_(sensor="camera", view=view, geometry=known)


def view_through(camera: Camera, motion: Motion, values: Values, observed: Array) -> View:
    """How the coordinates of a motion lie in the picture of a camera that is taken as ideal.

    Parameters
    ----------
    camera
        With its faults: a pivot, and the lever from there to the body, are measured in its picture.
    motion, values
        What it films.
    observed
        (n, d) of the undisturbed motion.
    """
    scale, middle = camera.focal_px / camera.distance_m, np.array(SIZE_PX) / 2
    origin = middle + np.array([-camera.centre_m[0], camera.centre_m[1]]) * scale
    if motion.model == "pendulum":
        origin = camera.project(np.zeros((1, 2)))[0]
        scale = float(np.mean(np.hypot(*(camera.project(in_plane(motion, values, observed)) - origin).T)))
    right, up = np.array([scale, 0.0]), np.array([0.0, -scale])
    if motion.model == "free-fall":
        right, up = up, -right
    kind = kind_of([Quantity(name, unit) for name, unit in motion.observed])
    assert kind is not None
    lies = [(float(x), float(y)) for x, y in (origin, right, up, SIZE_PX, middle)]
    return View(kind, lies[0], lies[1], lies[2], lies[3], lies[4], camera.focal_px)


def score_case(seed: int, clean: bool) -> Score:
    """Draw one case, diagnose it, and compare."""
    case = draw_case(seed, clean=clean)
    effect = case.hidden
    about = (
        seed,
        case.motion.model,
        effect.name if effect else "",
        effect.kind if effect else "",
        effect.own_form if effect else False,
        case.noise,
        case.factor,
        effect.right if effect else frozenset(),
        case.alike,
    )
    try:
        found = diagnose(trajectory_of(case), MODELS[case.motion.model])
    except FitError as error:
        return Score(*about, (), (), (), None, np.nan, str(error))
    added = tuple(effect.name for effect in found.added)
    classes = tuple(frozenset({name, *found.indistinguishable[name]}) for name in added)
    groups = tuple(frozenset(finding.effects) for finding in found.findings if finding.word == "group")
    estimate = found.sizes.get(effect.size) if effect else None
    covered = None
    if estimate is not None and effect is not None and not effect.own_form and case.motion.size == 1:
        low, high = estimate.interval
        covered = bool(low <= case.size <= high)
    return Score(*about, added, classes, groups, covered, found.after.heldout / case.noise_rms)


def alarm(seed: int, count: int) -> bool:
    """Whether anything is named in ``count`` clean clips of one motion."""
    cases = draw_clips(seed, count)
    found = diagnose([trajectory_of(case) for case in cases], MODELS[cases[0].motion.model])
    return bool(found.added)


def share(flags: Sequence[bool]) -> str:
    """The share that is true, with the counts."""
    return f"{100 * np.mean(flags):.0f} % ({int(np.sum(flags))} of {len(flags)})" if flags else ""


def row(label: str, scores: Sequence[Score]) -> dict[str, object]:
    """One line of the table."""
    sizes = [score.class_size for score in scores if score.class_size]
    heldout = np.array([score.heldout for score in scores if score.added and np.isfinite(score.heldout)])
    return {
        "hidden": label,
        "cases": len(scores),
        "exact name": share([score.exact for score in scores]),
        "exact, or nothing can tell": share([score.exact_or_alike for score in scores]),
        "in class": share([score.in_class for score in scores]),
        "class size: median, largest": f"{np.median(sizes):.0f}, {max(sizes)}" if sizes else "",
        "wrong extra name": share([bool(score.extra) for score in scores]),
        "group without it": share([score.wrong_group for score in scores]),
        "size covered": share([score.covered for score in scores if score.covered is not None]),
        "held-out error / noise: median, 90 %": (
            "{:.2f}, {:.2f}".format(*np.quantile(heldout, HALF_AND_90)) if heldout.size else ""
        ),
        "of those below 1.3": share(list(heldout < CLOSE)),
        "failed": str(sum(bool(score.failed) for score in scores)),
    }


def table(scores: Sequence[Score], alarms: Mapping[int, Sequence[bool]]) -> pd.DataFrame:
    """A line for all, for each kind of form, for each hidden effect, and for clean cases of one and several clips."""
    hidden = [score for score in scores if score.hidden]
    rows = [
        row("all, the library's forms", [score for score in hidden if not score.own_form]),
        row("all, other forms", [score for score in hidden if score.own_form]),
    ]
    for effect in HIDDEN:
        own = [score for score in hidden if score.hidden == effect.name]
        rows += [row(effect.name, own)] if own else []
    clean = [bool(score.added) for score in scores if not score.hidden]
    nothing = {1: clean, **alarms}
    rows += [
        {"hidden": f"nothing, clips: {count}", "cases": len(named), "wrong extra name": share(named)}
        for count, named in nothing.items()
    ]
    return pd.DataFrame(rows).astype(object).fillna("")


def mistakes(scores: Sequence[Score]) -> list[str]:
    """A line for each case that is not named exactly, or with more than that."""
    return [
        f"  {score.seed} {score.model}, {score.noise}: hidden {score.hidden or 'nothing'} x {score.factor:.1f}; "
        f"{said(score)}"
        for score in scores
        if (score.hidden and not score.exact) or score.extra or score.failed
    ]


def said(score: Score) -> str:
    """The names and the groups given, or that the diagnosis failed."""
    groups = [f"one of {', '.join(sorted(names))}" for names in score.groups]
    if score.failed:
        return f"failed: {score.failed}"
    return "; ".join([f"added {', '.join(score.added) or 'nothing'}", *groups])


def main() -> None:
    """Print the table, and unless the seeds are sealed the cases that went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--clips", type=int, default=40, help="clean cases of 2, of 5 and of 10 clips")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--first", type=int, default=0, help="first seed; with --sealed counted from the sealed ones")
    parser.add_argument("--sealed", action="store_true", help="score seeds that nobody looks at; prints no case")
    pages.add_option(parser)
    options = parser.parse_args()
    first = options.first + (SEALED if options.sealed else 0)
    with pages.table("blind-independent", options.write_docs), ProcessPoolExecutor(options.workers) as pool:
        hidden = list(pool.map(partial(score_case, clean=False), range(first, first + options.cases)))
        clean = list(pool.map(partial(score_case, clean=True), range(first, first + options.clean)))
        several = {
            count: list(pool.map(partial(alarm, count=count), range(first, first + options.clips)))
            for count in SEVERAL
            if options.clips
        }
        print(pages.markdown(table([*hidden, *clean], several)))
    if not options.sealed:
        print("\n".join(mistakes([*hidden, *clean])))


if __name__ == "__main__":
    main()
