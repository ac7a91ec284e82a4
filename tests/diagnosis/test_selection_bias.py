"""Sizes that are seen only above a threshold: truth drawn by NumPy, threshold applied as a search does."""

import numpy as np
import pytest

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
