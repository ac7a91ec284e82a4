"""Models from an equation in text and from a plain function: they fit what SciPy integrates."""

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.own_model.equation import quantities_of_equation
from iris_sysid import (
    MODELS,
    Quantity,
    Trajectory,
    fit,
    model_from_equation,
    model_from_function,
    simulate,
    with_effects,
)
from iris_sysid.errors import DataError, FitError

SWING = "theta'' = -g/L*sin(theta) - c*theta'"


def clip(rates, start, t_s, quantity, noise):
    truth = solve_ivp(rates, (t_s[0], t_s[-1]), start, "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    seen = (truth + noise * np.random.default_rng(0).standard_normal(t_s.size))[:, None]
    return Trajectory(t_s, (quantity,), seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool))


def pendulum(t, state):
    return [state[1], -9.81 / 0.5 * np.sin(state[0]) - 0.15 * state[1]]


@pytest.fixture(scope="module")
def swing():
    return clip(pendulum, [1.2, 0.3], np.arange(400) / 60, Quantity("theta", "rad"), 2e-3)


def assert_found(result, **truth):
    assert result.ok, result.message
    for name, value in truth.items():
        estimate = result.estimates[name]
        assert abs(estimate.value - value) < 4 * estimate.stderr, (name, estimate)


def test_pendulum_in_text_is_fitted_without_a_start(swing):
    model = model_from_equation(SWING, units={"theta": "rad", "L": "m", "g": "m/s^2"})
    result = fit(swing, model, fixed={"g": 9.81})
    assert_found(result, L=0.5, c=0.15, theta_0=1.2, theta_rate_0=0.3)
    assert result.estimates["L"].unit == "m"
    assert result.estimates["theta_rate_0"].unit == "rad/s"


def test_text_and_registered_model_give_the_same_fit(swing):
    mine = fit(swing, model_from_equation(SWING), fixed={"g": 9.80665})
    theirs = fit(swing, MODELS["pendulum"])
    assert mine.estimates["L"].value == pytest.approx(theirs.estimates["length"].value, rel=1e-6)
    assert mine.estimates["L"].stderr == pytest.approx(theirs.estimates["length"].stderr, rel=1e-2)


@pytest.mark.parametrize(
    ("text", "rates", "start", "seconds", "truth"),
    [
        ("x'' = m*(1-x^2)*x' - k*x", lambda t, s: [s[1], 1.7 * (1 - s[0] ** 2) * s[1] - 2.3 * s[0]], [1.2, 0.3], 20,
         {"m": 1.7, "k": 2.3}),
        ("x'' = a*x - b*x^3 - d*x' + F*cos(w*t)",
         lambda t, s: [s[1], 1.2 * s[0] - 0.9 * s[0] ** 3 - 0.1 * s[1] + 0.3 * np.cos(1.4 * t)], [1.2, 0.3], 20,
         {"a": 1.2, "b": 0.9, "d": 0.1, "F": 0.3, "w": 1.4}),
        ("x' = -k*sqrt(x - hole)", lambda t, s: [-0.3 * np.sqrt(max(s[0] - 0.4, 0))], [2.5], 8,
         {"k": 0.3, "hole": 0.4}),
        ("x'' = -w0^2*x - f*sign(x')", lambda t, s: [s[1], -9 * s[0] - 0.2 * np.sign(s[1])], [1.2, 0.0], 8,
         {"w0": 3.0, "f": 0.2}),
    ],
)  # fmt: skip
def test_equations_in_text_are_fitted_without_a_start(text, rates, start, seconds, truth):
    t_s = np.arange(seconds * 25) / 25
    assert_found(fit(clip(rates, start, t_s, Quantity("x", "m"), 5e-3), model_from_equation(text)), **truth)


def test_parameter_of_any_size_is_fitted_without_a_start():
    """Radiation (Stefan 1879) in SI units: the rate is linear in a coefficient of 1e-11, which is solved for."""
    cooling = lambda t, y: [-1.2e-11 * (y[0] ** 4 - 293.0**4)]  # noqa: E731
    hot = clip(cooling, [900.0], np.arange(0.0, 1800.0, 5.0), Quantity("T", "K"), 0.5)
    assert_found(fit(hot, model_from_equation("T' = -k*(T^4 - Te^4)")), k=1.2e-11, Te=293.0)


def test_hidden_state_is_fitted_without_a_start():
    def tanks(t, levels):
        first, second = np.sqrt(np.maximum(levels, 0))
        return [0.3 - 0.2 * first, 0.2 * first - 0.25 * second]

    t_s = np.arange(300) / 5
    below = solve_ivp(tanks, (0, 60), [0.5, 0.2], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[1]
    seen = (below + 2e-3 * np.random.default_rng(1).standard_normal(300))[:, None]
    clip = Trajectory(t_s, (Quantity("y", "V"),), seen, np.full_like(seen, np.nan), np.ones(300, bool))
    text = "x' = q - a*sqrt(max(x, 0)); y' = a*sqrt(max(x, 0)) - b*sqrt(max(y, 0))"
    model = model_from_equation(text, observed=["y"], bounds={"q": (0, 10), "a": (0, 10), "b": (0, 10)})
    assert_found(fit(clip, model, start={"x_0": 1.0}), q=0.3, a=0.2, b=0.25)


def test_input_is_what_is_named_u():
    t_s = np.arange(400) / 20
    push = np.sin(1.3 * t_s)[:, None]
    force = lambda t, s: [s[1], -4 * s[0] - 0.3 * s[1] + 0.7 * np.sin(1.3 * t)]  # noqa: E731
    plain = clip(force, [0.0, 0.0], t_s, Quantity("x", "m"), 1e-3)
    pushed = plain.with_(input_quantities=(Quantity("u", "V"),), inputs=push)
    assert_found(fit(pushed, model_from_equation("x'' = -k*x - c*x' + b*u")), k=4.0, c=0.3, b=0.7)


LATE = "x'' = -k*x - c*x' + b*u(t - tau)"


def held_steps(t, seed=1):
    """An input that changes at every quarter of a second, also before the record."""
    levels = np.random.default_rng(seed).standard_normal(60)
    return levels[np.clip(np.floor(np.asarray(t) / 0.25 + 1e-9), 0, 59).astype(int)]


def waves(t):
    """An input that goes on smoothly, and stood still before the record."""
    t = np.maximum(t, 0.0)
    return np.sin(1.7 * t) + 0.6 * np.sin(4.1 * t + 1.0) + 0.4 * np.sin(9.3 * t)


def late_record(given, hold, tau):
    """x'' = -16 x - 0.8 x' + 3 u(t - tau), integrated with small steps, and the input as it was given."""
    t_s = np.arange(1500) / 100
    rates = lambda t, s: [s[1], -16 * s[0] - 0.8 * s[1] + 3 * float(given(t - tau))]  # noqa: E731
    truth = solve_ivp(rates, (0, t_s[-1]), [0.1, 0.0], "DOP853", t_s, rtol=1e-9, atol=1e-10, max_step=5e-3).y[0]
    seen = (truth + 2e-3 * np.random.default_rng(2).standard_normal(t_s.size))[:, None]
    plain = Trajectory(t_s, (Quantity("x", "m"),), seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool))
    return plain.with_(input_quantities=(Quantity("u", "V"),), inputs=given(t_s)[:, None], hold=hold)


@pytest.mark.parametrize("tau", [0.037, 0.8])
@pytest.mark.parametrize(("given", "hold"), [(held_steps, "zero-order"), (waves, "linear")])
def test_delay_of_an_input_is_a_parameter_with_an_interval(given, hold, tau):
    found = fit(late_record(given, hold, tau), model_from_equation(LATE, units={"u": "V"}))
    assert_found(found, k=16.0, c=0.8, b=3.0, tau=tau)
    delay = found.estimates["tau"]
    assert (delay.unit, found.model.parameter("tau").lower) == ("s", 0.0)
    assert 0 < delay.stderr < 5e-4


def test_delay_in_the_text_is_the_effect_of_that_name():
    record, plain = late_record(waves, "linear", 0.21), model_from_equation("x'' = -k*x - c*x' + b*u")
    values = {"k": 16.0, "c": 0.8, "b": 3.0, "x_0": 0.1, "x_rate_0": 0.0}
    given = {"inputs": record.inputs, "hold": "linear"}
    late = pickle.loads(pickle.dumps(model_from_equation(LATE)))
    effect = simulate(with_effects(plain, ["input-delay"]), record.t_s, {**values, "input_delay": 0.21}, **given)
    assert np.allclose(simulate(late, record.t_s, {**values, "tau": 0.21}, **given).observed, effect.observed)
    stated = model_from_equation(LATE.replace("tau", "0.21"))
    assert np.allclose(simulate(stated, record.t_s, values, **given).observed, effect.observed)
    assert r"u\left(t - \tau\right)" in late.equation
    now = model_from_equation("x'' = -k*x - c*x' + b*u(t)")
    assert now.drive is None
    here, there = (simulate(model, record.t_s, values, **given).observed for model in (now, plain))
    assert np.array_equal(here, there)


def test_what_stands_alone_under_a_root_or_in_a_logarithm_is_above_zero():
    model = model_from_equation("x'' = -sqrt(k)*x - log(m)*x' + sqrt(x - a)")
    assert {p.name: p.lower for p in model.parameters} == {"k": 0.0, "m": 0.0, "a": -np.inf}


def test_bounds_are_kept():
    model = model_from_equation(SWING, bounds={"L": (0.1, 10.0)})
    assert (model.parameter("L").lower, model.parameter("L").upper) == (0.1, 10.0)
    with pytest.raises(DataError, match="bounds: the equation has no 'length'; it has g, L, c"):
        model_from_equation(SWING, bounds={"length": (0.1, 10.0)})
    with pytest.raises(DataError, match="the bounds of L must be a smaller and a larger number, not 2 and 1"):
        model_from_equation(SWING, bounds={"L": (2.0, 1.0)})


def test_equation_takes_effects_and_is_pickled(swing):
    model = model_from_equation(SWING, units={"theta": "rad"})
    dragged = pickle.loads(pickle.dumps(with_effects(model, ["quadratic-drag"])))
    values = {"g": 9.81, "L": 0.5, "c": 0.1, "theta_0": 1.0, "theta_rate_0": 0.0}
    free, slowed = (simulate(dragged, [0.0, 1.0, 2.0], {**values, "quadratic_drag": b}).observed for b in (0.0, 0.2))
    assert np.allclose(free, simulate(model, [0.0, 1.0, 2.0], values).observed)
    assert not np.allclose(free, slowed)


def test_powers_bind_as_in_mathematics():
    model = model_from_equation("x' = -a^2 + 2*b**-1 - a/b/2 - -a*(a - b - 1)^2^1")
    a, b = 3.0, 4.0
    assert model.rhs(0.0, (1.0,), (a, b)) == pytest.approx((-(a**2) + 2 / b - a / b / 2 + a * (a - b - 1) ** 2,))


@pytest.mark.parametrize(
    ("text", "column", "reason"),
    [
        ("", 1, "there is no equation"),
        ("theta'' = -g/L sin(theta)", 16, "an operator is missing before sin"),
        ("theta'' = 2theta", 12, "an operator is missing before theta"),
        ("theta'' = -g*(theta", 14, "this bracket is not closed"),
        ("theta'' = -g*theta)", 19, r"\) is not expected here"),
        ("theta'' = -9,81*theta", 13, ", is not expected here"),
        ("theta'' = sine(theta)", 11, "there is no function sine; there are sin, cos"),
        ("theta'' = sin", 11, "sin is a function"),
        ("theta''' = 1", 1, "first or second order"),
        ("2*x' = 1", 2, "an equation is written as"),
        ("x'' = -x''", 8, "x'' must not stand on the right"),
        ("x'' = -y'", 8, "no equation gives one of y"),
        ("x'' = -x; x' = 2", 11, "x has an equation already"),
        ("t' = 1", 1, "t has another meaning"),
        ("x'' = __import__('os').system('true')", 7, "__import__ cannot name anything here"),
        ("x'' = x.__class__", 9, "__class__ cannot name anything here"),
        ("x'' = [x][0]", 7, r"a number, a name or \( is expected here, not \["),
        ("x'' = lambda", 7, "lambda cannot name anything here"),
        ("x'' = 1e999", 7, "the number is too large"),
        ("x'' = " + "9" * 400, 7, "the number is too large"),
        ("x'' = " + "(" * 5000, 1001, "longer than 1000 characters"),
        ("x'' = " + "(" * 400 + "x" + ")" * 400, 37, "more than 30 brackets or powers"),
        ("x'' = " + "-" * 400 + "x", 256, "more than 150 operations"),
        ("x'' = x" + "^x" * 400, 67, "more than 30 brackets or powers"),
        ("x'' = x" + "+x" * 400, 308, "more than 150 operations"),
        ("x'' = " + "x" * 41, 7, "the name is longer than 40 letters"),
        ("x\x00'' = 1", 2, "an equation is written as"),
        ("x' = u(x)", 8, r"u is an input: write u, or u\(t - tau\)"),
        ("x' = u(t + tau)", 10, r"\+ is not expected here"),
        ("x' = u(t - 2*tau)", 13, r"\* is not expected here"),
        ("x' = u(t - (a + b))", 6, "a delay is one number or one name"),
        ("x' = u(t - x)", 12, "a delay is a parameter or a number"),
        ("x' = u(t - a) + u", 17, "u has one delay wherever it stands"),
        ("x' = u(t - a) + u(t - b)", 17, "u has one delay wherever it stands"),
    ],
)
def test_text_that_is_no_equation_is_refused_with_its_column(text, column, reason):
    with pytest.raises(DataError, match=rf"column {column} \(at .*\): .*{reason}"):
        model_from_equation(text)


def test_parameter_named_like_an_initial_value_is_refused():
    with pytest.raises(DataError, match="x_0 is the name of a state or its initial value"):
        model_from_equation("x' = x_0")


def test_left_sides_name_the_quantities():
    assert quantities_of_equation("x'' = -k*x; y' = -y") == ("x", "y")


def swinging(t, y, length, damping=0.1):
    """A pendulum as solve_ivp takes it."""
    theta, omega = y
    return [omega, -9.81 / length * np.sin(theta) - damping * omega]


def test_plain_function_is_fitted_and_its_parameters_are_its_arguments(swing):
    model = model_from_function(
        swinging, ["theta", "omega"], units={"theta": "rad", "omega": "rad/s"}, bounds={"length": (0.01, 100)}
    )
    assert [parameter.name for parameter in model.parameters] == ["length", "damping"]
    assert (model.name, model.summary) == ("swinging", "A pendulum as solve_ivp takes it.")
    assert_found(fit(swing, pickle.loads(pickle.dumps(model))), length=0.5, damping=0.15, theta_0=1.2, omega_0=0.3)


def test_argument_of_a_plain_function_may_be_an_input():
    model = model_from_function(lambda t, y, k, voltage: [-k * y[0] + voltage], ["level"], inputs=["voltage"])
    assert [quantity.name for quantity in model.inputs] == ["voltage"]
    levels = simulate(model, [0.0, 1.0, 2.0], {"k": 1.0, "level_0": 0.0}, inputs=[[1.0]] * 3).observed[:, 0]
    assert levels == pytest.approx(1 - np.exp(-np.arange(3.0)), abs=1e-9)


@pytest.mark.parametrize(
    ("function", "match"),
    [
        (lambda y: y, r"f\(t, y, a, b, ...\)"),
        (lambda t, y, *params: y, "name its parameters one by one"),
        (lambda t, y, **params: y, "name its parameters one by one"),
    ],
)
def test_function_whose_parameters_have_no_names_is_refused(function, match):
    with pytest.raises(DataError, match=match):
        model_from_function(function, ["y"])


@pytest.mark.parametrize("given", [{"inputs": ["u"]}, {"bounds": {"u": (0, 1)}}, {"observed": ["u"]}])
def test_names_that_the_function_lacks_are_refused(given):
    with pytest.raises(DataError, match=f"{next(iter(given))}: the function has no 'u'"):
        model_from_function(swinging, ["theta", "omega"], **given)


def test_only_fitting_quantity_is_taken_and_what_is_not_used_is_said():
    t_s = np.arange(200) / 60
    z = 0.1 * np.cos(9 * t_s) + 1e-4 * np.random.default_rng(0).standard_normal(200)
    named = Trajectory(t_s, (Quantity("x", "m"),), z[:, None], np.full((200, 1), np.nan), np.ones(200, bool))
    result = fit(named, "linear-oscillator")
    assert result.estimates["stiffness"].value == pytest.approx(81, abs=0.5)
    assert "z of the model linear-oscillator = x" in result.notes
    beside = (Quantity("x", "m"), Quantity("z", "m"))
    both = Trajectory(t_s, beside, np.stack([t_s, z], axis=1), np.full((200, 2), np.nan), np.ones(200, bool))
    assert "x is not observed by the model linear-oscillator: not used" in fit(both, "linear-oscillator").notes
    two = both.with_(quantities=(Quantity("x", "m"), Quantity("y", "m")))
    with pytest.raises(FitError, match="observes z, but the trajectory has x, y"):
        fit(two, "linear-oscillator")
