"""Several clips: one common size with one degree of freedom, against sizes that NumPy draws."""

import numpy as np
import pytest

from iris_sysid.diagnosis.score_test import combined, common_size
from iris_sysid.types import Score

RUNS = 2000


def scores(sizes: np.ndarray) -> list[Score]:
    """Scores of unit error in clips of 100 samples, to which a size of s explains s^2."""
    return [Score("drag", size, 1.0, "1", size**2 / 100.0, 100.0, size**2, degrees=99) for size in sizes.tolist()]


@pytest.mark.parametrize("clips", [1, 2, 5, 10])
def test_chi_square_of_clean_clips_exceeds_its_quantile_as_often_as_it_should(clips):
    drawn = np.random.default_rng(clips).standard_normal((RUNS, clips))
    chi2 = np.array([combined(scores(sizes)).explained for sizes in drawn])
    assert np.mean(chi2 > 3.84) == pytest.approx(0.05, abs=0.016)  # 3.3 standard errors


@pytest.mark.parametrize("clips", [2, 5, 10])
def test_common_size_of_clean_clips_is_significant_at_most_as_often_as_it_states(clips):
    drawn = np.random.default_rng(clips).standard_normal((RUNS, clips))
    common = [common_size([(size, 1.0) for size in sizes]) for sizes in drawn.tolist()]
    assert np.mean([abs(value) / stderr > 1.96 for value, stderr in common]) < 0.05 + 0.016


def test_sizes_that_contradict_each_other_have_a_larger_common_error():
    value, stderr = common_size([(10.0, 1.0), (-10.0, 1.0)])
    assert (value, stderr) == pytest.approx((0.0, 10.0))
    assert common_size([(10.0, 1.0), (10.0, 1.0)]) == pytest.approx((10.0, 0.5**0.5))


def test_sizes_without_an_error_say_nothing():
    assert common_size([(3.0, float("nan")), (2.0, 1.0)]) == (2.0, 1.0)
    value, stderr = common_size([(3.0, float("nan"))])
    assert np.isnan(value)
    assert np.isinf(stderr)
