"""The response of a fitted motion to forces, carried from sample to sample, against an integration of each force."""

from dataclasses import replace

import numpy as np

from fitters.effect_sensitivity import WORST_CONDITION, motion_of
from fitters.ode import fit
from iris_sysid import MODELS, Quantity, Trajectory, model_from_equation, simulate


def a_motion():
    t_s = np.arange(60) / 30
    height = simulate(MODELS["free-fall"], t_s, {"gravity": 9.8, "z_0": 20.0, "vz_0": 0.0}).observed
    noisy = height + 1e-3 * np.random.default_rng(0).standard_normal(height.shape)
    clip = Trajectory(t_s, (Quantity("z", "m"),), noisy, np.full_like(noisy, np.nan), np.ones(t_s.size, bool))
    return motion_of(fit(clip, MODELS["free-fall"]), clip)


def test_the_response_is_that_of_an_integration():
    motion = a_motion()
    force = np.sin(motion.grid)[:, None]
    np.testing.assert_allclose(replace(motion, response=None).answer(force), motion.answer(force), atol=1e-3)


def test_no_force_has_no_response():
    motion = a_motion()
    nothing = np.zeros((1, motion.grid.size, 1))
    for which in (motion, replace(motion, response=None)):
        assert not which.answers(nothing).any()


def a_decaying_motion(samples_per_s=20):
    """A body that forgets how it began, a hundred times over: v' = -20 v + 10 u over 30 s."""
    t_s = np.arange(30 * samples_per_s) / samples_per_s
    model = model_from_equation("x'' = -20*x' + 10*u", units={"x": "m"})
    u = np.sign(np.sin(t_s))[:, None]
    x = simulate(model, t_s, {"x_0": 0.0, "x_rate_0": 0.0}, inputs=u).observed
    noisy = x + 1e-4 * np.random.default_rng(0).standard_normal(x.shape)
    unknown, valid = np.full_like(noisy, np.nan), np.ones(t_s.size, bool)
    clip = Trajectory(t_s, (Quantity("x", "m"),), noisy, unknown, valid, (Quantity("u", "1"),), u)
    return motion_of(fit(clip, model, fixed={"x_0": 0.0, "x_rate_0": 0.0}), clip)


def test_a_motion_that_forgets_its_beginning_answers_as_by_integration():
    motion = a_decaying_motion()
    forces = np.stack([np.sin(k * motion.grid)[:, None] for k in (1.0, 3.0)])
    whole, blocks = replace(motion, response=None).answers(forces), motion.answers(forces)
    np.testing.assert_allclose(blocks, whole, atol=1e-4 * np.max(np.abs(whole)))
    exact = (np.sin(motion.grid[motion.at_samples]) * 20 - np.cos(motion.grid[motion.at_samples])) / 401
    slopes = np.gradient(blocks[0, :, 0], motion.grid[motion.at_samples])
    np.testing.assert_allclose(slopes[40:-1], exact[40:-1], atol=2e-3 * np.max(np.abs(exact)))


def test_a_motion_that_forgets_its_state_between_two_samples_answers_as_by_integration():
    motion = a_decaying_motion(samples_per_s=1)
    assert np.linalg.cond(motion.response.across).min() > WORST_CONDITION
    forces = np.sin(0.3 * motion.grid)[None, :, None]
    whole, carried = replace(motion, response=None).answers(forces), motion.answers(forces)
    np.testing.assert_allclose(carried, whole, atol=0.02 * np.max(np.abs(whole)))
