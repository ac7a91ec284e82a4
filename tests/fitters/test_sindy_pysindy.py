"""A discovery is a model of pysindy as well, and takes the feature libraries and the optimizers of pysindy."""

import copy
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import simulate
from fitters.sindy import discover
from fitters.sindy.as_pysindy import to_pysindy
from iris_sysid.types import Quantity, Trajectory

T_S = np.arange(300) / 60
THETA, Z, X, PUSH = Quantity("theta", "rad"), Quantity("z", "m"), Quantity("x", "m"), Quantity("u", "V")


def clip(slopes, start, *quantities, noise=1e-4, t_s=T_S, **more):
    """A motion integrated by SciPy, with white noise on the first of its states."""
    states = solve_ivp(slopes, (t_s[0], t_s[-1]), start, "DOP853", t_s, rtol=1e-10, atol=1e-12).y.T
    seen = states[:, : len(quantities)]
    seen = seen + noise * np.random.default_rng(0).standard_normal(seen.shape)
    return Trajectory(t_s, quantities, seen, np.full_like(seen, np.nan), np.ones(len(t_s), bool), **more)


def pendulum(t, s):
    return [s[1], -19.6 * np.sin(s[0]) - 0.2 * s[1]]


@pytest.fixture(scope="module")
def swing():
    return clip(pendulum, [1.0, 0.0], THETA, noise=1e-3)


@pytest.fixture(scope="module")
def found(swing):
    return discover(swing, resampled=10)


# --------------------------------------------------------------------------- a discovery in pysindy


def test_pysindy_has_the_coefficients_and_names_of_the_discovery(found):
    made = to_pysindy(found)
    assert made.feature_names == ["theta", "d_theta"]
    assert made.get_feature_names() == ["d_theta", "sin(theta)"]
    values = {term.term: term.coefficient.value for term in found.selected}
    assert made.coefficients().tolist() == [[1.0, 0.0], [values["theta'"], values["sin(theta)"]]]
    assert made.equations()[0] == " 1.000 d_theta"


def test_pysindy_moves_scores_and_predicts_as_the_discovery_does(found):
    made, ours = to_pysindy(found), simulate(found, T_S).states
    assert made.simulate(ours[0], T_S) == pytest.approx(ours, abs=1e-6)
    assert made.score(ours, T_S) > 0.999
    slopes = np.array([pendulum(0.0, state) for state in ours])
    assert np.asarray(made.predict(ours)) == pytest.approx(slopes, abs=0.05)


def test_pysindy_takes_the_inputs_of_the_discovery():
    def push(t):
        return np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t)

    def driven(t, s):
        return [s[1], -15.0 * s[0] - 0.6 * s[1] + 2.0 * push(t)]

    data = clip(driven, [0.1, 0.0], Z, input_quantities=(PUSH,), inputs=push(T_S)[:, None])
    discovery = discover(data, resampled=10)
    made, ours = to_pysindy(discovery), simulate(discovery, T_S, inputs=push(T_S)[:, None]).states
    assert made.feature_names == ["z", "d_z", "u"]
    assert set(made.get_feature_names()) == {"z", "d_z", "u"}
    moved = made.simulate(ours[0], T_S, u=lambda t: np.array([push(t)]))
    assert moved == pytest.approx(ours, abs=2e-4)  # ours joins the samples of the input by lines
    assert made.score(ours, T_S, u=push(T_S)[:, None]) > 0.999


def test_terms_of_two_equations_share_a_feature():
    data = clip(lambda t, s: [s[2], s[3], -0.5, -9.8], [0.0, 0.0, 1.0, 4.0], X, Z, t_s=T_S[:60])
    discovery = discover(data, resampled=10)
    made, ours = to_pysindy(discovery), simulate(discovery, T_S[:60]).states
    assert made.get_feature_names().count("1") == 1
    assert made.simulate(ours[0], T_S[:60]) == pytest.approx(ours, abs=1e-6)


def test_equation_of_first_order_has_no_rates():
    t_s = np.arange(300) / 15
    data = clip(lambda t, h: -0.02 * np.sqrt(np.maximum(h, 0)), [0.3], Quantity("h", "m"), t_s=t_s)
    discovery = discover(data, resampled=10)
    made, ours = to_pysindy(discovery), simulate(discovery, t_s).states
    assert made.feature_names == ["h"]
    assert made.simulate(ours[0], t_s) == pytest.approx(ours, abs=1e-6)


def test_model_of_pysindy_is_copied_pickled_and_fitted_again(found, swing):
    made, ours = to_pysindy(found), simulate(found, T_S).states
    for other in (copy.deepcopy(made), pickle.loads(pickle.dumps(made))):
        assert np.array_equal(other.predict(ours), made.predict(ours))
    slopes = np.array([pendulum(0.0, state) for state in ours])
    assert made.fit(ours, T_S, x_dot=slopes).coefficients()[1] == pytest.approx([-0.2, -19.6], abs=1e-6)
