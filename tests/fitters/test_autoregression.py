"""The restricted likelihood of an autoregression from lagged products, beside that of the whitened columns."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.signal import lfilter

from fitters.noise.autoregression import _LaggedProducts, _most_likely, burg, minus_restricted
from fitters.noise.sandwich_covariance import orthonormal_basis

PARTIAL = np.array([0.9, -0.5, 0.3, -0.1])


def residual_with_gaps(seed, n=500, lost=0.06):
    rng = np.random.default_rng(seed)
    residual = lfilter([1.0], [1.0, -1.2, 0.5], rng.standard_normal(n))
    residual[rng.random(n) < lost] = np.nan
    residual[100:130] = np.nan
    basis = np.vander(np.linspace(-1, 1, n), 4)
    basis[np.isnan(residual)] = 0.0
    return residual, orthonormal_basis(basis)


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("lost", [0.0, 0.06, 0.4])
def test_lagged_products_give_the_likelihood_of_the_whitened_columns_with_gaps(order, lost):
    residual, basis = residual_with_gaps(0, lost=lost)
    value, _ = _LaggedProducts.of(residual, basis, order).minus_restricted(PARTIAL[:order])
    assert value == pytest.approx(minus_restricted(residual, basis, PARTIAL[:order])[0], abs=1e-8)


@pytest.mark.parametrize("lost", [0.0, 0.06])
def test_gradient_of_the_likelihood_is_that_of_its_differences(lost):
    residual, basis = residual_with_gaps(1, lost=lost)
    products = _LaggedProducts.of(residual, basis, PARTIAL.size)
    gradient = products.minus_restricted(PARTIAL)[1]
    numeric = approx_fprime(PARTIAL, lambda partial: products.minus_restricted(partial)[0], 1e-7)
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-2)


def test_nothing_near_is_more_likely_than_what_is_found():
    residual, basis = residual_with_gaps(2)
    partial = _most_likely(residual, basis, burg(residual, 3)[0])
    least = minus_restricted(residual, basis, partial)[0]
    for step in 1e-3 * np.concatenate([np.eye(3), -np.eye(3)]):
        assert minus_restricted(residual, basis, partial + step)[0] > least


def test_noise_too_smooth_for_products_is_found_from_the_whitened_columns():
    t_s = np.arange(400) / 60
    residual = np.sin(3 * t_s) + 1e-9 * np.random.default_rng(0).standard_normal(400)
    basis = orthonormal_basis(np.vander(t_s, 4))
    residual -= basis @ (basis.T @ residual)
    start = burg(residual, 4)[0]
    partial = _most_likely(residual, basis, start)
    assert minus_restricted(residual, basis, partial)[0] <= minus_restricted(residual, basis, start)[0]
