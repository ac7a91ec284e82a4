"""The sandwich by itself: its parts against sums written out, and the degrees of freedom against many repetitions."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from fitters.noise.autoregression import Autoregression, autocovariance, coefficients_of
from fitters.noise.sandwich_covariance import (
    MAX_DEGREES,
    MAX_LAG,
    _memory,
    _slope,
    inverse_normal,
    orthonormal_basis,
    quantile_975,
    random_uncertainty,
)


def wave_columns(n=200):
    t = np.arange(n) / 20
    return np.column_stack([np.sin(t), t * np.cos(t), np.ones(n)])


def written_out(columns, partial, innovation_sd, kept=slice(None)):
    """The covariance of the values with the noise's whole matrix, of the samples that are kept."""
    gamma = toeplitz(autocovariance(partial, columns.shape[0]))[kept][:, kept]
    inside = columns[kept]
    bread = np.linalg.inv(inside.T @ inside)
    return bread @ inside.T @ gamma @ inside @ bread * innovation_sd**2


# --------------------------------------------------------------------------- inverse and basis


def test_scale_of_a_column_does_not_decide_whether_it_is_left_out():
    columns = wave_columns()
    scaled = columns * [1.0, 1e-9, 1e6]
    expected = np.linalg.inv(columns.T @ columns) / np.outer([1.0, 1e-9, 1e6], [1.0, 1e-9, 1e6])
    np.testing.assert_allclose(inverse_normal(scaled, 1e-6), expected, rtol=1e-9)
    assert orthonormal_basis(scaled).shape == (200, 3)


def test_value_that_moves_nothing_gets_no_variance_and_changes_no_other():
    columns = wave_columns()
    inverse = inverse_normal(np.column_stack([columns, np.zeros(200)]))
    np.testing.assert_allclose(inverse[:3, :3], np.linalg.inv(columns.T @ columns), rtol=1e-9)
    assert np.all(inverse[3] == 0.0)


@pytest.mark.parametrize(("smallest", "rank"), [(1.0, 1), (0.5, 2)])
def test_direction_is_left_out_below_a_share_of_the_largest(smallest, rank):
    """Two nearly parallel columns of unit length: singular values sqrt(2) and 1.2e-3, a ratio of 0.85e-3."""
    angle = 1.2e-3 * np.sqrt(2.0)
    columns = np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)], [0.0, 0.0]])
    inverse = inverse_normal(columns, 1e-3 * smallest)
    assert np.linalg.matrix_rank(inverse, hermitian=True) == rank


def test_basis_is_orthonormal_and_holds_the_columns():
    columns = wave_columns()
    basis = orthonormal_basis(columns)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(basis @ (basis.T @ columns), columns, atol=1e-9)


def test_fewer_than_one_degree_of_freedom_count_as_one():
    assert quantile_975(0.3) == pytest.approx(12.7062, abs=1e-3)


# --------------------------------------------------------------------------- memory of the noise


def test_memory_ends_where_the_response_is_a_millionth():
    for coefficients, samples in (([0.9], 132), ([-0.9], 132), ([1.2, -0.5], 40), ([0.5, 0.2], 51)):
        response = lfilter([1.0], np.concatenate([[1.0], -np.array(coefficients)]), np.eye(1, 400)[0])
        assert _memory(np.array(coefficients)) == samples
        assert np.max(np.abs(response[samples + 5 :])) < 4e-6


@pytest.mark.parametrize("coefficients", [[1.0], [1.5], [0.9999]])
def test_memory_that_would_not_end_is_limited(coefficients):
    assert _memory(np.array(coefficients)) == MAX_LAG


# --------------------------------------------------------------------------- gaps


def test_frames_that_were_lost_take_no_part_but_keep_the_others_apart():
    rng, n = np.random.default_rng(3), 400
    columns = np.column_stack([np.sin(np.arange(n) / 30), 0.5 + np.arange(n) / n])
    noise = lfilter([1.0], [1.0, -0.8], rng.standard_normal(n))
    kept = np.flatnonzero(rng.uniform(size=n) > 0.3)
    kept = np.union1d(kept, [0, 1, n - 1])
    bread = inverse_normal(columns[kept])
    found = random_uncertainty(kept / 60.0, noise[kept, None], columns[kept, None, :], bread)
    (process,) = found.noise
    assert process.partial[0] == pytest.approx(0.8, abs=0.1)
    expected = written_out(columns, process.partial, process.innovation_sd, kept)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-4)


# --------------------------------------------------------------------------- degrees of freedom


@pytest.mark.parametrize("partial", [[0.6], [-0.4], [0.7, -0.5], [0.9995]])
def test_slope_of_a_variance_is_the_derivative_of_the_sums_written_out(partial):
    partial, columns, sd = np.array(partial), wave_columns(), 1.7
    process = Autoregression(partial, coefficients_of(partial)[-1], sd, 197)
    bread = inverse_normal(columns)
    for index in range(partial.size):
        step = 1e-3 * (1.0 - np.abs(partial[index])) * np.eye(partial.size)[index]
        sides = [np.diag(written_out(columns, partial + sign * step, sd)) for sign in (1.0, -1.0)]
        expected = (sides[0] - sides[1]) / (2.0 * step[index])
        np.testing.assert_allclose(_slope(columns, bread, process, index), expected, rtol=2e-3)


def test_degrees_of_freedom_are_those_of_the_scatter_of_the_variance():
    """Of an estimated variance V with f degrees of freedom the relative scatter is sqrt(2 / f); white noise had 398."""
    rng, n = np.random.default_rng(7), 400
    columns = np.column_stack([np.ones(n), np.linspace(-1.0, 1.0, n)])
    bread, projector = inverse_normal(columns), columns @ np.linalg.pinv(columns)
    variances, degrees = [], []
    for _ in range(300):
        noise = lfilter([1.0], [1.0, -0.7], rng.standard_normal(n + 200))[200:]
        residual = noise - projector @ noise
        found = random_uncertainty(np.arange(n) / 60.0, residual[:, None], columns[:, None, :], bread)
        variances.append(np.diag(found.covariance))
        degrees.append(found.degrees)
    scatter = np.std(variances, axis=0) / np.mean(variances, axis=0)
    expected = np.sqrt(2.0 / np.median(degrees, axis=0))
    assert np.all(expected > 0.2)  # far fewer than of white noise, whose scatter is 0.07
    np.testing.assert_allclose(scatter / expected, 1.0, atol=0.2)  # 300 repetitions tell it to 4 %; skewed, to 10 %


def test_residual_of_zero_has_no_variance_and_as_many_degrees_as_there_can_be():
    columns = wave_columns()
    found = random_uncertainty(np.arange(200) / 60.0, np.zeros((200, 1)), columns[:, None, :], inverse_normal(columns))
    assert np.all(found.covariance == 0.0)
    assert np.all(found.degrees == MAX_DEGREES)
