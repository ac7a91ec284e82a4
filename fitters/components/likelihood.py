r"""The restricted likelihood of a residual that is a sum of components.

y = J dp + sum_k Z_k w_k + noise, w_k ~ N(0, lambda_k s^2), noise autoregressive of first order with variance s^2; dp is
free, so that only what the fitted values cannot imitate counts (restricted likelihood: Patterson and Thompson 1971,
Biometrika 58, 545). With A = Z'PZ and b = Z'Py over all samples, one evaluation costs a Cholesky factor of the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from iris_sysid.types import Array

MIN_LOG, MAX_LOG = -9.0, 9.0  # natural logarithm of a component's variance over the one that explains all
Columns = NDArray[np.intp]


@dataclass(frozen=True, eq=False, slots=True)
class Products:
    """Sums over all samples, whitened for one correlation of the noise and freed of the fitted values.

    ``information`` (k, k) and ``along`` (k,) of the columns, ``squares`` of the residual, over ``degrees``;
    ``log_scale`` is added to a log likelihood, the ``volume`` of the fitted values subtracted. The noise
    has at least the variance ``floor``: the components are a linear response, right to a few per cent, and a smaller
    rest tells nothing of them.
    """

    information: Array
    along: Array
    squares: float
    degrees: int
    log_scale: float
    volume: float
    floor: float = 0.0

    @property
    def constant(self) -> float:
        """What is added to each log likelihood."""
        return self.log_scale - self.volume

    def noise(self, squares: float) -> float:
        """The likeliest variance of the noise where components leave a sum of squares."""
        return max(squares / self.degrees, self.floor, 1e-12 * self.squares / self.degrees, 1e-300)

    def cost(self, squares: float) -> float:
        """Minus the log likelihood, without constants, where components leave a sum of squares."""
        noise = self.noise(squares)
        return 0.5 * (self.degrees * float(np.log(noise)) + squares / noise - self.degrees)


@dataclass(frozen=True, eq=False, slots=True)
class Variances:
    """Components with the variances that are likeliest: ``log_likelihood`` with the size of the noise profiled.

    ``groups`` are the columns of each component, ``variances`` theirs over that of the noise, ``noise`` that variance.
    """

    groups: tuple[Columns, ...]
    variances: Array
    noise: float
    log_likelihood: float

    @property
    def columns(self) -> Columns:
        """All columns."""
        return np.concatenate([*self.groups, np.zeros(0, dtype=np.intp)]).astype(np.intp)

    @property
    def prior(self) -> Array:
        """The variance of each column's coefficient (k,) over that of the noise, dimensionless."""
        return np.repeat(self.variances, [group.size for group in self.groups])

    def coefficients(self, products: Products, kept: Sequence[int] | None = None) -> tuple[Columns, Array, Array]:
        """Columns, mean (k,) and covariance (k, k) of the coefficients, of some of the components alone."""
        which = range(len(self.groups)) if kept is None else kept
        parts = [self.groups[k] for k in which]
        if not parts:
            return np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros((0, 0))
        columns = np.concatenate(parts)
        root = np.sqrt(np.repeat(self.variances[list(which)], [part.size for part in parts]))
        factor = cho_factor(_scaled(products, columns, root), lower=True)
        inverse = root[:, None] * cho_solve(factor, np.diag(root))
        return columns, inverse @ products.along[columns], self.noise * inverse


def _scaled(products: Products, columns: Columns, root: Array) -> Array:
    information = products.information[np.ix_(columns, columns)]
    return np.asarray(np.eye(columns.size) + root[:, None] * information * root)


def likeliest(products: Products, groups: Sequence[Columns]) -> Variances:
    """The variances of some components that maximise the restricted likelihood.

    Parameters
    ----------
    products
        Of all columns with the residual.
    groups
        The columns of each component.
    """
    if not groups:
        squares = products.squares
        return Variances((), np.zeros(0), products.noise(squares), products.constant - products.cost(squares))
    columns = np.concatenate(list(groups)).astype(np.intp)
    sizes = [group.size for group in groups]
    starts = np.concatenate([[0], np.cumsum(sizes)])[:-1]
    unit = np.array([_unit(products, group) for group in groups])
    information = products.information[np.ix_(columns, columns)]
    along = products.along[columns]

    def cost(logs: Array) -> tuple[float, Array]:
        root = np.sqrt(np.repeat(unit * np.exp(logs), sizes))
        factor = cho_factor(np.eye(columns.size) + root[:, None] * information * root, lower=True, check_finite=False)
        inverse = cho_solve(factor, np.eye(columns.size), check_finite=False)
        scaled = inverse @ (root * along)  # of the coefficients in units of their prior
        squares = max(products.squares - float(scaled @ (root * along)), 0.0)
        volume = float(np.sum(np.log(np.diag(factor[0]))))
        rest = np.add.reduceat(1.0 - np.diag(inverse), starts)
        grown = np.add.reduceat(scaled**2, starts)
        return volume + products.cost(squares), 0.5 * rest - 0.5 * grown / products.noise(squares)

    limits = [(MIN_LOG, MAX_LOG)] * len(groups)
    found = minimize(cost, np.full(len(groups), -1.0), jac=True, method="L-BFGS-B", bounds=limits)
    variances = unit * np.exp(found.x)
    root = np.sqrt(np.repeat(variances, sizes))
    factor = cho_factor(_scaled(products, columns, root), lower=True)
    scaled = cho_solve(factor, root * along)
    noise = products.noise(products.squares - float(scaled @ (root * along)))
    return Variances(tuple(groups), variances, noise, float(products.constant - found.fun))


def _unit(products: Products, group: Columns) -> float:
    """The variance of coefficients over that of the noise with which a component would be all of the residual."""
    trace = max(float(np.trace(products.information[np.ix_(group, group)])), 1e-300)
    return products.degrees / trace * max(np.sqrt(products.degrees), 10.0)


def best_choice(products: Products, current: Variances, choices: Sequence[Columns]) -> int:
    """Which of some sets of columns explains most beside the components that there are, to first order.

    Parameters
    ----------
    products
        Of all columns with the residual.
    current
        The components that there are.
    choices
        The rival sets.
    """
    columns, mean, _ = current.coefficients(products)
    every = np.concatenate(list(choices)).astype(np.intp)
    along = products.along[every] - products.information[np.ix_(every, columns)] @ mean
    root = np.sqrt(current.prior)
    information = products.information[np.ix_(every, every)]
    if columns.size:
        factor = cho_factor(_scaled(products, columns, root), lower=True)
        crossed = products.information[np.ix_(every, columns)] * root
        information = information - crossed @ cho_solve(factor, crossed.T)
    ends = np.cumsum([choice.size for choice in choices])
    gains = []
    for end, choice in zip(ends, choices, strict=True):
        own = slice(end - choice.size, end)
        block = information[own, own]
        block = block + 1e-9 * np.trace(block) * np.eye(choice.size) + 1e-300 * np.eye(choice.size)
        gains.append(float(along[own] @ np.linalg.solve(block, along[own])))
    return int(np.argmax(gains))
