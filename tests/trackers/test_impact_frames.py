"""Effect of an impact on the motion within an exposure, and on the position that an image shows."""

from __future__ import annotations

import numpy as np
import pytest

from trackers._disc.expected_position import ExpectedPath
from trackers._disc.impact_frames import impact_exposure_error
from trackers._disc.model import Disc

FPS, SHUTTER = 60.0, 0.5
BEFORE, AFTER = np.array([20.0, 2.0]), np.array([-12.0, 3.0])  # px a frame
SIGMA = 0.05  # px


def place(frame, struck_at):
    """Position at a time in frames of a body that is struck at another, at (300, 100) px."""
    elapsed = np.asarray(frame, dtype=float)[..., np.newaxis] - struck_at
    return np.array([300.0, 100.0]) + np.where(elapsed < 0, BEFORE, AFTER) * elapsed


def seen(struck_at, n=21, seed=1):
    """Mean positions over each exposure, with noise, and those at its middle."""
    middle = np.arange(n, dtype=float)
    within = middle[:, np.newaxis] + np.linspace(-SHUTTER / 2, SHUTTER / 2, 401)
    mean = place(within, struck_at).mean(axis=1)
    noise = np.random.default_rng(seed).normal(0, SIGMA, mean.shape)
    return middle / FPS, mean + noise, place(middle, struck_at)


@pytest.mark.parametrize("struck_at", [10.0, 9.85, 10.2])
def test_place_in_whose_exposure_a_body_is_struck_has_the_error_that_this_makes(struck_at):
    t_s, xy, true = seen(struck_at)
    added = impact_exposure_error(t_s, xy, np.full_like(xy, SIGMA), SHUTTER)
    assert np.flatnonzero(added.any(axis=1)).tolist() == [10]
    assert np.all(np.abs(xy - true)[10] <= added[10] + 4 * SIGMA)
    np.testing.assert_allclose(added[10], np.abs(AFTER - BEFORE) * SHUTTER / 8, atol=0.05)


def test_impact_between_two_exposures_adds_nothing():
    t_s, xy, _ = seen(10.5)
    assert not impact_exposure_error(t_s, xy, np.full_like(xy, SIGMA), SHUTTER).any()


def test_smooth_motion_and_gaps_add_nothing():
    t_s, xy, _ = seen(10.0)
    circle = 200 * np.column_stack([np.cos(8 * t_s), np.sin(8 * t_s)])
    assert not impact_exposure_error(t_s, circle, np.full_like(xy, SIGMA), SHUTTER).any()
    xy[7:13] = np.nan
    assert not impact_exposure_error(t_s, xy, np.full_like(xy, SIGMA), SHUTTER).any()


@pytest.mark.parametrize(("frame", "velocity"), [(8, BEFORE), (10, BEFORE), (11, AFTER), (13, AFTER)])
def test_motion_beside_an_impact_is_that_of_the_side_on_which_it_is(frame, velocity):
    discs = {number: Disc(*map(float, place(number, 10.5)), 20.0) for number in range(21)}
    motion = ExpectedPath({number: number / FPS for number in discs}, discs).motion(frame, SHUTTER)
    np.testing.assert_allclose([motion.x, motion.y], SHUTTER * velocity, atol=1e-6)
    np.testing.assert_allclose([motion.bend_x, motion.bend_y], 0.0, atol=1e-6)


def test_motion_on_a_smooth_path_is_that_of_the_discs_on_both_sides():
    discs = {number: Disc(0.5 * 2.0 * number**2, 3.0 * number, 20.0) for number in range(21)}
    motion = ExpectedPath({number: number / FPS for number in discs}, discs).motion(7, SHUTTER)
    np.testing.assert_allclose([motion.x, motion.y], [SHUTTER * 14.0, SHUTTER * 3.0], atol=1e-6)
    np.testing.assert_allclose([motion.bend_x, motion.bend_y], [SHUTTER**2 * 2.0, 0.0], atol=1e-6)
