"""The weak form finds values without a run, states their errors, and says where it does not apply."""

import numpy as np
import pytest

from fitters.ode import FitRequest
from fitters.ode import weak_fit as weak_form
from fitters.ode.weak_fit import _left_out, weak_fit
from iris_sysid import MODELS, Trajectory, model_from_equation, simulate, smooth

TRUTH = {"b": 2.0, "k": 3.0, "c": 0.4}
DRIVEN = model_from_equation("x'' = b*u - k*x - c*x'")
STEP_S, NOISE = 0.02, 1e-4


def record(seed, hold="zero-order", n=1500, wander=0.0):
    """A mass on a spring under a random input, simulated to 1e-9, with white noise and a force that wanders."""
    rng = np.random.default_rng(seed)
    t_s, u = np.arange(n) * STEP_S, np.repeat(rng.standard_normal(n // 10), 10)[:, None]
    slow = wander * np.repeat(rng.standard_normal(n // 50), 50)[:, None]
    start = {"x_0": 0.3, "x_rate_0": -0.5}
    motion = simulate(DRIVEN, t_s, {**TRUTH, **start}, inputs=u + slow, hold=hold).observed
    x = motion + NOISE * rng.standard_normal(motion.shape)
    unknown, valid = np.full_like(x, np.nan), np.ones(n, bool)
    return smooth(Trajectory(t_s, DRIVEN.observed, x, unknown, valid, DRIVEN.inputs, u, hold=hold))


@pytest.mark.parametrize("hold", ["zero-order", "linear"])
def test_values_are_found_from_a_poor_start_under_either_hold(hold):
    found = weak_fit(FitRequest(record(1, hold), DRIVEN, start={"b": 0.1, "k": 30.0, "c": -3.0}))
    for name, value in TRUTH.items():
        assert found.values[name] == pytest.approx(value, rel=0.02)
    assert found.values["x_0"] == pytest.approx(0.3, abs=1e-3)
    assert found.residual.shape == found.left_out.shape
    assert found.squares < 0.01 * found.residual.size


def test_many_windows_are_fitted_from_the_values_of_few_of_them(monkeypatch):
    clip, evaluated, bounded = record(4, wander=0.1), [], weak_form._WeakForm.bounded
    request = FitRequest(
        clip, model_from_equation("x'' = b*u - exp(a)*x - c*x'"), start={"b": 0.1, "a": 4.0, "c": -3.0}
    )

    def counted(form, at):
        evaluated.append(at.shape[1] * len(form.left))
        return bounded(form, at)

    monkeypatch.setattr(weak_form._WeakForm, "bounded", counted)
    every = weak_fit(request)
    whole = sum(evaluated)
    monkeypatch.setattr(weak_form, "FIRST_WINDOWS", len(every.residual) // 5)
    evaluated.clear()
    few = weak_fit(request)
    assert sum(evaluated) < 0.8 * whole
    for name, error in every.stderr.items():
        assert few.values[name] == pytest.approx(every.values[name], abs=1e-3 * error)
        assert few.stderr[name] == pytest.approx(error, rel=1e-3)


@pytest.mark.slow
def test_standard_errors_cover_the_truth_where_an_unknown_force_wanders():
    within, count = 0, 0
    for seed in range(40):
        found = weak_fit(FitRequest(record(seed, wander=0.2), DRIVEN, start={"b": 1.0, "k": 1.0, "c": 0.0}))
        within += sum(abs(found.values[name] - value) < 2.09 * found.stderr[name] for name, value in TRUTH.items())
        count += len(TRUTH)
    assert 0.85 <= within / count <= 0.99


def test_a_block_that_is_left_out_is_predicted_as_a_fit_without_it_does():
    rng = np.random.default_rng(0)
    jacobian, target = rng.standard_normal((60, 2, 3)), rng.standard_normal((60, 2))
    flat = jacobian.reshape(120, 3)
    residual = (target.ravel() - flat @ np.linalg.lstsq(flat, target.ravel())[0]).reshape(60, 2)
    without = np.linalg.lstsq(flat[6:], target.ravel()[6:])[0]  # a block: 3 of 60 windows of 2 equations
    np.testing.assert_allclose(_left_out(jacobian, residual)[:3].ravel(), target.ravel()[:6] - flat[:6] @ without)


def test_errors_of_blocks_are_those_of_their_windows():
    clip = record(3, wander=0.5)
    found = weak_fit(FitRequest(clip, DRIVEN, start={"b": 1.0, "k": 1.0, "c": 0.0}))
    assert np.sum(found.left_out**2) > found.squares
    squares, counts = found.block_squares()
    assert squares @ counts == pytest.approx(np.sum(found.left_out**2))


def test_held_values_stay_and_are_not_counted():
    found = weak_fit(FitRequest(record(2), DRIVEN, {"b": 2.0}, start={"k": 1.0, "c": 0.0}))
    assert found.values["b"] == 2.0
    assert set(found.stderr) == {"k", "c"}


@pytest.mark.parametrize("why", ["not smoothed", "short", "events"])
def test_none_where_the_form_does_not_apply(why):
    clip, model = record(0), DRIVEN
    if why == "not smoothed":
        clip = clip.with_(smoothed=None)
    if why == "short":
        clip = smooth(clip.with_(valid=clip.t_s < 0.5))
    if why == "events":
        model = MODELS["bouncing-ball"]
    assert weak_fit(FitRequest(clip, model)) is None
