"""Two halves of a recording are fitted apart and compared value by value."""

import numpy as np

from iris_sysid import MODELS, Trajectory, simulate
from validation.halves import MIN_SAMPLES, rows
from validation.world_tables import Recording, only

PENDULUM = MODELS["pendulum"]


def recording(count, length_after=0.5):
    t_s = np.arange(count) / 30
    known = {"damping": 0.05, "omega_0": 0.0, "vertical": 0.0}
    before = simulate(PENDULUM, t_s, {"length": 0.5, "theta_0": 0.6, **known}).observed
    after = simulate(PENDULUM, t_s, {"length": length_after, "theta_0": 0.6, **known}).observed
    theta = np.where(np.arange(count)[:, None] < count // 2, before, after)
    theta = theta + 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    clip = Trajectory(t_s, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(count, bool))
    return Recording("swing", "", "", PENDULUM, only(lambda: clip), "unknown")


def test_halves_of_one_motion_agree_in_what_belongs_to_the_set_up():
    found = {row["value"]: row for row in rows(recording(300))}
    assert {"length", "damping"} <= set(found)
    assert not any(name.endswith("_0") for name in found)
    assert abs(found["length"]["difference / standard error"]) < 3
    assert found["length"]["standard error / value, %"] < 1


def test_halves_of_two_lengths_do_not_agree():
    found = {row["value"]: row for row in rows(recording(300, length_after=0.52))}
    assert abs(found["length"]["difference / standard error"]) > 3


def test_recording_too_short_for_two_halves_has_no_row():
    assert not list(rows(recording(2 * MIN_SAMPLES - 1)))
