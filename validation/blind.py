"""Blind test of the diagnosis: 0, 1 or 2 hidden effects, random in kind, sign and size, in motions of many models."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import pandas as pd

from fitters.compose_effects import with_effects
from fitters.effect_sensitivity import shaped
from fitters.image_effects import offered
from fitters.ode import fit, simulate
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.score_test import Screen, critical_value, screen
from iris_sysid.diagnosis.screening import SINGLE_LEVEL
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Array, Diagnosis, Effect, Estimate, OdeModel, Trajectory
from validation import pages

Result = TypeVar("Result")

FRAME_RATE_HZ = 60.0
# by model: length of the clip, s; noise, in the observed unit (0.1 px of a 720-line image); ranges of the truth
SETTINGS: Mapping[str, tuple[float, float, Mapping[str, tuple[float, float]]]] = {
    "pendulum": (
        10.0, 5e-4, {"length": (0.3, 1.0), "damping": (0.01, 0.1), "theta_0": (0.3, 1.2), "omega_0": (-0.5, 0.5)},
    ),
    "linear-oscillator": (
        10.0, 2e-4, {"stiffness": (9.0, 60.0), "damping": (0.02, 0.2), "z_0": (0.1, 0.3), "vz_0": (-0.2, 0.2)},
    ),
    "incline": (2.0, 2e-4, {"acceleration": (0.5, 2.0), "s_0": (0.0, 0.1), "v_0": (0.1, 0.5)}),
    "free-fall": (0.6, 2e-4, {"gravity": (9.8, 9.8), "z_0": (1.5, 2.0), "vz_0": (-0.2, 0.2)}),
    "projectile": (
        0.8, 2e-4, {"x_0": (0.0, 0.1), "z_0": (0.5, 0.8), "vx_0": (1.5, 2.5), "vz_0": (2.0, 3.5)},
    ),
    "torricelli": (20.0, 2e-4, {"outflow": (0.02, 0.035), "h_0": (0.2, 0.3)}),
    "exponential-decay": (5.0, 0.3, {"decay_rate": (0.4, 1.0), "intensity_0": (150.0, 220.0)}),
}  # fmt: skip
FACTORS = (0.5, 20.0)  # hidden sizes, in units of the smallest detectable one


@dataclass(frozen=True, slots=True)
class Outcome:
    """The hidden effects of a case and the result of its diagnosis.

    ``factors`` are the hidden sizes over the smallest detectable ones (given the other effect, where two are hidden),
    ``found`` whether each is the effect added, or in its stated class or group, ``off`` how far each size is off, in
    half-widths of its 95 % interval, NaN where another name was given; ``wrong`` are the added effects whose class or
    group holds no hidden effect, ``excess`` is the final error over the noise. ``without_name``: something was found
    that got no name, located or open.
    """

    model: str
    hidden: tuple[str, ...]
    factors: tuple[float, ...]
    found: tuple[bool, ...]
    off: tuple[float, ...]
    added: tuple[str, ...]
    wrong: tuple[str, ...]
    excess: float
    without_name: bool = False


def measured(model: OdeModel, values: Mapping[str, float], rng: np.random.Generator) -> Trajectory:
    """A motion of a model with white noise of the setting.

    Parameters
    ----------
    model
        The equation, with or without hidden effects.
    values
        True values by parameter.
    rng
        Random generator of the noise.
    """
    seconds, noise, _ = SETTINGS[model.name.partition(" + ")[0]]
    t_s = np.arange(round(seconds * FRAME_RATE_HZ)) / FRAME_RATE_HZ
    seen: Array = simulate(model, t_s, values).observed
    if not np.all(np.isfinite(seen)):
        raise FitError("the motion runs away")
    seen = seen + noise * rng.standard_normal(seen.shape)
    return Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(t_s.size, dtype=bool))


def drawn(model: OdeModel, rng: np.random.Generator) -> dict[str, float]:
    """Random values of the model."""
    return {name: float(rng.uniform(*ends)) for name, ends in SETTINGS[model.name][2].items()}


def hide(
    model: OdeModel, values: Mapping[str, float], count: int, rng: np.random.Generator
) -> tuple[list[Effect], dict[str, float], list[float]]:
    """Choose effects that the data can show, their sizes, and these over the smallest detectable sizes.

    Parameters
    ----------
    model, values
        The motion without effects.
    count
        Number of effects.
    rng
        Random generator of the case.
    """
    clean = measured(model, values, rng)
    fitted = fit(clean, model)
    library = offered(EFFECTS.values(), model, [clean])
    visible = [score for score in screen(library, fitted, clean).scores.values() if score.stderr > 0]
    chosen = [visible[index] for index in rng.permutation(len(visible))[:count]]
    effects = [_in_some_shape(EFFECTS[effect.effect], clean, rng) for effect in chosen]
    alone = screen([replace(effect, trials=None) for effect in effects], fitted, clean)
    sizes, factors = {}, []
    for effect, tried in zip(effects, (effect.tried for effect in chosen), strict=True):
        first, factor = effect.parameters[0], float(np.exp(rng.uniform(*np.log(FACTORS))))
        detectable = critical_value(SINGLE_LEVEL / len(library), tried) * alone.scores[effect.name].stderr
        sign = float(rng.choice([-1.0, 1.0])) if first.lower < 0.0 else 1.0  # friction only brakes
        size = float(np.clip(sign * factor * detectable, first.lower, first.upper))
        shape = [each.default or 0.0 for each in effect.parameters[1:]]
        size = size if effect.is_meant(clean.t_s, [size, *shape]) else -size  # a cord only slackens
        sizes[first.name] = size
        factors.append(abs(size) / detectable * share_apart(effect.name, alone))
    return effects, sizes, factors


def _in_some_shape(effect: Effect, clip: Trajectory, rng: np.random.Generator) -> Effect:
    shapes = list(effect.trials(clip.t_s, clip.position)) if effect.trials else [()]
    return shaped(effect, shapes[int(rng.integers(len(shapes)))])


def share_apart(name: str, alone: Screen) -> float:
    """Share of an effect's sensitivity that the other hidden effect cannot imitate.

    Parameters
    ----------
    name
        Name of the effect.
    alone
        Screening of the hidden effects only.
    """
    if name not in alone.visible:
        return 0.0
    others = [alone.cosine(name, other) for other in alone.scores if other != name]
    return float(np.sqrt(max(1.0 - sum(others) ** 2, 0.0)))


@dataclass(frozen=True, eq=False, slots=True)
class Hidden:
    """A motion with hidden effects: their ``sizes`` by parameter, and ``factors`` over the smallest detectable ones."""

    model: OdeModel
    trajectory: Trajectory
    effects: tuple[Effect, ...]
    sizes: Mapping[str, float]
    factors: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hidden effects."""
        return tuple(effect.name for effect in self.effects)


def hidden_case(seed: int, count: int) -> Hidden | None:
    """Make one case; None when the motion with the hidden effects diverges.

    Parameters
    ----------
    seed
        Random seed of the case.
    count
        Number of effects to hide.
    """
    rng = np.random.default_rng(seed)
    model = MODELS[list(SETTINGS)[seed % len(SETTINGS)]]
    values = drawn(model, rng)
    effects, sizes, factors = hide(model, values, count, rng)
    try:
        trajectory = measured(with_effects(model, effects), {**values, **sizes}, rng)
    except FitError:
        return None
    return Hidden(model, trajectory, tuple(effects), sizes, tuple(factors))


def outcome(made: Hidden) -> Outcome | None:
    """Outcome of the diagnosis of a case; None when its model cannot be fitted."""
    try:
        diagnosis = diagnose(made.trajectory, made.model)
    except FitError:
        return None
    return outcome_of(diagnosis, made.names, made.sizes, made.factors, SETTINGS[made.model.name][1])


def outcome_of(
    diagnosis: Diagnosis, hidden: tuple[str, ...], sizes: Mapping[str, float], factors: tuple[float, ...], noise: float
) -> Outcome:
    """Compare a diagnosis with the hidden effects.

    Parameters
    ----------
    diagnosis
        The diagnosis.
    hidden, sizes, factors
        Names of the effects, their sizes by parameter and over the smallest detectable ones.
    noise
        Standard deviation of the measurement noise.
    """
    groups = [set(finding.effects) for finding in diagnosis.findings if finding.word == "group"]
    alike = {effect.name: {effect.name, *diagnosis.indistinguishable[effect.name]} for effect in diagnosis.added}
    classes = [names.union(*(group for group in groups if name in group)) for name, names in alike.items()]
    return Outcome(
        model=diagnosis.base.model.name,
        hidden=hidden,
        factors=factors,
        found=tuple(any(name in class_name for class_name in classes) for name in hidden),
        off=tuple(_off(diagnosis.sizes.get(name), size) for name, size in sizes.items()),
        added=tuple(effect.name for effect in diagnosis.added),
        wrong=tuple(
            effect.name for effect, names in zip(diagnosis.added, classes, strict=True) if not names & set(hidden)
        ),
        excess=diagnosis.after.fitted / noise,
        without_name=any(finding.word in ("located", "open") for finding in diagnosis.findings),
    )


def case(seed: int, count: int) -> Outcome | None:
    """One case, made and diagnosed; None when it diverges or cannot be fitted.

    Parameters
    ----------
    seed, count
        As for :func:`hidden_case`.
    """
    made = hidden_case(seed, count)
    return None if made is None else outcome(made)


def _off(estimate: Estimate | None, size: float) -> float:
    """How far a size is from the middle of its 95 % interval, in half-widths; NaN without one."""
    if estimate is None:
        return float("nan")
    low, high = estimate.interval
    return ((low + high) / 2 - size) / ((high - low) / 2)


def table(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Success rates by the size of the hidden effect."""
    rows = []
    for label, low, high in (("below detectable", 0, 1), ("1 to 2 times", 1, 2), ("above 2 times", 2, np.inf)):
        part = [
            (outcome, k) for outcome in outcomes for k, factor in enumerate(outcome.factors) if low <= factor < high
        ]
        off = np.array([outcome.off[k] for outcome, k in part])
        alone = np.array([outcome.off[k] for outcome, k in part if all(outcome.found)])
        rows.append(
            {
                "hidden size": label,
                "effects": len(part),
                "named or in the class": percent([outcome.found[k] for outcome, k in part]),
                "else found without a name": percent(
                    [outcome.without_name and not outcome.found[k] and not outcome.wrong for outcome, k in part]
                ),
                "interval covers": percent(np.abs(off[np.isfinite(off)]) < 1.0),
                "where all was named": percent(np.abs(alone[np.isfinite(alone)]) < 1.0),
                "wrong name in the case": percent([bool(outcome.wrong) for outcome, _ in part]),
                "error after / noise": f"{np.median([outcome.excess for outcome, _ in part]):.3f}" if part else "",
            }
        )
    faint = [outcome for outcome in outcomes if outcome.hidden and max(outcome.factors) < 1.0]
    clean = [outcome for outcome in outcomes if not outcome.hidden]
    rows += [_cases("all below detectable", faint), _cases("nothing hidden", clean)]
    return pd.DataFrame(rows).fillna("")


def _cases(label: str, cases: Sequence[Outcome]) -> dict[str, object]:
    """A row about whole cases instead of effects."""
    return {
        "hidden size": label,
        "effects": f"{len(cases)} cases",
        "wrong name in the case": percent([bool(outcome.wrong) for outcome in cases]),
        "error after / noise": f"{np.median([outcome.excess for outcome in cases]):.3f}" if cases else "",
    }


def percent(flags: Sequence[bool] | Array) -> str:
    """The share that is true, as text; empty for no values."""
    return f"{100 * np.mean(flags):.1f} %" if len(flags) else ""


def print_all_cases(
    case: Callable[[int, int], Result | None],
    show: Callable[[list[Result], int], None],
    *,
    about: str,
    cases: int,
    name: str,
) -> list[Result]:
    """Run every case in parallel processes, as the command line says, and print a table of the results.

    Parameters
    ----------
    case
        Function of a seed and a number of hidden effects; None where the case cannot be used.
    show
        Prints the table, from the results and the number of cases without one.
    about
        Description of the command.
    cases
        Default number of cases.
    name
        Name of the table in the docs.
    """
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--cases", type=int, default=cases)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    pages.add_option(parser)
    options = parser.parse_args()
    seeds = np.arange(options.cases) + 10_000 * options.seed
    counts = np.random.default_rng(options.seed).integers(0, 3, options.cases)
    with pages.table(name, options.write_docs):
        with ProcessPoolExecutor(options.workers) as pool:
            outcomes = list(pool.map(case, seeds.tolist(), counts.tolist()))
        results = [result for result in outcomes if result is not None]
        show(results, len(outcomes) - len(results))
    return results


def main() -> None:
    """Print the table, and the cases with a wrong result."""
    outcomes = print_all_cases(case, print_table, about=str(__doc__), cases=300, name="blind")
    print("\n".join(wrong_cases(outcomes)))


def print_table(outcomes: list[Outcome], unusable: int) -> None:
    """Print the rates, and how many cases could not be used."""
    print(f"{len(outcomes)} cases; {unusable} diverged or could not be fitted")
    print(pages.markdown(table(outcomes)))


def wrong_cases(outcomes: Sequence[Outcome]) -> list[str]:
    """One line for each case that names a wrong effect, or misses one of more than twice the detectable size."""
    lines = []
    for outcome in outcomes:
        sizes = list(zip(outcome.hidden, outcome.factors, outcome.found, strict=True))
        if outcome.wrong or any(factor > 2 and not found for _, factor, found in sizes):
            hidden = ", ".join(f"{name} x {factor:.1f}" for name, factor, _ in sizes) or "nothing"
            lines.append(f"  {outcome.model}: hidden {hidden}; added {', '.join(outcome.added) or 'nothing'}")
    return lines


if __name__ == "__main__":
    main()
