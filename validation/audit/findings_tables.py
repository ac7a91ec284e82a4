"""Findings about splits, counts, selection and what was never released."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pandas as pd

from iris_sysid.benchmark.sources.conversions import Values
from iris_sysid.benchmark.sources.reading import read_lines
from validation.audit.derive import mean, standard_deviation
from validation.audit.evidence import IRIS_TABLE, Outcome, estimated, facts, matches, row_name, run_errors
from validation.audit.folder import PREDICTIONS, PublishedFolder, estimates, reading_of, select
from validation.audit.printed import PublishedValue, all_values, sibling, values_at
from validation.audit.selection import score_published

TEST_CLIPS = 2  # a setting, in the stated test partition


def errors_are_over_all_clips(folder: PublishedFolder) -> Outcome:
    """Point 12: each error is over all 10 clips of a setting, not over 2 test clips; no pair of clips gives them."""
    names = ("iris_baseline", "iris_unified", "iris_unified_multistep")
    counts = sorted({int(n) for name in names for n in folder.errors(name)["n"]})
    rows = estimated(IRIS_TABLE, "one-step")
    errors = [run_errors(folder, "iris_baseline", row) for row in rows]
    fits = [_pairs_that_fit(row, clip_errors) for row, clip_errors in zip(rows, errors, strict=True)]
    everywhere = set.intersection(*fits)
    hits = sum(matches(row, float(clip_errors.mean())) for row, clip_errors in zip(rows, errors, strict=True))
    statement = (
        f"The error files say n = {', '.join(map(str, counts))}. All {max(counts)} clips give {hits} of {len(rows)} "
        f"printed one-step errors; {len(everywhere)} choices of {TEST_CLIPS} clips, the stated test partition, do."
    )
    table = pd.DataFrame(
        {
            "row": [row_name(row) for row in rows],
            "printed": [row.printed for row in rows],
            "all clips": [float(clip_errors.mean()) for clip_errors in errors],
            "pairs of clips that give it": [len(pairs) for pairs in fits],
        }
    )
    return Outcome(counts == [10] and not everywhere and hits == len(rows), statement, table)


def _pairs_that_fit(value: PublishedValue, errors: Values) -> set[tuple[int, ...]]:
    pairs = itertools.combinations(range(len(errors)), TEST_CLIPS)
    return {pair for pair in pairs if matches(value, float(errors[list(pair)].mean()))}


def variance_table_is_not_means(folder: PublishedFolder) -> Outcome:
    """Point 13: the 'mean' column is truth -/+ error, and the 'sigma' column is no standard deviation of the runs."""
    table = pd.DataFrame([_variance_row(folder, value) for value in estimated("tab:id_variance", "mean")])
    shifted, direct, deviations = (
        int(table.pop(name).sum()) for name in ("shift matches", "mean matches", "sigma matches")
    )
    statement = (
        f"{shifted} of {len(table)} printed means equal the printed truth -/+ the printed error exactly, {direct} "
        f"equal the mean of the runs; {deviations} of {len(table)} printed standard deviations are those of the runs."
    )
    return Outcome(shifted == len(table) > direct and deviations == 0, statement, table)


def _variance_row(folder: PublishedFolder, value: PublishedValue) -> dict[str, str | float | bool]:
    truth, error = sibling(value, "truth"), sibling(value, "one-step", IRIS_TABLE)
    sigma = sibling(value, "standard-deviation")
    runs = select(folder.runs("iris_baseline"), value.phenomenon, value.setting)
    values = estimates(runs, reading_of(value.phenomenon, value.parameter), zeros=False)
    shifted = truth.number + (error.number if value.number > truth.number else -error.number)
    centre, spread = mean(values, truth.number), standard_deviation(values, truth.number)
    return {
        "row": row_name(value),
        "printed mean": value.printed,
        "truth -/+ error": shifted,
        "mean of the runs": centre,
        "printed sigma": sigma.printed,
        "sd of the runs": spread,
        "shift matches": abs(shifted - value.number) < 1e-9,
        "mean matches": matches(value, centre),
        "sigma matches": matches(sigma, spread),
    }


def counts_disagree(folder: PublishedFolder) -> Outcome:
    """Point 23: Delfys75 has 90 videos of 6 phenomena in the results, 75 of 5 in the text; strategies are 3 to 5."""
    runs = folder.runs("delfys75_baseline")
    stated = {
        value.parameter: value.number for value in values_at("tab:benchmark_comparison") if value.dataset == "delfys75"
    }
    announced = [value for value in all_values() if value.parameter == "strategies"]
    methods = sorted({method for _, method in PREDICTIONS})
    table = facts(
        {
            "Delfys75 videos, printed": stated["videos"],
            "Delfys75 runs": len(runs),
            "Delfys75 phenomena, printed": stated["phenomena"],
            "Delfys75 phenomena in the runs": runs["phenomenon"].nunique(),
            "runs per phenomenon": ", ".join(str(n) for n in sorted(set(runs.groupby("phenomenon").size()))),
            **{f"strategies, {value.place} line {value.line}": value.printed.lower() for value in announced},
            "strategies with predictions": ", ".join(methods),
        }
    )
    statement = (
        f"{stated['videos']:g} videos of {stated['phenomena']:g} phenomena are printed, {len(runs)} of "
        f"{runs['phenomenon'].nunique()} were run; {', '.join(sorted({value.printed.lower() for value in announced}))} "
        f"strategies are announced, {len(methods)} have predictions, the oracle has no row."
    )
    holds = (stated["videos"], stated["phenomena"]) != (len(runs), runs["phenomenon"].nunique())
    return Outcome(holds and len({value.number for value in announced}) > 1, statement, table)


def cnn_accuracy_is_not_attainable(folder: PublishedFolder) -> Outcome:
    """Point 24: no number of right answers gives the printed CNN accuracies; the VLM ones are confirmed."""
    table = pd.DataFrame([_accuracy_row(folder, value) for value in values_at("tab:summary_vlm_methods")])
    is_cnn = table["method"] == "cnn"
    wrong = int((is_cnn & (table["attainable"] == "no")).sum())
    right = int((~is_cnn & (table["printed"] == table["re-scored"])).sum())
    statement = (
        f"{wrong} of {is_cnn.sum()} printed CNN accuracies are no fraction of the held-out fifth nor of all videos "
        f"(the files give 100 %, training videos included); {right} of {(~is_cnn).sum()} VLM accuracies are confirmed."
    )
    return Outcome(wrong == is_cnn.sum() and right == (~is_cnn).sum(), statement, table)


def _accuracy_row(folder: PublishedFolder, value: PublishedValue) -> dict[str, str | float]:
    score = score_published(folder, value.dataset, value.column)
    sizes = (max(round(score.n / 5), 1), score.n) if value.column == "cnn" else (score.n,)
    reachable = any(attainable(value.number, value.tolerance, n) for n in sizes)
    balls = [
        f"{name} {row['correct']:g}/{row['videos']:g}"
        for name, row in score.per_class.iterrows()
        if "_ball" in str(name)
    ]
    return {
        "dataset": value.dataset,
        "method": value.column,
        "printed": value.printed,
        "re-scored": f"{100 * score.accuracy:.2f}",
        "right": f"{score.correct}/{score.n}",
        "attainable": "yes" if reachable else "no",
        "nearest": "; ".join(f"{_nearest(value.number, n)} of {n}" for n in sizes),
        "balls": ", ".join(balls),
    }


def attainable(percent: float, tolerance: float, n: int) -> bool:
    """Whether some number of ``n`` videos is ``percent`` within ``tolerance`` (both in per cent).

    Parameters
    ----------
    percent
        The printed share.
    tolerance
        Half of its last digit.
    n
        Number of videos.
    """
    return any(abs(100 * k / n - percent) <= tolerance for k in range(n + 1))


def _nearest(percent: float, n: int) -> str:
    below = int(percent * n / 100)
    return " or ".join(f"{100 * k / n:.2f}" for k in dict.fromkeys((below, min(below + 1, n))))


def identifiability_was_not_released(folder: PublishedFolder) -> Outcome:
    """Point 25: no file holds gradient norms, ODE residuals of a run, or predictions beyond the training window."""
    headers = {path.relative_to(folder.path).as_posix(): read_lines(path)[0][1] for path in _csv_files(folder.path)}
    pattern = re.compile(r"grad|norm|resid|extrap|horizon|epoch", re.IGNORECASE)
    hits = {path: name for path, header in headers.items() for name in header if pattern.search(name)}
    runs_hit = {path for path in hits if not path.startswith("ablations/")}  # an oscillator test, no run
    norms = next(
        value for value in values_at("tab:identifiability", "gradient-epoch-1") if value.phenomenon == "Dropping_ball"
    )
    low, high = (next(values_at("text:app:grad_norms", f"gradient-epoch-1-{end}")).number for end in ("low", "high"))
    numbers = {place: sum(1 for _ in values_at(place)) for place in ("tab:identifiability", "tab:extrapolation")}
    statement = (
        f"None of the {len(headers)} CSV files holds what "
        f"{' and '.join(f'{k} ({v} numbers)' for k, v in numbers.items())} print, though each entry is said to be "
        f"traceable; at epoch 1 the text's gradient norm is {low / norms.number:.0f} to {high / norms.number:.0f} "
        "times the table's."
    )
    table = facts(
        {
            "CSV files searched": len(headers),
            "columns of that kind": ", ".join(f"{path}: {name}" for path, name in hits.items()) or "none",
            "gradient norm at epoch 1, dropped ball, table": norms.printed,
            "gradient norm at epoch 1, dropped ball, text": f"{low:g} to {high:g}",
            "last epoch, table": norms.column.replace("gradient-epoch-1", "200"),
            "epochs, text": next(values_at("text:app:training", "stated")).printed,
        }
    )
    return Outcome(bool(headers) and not runs_hit, statement, table)


def _csv_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.csv") if path.is_file())


def multi_clip_tests_one_setting(folder: PublishedFolder) -> Outcome:
    """Point 26: the shared model is tested on one setting a phenomenon, with one alpha for all six clips."""
    everything = folder.runs("iris_baseline")
    table = pd.DataFrame(
        [
            {
                "phenomenon": name,
                "settings": ", ".join(sorted(set(select(everything, str(name))["setting"]))),
                "tested": ", ".join(sorted(set(runs["setting"]))),
                "clips": ", ".join(runs["clip"]),
                "different alphas": runs["alpha"].nunique(),
            }
            for name, runs in folder.runs("iris_multi_clip").groupby("phenomenon")
        ]
    )
    single = int(((table["different alphas"] == 1) & ~table["tested"].str.contains(",")).sum())
    last = sum(row["settings"].endswith(row["tested"]) for row in table.to_dict("records"))
    statement = (
        f"{single} of {len(table)} phenomena are tested on one setting (the alphabetically last in {last}) with a "
        "single alpha for all its clips: the test rows are one number, and sharing is confounded with the setting."
    )
    return Outcome(single == len(table) == last, statement, table)
