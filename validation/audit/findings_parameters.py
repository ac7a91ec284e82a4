"""Findings about the parameter tables: the meaning of alpha, failed runs, and the file behind each column."""

from __future__ import annotations

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.conversions import GRAVITY
from validation.audit.derive import error_row
from validation.audit.evidence import (
    BALLS,
    DELFYS_TABLE,
    IRIS_TABLE,
    PAIRS,
    PENDULUMS,
    Outcome,
    estimated,
    matches,
    rounded,
    row_name,
    run_mae,
    truth_value,
)
from validation.audit.folder import RUNS, PublishedFolder, estimates, n_failed, reading_of, select
from validation.audit.printed import PublishedValue, sibling, values_at

FIRST_ALPHA = 10.0  # what the released main.py starts alpha at (init_phys)
AS_LENGTH = "alpha as length"


def alpha_is_a_length(folder: PublishedFolder) -> Outcome:
    """Point 1: the baseline's pendulum alpha rises with the true length, so it is the length, not g/L."""
    printed = [value for value in values_at(DELFYS_TABLE, "baseline") if value.parameter == "length"]
    table = pd.DataFrame([_both_readings(folder, value) for value in printed])
    iris = [value for value in values_at(IRIS_TABLE, "one-step") if value.phenomenon in PENDULUMS]
    rising = bool(table.sort_values("true length (m)")["mean alpha"].is_monotonic_increasing)
    worse = int((table["corrected (m)"] > table["alpha as length (m)"]).sum())
    statement = (
        "alpha rises with the true length (g/L would fall). Read as a length the Delfys75 baseline's errors are "
        f"{rounded(table['alpha as length (m)'].tolist())} m, not {rounded(table['g/alpha (m)'].tolist())} m, and the "
        f"correction makes {worse} of {len(table)} worse; on IRIS they become "
        f"{rounded([run_mae(folder, 'iris_baseline', iri, AS_LENGTH) for iri in iris])} m."
    )
    same = all(matches(value, error) for value, error in zip(printed, table["g/alpha (m)"], strict=True))
    return Outcome(rising and same and worse >= 2, statement, table)


def _both_readings(folder: PublishedFolder, value: PublishedValue) -> dict[str, str | float]:
    alpha = float(select(folder.runs("delfys75_baseline"), value.phenomenon, value.setting)["alpha"].mean())
    return {
        "row": row_name(value),
        "true length (m)": truth_value(value),
        "mean alpha": alpha,
        "alpha / length": alpha / truth_value(value),
        "printed (m)": value.printed,
        "g/alpha (m)": run_mae(folder, "delfys75_baseline", value),
        "alpha as length (m)": run_mae(folder, "delfys75_baseline", value, AS_LENGTH),
        "corrected (m)": sibling(value, "corrected").number,
        "corrected, released runs (m)": run_mae(folder, "delfys75_unified", value),
    }


def failures_scored_as_zero(folder: PublishedFolder) -> Outcome:
    """Point 2: runs that failed are all-zero rows, scored as estimates of 0, and printed as errors of 0.00."""
    runs = folder.runs("delfys75_baseline")
    iris = {name: n_failed(folder.runs(name)) for name in RUNS if name.startswith("iris_")}
    columns = (("baseline", "delfys75_baseline"), ("corrected", "delfys75_unified"))
    table = pd.DataFrame(
        [_zero(folder, value, name) for column, name in columns for value in values_at(DELFYS_TABLE, column)]
    )
    table = table[(table["estimate"] == 0) & (table["printed"] == "0.00")]
    statement = (
        f"{n_failed(runs)} of {len(runs)} Delfys75 baseline runs are all zeros (the IRIS files have "
        f"{sum(iris.values())}). The error files count each as an estimate of 0, so that its error is the truth "
        f"itself; {len(table)} of these rows are printed as an error of 0.00."
    )
    holds = n_failed(runs) > 0 and not any(iris.values()) and not table.empty
    holds = holds and bool(np.allclose(table["error in the file"], table["truth"]))
    return Outcome(holds, statement, table.reset_index(drop=True))


def _zero(folder: PublishedFolder, value: PublishedValue, name: str) -> dict[str, str | float]:
    row = error_row(folder, name, value)
    return {
        "row": row_name(value),
        "column": value.column,
        "printed": value.printed,
        "estimate": float(row["est_mean"]),
        "error in the file": float(row["abs_err_mean"]),
        "truth": float(row["gt_mean"]),
    }


def initial_values(folder: PublishedFolder) -> Outcome:
    """Point 3: beta never moved from 1.0 or 10.0, and the untrained alpha = 10 beats most of the table."""
    runs = folder.runs("iris_baseline")
    frozen = {name: sorted(set(select(runs, name)["beta"])) for name in (*BALLS, "Hitting_cones", "Sliding_cone")}
    rows = [value for value in estimated(IRIS_TABLE, "one-step") if value.parameter in ("gravity", "length")]
    rows += [value for value in values_at("tab:multi_clip", "per-clip") if value.parameter in ("gravity", "length")]
    table = pd.DataFrame(
        {"row": [f"{row.place}: {row_name(row)}" for row in rows], "printed": [row.number for row in rows]}
    ).assign(**{"initial value alone": [_initial_error(row) for row in rows]})
    better = int((table["initial value alone"] < table["printed"]).sum())
    still = "; ".join(f"{name} {rounded(values)}" for name, values in frozen.items())
    statement = (
        f"beta never moved ({still} in every run). Doing nothing, alpha = {FIRST_ALPHA:g}, has a smaller error than "
        f"{better} of {len(table)} printed gravity and length errors, and the per-clip gravity errors are about its "
        "own."
    )
    holds = all(values in ([1.0], [10.0]) for values in frozen.values()) and better > 0
    return Outcome(holds, statement, table)


def _initial_error(value: PublishedValue) -> float:
    if value.parameter == "gravity":
        return abs(FIRST_ALPHA - GRAVITY)
    return abs(GRAVITY / FIRST_ALPHA - 0.5)  # every IRIS rope is 0.50 m


def uncorrected_integrator_trains(folder: PublishedFolder) -> Outcome:
    """Point 4: the uncorrected baseline's alpha differs from clip to clip, so that it did receive a gradient."""
    runs = folder.runs("iris_baseline")
    table = runs.groupby(["phenomenon", "setting"], as_index=False)["alpha"].agg(["min", "max"])
    own = select(runs, "Pendulum", "pendulum_20")["alpha"].agg(["min", "max"])
    statement = (
        f"Without a gradient every clip would keep alpha = {FIRST_ALPHA:g}; in pendulum_20 it runs from "
        f"{own['min']:.3g} to {own['max']:.3g}, so 'no gradient at any epoch' does not describe the released baseline."
    )
    return Outcome(bool(((table["max"] - table["min"]) > 0.1).all()), statement, table)


def one_step_column_is_the_baseline(folder: PublishedFolder) -> Outcome:
    """Point 5: the column '1-step, +Corrected' is the uncorrected baseline's file, not the corrected one's."""
    rows = estimated(IRIS_TABLE, "one-step")
    by_file = {name: [run_mae(folder, name, row) for row in rows] for name in ("iris_baseline", "iris_unified")}
    hits = {name: sum(map(matches, rows, errors)) for name, errors in by_file.items()}
    statement = (
        f"{hits['iris_baseline']} of {len(rows)} printed one-step errors are those of the uncorrected baseline; "
        f"{hits['iris_unified']} of the corrected one-step run, which the caption names."
    )
    table = pd.DataFrame({"row": [row_name(row) for row in rows], "printed": [row.printed for row in rows], **by_file})
    return Outcome(hits["iris_baseline"] == len(rows) > hits["iris_unified"], statement, table)


def differences_mix_references(folder: PublishedFolder) -> Outcome:
    """Point 6: three printed differences are against another run than the column beside them, with the wrong sign."""
    places = (IRIS_TABLE, "text:sec:exp_iris")
    rows = [value for place in places for value in estimated(place, "difference")]
    table = pd.DataFrame([_references(folder, row) for row in rows])
    mixed = [
        row
        for row, used in zip(rows, table["reference"], strict=True)
        if row.place == IRIS_TABLE and used == "corrected one-step"
    ]
    bold = sum(
        sibling(value, "multi-step").bold and sibling(value, "multi-step").number > sibling(value, "one-step").number
        for value in mixed
    )
    text = table[table["place"] != IRIS_TABLE]["reference"].value_counts()
    names = ", ".join(f"{row_name(value)} {value.printed}" for value in mixed)
    statement = (
        f"{len(mixed)} differences of the table ({names}) are "
        f"against the corrected run, while the column beside them is the baseline; {bold} of them set the larger "
        f"error in bold. In the text {text.get('corrected one-step', 0)} are against the corrected run and "
        f"{text.get('baseline', 0)} against the baseline."
    )
    kept = table[table["reference"] == "corrected one-step"] if mixed else table
    return Outcome(len(mixed) > 0 and bold == len(mixed), statement, kept.reset_index(drop=True))


def _references(folder: PublishedFolder, value: PublishedValue) -> dict[str, str | float]:
    multi, base, unified = _errors_of_three(folder, value)
    fits = {"baseline": matches(value, multi - base), "corrected one-step": matches(value, multi - unified)}
    return {
        "place": value.place,
        "row": row_name(value),
        "printed": value.printed,
        "minus baseline": multi - base,
        "minus corrected one-step": multi - unified,
        "reference": next((name for name, fit in fits.items() if fit), "neither"),
    }


def _errors_of_three(folder: PublishedFolder, value: PublishedValue) -> tuple[float, float, float]:
    names = ("iris_unified_multistep", "iris_baseline", "iris_unified")
    multi, base, unified = (float(error_row(folder, name, value)["abs_err_mean"]) for name in names)
    return multi, base, unified


def multi_step_is_not_consistently_worse(folder: PublishedFolder) -> Outcome:
    """Point 7: against the corrected one-step run, the multi-step loss makes gravity better as often as worse."""
    rows = [value for value in values_at(IRIS_TABLE, "difference") if value.parameter == "gravity"]
    table = pd.DataFrame([_references(folder, row) for row in rows]).drop(columns=["place", "reference"])
    delfys = [
        value.number for value in values_at("tab:multistep_ablation", "difference") if value.parameter == "gravity"
    ]
    grown, fallen = int((table["minus baseline"] > 0).sum()), int((table["minus corrected one-step"] < 0).sum())
    statement = (
        f"The gravity error grows in {grown} of {len(table)} rows against the uncorrected baseline, but falls in "
        f"{fallen} against the true one-step run; on Delfys75, said to be mirrored, all {len(delfys)} printed changes "
        "are reductions."
    )
    return Outcome(grown == len(table) and fallen > 0 and max(delfys) < 0, statement, table)


def lengths_blow_up_as_one_over_alpha(folder: PublishedFolder) -> Outcome:
    """Point 9: errors of hundreds of metres are g/alpha for alpha near 0; alpha <= 0 counts as a length of 0."""
    rows = [value for value in values_at(IRIS_TABLE, "multi-step") if value.phenomenon in PAIRS]
    table = pd.DataFrame([_blow_up(folder, row) for row in rows])
    means, invalid = table["mean alpha"], table["clips with alpha <= 0"]
    shared = _bodies_share_one_length(folder)
    statement = (
        f"alpha averages {means.min():.3g} to {means.max():.3g} in the two-pendulum multi-step runs, so that g/alpha "
        f"diverges; {invalid.min()} to {invalid.max()} of 10 clips have alpha <= 0 and count as a length of 0; the "
        f"rows of both bodies are {'identical' if shared else 'different'}."
    )
    return Outcome(bool(means.max() < 0.5 and invalid.min() >= 1) and shared, statement, table)


def _blow_up(folder: PublishedFolder, value: PublishedValue) -> dict[str, str | float | int]:
    runs = select(folder.runs("iris_unified_multistep"), value.phenomenon, value.setting)
    lengths = estimates(runs, reading_of(value.phenomenon, value.parameter), zeros=True)
    return {
        "row": row_name(value),
        "printed (m)": value.printed,
        "mean alpha": float(runs["alpha"].mean()),
        "largest length (m)": float(lengths.max()),
        "its share of the mean": float(lengths.max() / lengths.sum()) if lengths.any() else 0.0,
        "clips with alpha <= 0": int((runs["alpha"] <= 0).sum()),
    }


def _bodies_share_one_length(folder: PublishedFolder) -> bool:
    frame = folder.errors("iris_unified_multistep").set_index(["dynamics", "setting"])
    columns = ["est_mean", "abs_err_mean"]
    first, second = (frame.loc[frame["parameter"] == name, columns] for name in ("length_1", "length_2"))
    return bool(len(first) > 0 and first.equals(second))
