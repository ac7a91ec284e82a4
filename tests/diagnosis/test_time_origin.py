"""A diagnosis does not depend on where the clock starts."""

import numpy as np
import pytest

from iris_sysid import MODELS, Quantity, Trajectory, diagnose
from validation.independent.effects import HIDDEN
from validation.independent.motions import MOTIONS, integrate

VALUES = {"length": 0.5, "damping": 0.03, "x0": 0.9, "v0": 0.0}
SIZES = {"drift of the force": -2e-3, "camera drift": 2e-3, "periodic force": 0.08}
SHAPES = {"periodic force": {"rate": 5.3, "phase": 1.0}}


def diagnosed(hidden: str, start_s: float):
    """The diagnosis of a pendulum with something hidden in it whose first time stamp is ``start_s``."""
    motion = MOTIONS["pendulum"]
    effect = next(effect for effect in HIDDEN if effect.name == hidden)
    t_s = motion.times()
    theta = effect.show(motion, VALUES, t_s, SIZES[hidden], {"start": 0.0, **SHAPES.get(hidden, {})})
    theta = theta + motion.noise * np.random.default_rng(5).standard_normal(theta.shape)
    quantity = Quantity("theta", "rad", "theta")
    clip = Trajectory(t_s + start_s, (quantity,), theta, np.full_like(theta, np.nan), np.ones(t_s.size, dtype=bool))
    return diagnose(clip, MODELS["pendulum"])


@pytest.mark.parametrize("hidden", SIZES)
def test_diagnosis_is_the_same_whenever_the_clock_starts(hidden):
    first, later = diagnosed(hidden, 0.0), diagnosed(hidden, 60.0)
    assert [effect.name for effect in first.added] == [effect.name for effect in later.added] != []
    for name in ("length", "damping", *(effect.parameters[0].name for effect in first.added)):
        before, after = first.final.estimates[name], later.final.estimates[name]
        assert after.value == pytest.approx(before.value, abs=0.02 * before.stderr)
        assert after.stderr == pytest.approx(before.stderr, rel=0.02)


def test_length_is_right_beside_a_drift_whenever_the_clock_starts():
    estimates = diagnosed("drift of the force", 60.0).final.estimates
    passed_s = estimates["drift_start"].value - 60.0  # the force is measured at the first sample used
    length, rate = estimates["length"], SIZES["drift of the force"]
    assert abs(length.value - VALUES["length"] / (1 + rate * passed_s)) < 3 * length.stderr


def test_undisturbed_motion_is_that_of_the_generator():
    motion = MOTIONS["pendulum"]
    first = integrate(motion, VALUES, motion.times())
    later = integrate(motion, VALUES, motion.times(60.0))
    np.testing.assert_allclose(first, later, atol=1e-9)
