"""The diagnosis compared with SINDy on the mismatch between model and measurement, on the same blind cases.

The mismatch is the measured acceleration less that of the fitted model, regressed by sequentially thresholded least
squares on a library (Kaheman, Kaiser, Strom, Kutz and Brunton 2019, arXiv 1909.08574). It gets the same
effects: a column for every shape of every effect that is a force; the threshold is that of the least BIC, for as many
independent samples as the smoothing leaves.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pysindy

from fitters.effect_sensitivity import force_along, rates, shaped
from fitters.ode import fit
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Array, Effect, OdeModel, Trajectory
from validation import pages
from validation.blind import Outcome, hidden_case, outcome, percent, print_all_cases

THRESHOLDS = np.geomspace(1e-3, 1.0, 13)  # of a column's share, in units of the largest mismatch
WINDOW = 11  # samples of the smoothing before each derivative, pysindy's own default


@dataclass(frozen=True, slots=True)
class Pair:
    """One case: the outcome of the diagnosis, and the names that SINDy on the mismatch gives."""

    ours: Outcome
    theirs: tuple[str, ...]


def pair(seed: int, count: int) -> Pair | None:
    """One case through both methods; None when its motion diverges or cannot be fitted.

    Parameters
    ----------
    seed, count
        As for :func:`validation.blind.case`.
    """
    made = hidden_case(seed, count)
    ours = None if made is None else outcome(made)
    if made is None or ours is None:
        return None
    try:
        return Pair(ours, on_the_mismatch(made.trajectory, made.model))
    except FitError:
        return None


def on_the_mismatch(trajectory: Trajectory, model: OdeModel) -> tuple[str, ...]:
    """Names of the effects whose columns SINDy keeps.

    Parameters
    ----------
    trajectory
        Measured trajectory.
    model
        The equation without hidden effects; fitted here, as for the diagnosis.
    """
    fitted = fit(trajectory, model)
    if not fitted.usable:
        raise FitError(fitted.message)
    t_s, derivative = trajectory.t_s, pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": WINDOW})
    velocity = np.asarray(derivative(trajectory.position, t_s))
    states = np.hstack([trajectory.position, velocity]) if model.second_order else trajectory.position
    highest = np.asarray(derivative(velocity, t_s)) if model.second_order else velocity
    slopes = rates(model, t_s, states, {name: estimate.value for name, estimate in fitted.estimates.items()}, None)
    mismatch = highest - slopes[:, -highest.shape[1] :]
    names, columns = _library(trajectory, model, states, slopes)
    inside = slice(WINDOW, t_s.size - WINDOW)  # derivatives at the ends are unreliable
    kept = _sparse(np.stack(columns, axis=2)[inside], mismatch[inside])
    return tuple(dict.fromkeys(name for name, keep in zip(names, kept, strict=True) if keep))


def _library(trajectory: Trajectory, model: OdeModel, states: Array, slopes: Array) -> tuple[list[str], list[Array]]:
    """A column (n, f) of each shape of each effect that acts on the motion; those that vanish are left out."""
    names, columns = [], []
    for effect in EFFECTS.values():
        if effect.acceleration is None or not effect.applies(model):
            continue
        for own in _shapes(effect, trajectory):
            sizes = np.array([parameter.default or 0.0 for parameter in own.parameters])
            column = force_along(own, sizes, model, trajectory.t_s, states, slopes)
            if np.all(np.isfinite(column)) and np.any(column):
                names.append(effect.name)
                columns.append(column)
    return names, columns


def _shapes(effect: Effect, trajectory: Trajectory) -> list[Effect]:
    if effect.trials is None:
        return [effect]
    return [shaped(effect, shape) for shape in effect.trials(trajectory.t_s, trajectory.position)]


def _sparse(columns: Array, mismatch: Array) -> Array:
    """Which columns (n, f, k) the threshold of the least BIC keeps; possibly none."""
    rows, target = columns.reshape(-1, columns.shape[2]), mismatch.ravel() / np.max(np.abs(mismatch))
    rows = rows / np.linalg.norm(rows, axis=0) * np.sqrt(len(rows))
    best, kept = _bic(target, 0), np.zeros(rows.shape[1], dtype=bool)
    for threshold in THRESHOLDS:
        optimizer = pysindy.STLSQ(threshold=threshold)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the empty selection, a valid answer
            coefficients = np.asarray(optimizer.fit(rows, target[:, None]).coef_)[0]
        score = _bic(target - rows @ coefficients, int(np.count_nonzero(coefficients)))
        if score < best:
            best, kept = score, coefficients != 0
    return kept


def _bic(residual: Array, terms: int) -> float:
    independent = residual.size / WINDOW
    return float(independent * np.log(np.mean(residual**2)) + terms * np.log(independent))


def table(pairs: Sequence[Pair]) -> pd.DataFrame:
    """Success of both methods by the size of the hidden effect, and by whether it is a force."""
    rows = []
    bins = (("below detectable", 0.0, 1.0), ("1 to 2 times", 1.0, 2.0), ("above 2 times", 2.0, np.inf))
    for label, low, high in bins:
        rows.append(_row(label, pairs, low, high, forces_only=False))
    rows.append(_row("above 2 times, forces only", pairs, 2.0, np.inf, forces_only=True))
    clean = [pair for pair in pairs if not pair.ours.hidden]
    rows.append(
        {
            "hidden size": "nothing hidden",
            "effects": f"{len(clean)} cases",
            "diagnosis: wrong name": percent([bool(outcome.ours.wrong) for outcome in clean]),
            "mismatch: wrong name": percent([bool(outcome.theirs) for outcome in clean]),
        }
    )
    return pd.DataFrame(rows).fillna("")


def _row(label: str, pairs: Sequence[Pair], low: float, high: float, *, forces_only: bool) -> dict[str, object]:
    part = [
        (pair, k)
        for pair in pairs
        for k, factor in enumerate(pair.ours.factors)
        if low <= factor < high and (not forces_only or EFFECTS[pair.ours.hidden[k]].acceleration is not None)
    ]
    return {
        "hidden size": label,
        "effects": len(part),
        "diagnosis: named or in the class": percent([pair.ours.found[k] for pair, k in part]),
        "mismatch: named": percent([pair.ours.hidden[k] in pair.theirs for pair, k in part]),
        "mismatch: named, and nothing else": percent([set(pair.theirs) == set(pair.ours.hidden) for pair, _ in part]),
        "diagnosis: wrong name": percent([bool(pair.ours.wrong) for pair, _ in part]),
        "mismatch: wrong name": percent([bool(set(pair.theirs) - set(pair.ours.hidden)) for pair, _ in part]),
    }


def main() -> None:
    """Print the table."""
    print_all_cases(pair, print_table, about=str(__doc__), cases=60, name="mismatch")


def print_table(pairs: list[Pair], unusable: int) -> None:
    """Print how often each method names the hidden effect."""
    print(f"{len(pairs)} cases; {unusable} diverged or could not be fitted")
    print(pages.markdown(table(pairs)))


if __name__ == "__main__":
    main()
