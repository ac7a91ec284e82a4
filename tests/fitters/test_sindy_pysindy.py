"""A discovery is a model of pysindy as well, and takes the feature libraries and the optimizers of pysindy."""

import copy
import pickle

import numpy as np
import pysindy
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import simulate
from fitters.sindy import discover
from fitters.sindy.as_pysindy import to_pysindy
from fitters.sindy.given_library import with_features
from fitters.sindy.library import evaluated, library_of
from iris_sysid.errors import DataError, FitError
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


# --------------------------------------------------------------------------- a library of pysindy in a discovery

POLYNOMIALS = pysindy.PolynomialLibrary(degree=3)
CHIRP = pysindy.CustomLibrary([lambda x: np.exp(x), lambda x, y: x * np.abs(y)], include_bias=True)


def selected(discovery):
    return {term.term for term in discovery.selected}


@pytest.mark.parametrize(
    "library",
    [
        POLYNOMIALS,
        pysindy.IdentityLibrary(),
        pysindy.FourierLibrary(n_frequencies=2),
        pysindy.FourierLibrary(include_cos=False),
        CHIRP,
        pysindy.CustomLibrary([lambda x, y: x * y], interaction_only=False),
        POLYNOMIALS + pysindy.FourierLibrary() + CHIRP,
        pysindy.IdentityLibrary() * pysindy.FourierLibrary(n_frequencies=2),
        pysindy.GeneralizedLibrary(
            [POLYNOMIALS, pysindy.FourierLibrary()], tensor_array=[[1, 1]], inputs_per_library=[[0, 1], [2]]
        ),
    ],
)
def test_features_have_the_values_that_pysindy_gives_them(library):
    x = np.random.default_rng(1).uniform(0.2, 1.2, (20, 3))
    theirs = np.asarray(copy.deepcopy(library).fit(x).transform(x))
    made = with_features(library_of((THETA,), (PUSH,)), library)
    ours = evaluated(made, x[:, :1], x[:, 1:2], x[:, 2:])
    assert ours.shape[1] <= theirs.shape[1]
    for column in theirs.T:
        assert np.min(np.max(np.abs(ours - column[:, None]), axis=0)) < 1e-12
    texts = [term.text for term in made.terms]
    assert len(set(texts)) == len(set(made.names)) == len(texts)


def test_pendulum_in_a_library_of_pysindy_is_named_with_its_length(swing):
    library = pysindy.PolynomialLibrary(degree=2) + pysindy.FourierLibrary(n_frequencies=1)
    discovery = discover(swing, library=library, resampled=10)
    assert selected(discovery) == {"sin(theta)", "theta'"}
    assert discovery.matched.model == "pendulum"
    assert discovery.matched.parameters["length"].value == pytest.approx(9.80665 / 19.6, rel=5e-3)


def test_feature_that_our_library_lacks_is_found_with_its_interval_and_unit():
    def van_der_pol(t, s):
        return [s[1], -20.0 * s[0] + 1.5 * s[1] - 60.0 * s[0] ** 2 * s[1]]

    data = clip(van_der_pol, [0.05, 0.0], Z, noise=2e-4)
    discovery = discover(data, library=POLYNOMIALS, resampled=10)
    assert selected(discovery) == {"z", "z'", "z^2 z'"}
    values = {term.term: term.coefficient for term in discovery.selected}
    for name, truth in {"z": -20.0, "z'": 1.5, "z^2 z'": -60.0}.items():
        assert abs(values[name].value - truth) < 4 * values[name].stderr < 0.1 * abs(truth)
    assert values["z^2 z'"].unit == "1/m^2/s"
    assert discovery.matched is None
    again = pickle.loads(pickle.dumps(discovery))
    ours = simulate(again, T_S).states
    assert np.array_equal(ours, simulate(discovery, T_S).states)
    made = to_pysindy(discovery)
    assert set(made.get_feature_names()) == {"z", "d_z", "z^2 d_z"}
    assert made.simulate(ours[0], T_S) == pytest.approx(ours, abs=1e-5)


def test_product_with_an_input_is_found():
    u = np.sign(np.sin(2.3 * T_S))

    def pumped(t, s):
        return [s[1], -15.0 * s[0] - 5.0 * np.interp(t, T_S, u) * s[0]]

    data = clip(pumped, [0.2, 0.0], Z, input_quantities=(PUSH,), inputs=u[:, None])
    discovery = discover(data, library=pysindy.PolynomialLibrary(degree=2, interaction_only=True), resampled=10)
    assert selected(discovery) == {"z", "z u"}
    (term,) = (term for term in discovery.selected if term.term == "z u")
    assert term.coefficient.value == pytest.approx(-5.0, rel=0.01)
    assert term.coefficient.unit == "1/s^2/V"


def test_function_of_the_user_that_is_one_of_ours_has_its_name_and_effect():
    drag = pysindy.CustomLibrary([lambda v: np.abs(v) * v], [lambda name: f"abs({name}) {name}"])
    data = clip(lambda t, s: [s[1], -20.0 * s[0] - 0.8 * np.abs(s[1]) * s[1]], [0.4, 0.0], Z, noise=4e-4)
    discovery = discover(data, library=pysindy.IdentityLibrary() + drag, resampled=10)
    assert selected(discovery) == {"z", "|z'| z'"}
    assert {term.effect for term in discovery.selected} == {"", "quadratic-drag"}


@pytest.mark.parametrize(
    "library", [pysindy.PDELibrary(derivative_order=1, spatial_grid=np.arange(4.0)), "polynomials", object()]
)
def test_library_that_cannot_be_integrated_is_refused(swing, library):
    with pytest.raises(DataError, match=r"can be integrated; give PolynomialLibrary, FourierLibrary"):
        discover(swing, library=library)


def test_feature_without_a_value_in_the_motion_is_named(swing):
    logarithm = pysindy.CustomLibrary([lambda x: np.log(x)], [lambda name: f"log({name})"])
    with pytest.raises(DataError, match=r"log\(theta\), log\(theta'\): not a finite number"):
        discover(swing, library=pysindy.IdentityLibrary() + logarithm)


def test_library_without_any_feature_is_refused(swing):
    with pytest.raises(DataError, match="no feature of theta, theta'"):
        discover(swing, library=pysindy.CustomLibrary([lambda a, b, c: a * b * c]))


def test_library_without_a_term_of_the_model_cannot_explain_its_residual(swing):
    with pytest.raises(FitError, match="lacks a term of 'pendulum'"):
        discover(swing, library=pysindy.IdentityLibrary(), residual_of="pendulum")


# --------------------------------------------------------------------------- an optimizer of pysindy in a discovery


@pytest.mark.parametrize(
    "optimizer",
    [
        pysindy.STLSQ(threshold=0.1),
        pysindy.SR3(reg_weight_lam=0.01),
        pysindy.SSR(),
        pysindy.EnsembleOptimizer(pysindy.STLSQ(threshold=0.1), bagging=True, n_models=5),
    ],
)
def test_optimizer_proposes_and_the_fit_decides(swing, optimizer):
    before = copy.deepcopy(vars(optimizer))
    first, second = (discover(swing, optimizer=optimizer, resampled=5) for _ in range(2))
    assert selected(first) == {"sin(theta)", "theta'"}
    assert first.proposed == second.proposed
    assert vars(optimizer).keys() == before.keys()


def test_proposal_is_that_of_the_optimizer_and_the_fit_puts_back_what_it_lacks(swing):
    small, large = (discover(swing, optimizer=pysindy.STLSQ(threshold=t), resampled=5) for t in (0.05, 5.0))
    assert "theta_rate" in small.proposed
    assert "theta_rate" not in large.proposed  # its coefficient of 0.2 is below the threshold
    assert "theta_sin" in large.proposed
    assert selected(small) == selected(large) == {"sin(theta)", "theta'"}


@pytest.mark.parametrize("optimizer", ["STLSQ", pysindy.STLSQ])
def test_what_is_no_optimizer_is_refused(swing, optimizer):
    with pytest.raises(DataError, match="give an optimizer of pysindy"):
        discover(swing, optimizer=optimizer)


def test_optimizer_with_constraints_is_refused(swing):
    optimizer = pysindy.STLSQ()
    optimizer.constraint_lhs = np.eye(2)
    with pytest.raises(DataError, match="constraints between coefficients"):
        discover(swing, optimizer=optimizer)
