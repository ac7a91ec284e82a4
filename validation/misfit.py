"""How often 95 % intervals hold the truth when the equation lacks something: cases of the independent generator.

The hidden effects have 3 to 100 times the smallest detectable size. Seeds below 500 may be looked at while code is
written; those from 500,000 on are sealed: scored once for a table.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from fitters.ode.model_discrepancy import SOURCE
from iris_sysid import MODELS, FitOptions, Quantity, Trajectory, fit
from iris_sysid.types import Array, Estimate
from validation import pages
from validation.independent.cases import MAX_CHANGE, Case, draw_case, smallest_detectable
from validation.independent.effects import HIDDEN
from validation.independent.motions import MOTIONS
from validation.independent.noise import NOISES

ASKED = {
    "pendulum": "length",
    "linear-oscillator": "stiffness",
    "incline": "acceleration",
    "free-fall": "gravity",
    "torricelli": "outflow",
    "exponential-decay": "decay_rate",
}
FACTORS = (3.0, 100.0)  # of the smallest detectable size
SEALED = 500_000
STREAM = 4  # keeps these draws apart from those of the blind test with the same seeds
BINS = ((0.0, 1.5), (1.5, 3.0), (3.0, 10.0), (10.0, np.inf))  # residual over true noise


@dataclass(frozen=True, slots=True)
class Row:
    """One case: what is hidden, residual over true noise, status, and the estimate with and without the discrepancy."""

    model: str
    hidden: str
    ratio: float
    status: str
    truth: float
    plain: Estimate
    wide: Estimate

    @property
    def covered(self) -> tuple[bool, bool]:
        """Whether the interval holds the truth without and with the discrepancy."""
        ends = (self.plain.interval, self.wide.interval)
        return tuple(low <= self.truth <= high for low, high in ends)  # type: ignore[return-value]


def hidden_case(seed: int) -> Case:
    """A case with a hidden effect of 3 to 100 times the detectable size; the same seed gives the same case."""
    rng = np.random.default_rng([seed, STREAM])
    while True:
        kind, effect = list(NOISES)[int(rng.integers(len(NOISES)))], HIDDEN[int(rng.integers(len(HIDDEN)))]
        names = [name for name in effect.motions if name in ASKED]
        if not names:
            continue
        motion = MOTIONS[names[int(rng.integers(len(names)))]]
        values, t_s = motion.draw(rng), motion.times()
        shape, factor = effect.shape(motion, t_s, rng), float(np.exp(rng.uniform(*np.log(FACTORS))))
        sign = 1.0 if effect.brakes else float(rng.choice([-1.0, 1.0]))
        try:
            size = sign * factor * smallest_detectable(motion, values, t_s, effect, shape, kind)
            without, clean = (effect.show(motion, values, t_s, each, shape) for each in (0.0, size))
        except (ArithmeticError, ValueError):
            continue
        if np.max(np.abs(clean - without)) <= MAX_CHANGE * 4 * float(np.std(without)):
            observed = NOISES[kind](clean, motion.noise, rng)
            return Case(seed, motion, values, kind, t_s, observed, clean, effect, size, factor, shape)


def clean_case(seed: int) -> Case:
    """A case that lacks nothing, of a motion whose parameter is asked for."""
    case = draw_case(seed, clean=True)
    return case if case.motion.model in ASKED else clean_case(seed + 10_000)


def trajectory_of(case: Case) -> Trajectory:
    """The table of a case, without stated errors."""
    quantities = tuple(Quantity(name, unit, name) for name, unit in case.motion.observed)
    unknown = np.full_like(case.observed, np.nan)
    return Trajectory(case.t_s, quantities, case.observed, unknown, np.ones(case.t_s.size, dtype=bool))


def row_of(case: Case) -> Row:
    """Fit the model that lacks the effect, with and without the errors of a discrepancy."""
    model, name = MODELS[case.motion.model], ASKED[case.motion.model]
    trajectory = trajectory_of(case)
    wide = fit(trajectory, model)
    discrepancy = SOURCE in wide.budget[name]
    plain = fit(trajectory, model, options=replace(FitOptions(), discrepancy=False)) if discrepancy else wide
    residual: Array = wide.rms / case.motion.noise
    hidden = case.hidden.name if case.hidden else ""
    truth, before, after = case.values[name], plain.estimates[name], wide.estimates[name]
    return Row(model.name, hidden, float(np.max(residual)), wide.status, truth, before, after)


def table(rows: Sequence[Row]) -> pd.DataFrame:
    """A line for each range of residual over noise, one for what is called a misfit, and one for each effect."""
    groups: dict[str, list[Row]] = {
        f"residual {low:g} to {high:g} times the noise": [row for row in rows if low <= row.ratio < high]
        for low, high in BINS
    }
    groups["all with status misfit"] = [row for row in rows if row.status == "misfit"]
    groups |= {
        name: [row for row in rows if row.hidden == name and row.status == "misfit"]
        for name in dict.fromkeys(row.hidden for row in rows)
        if name
    }
    return pd.DataFrame([_line(label, part) for label, part in groups.items() if part])


def _line(label: str, rows: Sequence[Row]) -> dict[str, object]:
    covered = np.array([row.covered for row in rows])
    return {
        "cases": label,
        "number": len(rows),
        "status misfit / %": f"{100 * np.mean([row.status == 'misfit' for row in rows]):.0f}",
        "covered by the noise alone / %": f"{100 * covered[:, 0].mean():.0f}",
        "covered / %": f"{100 * covered[:, 1].mean():.0f}",
        "half width / error, median": f"{_relative_width(rows):.1f}",
    }


def _relative_width(rows: Sequence[Row]) -> float:
    widths = [(row.wide.interval[1] - row.wide.interval[0]) / 2 for row in rows]
    return float(np.median(widths) / np.median([abs(row.wide.value - row.truth) for row in rows]))


def main() -> None:
    """Print the tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--clean", type=int, default=100)
    parser.add_argument("--sealed", action="store_true", help="score seeds that nobody looks at")
    parser.add_argument("--first", type=int, default=0, help="first seed; with --sealed counted from the sealed ones")
    pages.add_option(parser)
    options = parser.parse_args()
    first = SEALED * options.sealed + options.first
    seeds = range(first, first + max(options.cases, options.clean))
    with pages.table("misfit", options.write_docs):
        for draw, count in ((hidden_case, options.cases), (clean_case, options.clean)):
            rows = _rows(draw, seeds[:count])
            print(f"{len(rows)} cases, {'sealed' if options.sealed else 'looked at'}, {_ABOUT[draw]}\n")
            print(pages.markdown(table(rows)))
            print()


def _rows(draw: Callable[[int], Case], seeds: Sequence[int]) -> list[Row]:
    return [row_of(draw(seed)) for seed in seeds]


_ABOUT = {hidden_case: "with a hidden effect:", clean_case: "with nothing hidden:"}


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
