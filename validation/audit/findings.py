"""All findings, each computed from the files; where a file is absent, the finding states the gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from iris_sysid.errors import DataError
from validation.audit import findings_beyond as beyond
from validation.audit import findings_parameters as parameters
from validation.audit import findings_tables as tables
from validation.audit.evidence import CONFIRMED, NOT_CONFIRMED, Finding, Outcome
from validation.audit.folder import ERRORS, KAPPA_STATISTICS, PREDICTIONS, RUNS, PublishedFolder
from validation.audit.reproduce import NOT_DERIVABLE

_IRIS_ERRORS = tuple(ERRORS[name] for name in ("iris_baseline", "iris_unified", "iris_unified_multistep"))
_MULTI_STEP = RUNS["iris_unified_multistep"]


@dataclass(frozen=True, slots=True)
class Finder:
    """How one finding is computed, and from which files."""

    point: int
    title: str
    compute: Callable[[PublishedFolder], Outcome]
    sources: tuple[str, ...]


# points 1 to 28 as the project's notes number them; 32 and above were found while these were computed
FINDERS = (
    Finder(
        1,
        "alpha is a length, reported as g/alpha",
        parameters.alpha_is_a_length,
        (RUNS["delfys75_baseline"], RUNS["delfys75_unified"], RUNS["iris_baseline"]),
    ),
    Finder(
        2,
        "Failed runs are scored as zeros",
        parameters.failures_scored_as_zero,
        (RUNS["delfys75_baseline"], ERRORS["delfys75_baseline"], ERRORS["delfys75_unified"]),
    ),
    Finder(3, "Initial values, not estimates", parameters.initial_values, (RUNS["iris_baseline"],)),
    Finder(
        4, "The uncorrected baseline was trained", parameters.uncorrected_integrator_trains, (RUNS["iris_baseline"],)
    ),
    Finder(
        5,
        "The one-step column is the uncorrected baseline",
        parameters.one_step_column_is_the_baseline,
        (RUNS["iris_baseline"], RUNS["iris_unified"]),
    ),
    Finder(6, "Differences mix references", parameters.differences_mix_references, _IRIS_ERRORS),
    Finder(
        7,
        "Multi-step does not consistently increase the gravity error",
        parameters.multi_step_is_not_consistently_worse,
        _IRIS_ERRORS,
    ),
    Finder(
        9,
        "Errors of hundreds of metres are 1/alpha",
        parameters.lengths_blow_up_as_one_over_alpha,
        (_MULTI_STEP, ERRORS["iris_unified_multistep"]),
    ),
    Finder(
        12,
        "Errors are over all clips, not a test split",
        tables.errors_are_over_all_clips,
        (*_IRIS_ERRORS, RUNS["iris_baseline"]),
    ),
    Finder(13, "The variance table does not hold means", tables.variance_table_is_not_means, (RUNS["iris_baseline"],)),
    Finder(
        14, "kappa is the column alpha", beyond.kappa_is_the_column_alpha, (KAPPA_STATISTICS, RUNS["iris_baseline"])
    ),
    Finder(23, "Counts disagree", tables.counts_disagree, (RUNS["delfys75_baseline"],)),
    Finder(
        24,
        "The CNN accuracies are not attainable",
        tables.cnn_accuracy_is_not_attainable,
        tuple(PREDICTIONS.values()),
    ),
    Finder(25, "Identifiability and extrapolation have no file", tables.identifiability_was_not_released, ()),
    Finder(
        26,
        "The multi-clip test is one setting and one number",
        tables.multi_clip_tests_one_setting,
        (RUNS["iris_multi_clip"], RUNS["iris_baseline"]),
    ),
    Finder(28, "Duplicated runs", beyond.duplicated_runs, tuple(RUNS[name] for name in beyond.SINGLE_CLIP_RUNS)),
    Finder(
        32,
        "The multi-body multi-step latents collapsed",
        beyond.latents_collapsed,
        (RUNS["iris_baseline"], RUNS["iris_unified"], _MULTI_STEP),
    ),
    Finder(33, "Negative damping is scored as zero", beyond.negative_damping_counts_as_zero, (_MULTI_STEP,)),
    Finder(
        34,
        "The corrected Delfys75 column has no released runs",
        beyond.error_rows_without_a_run,
        (ERRORS["delfys75_unified"], RUNS["delfys75_unified"]),
    ),
    Finder(35, "The LED baseline's error is the truth", beyond.led_error_is_the_truth, (RUNS["delfys75_baseline"],)),
    Finder(
        36,
        "The reversed VLM ranking comes from two classes",
        beyond.ranking_reverses_by_the_balls_alone,
        (PREDICTIONS["iris", "vlm-temporal"], PREDICTIONS["iris", "vlm-describe"]),
    ),
)


def findings(published_folder: str | Path) -> list[Finding]:
    """Compute every finding about the published numbers from the released files, in order of their numbers.

    A finding whose file is absent or damaged has the verdict ``cannot be derived`` and says which file. Raises
    DataError when the folder does not exist.
    """
    folder = PublishedFolder(published_folder)
    return [_found(finder, folder) for finder in FINDERS]


def _found(finder: Finder, folder: PublishedFolder) -> Finding:
    try:
        outcome = finder.compute(folder)
    except DataError as error:
        why = folder.relative(error)
        return Finding(finder.point, finder.title, NOT_DERIVABLE, why, pd.DataFrame(), finder.sources)
    verdict = CONFIRMED if outcome.holds else NOT_CONFIRMED
    return Finding(finder.point, finder.title, verdict, outcome.statement, outcome.evidence, finder.sources)
