"""Error bars: against closed forms, brute force and repeated experiments."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from fitters.noise.autoregression import (
    autocovariance,
    burg,
    coefficients_of,
    fit_autoregression,
    grid_positions,
    whiten,
)
from fitters.noise.measurement_noise import (
    noise_from_differences,
    normalised_difference,
    outliers_in_motion,
    outliers_in_residual,
)
from fitters.noise.sandwich_covariance import (
    _all_pole_filter,
    inverse_normal,
    middle,
    orthonormal_basis,
    quantile_975,
    random_uncertainty,
)
from fitters.ode import fit, simulate
from fitters.ode.status import determination, is_misfit, null_direction_text
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate
from tests._experiments import EXPERIMENTS, NOISE, clip, correlated, repeated

# --------------------------------------------------------------------------- repeated experiments


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_intervals_of_a_pendulum_cover_in_a_quick_check(rho):
    errors, stderrs, hits, _ = repeated("pendulum", rho, range(40))
    assert 0.89 < hits.mean() < 0.99
    np.testing.assert_allclose(errors.std(axis=0) / stderrs.mean(axis=0), 1.0, atol=0.35)


def test_errors_with_correlated_noise_are_several_times_those_of_plain_least_squares():
    _, stderrs, _, bound = repeated("pendulum", 0.9, range(10))
    assert np.all(stderrs.mean(axis=0) > 2.5 * bound)


def test_coverage_survives_gaps():
    model, hits = MODELS["pendulum"], []
    values, _ = EXPERIMENTS["pendulum"]
    for seed in range(30):
        rng = np.random.default_rng(seed)
        whole = clip(model, NOISE * correlated(rng, (600, 1), 0.9))
        valid = rng.random(600) > 0.1
        valid[200:260] = False
        result = fit(whole.with_(valid=valid), model)
        low, high = result.estimates["length"].interval
        hits.append(low <= values["length"] <= high)
    assert np.mean(hits) >= 0.85


# --------------------------------------------------------------------------- the sandwich


def wave_columns(n=200):
    t = np.arange(n) / 20
    return np.column_stack([np.sin(t), t * np.cos(t), np.ones(n)])


@pytest.mark.parametrize("partial", [[0.9], [0.5, -0.6], [0.3, 0.2, -0.4]])
def test_middle_of_the_sandwich_equals_the_matrix_product(partial):
    partial, columns = np.array(partial), wave_columns()
    gamma = toeplitz(autocovariance(partial, 200))
    np.testing.assert_allclose(middle(columns, coefficients_of(partial)[-1]), columns.T @ gamma @ columns, rtol=1e-4)


def test_random_uncertainty_of_white_noise_is_that_of_least_squares():
    columns, rng = wave_columns(), np.random.default_rng(0)
    residual = rng.standard_normal((200, 1))
    residual -= columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    bread = inverse_normal(columns)
    uncertainty = random_uncertainty(np.arange(200.0), residual, columns[:, None, :], bread)
    variance = float(residual[:, 0] @ residual[:, 0]) / 197
    np.testing.assert_allclose(uncertainty.covariance, variance * np.linalg.inv(columns.T @ columns), rtol=1e-8)
    np.testing.assert_allclose(uncertainty.degrees, 197)


def test_lost_frames_keep_their_position_in_the_noise():
    t_s = np.array([0.0, 1.0, 2.0, 5.0, 6.0]) / 60
    assert grid_positions(t_s).tolist() == [0, 1, 2, 5, 6]
    assert grid_positions(np.array([0.0, 0.1, 1e6]))[-1] < 1e4


def test_inverse_normal_leaves_out_what_is_not_determined():
    columns = wave_columns()
    doubled = np.column_stack([columns, columns[:, 0] * 5])
    np.testing.assert_allclose(
        np.diag(inverse_normal(doubled, 1e-6))[1:3], np.diag(inverse_normal(columns))[1:3], rtol=1e-6
    )


def test_orthonormal_basis_has_the_rank_of_the_columns():
    columns = wave_columns()
    assert orthonormal_basis(np.column_stack([columns, columns[:, 0] * 5, np.zeros(200)])).shape == (200, 3)


def test_quantile_is_students_and_ends_at_the_normal():
    assert quantile_975(5.0) == pytest.approx(2.5706, abs=1e-4)
    assert quantile_975(np.inf) == pytest.approx(1.959964, abs=1e-5)


# --------------------------------------------------------------------------- autoregressions


def test_autocovariance_of_first_order_is_geometric():
    np.testing.assert_allclose(autocovariance(np.array([0.8]), 4), 0.8 ** np.arange(4) / (1 - 0.64), rtol=1e-12)


def test_autocovariance_solves_the_yule_walker_equations():
    partial = np.array([0.5, -0.6, 0.2])
    gamma, coefficients = autocovariance(partial, 7), coefficients_of(partial)[-1]
    for lag in range(1, 7):
        expected = sum(coefficients[k] * gamma[abs(lag - 1 - k)] for k in range(3))
        assert gamma[lag] == pytest.approx(expected)


def test_burg_finds_the_coefficients_of_a_long_series():
    series = lfilter([1.0], [1.0, -0.9, 0.5], np.random.default_rng(0).standard_normal(50_000))
    partial, variance = burg(series, 4)
    np.testing.assert_allclose(coefficients_of(partial[:2])[-1], [0.9, -0.5], atol=0.02)
    assert variance[2] == pytest.approx(1.0, abs=0.03)


def test_order_of_white_noise_is_mostly_zero():
    orders = [
        fit_autoregression(np.random.default_rng(seed).standard_normal(300), np.zeros((300, 0))).partial.size
        for seed in range(40)
    ]
    assert np.mean(np.array(orders) == 0) > 0.9


def test_restricted_likelihood_removes_most_of_the_bias_from_fitted_parameters():
    plain, restricted = [], []
    basis = orthonormal_basis(np.vander(np.linspace(-1, 1, 120), 5))
    for seed in range(150):
        noise = correlated(np.random.default_rng(seed), (120,), 0.9)
        residual = noise - basis @ (basis.T @ noise)
        plain.append(burg(residual, 1)[0][0])
        partial = fit_autoregression(residual, basis).partial
        restricted.append(partial[0] if partial.size else 0.0)
    assert 0.9 - np.mean(plain) > 0.1
    assert abs(0.9 - np.mean(restricted)) < 0.04


def test_whitening_gives_unit_noise_after_gaps_too():
    series = 3.0 * correlated(np.random.default_rng(0), (20_000,), 0.95)
    series[np.random.default_rng(1).random(20_000) < 0.05] = np.nan
    white, variances = whiten(series[:, None], np.array([0.95]))
    innovation = 3.0 * np.sqrt(1 - 0.95**2)
    assert white.std() / innovation == pytest.approx(1.0, abs=0.03)
    assert white[variances > 1].std() / innovation == pytest.approx(1.0, abs=0.1)


# --------------------------------------------------------------------------- noise without a model


@pytest.mark.parametrize("fps", [10, 60, 240])
def test_noise_is_found_whatever_the_frame_rate(fps):
    t_s = np.arange(int(20 * fps)) / fps
    theta = simulate(MODELS["pendulum"], t_s, EXPERIMENTS["pendulum"][0]).observed[:, 0]
    noisy = theta + NOISE * np.random.default_rng(0).standard_normal(t_s.size)
    assert noise_from_differences(t_s, noisy) == pytest.approx(NOISE, rel=0.25)


def test_noise_of_uneven_times_is_found():
    rng = np.random.default_rng(0)
    t_s = np.cumsum(rng.choice([0.008, 0.017, 0.033], 2000))
    assert noise_from_differences(t_s, np.sin(3 * t_s) + NOISE * rng.standard_normal(2000)) == pytest.approx(
        NOISE, rel=0.1
    )


def test_noise_is_unmoved_by_outliers_and_unknown_for_a_few():
    rng = np.random.default_rng(0)
    values = NOISE * rng.standard_normal(1000)
    values[::100] += 5.0
    assert noise_from_differences(np.arange(1000.0), values) == pytest.approx(NOISE, rel=0.15)
    assert np.isnan(noise_from_differences(np.arange(7.0), values[:7]))


def test_difference_of_order_m_removes_polynomials_of_lower_degree_at_uneven_times():
    t_s = np.cumsum(np.random.default_rng(0).uniform(0.5, 2.0, 30))
    for order in range(2, 7):
        difference = normalised_difference(t_s, t_s ** (order - 1), order)
        assert np.abs(difference).max() < 1e-9 * np.abs(t_s ** (order - 1)).max()


def test_outliers_in_motion_marks_gross_errors_at_the_ends_and_in_pairs_but_no_kink():
    t_s = np.arange(400) / 60
    values = np.abs(np.sin(2 * t_s)) + 1e-3 * np.random.default_rng(0).standard_normal(400)
    values[[0, 100, 101, 399]] += 1.0
    assert np.flatnonzero(outliers_in_motion(t_s, values[:, None])).tolist() == [0, 100, 101, 399]


def test_outliers_in_residual_marks_what_stands_alone_but_no_slow_misfit():
    rng = np.random.default_rng(0)
    residual = rng.standard_normal((500, 1)) + 40.0 * np.sin(np.arange(500) / 80)[:, None]
    assert not outliers_in_residual(residual, 3.0).any()
    residual[250] += 30.0
    assert np.flatnonzero(outliers_in_residual(residual, 3.0)).tolist() == [250]


def test_where_noise_has_tails_only_what_stands_out_of_the_data_is_an_outlier():
    residual = np.random.default_rng(0).standard_cauchy((500, 1))
    spikes = np.zeros(500, dtype=bool)
    spikes[[100, 250]] = True
    residual[[100, 250]] = [[0.5], [60.0]]
    assert not outliers_in_residual(residual, 3.0).any()
    assert np.flatnonzero(outliers_in_residual(residual, 3.0, spikes)).tolist() == [250]


# --------------------------------------------------------------------------- systematic errors


def test_error_of_gravity_goes_into_the_length_in_proportion():
    model = MODELS["pendulum"]
    exact = clip(model, NOISE * np.random.default_rng(0).standard_normal((600, 1)))
    gravity = Estimate(9.80665, 0.05, "m/s^2", "direct")
    result = fit(exact, model, fixed={"gravity": gravity})
    length = result.estimates["length"]
    assert result.budget["length"]["gravity"] == pytest.approx(length.value * 0.05 / 9.80665, rel=1e-4)
    assert length.stderr == pytest.approx(np.hypot(*result.budget["length"].values()))
    assert result.budget["damping"]["gravity"] < 1e-3 * result.budget["damping"]["random"]
    assert np.sqrt(result.covariance[0, 0]) == pytest.approx(result.budget["length"]["random"])


def test_propagated_error_equals_the_change_of_a_refit():
    model = MODELS["projectile"]
    data = clip(model, NOISE * np.random.default_rng(0).standard_normal((300, 2)))
    result = fit(data, model, fixed={"gravity": Estimate(9.8, 0.02, "m/s^2")})
    moved = fit(data, model, fixed={"gravity": 9.82})
    for name in ("vz_0", "launch_speed", "launch_angle"):
        change = abs(moved.estimates[name].value - result.estimates[name].value)
        assert result.budget[name]["gravity"] == pytest.approx(change, rel=0.02), name


def test_derived_error_equals_the_scatter_of_the_derived_value():
    model, speeds, stderrs = MODELS["projectile"], [], []
    for seed in range(50):
        result = fit(clip(model, NOISE * np.random.default_rng(seed).standard_normal((300, 2))), model)
        speeds.append(result.estimates["launch_speed"].value)
        stderrs.append(result.estimates["launch_speed"].stderr)
    assert np.std(speeds) / np.mean(stderrs) == pytest.approx(1.0, abs=0.25)


def test_interval_uses_few_degrees_of_freedom_when_the_random_part_is_uncertain():
    model = MODELS["incline"]
    short = clip(model, NOISE * np.random.default_rng(0).standard_normal((300, 1)))
    short = short.with_(valid=np.arange(300) % 40 == 0)
    estimate = fit(short, model).estimates["acceleration"]
    low, high = estimate.interval
    assert (high - low) / 2 / estimate.stderr > 2.3


# --------------------------------------------------------------------------- what is determined


def test_determination_names_the_null_direction():
    columns = wave_columns()
    sensitivity = np.column_stack([columns[:, 0], columns[:, 1], -2.0 * columns[:, 0]])
    determined = determination(sensitivity)
    assert determined.undetermined.tolist() == [True, False, True]
    assert determined.condition > 1e12
    text = null_direction_text(("a", "b", "c"), np.array([4.0, 1.0, 2.0]), determined.null[0])
    assert text == "a and c scale together: only their ratios are determined"


def test_null_direction_with_other_exponents_is_spelled_out():
    text = null_direction_text(("a", "b"), np.array([1.0, 1.0]), np.array([1.0, -0.5]))
    assert text == "a and b cannot be told apart: changing a by +1 %, b by -0.5 % leaves the prediction as it is"


def test_single_undetermined_value_is_named():
    assert null_direction_text(("a", "b"), np.array([2.0, 1.0]), np.array([1.0, 0.0])) == (
        "the data do not determine a at all"
    )


@pytest.mark.parametrize(
    ("rms", "noise", "expected"),
    [
        (0.02, 0.001, True),
        (0.004, 0.001, False),
        (0.02, 0.01, False),
        (0.01, 0.0001, True),
        (0.2, np.nan, True),
        (1e-8, 1e-12, False),
    ],
)
def test_misfit_is_a_residual_far_above_the_noise_and_above_rounding(rms, noise, expected):
    assert is_misfit(np.array([rms]), np.array([noise]), np.array([0.3])) is expected


@pytest.mark.parametrize("coefficients", [[0.9], [0.5, -0.3, 0.2]], ids=["first order", "third order"])
def test_all_pole_filter_is_that_of_scipy(coefficients):
    columns = np.random.default_rng(0).standard_normal((200, 3))
    filtered = _all_pole_filter(np.array(coefficients), columns)
    expected = lfilter([1.0], [1.0, *(-c for c in coefficients)], columns, axis=0)
    np.testing.assert_allclose(filtered, expected, rtol=1e-13, atol=1e-13)
