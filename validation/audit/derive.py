"""Recipes that derive a published number again from the result files: one recipe for each possible derivation.

A recipe takes the folder and the published number and returns derivations.
:data:`validation.audit.reproduce.RECIPES` lists the recipes of each number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.conversions import READINGS, LatentReading, Values
from iris_sysid.benchmark.sources.published import truth_of
from iris_sysid.errors import DataError
from validation.audit.folder import ERRORS, RUNS, PublishedFolder, estimates, n_failed, reading_of, select
from validation.audit.printed import PublishedValue, sibling, values_at
from validation.audit.selection import score_published


@dataclass(frozen=True, slots=True)
class Derivation:
    """One derivation of a published number, and its result.

    ``as_stated`` says whether the publication describes this derivation. ``n`` counts the runs (or videos)
    used, ``n_failed`` the failed ones among them, ``n_zero`` the estimates that were set to 0 because a run failed
    or gave no valid value. ``tolerance`` is what rounding of *other* printed numbers adds. ``kind`` is ``result
    files``, ``error file`` (a summary that the publication made itself), ``printed numbers`` or ``metadata``.
    """

    value: float
    source: str
    rule: str
    as_stated: bool
    conversion: str = ""
    split: str = ""
    n: int = 0
    n_failed: int = 0
    n_zero: int = 0
    tolerance: float = 0.0
    note: str = ""
    kind: str = "result files"


Recipe = Callable[[PublishedFolder, PublishedValue], list[Derivation]]
Statistic = Callable[[Values, float], float]


def mean_absolute_error(values: Values, truth: float) -> float:
    """Mean of |value - truth|; NaN when there is no value."""
    return float(np.mean(np.abs(values - truth))) if values.size else math.nan


def mean(values: Values, truth: float) -> float:
    """Mean of the values; the truth is not used. NaN when there is no value."""
    return float(np.mean(values)) if values.size else math.nan


def standard_deviation(values: Values, truth: float) -> float:
    """Sample standard deviation (n - 1) of the values; the truth is not used. NaN for fewer than two."""
    return float(np.std(values, ddof=1)) if values.size > 1 else math.nan


def from_run(run: str, *, as_stated: bool, statistic: Statistic = mean_absolute_error, note: str = "") -> Recipe:
    """A statistic over a per-clip file, under every reading, failures as zeros and, where it matters, left out.

    Parameters
    ----------
    run
        Name of the file, a key of ``RUNS``.
    as_stated
        Whether the publication says that this file and statistic are behind the number.
    statistic
        Function of the estimates and the truth.
    note
        Kept in each derivation.
    """

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        runs = select(folder.runs(run), value.phenomenon, value.setting)
        truth = _truth(value, runs)
        ways = []
        for reading in _readings(value):
            stated = as_stated and reading.published
            ways.append(_run_derivation(runs, reading, statistic, truth, run, stated, zeros=True, note=note))
            if ways[-1].n_zero:
                ways.append(_run_derivation(runs, reading, statistic, truth, run, False, zeros=False, note=note))
        return ways

    return recipe


def _readings(value: PublishedValue) -> list[LatentReading]:
    names = (value.parameter, f"{value.parameter}_1")
    readings = [reading for reading in READINGS.get(value.phenomenon, ()) if reading.parameter in names]
    if not readings:
        raise DataError(f"alpha and beta give no {value.parameter} for {value.phenomenon}")
    return readings


def _truth(value: PublishedValue, runs: pd.DataFrame) -> float:
    setting = value.setting or str(runs["setting"].iloc[0])
    for parameter in (value.parameter, f"{value.parameter}_1"):
        truth = truth_of(value.dataset, value.phenomenon, setting, parameter)
        if truth:
            return truth.value
    return math.nan


def _run_derivation(
    runs: pd.DataFrame,
    reading: LatentReading,
    statistic: Statistic,
    truth: float,
    run: str,
    as_stated: bool,
    *,
    zeros: bool,
    note: str,
) -> Derivation:
    kept = estimates(runs, reading, zeros=zeros)
    plain = estimates(runs, reading, zeros=False)
    used = kept[np.isfinite(kept)]
    changed = ~np.isfinite(plain) | (kept != plain)
    return Derivation(
        value=statistic(used, truth),
        source=RUNS[run],
        rule="failed and invalid estimates count as 0" if zeros else "failed runs left out, values as they are",
        as_stated=as_stated,
        conversion=reading.conversion,
        split=describe_split(runs),
        n=int(used.size),
        n_failed=n_failed(runs),
        n_zero=int(changed.sum()) if zeros else 0,
        note=note or ("" if used.size else f"all {len(runs)} runs failed"),
    )


def describe_split(runs: pd.DataFrame) -> str:
    """Which clips a number averages, e.g. ``all 10 clips`` or ``6 clips of 1 setting (drop_50)``."""
    settings = runs["setting"].unique()
    numbered = runs["clip"].str.fullmatch(r"\d+").all()
    if numbered and runs["clip"].astype(int).min() > 1:  # a test split, not clips counted from 0 or 1
        clips = sorted(runs["clip"].astype(int))
        return f"{len(runs)} clips ({clips[0]} to {clips[-1]}) of {len(settings)} setting ({', '.join(settings)})"
    return f"all {len(runs)} clips" + ("" if len(settings) == 1 else f" of {len(settings)} settings")


def from_errors(name: str, column: str = "abs_err_mean", *, as_stated: bool) -> Recipe:
    """A column of one of the publication's own error files.

    Parameters
    ----------
    name
        Key of ``ERRORS``.
    column
        E.g. ``abs_err_mean`` or ``gt_mean``.
    as_stated
        Whether the publication says that this file is behind the number.
    """

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        row = error_row(folder, name, value)
        n = int(row["n"])
        number, rule = float(row[column]), f"column {column}"
        return [Derivation(number, ERRORS[name], rule, as_stated, split=f"n = {n}", n=n, kind="error file")]

    return recipe


def truth_of_split(run: str) -> Recipe:
    """The ground truth of the one setting that a file of test clips (``run``) holds."""

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        runs = select(folder.runs(run), value.phenomenon)
        return [
            Derivation(_truth(value, runs), RUNS[run], "truth of the setting tested", True, split=describe_split(runs))
        ]

    return recipe


def error_row(folder: PublishedFolder, name: str, value: PublishedValue) -> pd.Series:
    """The line of an error file (``name``) for the parameter of ``value``; DataError when there is none."""
    frame = folder.errors(name)
    same = (frame["dynamics"] == value.phenomenon.lower()) & frame["parameter"].isin(
        [value.parameter, f"{value.parameter}_1"]
    )
    if value.setting:
        same &= frame["setting"] == value.setting
    if not same.any():
        raise DataError(f"{ERRORS[name]} has no line for {value.phenomenon}/{value.setting}/{value.parameter}")
    return frame[same].iloc[0]


def error_difference(later: str, earlier: str, *, as_stated: bool) -> Recipe:
    """The difference of two error files' mean absolute errors.

    Parameters
    ----------
    later, earlier
        Keys of ``ERRORS``: the minuend and the reference.
    as_stated
        Whether the publication describes this reference.
    """

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        high, low = (error_row(folder, name, value) for name in (later, earlier))
        difference = float(high["abs_err_mean"]) - float(low["abs_err_mean"])
        source = f"{ERRORS[later]} minus {ERRORS[earlier]}"
        rule, n = f"reference is {earlier}", int(high["n"])
        return [Derivation(difference, source, rule, as_stated, split=f"n = {n}", n=n, kind="error file")]

    return recipe


def displayed_difference(later: str, earlier: str, *, place: str | None = None, as_stated: bool = True) -> Recipe:
    """The difference of two numbers printed in the same row; it needs no file.

    Parameters
    ----------
    later, earlier
        Columns of the table: the minuend and the reference.
    place
        Table that prints them, when it is another.
    as_stated
        Whether the publication defines the number so.
    """

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        high, low = sibling(value, later, place), sibling(value, earlier, place)
        rule = f"printed {later} minus printed {earlier}"
        number, source = high.number - low.number, f"printed in {high.place}"
        slack = high.tolerance + low.tolerance
        return [Derivation(number, source, rule, as_stated, tolerance=slack, kind="printed numbers")]

    return recipe


def truth_shifted_by_error(sign: int) -> Recipe:
    """The printed truth plus (``sign`` 1) or minus (-1) the printed one-step error, printed as a mean."""

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        truth, error = sibling(value, "truth"), sibling(value, "one-step", "tab:iris_results")
        number = truth.number + sign * error.number
        rule = f"printed truth {'plus' if sign > 0 else 'minus'} printed error"
        return [Derivation(number, "printed in tab:iris_results", rule, False, kind="printed numbers")]

    return recipe


def displayed_ratio(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
    """The ratio of the extrapolation errors printed for two settings at k = 50; ``value`` names the larger."""
    table = {value.setting: value.number for value in values_at("tab:extrapolation", "mean-k50")}
    ratio = table[value.setting] / table["pendulum_20"]
    rule = "ratio of printed errors"
    return [Derivation(ratio, "printed in tab:extrapolation", rule, True, kind="printed numbers")]


def from_metadata(note: str) -> Recipe:
    """The error of a value that is copied from the setting's name: 0 by construction; ``note`` says what it is."""

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        row = error_row(folder, "iris_baseline", value)
        stated = float(value.setting.rpartition("_")[2])
        number = stated if value.column in ("mean",) else abs(stated - float(row["gt_mean"]))
        rule = "copied, not estimated"
        return [Derivation(number, "the setting's name", rule, True, "metadata", note=note, kind="metadata")]

    return recipe


def from_cell(path: str, column: str, *, as_stated: bool = True) -> Recipe:
    """One cell of a file with a column ``setting``.

    Parameters
    ----------
    path
        Within the folder.
    column
        Column of numbers.
    as_stated
        Whether the publication names this file or describes what it holds.
    """

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        frame = folder.table(path, ("setting",), (column,))
        cells = frame.loc[frame["setting"] == value.setting, column]
        if cells.empty:
            raise DataError(f"{path} has no line for setting {value.setting}")
        return [Derivation(float(cells.iloc[0]), path, f"column {column}", as_stated)]

    return recipe


def variation_of_alpha(run: str) -> Recipe:
    """Coefficient of variation of the column alpha in per cent (population sd); ``run`` names the file."""

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        runs = select(folder.runs(run), value.phenomenon, value.setting)
        alpha = estimates(runs, reading_of(value.phenomenon, value.parameter), zeros=False)
        if not np.mean(alpha):
            raise DataError(
                f"alpha of {value.phenomenon}/{value.setting} has mean 0: there is no variation in per cent"
            )
        number = 100 * float(np.std(alpha) / np.mean(alpha))
        return [Derivation(number, RUNS[run], "sd/mean of alpha", False, "alpha", describe_split(runs), alpha.size)]

    return recipe


def from_predictions(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
    """Accuracy, per-class count or confusion count from the per-video predictions; ``value`` says which."""
    in_columns = value.parameter == "accuracy" and value.phenomenon == "all"
    score = score_published(folder, value.dataset, value.column)
    if in_columns:
        number, rule = 100 * score.accuracy, f"{score.correct} of {score.n} videos"
    elif value.phenomenon == "all":
        number, rule = float(score.correct if value.parameter == "correct" else score.n), "videos counted"
    else:
        number, rule = _confusion_count(score.confusion, value), "videos counted"
    split = f"all {score.n} videos" + (", training ones included" if value.column == "cnn" else "")
    note = "stated over a held-out 20 %, whose list was not released" if value.column == "cnn" else ""
    return [Derivation(number, score.source, rule, True, split=split, n=score.n, note=note)]


def _confusion_count(confusion: pd.DataFrame, value: PublishedValue) -> float:
    if value.phenomenon not in confusion.index:
        raise DataError(f"the predictions hold no video of {value.phenomenon}")
    if value.parameter == "videos":
        return float(confusion.loc[[value.phenomenon]].to_numpy().sum())
    answer = value.parameter.removeprefix("predicted-")
    return float(confusion.loc[[value.phenomenon], confusion.columns == answer].to_numpy().sum())


def counted(run: str) -> Recipe:
    """Number of videos, settings, phenomena or trials that a per-clip file (``run``) has, as the value asks."""

    def recipe(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
        runs = folder.runs(run)
        if value.phenomenon != "all":
            runs = select(runs, value.phenomenon, value.setting)
        settings = runs.groupby(["phenomenon", "setting"]).size()
        number = {
            "videos": len(runs),
            "settings": len(settings),
            "phenomena": runs["phenomenon"].nunique(),
            "trials": int(settings.max()),
        }[value.parameter]
        return [Derivation(float(number), RUNS[run], "runs counted", True, n=len(runs), n_failed=n_failed(runs))]

    return recipe


def clips_scored(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
    """Clips a setting behind each error, from the column n of the error files; ``value`` is the stated number."""
    derivations = []
    for name in ("iris_baseline", "iris_unified", "iris_unified_multistep"):
        counts: Sequence[int] = sorted({int(n) for n in folder.errors(name)["n"]})
        rule = f"column n: {', '.join(map(str, counts))}"
        derivations.append(Derivation(float(counts[-1]), ERRORS[name], rule, True, n=len(folder.errors(name))))
    return derivations


def strategies_scored(folder: PublishedFolder, value: PublishedValue) -> list[Derivation]:
    """Number of selection methods with per-video predictions; ``value`` is the stated number."""
    methods = {
        score.method for score in (score_published(folder, "iris", m) for m in ("cnn", "vlm-temporal", "vlm-describe"))
    }
    return [
        Derivation(float(len(methods)), "per-video prediction files", f"methods: {', '.join(sorted(methods))}", True)
    ]
