"""What a model observes of positions that were tracked: a distance along a line, or an angle about a centre."""

import numpy as np
import pytest

from fitters.positions import along_path, phenomenon_of
from iris_sysid import MODELS, Quantity, Trajectory, fit, simulate

T_S = np.arange(120) / 60
PLANE = (Quantity("x", "m"), Quantity("z", "m"))


def positions(xz, sigma_m=2e-4):
    """Positions (n, 2), m, with noise."""
    noise = sigma_m * np.random.default_rng(3).standard_normal(xz.shape)
    return Trajectory(T_S, PLANE, xz + noise, np.full(xz.shape, sigma_m), np.ones(len(xz), bool))


def test_puck_that_slides_askew_gives_its_distance_with_errors_in_m():
    model = MODELS["stopping-block"]
    s = simulate(model, T_S, {"pull": 0.0, "friction": 0.6, "s_0": 0.0, "v_0": 1.0}).observed[:, 0]
    seen = along_path(model, positions(np.outer(s, [-0.8, 0.6])))
    assert [quantity.name for quantity in seen.quantities] == ["s"]
    assert seen.sigma == pytest.approx(2e-4)
    friction = fit(seen, model).estimates["friction"]
    assert abs(friction.value - 0.6) < 3 * friction.stderr < 0.01


def test_marker_on_a_wheel_gives_its_angle_with_errors_in_rad():
    turned = 4.0 * (1 - np.exp(-0.5 * T_S))
    seen = along_path(MODELS["angular-oscillator"], positions(0.2 * np.column_stack([np.sin(turned), -np.cos(turned)])))
    assert np.ptp(seen.position) == pytest.approx(np.ptp(turned), rel=0.01)
    assert seen.sigma == pytest.approx(2e-4 / 0.2, rel=0.01)


def test_positions_stay_as_they_are_for_what_they_hold_and_for_what_they_do_not_show():
    plane = positions(np.column_stack([0.1 * np.sin(5 * T_S), -T_S]))
    assert along_path(MODELS["projectile"], plane) is None
    assert along_path(MODELS["spin-down"], plane) is None
    assert phenomenon_of(MODELS["pendulum"], plane) is not None
