"""The step in which a sensor reads is found on its grid, and nowhere else; noise is at least what the step makes."""

import numpy as np
import pytest

from fitters.noise.measurement_noise import noise_from_differences
from fitters.noise.reading_step import reading_step

T_S = np.arange(800) / 100
MOTION = 0.2 * np.sin(3.0 * T_S) + 0.1 * np.sin(7.1 * T_S)


@pytest.mark.parametrize("step", [1e-4, 2 * np.pi / 4096, 0.01])
@pytest.mark.parametrize("zero", [0.0, 1.2345])
def test_step_is_that_of_the_grid_wherever_it_lies(step, zero):
    read = step * np.round((MOTION + 1e-4 * np.random.default_rng(0).standard_normal(800)) / step) + zero
    read[::97] = np.nan
    assert reading_step(read) == pytest.approx(step, rel=1e-6)


def test_step_is_found_where_neighbours_on_the_grid_never_occur():
    read = np.random.default_rng(0).choice([2, 3, 5, 7, 11], 400).cumsum() * 0.25
    assert reading_step(read) == pytest.approx(0.25)


def test_motion_without_steps_has_none():
    for values in (MOTION, MOTION + np.random.default_rng(1).standard_normal(800), np.zeros(800), np.full(9, np.nan)):
        assert reading_step(values) == 0.0
    assert reading_step(np.repeat([0.0, 1.0, 3.0], 100)) == 0.0  # too few to be a grid


def test_noise_of_a_coarse_reading_is_that_of_its_step():
    step = 0.02
    read = step * np.round(MOTION / step)
    error = np.std(read - MOTION)
    assert noise_from_differences(T_S, read) == pytest.approx(error, rel=0.1)
