"""Sizes that are seen only above a threshold, truth drawn by NumPy; and those whose error is not known."""

import numpy as np
import pytest

from iris_sysid.diagnosis.notes import weak_notes
from iris_sysid.diagnosis.search_report import holds_zero
from iris_sysid.diagnosis.selection_bias import corrected_for_selection
from iris_sysid.types import Estimate

CRITICAL = 4.0


def seen(truth: float, count: int) -> np.ndarray:
    """Sizes of unit error that came out significant."""
    drawn = truth + np.random.default_rng(0).standard_normal(60 * count)
    return drawn[np.abs(drawn) > CRITICAL][:count]


@pytest.mark.parametrize("truth", [3.5, 4.5, 6.0])
def test_interval_of_a_size_that_was_selected_holds_the_truth(truth):
    sizes = [Estimate(float(size), 1.0, "1", "fitted", "") for size in seen(truth, 400)]
    corrected = [corrected_for_selection(size, CRITICAL) for size in sizes]
    covered = [low <= truth <= high for low, high in (size.interval for size in corrected)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.04)  # 3.7 standard errors of a share of 400
    assert abs(np.median([size.value for size in corrected]) - truth) < abs(np.median(seen(truth, 400)) - truth) + 0.1


def test_size_far_beyond_the_threshold_is_not_changed():
    size = Estimate(12.0, 1.0, "1", "fitted", "")
    assert corrected_for_selection(size, CRITICAL) is size


def test_size_just_beyond_the_threshold_may_be_zero():
    low, high = corrected_for_selection(Estimate(-4.1, 1.0, "1", "fitted", ""), CRITICAL).interval
    assert low < 0.0 < high


@pytest.mark.parametrize(("stderr", "unsure"), [(0.2, False), (0.6, True), (0.0, True), (float("nan"), True)])
def test_size_without_an_error_is_not_known_to_differ_from_zero(stderr, unsure):
    assert holds_zero(Estimate(1.0, stderr, "1", "fitted")) is unsure


def test_note_on_a_size_without_an_error_gives_no_interval():
    (note,) = weak_notes([("drag", Estimate(1.0, 0.0, "1", "fitted"))])
    assert note.text == "drag = 1 is not named: its error is not known"
