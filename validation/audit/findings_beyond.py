"""Findings beyond the required ones: what the same files show about kappa, copies, collapse and sources."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np
import pandas as pd

from iris_sysid.errors import DataError
from validation.audit.evidence import DELFYS_TABLE, IRIS_TABLE, PAIRS, Outcome, facts, rounded, row_name, run_errors
from validation.audit.folder import (
    KAPPA_STATISTICS,
    PublishedFolder,
    estimates,
    n_failed,
    reading_of,
    select,
)
from validation.audit.printed import PublishedValue, sibling, values_at
from validation.audit.selection import score_published

COLLAPSED = 0.1  # range of a latent that its loss pulls towards N(0, 1)
SINGLE_CLIP_RUNS = ("iris_baseline", "iris_unified", "iris_unified_multistep", "delfys75_baseline", "delfys75_unified")


def kappa_is_the_column_alpha(folder: PublishedFolder) -> Outcome:
    """Point 14: the coupling statistics are those of alpha in the baseline's hitting-cones runs."""
    table = folder.table(KAPPA_STATISTICS, ("setting",), ("mean_kappa", "std_kappa", "cv_pct"))
    runs = folder.runs("iris_baseline")
    alphas = [select(runs, "Hitting_cones", str(setting))["alpha"].to_numpy(copy=True) for setting in table["setting"]]
    table = table.assign(mean_alpha=[alpha.mean() for alpha in alphas], std_alpha=[alpha.std() for alpha in alphas])
    same = np.isclose(table["mean_kappa"], table["mean_alpha"]) & np.isclose(table["std_kappa"], table["std_alpha"])
    statement = (
        f"Mean and standard deviation of kappa equal those of alpha in {same.sum()} of {len(same)} settings. alpha is "
        f"the acceleration of a one-body model there, and means of {rounded(table['mean_kappa'].tolist())} contradict "
        "the text's near-zero kappa."
    )
    return Outcome(bool(same.all()), statement, table)


def duplicated_runs(folder: PublishedFolder) -> Outcome:
    """Point 28: some runs occur twice within a setting, value for value."""
    copies = pd.concat([folder.runs(name).assign(file=name) for name in SINGLE_CLIP_RUNS])
    copies = copies[copies["duplicate_of"].notna()][["file", "phenomenon", "setting", "line", "duplicate_of"]]
    statement = f"{len(copies)} runs are copies of another run of their setting: those settings have one clip fewer."
    return Outcome(not copies.empty, statement, copies.reset_index(drop=True))


def latents_collapsed(folder: PublishedFolder) -> Outcome:
    """Point 32: in every two-pendulum multi-step run the latent hardly moves, so alpha carries no information."""
    table = pd.DataFrame(
        [_spread(folder, name) for name in ("iris_baseline", "iris_unified", "iris_unified_multistep")]
    )
    flat, total = table["collapsed"].tolist(), int(table["runs"].iloc[-1])
    statement = (
        f"In {flat[2]} of {total} two-pendulum multi-step runs the latent stays within {COLLAPSED:g} of one value, "
        f"though its loss asks for unit variance ({flat[0]} and {flat[1]} in the one-step runs): the encoder "
        "collapsed to a constant, which is no error that grows with the horizon."
    )
    return Outcome(flat[2] == total > 0 and flat[0] == flat[1] == 0, statement, table)


def _spread(folder: PublishedFolder, name: str) -> dict[str, str | float | int]:
    runs = folder.runs(name)
    spread = (runs["max_z"] - runs["min_z"])[runs["phenomenon"].isin(PAIRS)]
    return {
        "file": name,
        "runs": len(spread),
        "median range of z": float(spread.median()),
        "largest range of z": float(spread.max()),
        "collapsed": int((spread < COLLAPSED).sum()),
    }


def negative_damping_counts_as_zero(folder: PublishedFolder) -> Outcome:
    """Point 33: negative damping is set to 0 before the error is taken, which makes the one damping 'win'."""
    rows = [value for value in values_at(IRIS_TABLE, "multi-step") if value.parameter == "damping"]
    table = pd.DataFrame([_floored(folder, row) for row in rows])
    wins = [row.setting for row in rows if row.number < sibling(row, "one-step").number]
    won = table[table["row"].str.contains("|".join(wins))] if wins else table.iloc[:0]
    statement = (
        f"Multi-step damping is printed as better in {len(won)} of {len(table)} rows ({', '.join(wins)}), on "
        f"{', '.join(str(n) for n in won['negative values'])} of 10 negative values scored as 0; as they are the "
        f"error is {rounded(won['as they are'].tolist())}, not {rounded(won['negative as 0'].tolist())}."
    )
    return Outcome(bool((won["as they are"] > won["one-step"]).all()) and not won.empty, statement, table)


def _floored(folder: PublishedFolder, value: PublishedValue) -> dict[str, str | float | int]:
    floored, plain = (run_errors(folder, "iris_unified_multistep", value, zeros=zeros) for zeros in (True, False))
    return {
        "row": row_name(value),
        "one-step": sibling(value, "one-step").number,
        "printed": value.printed,
        "negative as 0": float(floored.mean()),
        "as they are": float(plain.mean()),
        "negative values": int((floored != plain).sum()),
    }


def error_rows_without_a_run(folder: PublishedFolder) -> Outcome:
    """Point 34: the error file behind the corrected Delfys75 column does not come from the released corrected runs."""
    frame = folder.errors("delfys75_unified")
    frame = frame[frame["parameter"] != "angle"]
    table = frame[["dynamics", "setting", "parameter", "est_mean"]].rename(columns={"est_mean": "error file"})
    table = table.assign(**{"released runs": [_released_mean(folder, row) for row in frame.to_dict("records")]})
    differs = ~np.isclose(table["error file"], table["released runs"], rtol=1e-6, atol=1e-9)
    zeros = int((table["error file"] == 0).sum())
    failed = n_failed(folder.runs("delfys75_unified"))
    statement = (
        f"{differs.sum()} of {len(table)} mean estimates of the corrected error file are not those of the released "
        f"corrected runs; {zeros} of them are 0, as of failed runs, while {failed} released runs failed: the printed "
        "column rests on runs that were not released."
    )
    return Outcome(bool(differs.all()), statement, table.reset_index(drop=True))


def _released_mean(folder: PublishedFolder, row: dict[Hashable, Any]) -> float:
    phenomenon, setting = str(row["dynamics"]), str(row["setting"])
    runs = select(folder.runs("delfys75_unified"), phenomenon, setting)
    return float(estimates(runs, reading_of(phenomenon, str(row["parameter"])), zeros=True).mean())


def led_error_is_the_truth(folder: PublishedFolder) -> Outcome:
    """Point 35: the LED baseline's printed error is the truth itself, since beta is 0 in every run."""
    beta = select(folder.runs("delfys75_baseline"), "led")["beta"].dropna()
    printed = next(value for value in values_at(DELFYS_TABLE, "baseline") if value.phenomenon == "led")
    other = next(value for value in values_at("tab:multistep_ablation", "one-step") if value.phenomenon == "led")
    as_alpha = float(run_errors(folder, "delfys75_baseline", other, "alpha", zeros=False).mean())
    statement = (
        f"beta is {rounded(sorted(set(beta)))} in all {len(beta)} LED baseline runs, so that the printed error "
        f"{printed.printed} is the truth itself; the other table's {other.printed} reads alpha of the same file as "
        "the decay rate."
    )
    table = facts(
        {
            "values of beta": rounded(sorted(set(beta))),
            f"{row_name(printed)}: printed error": printed.printed,
            f"{row_name(printed)}: truth": sibling(printed, "truth").printed,
            f"{row_name(other)}: printed one-step error": other.printed,
            f"{row_name(other)}: error of alpha": as_alpha,
        }
    )
    return Outcome(bool((beta == 0).all()) and printed.number == sibling(printed, "truth").number, statement, table)


def ranking_reverses_by_the_balls_alone(folder: PublishedFolder) -> Outcome:
    """Point 36: without the two ball classes the VLM strategies rank on IRIS as they do on Delfys75."""
    table = pd.DataFrame([_without_balls(folder, method) for method in ("vlm-temporal", "vlm-describe")])
    (temporal, describe), (temporal_rest, describe_rest) = table["all (%)"], table["without the balls (%)"]
    statement = (
        f"Over all classes describing first is ahead ({describe:.1f} against {temporal:.1f} %); without the two ball "
        f"classes temporal reasoning is ({temporal_rest:.1f} against {describe_rest:.1f} %), as on Delfys75."
    )
    return Outcome(bool(describe > temporal and temporal_rest >= describe_rest), statement, table)


def _without_balls(folder: PublishedFolder, method: str) -> dict[str, str | float]:
    score = score_published(folder, "iris", method)
    rest = score.per_class.drop(index=["dropping_ball", "falling_ball"], errors="ignore")
    if rest.empty:
        raise DataError(f"{score.source} holds no video but of balls; there is nothing to compare")
    return {
        "method": method,
        "all": f"{score.correct}/{score.n}",
        "all (%)": 100 * score.accuracy,
        "without the balls": f"{rest['correct'].sum()}/{rest['videos'].sum()}",
        "without the balls (%)": 100 * float(rest["correct"].sum() / rest["videos"].sum()),
    }
