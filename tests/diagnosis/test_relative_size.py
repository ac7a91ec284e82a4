"""The size of an effect beside the forces and the motion, against closed forms."""

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from iris_sysid.diagnosis.relative_size import relative_size
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory
from tests.diagnosis.test_hold_out import fit


def fallen(name: str, start: dict[str, float], force) -> Trajectory:
    """A body that falls under gravity and a constant force, without noise to speak of."""
    t_s = np.arange(60) / 60
    z = start["z"] + start["v"] * t_s + 0.5 * force * t_s**2
    z = (z + 1e-6 * np.random.default_rng(3).standard_normal(60))[:, None]
    return Trajectory(t_s, MODELS[name].observed, z, np.full_like(z, np.nan), np.ones(60, dtype=bool))


def test_constant_force_is_measured_by_gravity():
    model, push = MODELS["free-fall"], EFFECTS["constant-force"]
    clip = fallen("free-fall", {"z": 10.0, "v": 1.0}, -7.81)
    fitted = fit(clip, with_effects(model, [push]), fixed={"gravity": 9.81})
    assert relative_size(push, fitted, model, clip) == pytest.approx(2.0 / 9.81, rel=1e-3)
    assert relative_size(push, fitted, model, clip) < push.largest


def test_offset_is_measured_by_the_spread_of_the_motion():
    model, shift, t_s = MODELS["linear-oscillator"], EFFECTS["zero-offset"], np.arange(200) / 40
    x = (0.1 + 0.2 * np.cos(6.0 * t_s) + 1e-5 * np.random.default_rng(1).standard_normal(200))[:, None]
    clip = Trajectory(t_s, model.observed, x, np.full_like(x, np.nan), np.ones(200, dtype=bool))
    fitted = fit(clip, with_effects(model, [shift]))
    assert relative_size(shift, fitted, model, clip) == pytest.approx(0.1 / np.std(x), rel=0.01)
