"""The ball among the cups: its run-up is found by who moves first, and gives the damping."""

import numpy as np
import pytest

from fitters.ode import fit
from iris_sysid.errors import DataError
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.types import Quantity, Trajectory

T_S = np.arange(150) / 60
RELEASE, IMPACT, DAMPING = 30, 90, 0.4
SIGMA = 2e-4  # m


def body(x_m, z_m, rng):
    position = np.column_stack([x_m, np.broadcast_to(z_m, T_S.shape)]) + rng.normal(0, SIGMA, (T_S.size, 2))
    return Trajectory(
        t_s=T_S, quantities=(Quantity("x", "m"), Quantity("z", "m")), position=position,
        sigma=np.full((T_S.size, 2), SIGMA), valid=np.ones(T_S.size, dtype=bool),
    )  # fmt: skip


def scene(seed=0, *, speed=2.0):
    """Two cups, and between them in the list the ball, which rolls to the right and slows at the impact."""
    rng = np.random.default_rng(seed)
    rolled = np.clip(T_S - T_S[RELEASE], 0, None)
    ball = -2.0 + speed / DAMPING * (1 - np.exp(-DAMPING * rolled))
    since = np.clip(T_S - T_S[IMPACT], 0, None)
    ball[IMPACT:] = ball[IMPACT] + 0.3 * since[IMPACT:]
    return [body(0.9 * since, 0.05, rng), body(ball, 0.075, rng), body(0.1 + 1.1 * since, 0.05, rng)]


def motion(trajectory):
    return next((segment.start, segment.stop) for segment in trajectory.segments if segment.label == "motion")


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_run_up_goes_from_where_the_ball_leaves_to_before_the_first_cup_moves(speed):
    trajectory = PHENOMENA["hitting-cones"].observe(scene(speed=speed), {})
    start, stop = motion(trajectory)
    assert RELEASE <= start <= RELEASE + 2
    assert IMPACT - 3 <= stop <= IMPACT + 1
    assert trajectory.position[stop - 1, 0] > 0


def test_run_up_gives_the_damping_within_its_error():
    pulls = []
    for seed in range(20):
        trajectory = PHENOMENA["hitting-cones"].observe(scene(seed), {})
        damping = fit(trajectory, MODELS["coasting-ball"]).estimates["damping"]
        pulls.append((damping.value - DAMPING) / damping.stderr)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_ball_that_is_not_seen_to_roll_is_refused():
    with pytest.raises(DataError, match="the ball rolls by itself for 0 samples"):
        PHENOMENA["hitting-cones"].observe(scene()[::2], {})
