"""Outliers: named where a value stands out beside errors and scatter, and in one class of a hundred without any."""

import numpy as np
import pytest

from iris_sysid.classroom.outliers import deviations


def test_values_far_off_are_outliers_and_the_others_are_not():
    rng = np.random.default_rng(0)
    values = 1 + 0.01 * rng.standard_normal(20)
    values[[3, 8, 9, 15]] = [1.2, 64.0, 0.8, 1.15]
    in_errors, outlying = deviations(values, np.full(20, 0.005))
    assert np.flatnonzero(outlying).tolist() == [3, 8, 9, 15]
    assert in_errors[3] > 10
    assert in_errors[9] < -10


def test_a_value_with_a_large_error_of_its_own_is_no_outlier():
    values, stderrs = np.array([1.0, 1.01, 0.99, 1.0, 1.3]), np.array([0.01, 0.01, 0.01, 0.01, 0.2])
    assert not deviations(values, stderrs)[1].any()


def test_three_groups_have_no_outlier_and_gaps_are_left_out():
    assert not deviations(np.array([1.0, 1.0, 9.0]), np.full(3, 0.01))[1].any()
    in_errors, outlying = deviations(np.array([1.0, np.nan, 1.01, 0.99, 1.0, 5.0]), np.full(6, 0.01))
    assert np.isnan(in_errors[1])
    assert outlying.tolist() == [False] * 5 + [True]


@pytest.mark.slow
def test_false_alarms_of_a_class_are_about_one_in_a_hundred():
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(300):
        stderrs = rng.uniform(0.5, 2.0, 12)
        values = stderrs * rng.standard_normal(12) + rng.standard_normal(12)
        alarms += deviations(values, stderrs)[1].any()
    assert alarms <= 18  # 6 %: the scatter itself is estimated from twelve
