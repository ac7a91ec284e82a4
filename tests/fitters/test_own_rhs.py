"""Right-hand sides as people write them: roots and logarithms, lists, imports, exceptions, guesses of little use."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import fit
from iris_sysid.errors import FitError
from iris_sysid.types import OdeModel, Parameter, Quantity, Trajectory

LEVEL = (Quantity("h", "m", "h"),)
ANGLE = (Quantity("theta", "rad", r"\theta"), Quantity("omega", "rad/s", r"\omega"))


def clip(rates, start, t_s, observed, noise=1e-3):
    truth = solve_ivp(rates, (t_s[0], t_s[-1]), start, "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    seen = (truth + noise * np.random.default_rng(0).standard_normal(t_s.size))[:, None]
    return Trajectory(t_s, observed, seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool))


def model(rhs, states, names, guess):
    parameters = tuple(Parameter(name, "1", name) for name in names)
    return OdeModel("own", "", "", "", states, parameters, states[:1], rhs, guess)


def ones(*names, value=1.0):
    return lambda trajectory: dict.fromkeys(names, value)


@pytest.fixture(scope="module")
def tank():
    return clip(lambda t, h: [-0.03 * np.sqrt(max(h[0] - 0.04, 0))], [0.25], np.arange(300) / 10, LEVEL)


@pytest.fixture(scope="module")
def swing():
    return clip(lambda t, s: [s[1], -np.sqrt(300) * s[0]], [0.3, 0.0], np.arange(300) / 60, ANGLE[:1])


def clipped_root(t, state, params):
    return (-params[0] * np.sqrt(max(state[0] - params[1], 0.0)),)


def open_root(t, state, params):
    return (-params[0] * np.sqrt(state[0] - params[1]),)


def own_frequency(t, state, params):
    return state[1], -np.sqrt(params[0]) * state[0]


@pytest.mark.parametrize("start", [1.0, 1000.0, -1.0])
@pytest.mark.parametrize("rhs", [clipped_root, open_root])
def test_start_outside_the_domain_of_a_root_is_rescued(tank, rhs, start):
    result = fit(tank, model(rhs, LEVEL, ("k", "hole"), ones("k", "hole", value=start)))
    assert result.ok, result.message
    assert result.estimates["k"].value == pytest.approx(0.03, abs=3e-4)
    assert result.estimates["hole"].value == pytest.approx(0.04, abs=1e-3)


def test_negative_start_of_what_stands_under_a_root_is_rescued(swing):
    result = fit(swing, model(own_frequency, ANGLE, ("k",), ones("k", value=-1.0)))
    assert result.ok, result.message
    assert result.estimates["k"].value == pytest.approx(300.0, abs=0.5)


def test_search_that_ends_where_a_value_does_not_act_has_failed(swing):
    def overdamped(t, state, params):
        return state[1], -(params[0] ** 2) * state[1] + 0.0 * params[1]

    result = fit(swing, model(overdamped, ANGLE, ("c", "idle"), ones("c", "idle")))
    assert result.status == "not-converged"
    assert not result.usable
    assert result.reason == "not-converged"


def listed(t, state, params):
    return [state[1], -params[0] * state[0]]


def stacked(t, state, params):
    return np.array([state[1], -params[0] * state[0]])


def imported(t, state, params):
    import math

    return state[1], -params[0] * math.sin(state[0]) * 1.0


def mixed(t, state, params):
    rates = np.zeros(2)
    rates[0] = state[1]
    rates[1] = -params[0] * state[0]
    return list(rates)


@pytest.mark.parametrize("rhs", [listed, stacked, imported, mixed])
def test_right_hand_side_may_return_a_list_or_an_array_and_import(swing, rhs):
    result = fit(swing, model(rhs, ANGLE, ("k",), ones("k", value=15.0)))
    assert result.usable, result.message
    assert result.estimates["k"].value == pytest.approx(np.sqrt(300), rel=0.02)


def refusing(t, state, params):
    if params[0] < 5.0:
        raise ValueError("negative spring")
    return state[1], -params[0] * state[0]


def asserting(t, state, params):
    assert state[0] < 0.2, "angle too large"
    return state[1], -params[0] * state[0]


def failing_later(t, state, params):
    return state[1], -params[0] * state[0] / int(t < 1.0)


def looking_up(t, state, params):
    return state[1], -params[0] * state[0] * {0: 1.0, 1: 1.0}[int(t)]


@pytest.mark.parametrize(
    ("rhs", "match"),
    [
        (refusing, "raises ValueError: negative spring"),
        (asserting, "raises AssertionError: angle too large"),
        (looking_up, r"raises KeyError: 2 \(at t = 2"),
    ],
)
def test_first_exception_of_a_right_hand_side_ends_the_fit(swing, rhs, match, capfd):
    with pytest.raises(FitError, match=match):
        fit(swing, model(rhs, ANGLE, ("k",), ones("k", value=2.0)))
    assert capfd.readouterr().err == ""


def test_division_by_zero_is_no_exception_but_no_solution(swing):
    result = fit(swing, model(failing_later, ANGLE, ("k",), ones("k", value=15.0)))
    assert result.status == "diverged"


@pytest.mark.parametrize(
    ("guess", "match"),
    [
        (lambda trajectory: None, "guess of model 'own' must return numbers by name, e.g. {'k': 1.0}, not None"),
        (lambda trajectory: {"k": "much"}, "not {'k': 'much'}"),
        (lambda trajectory: [1.0], r"not \[1.0\]"),
        (lambda trajectory: {"stiffness": 1.0}, "guess: model 'own' has no parameter 'stiffness'; it has k"),
        (lambda trajectory: 1 / 0, "guess of model 'own' raises ZeroDivisionError"),
    ],
)
def test_guess_of_no_use_is_refused(swing, guess, match):
    with pytest.raises(FitError, match=match):
        fit(swing, model(own_frequency, ANGLE, ("k",), guess))
