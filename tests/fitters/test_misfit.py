"""An equation that lacks something: the status says so, and intervals hold the truth all the same."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import FitOptions, fit
from fitters.ode.model_discrepancy import SOURCE
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory
from validation.misfit import clean_case, hidden_case, row_of, table

PENDULUM = MODELS["pendulum"]
LENGTH, NOISE = 0.6, 5e-4


def swing(drag=0.0, stiffening=0.0, noise=NOISE, seed=0):
    """A pendulum with quadratic drag and a cubic force, by SciPy."""
    t_s = np.arange(600) / 60

    def rates(t, state):
        theta, omega = state
        force = -0.04 * omega - drag * abs(omega) * omega - stiffening * theta**3
        return [omega, -9.80665 / LENGTH * np.sin(theta) + force]

    theta = solve_ivp(rates, (0, 10), [1.0, 0.0], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    return clip_of(t_s, theta[:, None] + noise * np.random.default_rng(seed).standard_normal((600, 1)))


def clip_of(t_s, theta):
    return Trajectory(t_s, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(t_s.size, bool))


@pytest.mark.parametrize("count", [12, 15, 18])
@pytest.mark.parametrize("growth", [0.3, 0.9])
def test_few_samples_that_are_far_off_do_not_give_a_value_a_small_error(count, growth):
    t_s = np.arange(count) / 10
    way = solve_ivp(lambda t, state: [state[1], 0.3 * (1 + growth * t)], (0, 2), [0.0, 0.0], "DOP853", t_s, rtol=1e-10)
    position = way.y[0][:, None] + 1e-4 * np.random.default_rng(0).standard_normal((count, 1))
    model = MODELS["incline"]
    unknown = np.full_like(position, np.nan)
    result = fit(Trajectory(t_s, model.observed, position, unknown, np.ones(count, bool)), model)
    found = result.estimates["acceleration"]
    assert result.status == "misfit"
    assert abs(found.value - 0.3) < 2.5 * found.stderr  # at the start; it is 0.3 (1 + growth t)


@pytest.mark.parametrize("hidden", [{"drag": 0.1}, {"stiffening": 0.5}, {"drag": 0.02, "stiffening": -0.2}])
def test_fit_that_lacks_a_force_is_a_misfit_and_its_length_is_within_the_interval(hidden):
    result = fit(swing(**hidden), PENDULUM)
    length = result.estimates["length"]
    assert result.rms[0] > 3 * NOISE
    assert result.status == "misfit"
    assert length.interval[0] < LENGTH < length.interval[1]
    assert result.budget["length"][SOURCE] > result.budget["length"]["random"]
    assert length.stderr < 0.1 * LENGTH  # no better off with an interval that holds everything


@pytest.mark.parametrize("aspect", [1.03, 0.97])
def test_pendulum_filmed_with_unequal_scales_has_its_length_within_the_interval(aspect):
    clip = swing()
    result = fit(clip_of(clip.t_s, np.arctan(aspect * np.tan(clip.position))), PENDULUM)
    length = result.estimates["length"]
    assert result.status == "misfit"
    assert length.interval[0] < LENGTH < length.interval[1]
    assert length.stderr < 0.01 * LENGTH


def test_fit_that_lacks_nothing_has_no_discrepancy_and_the_same_errors():
    for seed in range(5):
        result = fit(swing(seed=seed), PENDULUM)
        plain = fit(swing(seed=seed), PENDULUM, options=replace(FitOptions(), discrepancy=False))
        assert result.ok
        assert SOURCE not in result.budget["length"]
        assert result.estimates["length"] == plain.estimates["length"]


def test_residual_of_rounding_alone_is_no_misfit():
    result = fit(swing(noise=0.0), PENDULUM)
    assert result.ok, result.message


@pytest.mark.parametrize("factor", [1e-2, 1e2])
def test_discrepancy_does_not_depend_on_the_unit(factor):
    model = MODELS["linear-oscillator"]
    t_s = np.arange(400) / 60
    z = solve_ivp(lambda t, s: [s[1], -20 * s[0] - 200 * s[0] ** 3], (0, 7), [0.2, 0.0], "DOP853", t_s, rtol=1e-10)
    z = z.y[0][:, None] + 2e-4 * np.random.default_rng(1).standard_normal((400, 1))
    valid = np.ones(400, bool)
    one, other = (Trajectory(t_s, model.observed, z * k, np.full_like(z, np.nan), valid) for k in (1.0, factor))
    first, second = (fit(clip, model) for clip in (one, other))
    assert first.status == second.status == "misfit"
    assert second.budget["stiffness"][SOURCE] == pytest.approx(first.budget["stiffness"][SOURCE], rel=0.05)
    assert second.budget["z_0"][SOURCE] == pytest.approx(factor * first.budget["z_0"][SOURCE], rel=0.05)


@pytest.mark.slow
def test_intervals_of_incomplete_equations_hold_the_truth_nine_times_in_ten():
    rows = [row for row in (row_of(hidden_case(seed)) for seed in range(60)) if row.status == "misfit"]
    assert len(rows) > 40
    hits = np.mean([row.covered for row in rows], axis=0)
    assert hits[0] < 0.8  # by the noise alone
    assert hits[1] > 0.88, table(rows).to_string()


@pytest.mark.slow
def test_complete_equations_are_no_misfit_and_their_intervals_stay():
    rows = [row_of(clean_case(seed)) for seed in range(40)]
    assert np.mean([row.status == "misfit" for row in rows]) <= 0.05
    assert np.mean([row.covered[1] for row in rows]) >= 0.88


def test_drag_that_slows_a_throw_sideways_does_not_leave_gravity_undetermined():
    t_s = np.arange(45) / 60

    def rates(t, state):
        speed = np.hypot(state[2], state[3])
        return [state[2], state[3], -0.05 * speed * state[2], -9.80665 - 0.05 * speed * state[3]]

    way = solve_ivp(rates, (0, 1), [0.0, 1.5, 3.8, 1.7], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[:2].T
    seen = way + 2e-4 * np.random.default_rng(0).standard_normal(way.shape)
    model = MODELS["projectile"]
    clip = Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool))
    gravity = fit(clip, model, free=("gravity",)).estimates["gravity"]
    assert gravity.interval[0] < 9.80665 < gravity.interval[1]
    assert gravity.stderr < 3.0, "sideways nothing but the drag acts: it has no force to be compared with"
