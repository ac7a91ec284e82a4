"""Errors that a tracker's readings share through a clip reach the parameters' budget."""

import numpy as np
import pytest

from fitters.ode import fit, simulate
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.pipeline.one_clip import observe
from iris_sysid.registry import MODELS
from iris_sysid.trajectory.systematic_errors import from_pivots
from iris_sysid.types import Estimate, Quantity, Track, Trajectory

T_S = np.arange(300) / 60
STIFFNESS, SIGMA = 0.1, 3e-4
TRUTH = {"stiffness": STIFFNESS, "damping": 0.05, "phi_0": 2 * np.pi, "omega_0": 0.0, "rest": 0.0}


def reading(phase, share, seed, truth=TRUTH, order=1, t_s=T_S, sigma=SIGMA):
    """The angle of a slow oscillation, read about an axis that is off by a share of the arm in some direction.

    Or, of higher order, with an error that comes back several times in a turn.
    """
    angle = simulate(MODELS["angular-oscillator"], t_s, truth).observed[:, 0]
    angle = angle + share * np.cos(order * angle + phase) + np.random.default_rng(seed).normal(0, sigma, t_s.size)
    n = t_s.size
    return Track(
        t_s=t_s, xy_px=np.full((n, 2), 300.0), sigma_px=np.full((n, 2), 0.05), valid=np.ones(n, dtype=bool),
        frame=np.arange(n), angle_rad=angle, sigma_angle_rad=np.full(n, sigma),
    )  # fmt: skip


def test_axis_that_is_off_by_a_thousandth_of_the_arm_stays_within_the_stated_error():
    pulls, alone = [], []
    for seed, phase in enumerate(np.linspace(0, 2 * np.pi, 8, endpoint=False)):
        _, trajectory = observe([reading(phase, 1e-3, seed)], uncalibrated(), "rotating-cone")
        result = fit(trajectory, MODELS["angular-oscillator"], free=["rest"])
        stiffness = result.estimates["stiffness"]
        pulls.append((stiffness.value - STIFFNESS) / stiffness.stderr)
        alone.append((stiffness.value - STIFFNESS) / result.budget["stiffness"]["random"])
    assert np.sqrt(np.mean(np.square(pulls))) < 1.5
    assert np.sqrt(np.mean(np.square(alone))) > 1.5  # the random part alone would be too small


@pytest.mark.parametrize(("order", "share"), [(2, 3e-4), (3, 1.5e-4)])
def test_short_arc_of_a_slow_turn_read_in_uneven_light_stays_within_the_stated_error(order, share):
    quarter, short = {**TRUTH, "phi_0": np.pi / 2, "rest": 0.0}, np.arange(240) / 60
    pulls = []
    for seed, phase in enumerate(np.linspace(0, 2 * np.pi, 8, endpoint=False)):
        track = reading(phase, share, seed, quarter, order, t_s=short, sigma=1e-4)
        _, trajectory = observe([track], uncalibrated(), "rotating-cone")
        stiffness = fit(trajectory, MODELS["angular-oscillator"], free=["rest"]).estimates["stiffness"]
        pulls.append((stiffness.value - STIFFNESS) / stiffness.stderr)
    assert 0.2 < np.abs(pulls).max() < 2.0


def test_pivots_that_are_off_change_each_angle_by_what_geometry_says():
    theta = np.column_stack([np.linspace(-0.8, 0.2, 50), np.linspace(-0.1, 0.9, 50)])
    off = {"pivot_across_1": 2e-3, "pivot_along_1": 1e-3, "pivot_across_2": 3e-3, "pivot_along_2": 4e-3}
    trajectory = Trajectory(
        t_s=np.arange(50) / 60, quantities=(Quantity("theta1", "rad"), Quantity("theta2", "rad")), position=theta,
        sigma=np.full((50, 2), SIGMA), valid=np.ones(50, dtype=bool),
        geometry={name: Estimate(0.0, share, "1", "assumed") for name, share in off.items()},
    )  # fmt: skip
    patterns = from_pivots(trajectory)["pivots"]
    x, z = np.sin(theta), -np.cos(theta)  # of the bodies about their pivots, in units of the arc
    for body in (0, 1):
        across, along = off[f"pivot_across_{body + 1}"], off[f"pivot_along_{body + 1}"]
        moved = np.arctan2(x[:, body] + across, -z[:, body]) - theta[:, body]
        np.testing.assert_allclose(patterns[2 * body, :, body], moved, atol=across**2)
        raised = np.arctan2(x[:, body], -(z[:, body] + along)) - theta[:, body]
        np.testing.assert_allclose(patterns[2 * body + 1, :, body], raised, atol=along**2)
        assert not patterns[2 * body : 2 * body + 2, :, 1 - body].any()
    assert from_pivots(trajectory.with_(geometry={})) == {}
