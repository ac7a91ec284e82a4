"""A motion that no free run follows is fitted in pieces that meet: against SciPy, with honest errors."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.compose_effects import with_effects
from fitters.ode import FitRequest
from fitters.ode.multiple_shooting import shot_in_pieces
from iris_sysid import MODELS, Estimate, Quantity, Trajectory, fit, model_from_equation

UNITS = {"x": "rad", "u": "V"}
UPRIGHT = model_from_equation("x'' = a*sin(x) - c*x' + b*u", units=UNITS)
TRUTH = {"a": 20.0, "b": 3.0, "c": 0.3}
CHAOTIC = model_from_equation("x'' = -k*sin(x) - c*x' + u", units=UNITS)
NOISE = 1e-3


def record(t_s, u, x, hold, seed, noise=NOISE):
    seen = x[:, None] + noise * np.random.default_rng(seed).standard_normal((x.size, 1))
    unknown, valid = np.full_like(seen, np.nan), np.ones(x.size, dtype=bool)
    return Trajectory(t_s, UPRIGHT.observed, seen, unknown, valid, UPRIGHT.inputs, u[:, None], hold=hold)


def upright(seed, n=2000, step_s=0.01):
    """An inverted pendulum that feedback and a random voltage hold up, held from sample to sample: 90 e-foldings."""
    push = 2.0 * np.repeat(np.random.default_rng(1000 + seed).standard_normal(n // 5 + 1), 5)[:n]
    u, states = np.zeros(n), np.zeros((n, 2))
    states[0] = 0.05, 0.0
    for k in range(n):
        u[k] = push[k] - states[k] @ (12.0, 2.5)
        if k + 1 < n:
            states[k + 1] = one_step(
                lambda _, y, k=k: (y[1], TRUTH["a"] * np.sin(y[0]) - TRUTH["c"] * y[1] + TRUTH["b"] * u[k]),
                step_s,
                states[k],
            )
    return record(np.arange(n) * step_s, u, states[:, 0], "zero-order", seed)


def chaotic(seed, n=2000, step_s=0.1, rate=2 / 3):
    """A pendulum that a cosine drives into chaos, whose force is on a line between samples."""
    t_s = np.arange(n) * step_s
    u, states = 1.15 * np.cos(rate * t_s), np.zeros((n, 2))
    states[0] = 0.2, 0.0
    for k in range(n - 1):
        slope = (u[k + 1] - u[k]) / step_s
        states[k + 1] = one_step(
            lambda t, y, k=k, slope=slope: (y[1], -np.sin(y[0]) - 0.5 * y[1] + u[k] + slope * t), step_s, states[k]
        )
    return record(t_s, u, states[:, 0], "linear", seed, noise=5e-3)


def one_step(slopes, step_s, start):
    return solve_ivp(slopes, (0.0, step_s), start, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]


def pulls(result, truth):
    return np.array(
        [(result.estimates[name].value - value) / result.estimates[name].stderr for name, value in truth.items()]
    )


def test_unstable_motion_under_feedback_is_fitted_in_pieces():
    result = fit(upright(0), UPRIGHT)
    assert result.status == "ok"
    assert any("multiple shooting in 100 pieces of 0.2 s" in note for note in result.notes)
    assert np.all(np.abs(pulls(result, {**TRUTH, "x_0": 0.05, "x_rate_0": 0.0})) < 4)
    assert all(result.estimates[name].stderr < 0.02 * value for name, value in TRUTH.items())
    assert result.rms[0] == pytest.approx(NOISE, rel=0.05)


def test_chaotic_motion_is_fitted_and_a_given_value_passes_its_error_on():
    clip = chaotic(2)
    result = fit(clip, CHAOTIC)
    assert result.status == "ok"
    assert np.all(np.abs(pulls(result, {"k": 1.0, "c": 0.5, "x_0": 0.2, "x_rate_0": 0.0})) < 4)
    given = fit(clip, CHAOTIC, fixed={"c": Estimate(0.5, 1e-4, "1")})
    assert given.budget["k"]["c"] > 0


def test_an_effect_that_the_equation_lacks_is_not_hidden_in_the_jumps():
    lacking = model_from_equation("x'' = a*sin(x) + b*u", units=UNITS)
    assert shot_in_pieces(FitRequest(upright(1), lacking)) is None
    assert fit(upright(1), lacking).status != "ok"


def test_pieces_of_a_stable_motion_give_what_a_free_run_gives():
    clip = upright(3)
    t_s, u = clip.t_s, clip.inputs[:, 0]
    x = np.zeros((t_s.size, 2))
    for k in range(t_s.size - 1):
        x[k + 1] = one_step(lambda _, y, k=k: (y[1], -8.0 * np.sin(y[0]) - 0.4 * y[1] + 3.0 * u[k]), 0.01, x[k])
    stable = record(t_s, u, x[:, 0], "zero-order", 3)
    run, shot = fit(stable, UPRIGHT), shot_in_pieces(FitRequest(stable, UPRIGHT))
    assert run.status == "ok"
    for name in run.free:
        assert abs(shot.start[name] - run.estimates[name].value) < 0.05 * run.estimates[name].stderr
    expected = np.sqrt(np.diag(np.linalg.inv(run.fisher)))
    weighed = shot.near.flat.T @ shot.near.flat / np.mean(shot.near.residual**2)
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(weighed))), expected, rtol=0.02)


@pytest.mark.parametrize("why", ["short", "events", "drive", "prior"])
def test_none_where_it_does_not_apply(why):
    clip, model, more = upright(4, n=200), UPRIGHT, {}
    if why == "short":
        clip = clip.with_(valid=clip.t_s < 0.5)
    if why == "events":
        z = Quantity("z", "m")
        clip, model = clip.with_(quantities=(z,)), MODELS["bouncing-ball"]
    if why == "drive":
        model = with_effects(UPRIGHT, ("input-saturation",))
    if why == "prior":
        more = {"fixed": {"a": Estimate(20.0, 1.0, "1")}, "free": ["a"]}
    assert shot_in_pieces(FitRequest(clip, model, **more)) is None


@pytest.mark.slow
def test_standard_errors_of_pieces_cover_the_truth():
    each = np.array([pulls(fit(upright(seed), UPRIGHT), TRUTH) for seed in range(20)])
    assert 0.88 <= np.mean(np.abs(each) < 1.96) <= 0.99
    assert np.all(np.abs(np.mean(each, axis=0)) < 0.67)  # three standard errors of a mean of twenty
