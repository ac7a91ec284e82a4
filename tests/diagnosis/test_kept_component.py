"""A component that no formula fits is kept as an effect of one's own."""

import numpy as np
import pytest

from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.errors import DataError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory
from validation.independent.motions import MOTIONS, integrate

T_S = np.arange(360) / 60
VALUES = {"length": 0.5, "damping": 0.05, "x0": 0.8, "v0": 0.1}
ONE_EFFECT = [EFFECTS["constant-force"]]


def table(theta: np.ndarray) -> Trajectory:
    seen = theta + 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    unknown, valid = np.full_like(seen, np.nan), np.ones(T_S.size, dtype=bool)
    return Trajectory(T_S, MODELS["pendulum"].observed, seen, unknown, valid, sensor="encoder")


def bumpy(t, x, v, base):
    return -0.3 * np.exp(-(((np.abs(v) - 2.0) / 0.6) ** 2)) * np.sign(v)


def stepped(theta: np.ndarray) -> np.ndarray:
    return theta + 0.02 * np.tanh(theta / 0.1) ** 2


@pytest.mark.parametrize(
    ("kind", "motion"),
    [
        ("force-of-velocity", lambda: integrate(MOTIONS["pendulum"], VALUES, T_S, bumpy)[:, :1]),
        ("reading-of-position", lambda: stepped(integrate(MOTIONS["pendulum"], VALUES, T_S)[:, :1])),
    ],
)
def test_component_that_is_kept_reduces_the_error_over_blocks_left_out(kind, motion):
    found = diagnose(table(motion()), "pendulum", effects=ONE_EFFECT, keep=[kind])
    assert f"kept-{kind}" in [effect.name for effect in found.added]
    assert found.sizes[f"kept_{kind.replace('-', '_')}"].value == pytest.approx(1.0, abs=0.3)
    assert found.after.heldout < 0.5 * found.before.heldout


def test_component_that_is_not_there_is_refused_with_those_that_are():
    clip = table(integrate(MOTIONS["pendulum"], VALUES, T_S, bumpy)[:, :1])
    with pytest.raises(DataError, match="no component 'clock'; its components are force-of-velocity"):
        diagnose(clip, "pendulum", effects=ONE_EFFECT, keep=["clock"])
