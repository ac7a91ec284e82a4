"""The audit: derive each published number again from the result files, by every derivation that could produce it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd

from iris_sysid.errors import DataError
from validation.audit import derive
from validation.audit.derive import Derivation, Recipe
from validation.audit.folder import KAPPA_LOSSES, KAPPA_STATISTICS, PublishedFolder
from validation.audit.printed import PublishedValue, all_values

REPRODUCED = "reproduced"
DIFFERS = "differs"
NOT_DERIVABLE = "cannot be derived"
KINDS = {"result files": 0, "metadata": 1, "error file": 2, "printed numbers": 3}  # kinds of source, best first

_IRIS = "tab:iris_results"
_DELFYS = "tab:delfys75_baseline_unified"
_ANGLE = derive.from_metadata("the angle is the number in the setting's name; nothing is estimated")
_COUNTS: Mapping[str, tuple[Recipe, ...]] = {
    "iris": (derive.counted("iris_baseline"),),
    "delfys75": (derive.counted("delfys75_baseline"),),
    "all": (derive.strategies_scored,),
}

_ONE_STEP: tuple[Recipe, ...] = (
    derive.from_run("iris_unified", as_stated=True, note="the corrected one-step run, which the caption names"),
    derive.from_run("iris_baseline", as_stated=False, note="the uncorrected baseline"),
    derive.from_errors("iris_unified", as_stated=True),
    derive.from_errors("iris_baseline", as_stated=False),
)
_MULTI_STEP: tuple[Recipe, ...] = (
    derive.from_run("iris_unified_multistep", as_stated=True),
    derive.from_errors("iris_unified_multistep", as_stated=True),
)
_MULTI_MINUS_UNIFIED = derive.error_difference("iris_unified_multistep", "iris_unified", as_stated=False)
_MULTI_MINUS_BASELINE = derive.error_difference("iris_unified_multistep", "iris_baseline", as_stated=False)

# (table or section, column) -> the recipes that could produce the number
RECIPES: Mapping[tuple[str, str], tuple[Recipe, ...]] = {
    (_DELFYS, "difference"): (
        derive.displayed_difference("corrected", "baseline"),
        derive.error_difference("delfys75_unified", "delfys75_baseline", as_stated=True),
    ),
    ("text:sec:exp_delfys", "difference"): (
        derive.displayed_difference("corrected", "baseline", place=_DELFYS),
        derive.error_difference("delfys75_unified", "delfys75_baseline", as_stated=True),
    ),
    ("tab:multistep_ablation", "one-step"): (
        derive.from_run("delfys75_unified", as_stated=True, note="the corrected one-step run"),
        derive.from_run("delfys75_baseline", as_stated=False, note="the uncorrected baseline"),
        derive.from_errors("delfys75_unified", as_stated=True),
        derive.from_errors("delfys75_baseline", as_stated=False),
    ),
    ("tab:multistep_ablation", "difference"): (derive.displayed_difference("multi-step", "one-step"),),
    (_IRIS, "difference"): (
        derive.displayed_difference("multi-step", "one-step"),
        _MULTI_MINUS_UNIFIED,
        _MULTI_MINUS_BASELINE,
    ),
    ("text:sec:exp_iris", "difference"): (  # there the corrected run is named as the reference
        derive.error_difference("iris_unified_multistep", "iris_unified", as_stated=True),
        _MULTI_MINUS_BASELINE,
        derive.displayed_difference("multi-step", "one-step", place=_IRIS, as_stated=False),
    ),
    ("text:app:iris_full_results", "difference"): (
        derive.displayed_difference("multi-step", "one-step", place=_IRIS),
        _MULTI_MINUS_UNIFIED,
        _MULTI_MINUS_BASELINE,
    ),
    ("tab:multi_clip", "truth"): (derive.truth_of_split("per_clip_on_test_split"),),
    ("tab:multi_clip", "difference"): (derive.displayed_difference("multi-clip", "per-clip"),),
    ("tab:id_variance", "mean"): (
        derive.from_run("iris_baseline", as_stated=True, statistic=derive.mean),
        derive.from_errors("iris_baseline", "est_mean", as_stated=True),
        derive.truth_shifted_by_error(-1),
        derive.truth_shifted_by_error(+1),
    ),
    ("tab:kappa_ablation", "kappa-zero"): (derive.from_cell(KAPPA_LOSSES, "kappa_0_loss"),),
    ("tab:kappa_ablation", "kappa-learned"): (derive.from_cell(KAPPA_LOSSES, "kappa_learned_loss"),),
}
# (data set, column) for numbers that have the same meaning in every table and in the text
BY_COLUMN: Mapping[tuple[str, str], tuple[Recipe, ...]] = {
    ("delfys75", "truth"): (derive.from_errors("delfys75_baseline", "gt_mean", as_stated=True),),
    ("delfys75", "baseline"): (
        derive.from_run("delfys75_baseline", as_stated=True),
        derive.from_errors("delfys75_baseline", as_stated=True),
    ),
    ("delfys75", "corrected"): (
        derive.from_run("delfys75_unified", as_stated=True),
        derive.from_errors("delfys75_unified", as_stated=True),
    ),
    ("iris", "truth"): (derive.from_errors("iris_baseline", "gt_mean", as_stated=True),),
    ("iris", "one-step"): _ONE_STEP,
    ("iris", "multi-step"): _MULTI_STEP,
    ("iris", "standard-deviation"): (
        derive.from_run("iris_baseline", as_stated=True, statistic=derive.standard_deviation),
        derive.from_errors("iris_baseline", "abs_err_std", as_stated=False),
    ),
    ("iris", "per-clip"): (derive.from_run("per_clip_on_test_split", as_stated=True),),
    ("iris", "multi-clip"): (derive.from_run("iris_multi_clip", as_stated=True),),
    ("iris", "reduction"): (derive.from_cell(KAPPA_LOSSES, "reduction_pct"),),
    ("iris", "coefficient-of-variation"): (
        derive.from_cell(KAPPA_STATISTICS, "cv_pct"),
        derive.variation_of_alpha("iris_baseline"),
    ),
    ("iris", "ratio-to-pendulum_20-k50"): (derive.displayed_ratio,),
} | {
    (dataset, method): (derive.from_predictions,)
    for dataset in ("delfys75", "iris")
    for method in ("cnn", "vlm-temporal", "vlm-describe")
}

NO_FILE = {
    "tab:identifiability": "no result file holds gradient norms or ODE residuals",
    "tab:extrapolation": "no result file holds predictions beyond the training window",
    "tab:multistep_ablation": "no multi-step run on Delfys75 was released",
    "text:app:grad_norms": "no result file holds gradient norms, initial values or parameter histories",
    "text:sec:ablations": "no per-video predictions for this prompt were released",
    "text:app:frame_sampling": "no per-video predictions for this prompt were released",
}
MEASURED = ("drop_height", "camera_distance", "ball_radius", "board_length", "release_angle", "ball_to_cones")
ANGLE_COLUMNS = ("one-step", "multi-step", "mean", "standard-deviation")


def audit(published_folder: str | Path) -> pd.DataFrame:
    """Derive each published number again from the released result files.

    Parameters
    ----------
    published_folder
        Folder of the released files, as ``iris_baseline/iris_baseline.csv`` in it.

    Returns
    -------
    DataFrame
        One row for each derivation of each published number: its ``key``, ``place`` and ``line``; its data set and
        parameter; ``printed``,
        ``published`` (the number), ``unit`` and ``tolerance`` (half of the last printed digit); ``status``
        ``reproduced``, ``differs`` or ``cannot be derived``; ``as_stated``, whether the publication describes
        this derivation; ``derived`` and ``difference`` (derived - published), NaN where there is none;
        ``conversion`` of alpha, ``rule`` for failures, ``split`` really used, ``n``, ``n_failed``, ``n_zero``
        (estimates set to 0), ``kind`` of source, ``source`` (file), ``note``.

    Raises
    ------
    DataError
        When the folder does not exist. A file that is absent or damaged makes rows that cannot be derived.
    """
    folder = PublishedFolder(published_folder)
    return pd.DataFrame([row for value in all_values() for row in _rows(folder, value)], columns=AUDIT_COLUMNS)


AUDIT_COLUMNS = (
    *("key", "place", "line", "dataset", "phenomenon", "setting", "parameter", "column"),
    *("printed", "published", "unit", "tolerance", "status", "as_stated", "derived", "difference"),
    *("conversion", "rule", "split", "n", "n_failed", "n_zero", "kind", "source", "note"),
)


def recipes_for(value: PublishedValue) -> tuple[Recipe, ...]:
    """The recipes that could produce a published number; empty when no released file can."""
    if value.parameter == "angle" and value.column in ANGLE_COLUMNS:
        return (_ANGLE,)
    if value.parameter in MEASURED:
        return ()
    if value.column == "count":
        return (derive.clips_scored,) if value.parameter == "clips-per-setting" else _COUNTS[value.dataset]
    return RECIPES.get((value.place, value.column)) or BY_COLUMN.get((value.dataset, value.column), ())


def _rows(folder: PublishedFolder, value: PublishedValue) -> Iterator[dict[str, Any]]:
    derivations = [derivation for recipe in recipes_for(value) for derivation in _tried(recipe, folder, value)]
    if not derivations:
        derivations = [_gap(NO_FILE.get(value.place, "a measurement or setting of the publication; no file holds it"))]
    for derivation in derivations:
        yield _row(value, derivation)


def _tried(recipe: Recipe, folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
    try:
        return recipe(folder, value)
    except DataError as error:
        return [_gap(folder.relative(error))]


def _gap(why: str) -> Derivation:
    return Derivation(math.nan, "", "", False, note=why)


def _row(value: PublishedValue, derivation: Derivation) -> dict[str, Any]:
    difference = derivation.value - value.number
    tolerance = value.tolerance + derivation.tolerance
    return asdict(value) | {
        "key": value.key,
        "published": value.number,
        "tolerance": tolerance,
        "status": status_of(difference, tolerance),
        "derived": derivation.value,
        "difference": difference,
        **{name: getattr(derivation, name) for name in ("as_stated", "conversion", "rule", "split")},
        **{name: getattr(derivation, name) for name in ("n", "n_failed", "n_zero", "kind", "source", "note")},
    }


def status_of(difference: float, tolerance: float) -> str:
    """Whether a derived number equals the published one within its printed digits; NaN means it cannot be derived."""
    if not math.isfinite(difference):
        return NOT_DERIVABLE
    # 1e-9: a printed 2.675 and a derived 2.6750000000000003 are the same number
    return REPRODUCED if abs(difference) <= tolerance + 1e-9 * max(1.0, abs(difference)) else DIFFERS


def verdicts(rows: pd.DataFrame) -> pd.DataFrame:
    """Reduce the audit to one row for each published number.

    ``rows`` come from :func:`audit`. The row kept is the derivation that reproduces the number, as stated before
    any other; otherwise the first that gives a number. ``way`` says whether it is as stated, and its kind of source.
    """
    rank = rows["status"].map({REPRODUCED: 0, DIFFERS: 20, NOT_DERIVABLE: 40})
    rank = rank + 10 * (~rows["as_stated"]).astype(int) + rows["kind"].map(KINDS).fillna(len(KINDS))
    best = rows.assign(rank=rank).sort_values("rank", kind="stable").drop_duplicates("key").sort_index()
    way = best["as_stated"].map({True: "as stated", False: "not as stated"}) + ", from " + best["kind"]
    return best.assign(way=way.where(best["status"] == REPRODUCED, "")).drop(columns="rank").reset_index(drop=True)
