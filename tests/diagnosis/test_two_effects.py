"""Two effects that hide each other are found together: SciPy integrates the truth."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

PENDULUM = MODELS["pendulum"]
RATE = math.sqrt(9.80665)  # 1/s, of a pendulum of 1 m
NOISE_RAD = 0.002


def drag(_t, _x, v):
    return -0.15 * v * abs(v)


def friction(_t, _x, v):
    return -0.08 * math.tanh(v / 1e-3)


def forcing(t, _x, _v):
    return 0.12 * math.cos(0.5 * RATE * t + 1.0)


def stiffening(t, x, _v):
    return -0.006 * t * RATE**2 * math.sin(x)


def swing(*forces, n=600, seed=3):
    """A noisy swing at 60 Hz with some damping and these forces; ``n`` samples."""
    t_s = np.arange(n) / 60

    def rates(t, state):
        x, v = state
        return v, -(RATE**2) * math.sin(x) - 0.05 * v + sum(force(t, x, v) for force in forces)

    motion = solve_ivp(rates, (0, t_s[-1]), (0.7, 0.0), t_eval=t_s, rtol=1e-8, atol=1e-9, max_step=0.01).y[:1].T
    theta = motion + NOISE_RAD * np.random.default_rng(seed).standard_normal(motion.shape)
    return Trajectory(t_s, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(n, dtype=bool))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("forces", "sizes"),
    [
        ((drag, friction), {"quadratic-drag": 0.15, "coulomb-friction": 0.08}),
        ((drag, forcing), {"quadratic-drag": 0.15, "periodic-forcing": 0.12}),
        ((friction, stiffening), {"coulomb-friction": 0.08, "parameter-drift": 0.006}),
        ((forcing, stiffening), {"periodic-forcing": 0.12, "parameter-drift": 0.006}),
    ],
)
def test_two_effects_that_hide_each_other_are_both_found(forces, sizes):
    """Neither predicts surely better alone, or the first is found in a form that makes up for the second."""
    found = diagnose(swing(*forces), PENDULUM)
    said = [finding.effects for finding in found.findings if finding.word in ("named", "group")]
    for name, size in sizes.items():
        assert any(name in effects for effects in said), (name, found.findings)
        estimate = found.sizes.get(name.replace("-", "_"))
        if size is not None and estimate is not None:
            assert abs(abs(estimate.value) - size) < 3.5 * estimate.stderr
    assert found.residual_ratio < 1.1
