"""The response of a fitted motion to forces, with and without the inverse of its transition matrices."""

from dataclasses import replace

import numpy as np

from fitters.effect_sensitivity import motion_of
from fitters.ode import fit
from iris_sysid import MODELS, Quantity, Trajectory, simulate


def a_motion():
    t_s = np.arange(60) / 30
    height = simulate(MODELS["free-fall"], t_s, {"gravity": 9.8, "z_0": 20.0, "vz_0": 0.0}).observed
    noisy = height + 1e-3 * np.random.default_rng(0).standard_normal(height.shape)
    clip = Trajectory(t_s, (Quantity("z", "m"),), noisy, np.full_like(noisy, np.nan), np.ones(t_s.size, bool))
    return motion_of(fit(clip, MODELS["free-fall"]), clip)


def test_response_without_the_inverse_is_the_same():
    motion = a_motion()
    force = np.sin(motion.grid)[:, None]
    np.testing.assert_allclose(replace(motion, inverse=None).answer(force), motion.answer(force), atol=1e-3)


def test_no_force_has_no_response_with_or_without_the_inverse():
    motion = a_motion()
    nothing = np.zeros((1, motion.grid.size, 1))
    for which in (motion, replace(motion, inverse=None)):
        assert not which.answers(nothing).any()
