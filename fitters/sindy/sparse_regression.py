"""Sparse regression: pysindy's stepwise regression on rows, and the same elimination on compressed rows.

Both remove, one at a time, the term without which the data are explained best (stepwise sparse regression, Boninsegna,
Nueske and Clementi 2018, J. Chem. Phys. 148, 241723, with the residual as criterion). On compressed rows it costs
microseconds, so that it can be repeated on resampled data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitters.sindy.weak_form import Rows
from iris_sysid.types import Array

FOLDS = 5
PRICES = (1.0, 1.5, 2.5, 4.0, 8.0, 16.0, 32.0)  # prices of a term, relative to the smallest
ALIKE = 1e-8  # fraction of a column's length that other columns must not span, for it to be independent


# --------------------------------------------------------------------------- proposals from rows, by pysindy


def proposed(rows: Rows) -> list[NDArray[np.intp]]:
    """Choices of terms for each number of terms, from none upwards, from whitened rows, by pysindy's SSR.

    Each choice (c,) holds indices of terms.
    """
    from pysindy import SSR  # takes two seconds to import, and what a residual suggests does without

    left, right = rows.left, rows.right
    count = right.shape[1]
    chosen = [np.arange(count)]
    if count > 1:
        size = np.maximum(np.linalg.norm(right, axis=0), 1e-300)
        regression = SSR(criteria="model_residual", alpha=0.0, max_iter=count, ridge_kw={"solver": "svd"})
        regression.fit(right / size, left[:, None])
        # the first entry of the history is the array that the later steps overwrite
        chosen += [np.flatnonzero(coefficients[0]) for coefficients in regression.history_[1:]]
    return [np.empty(0, dtype=np.intp), *chosen[::-1]]


def predicted_best(rows: Rows, choices: Sequence[NDArray[np.intp]]) -> int:
    """Index of the choice of terms that predicts held-out rows best, or equally well with fewer terms.

    Each choice (c,) holds indices of terms.

    Contiguous blocks are held out in turn; a choice with fewer terms is taken when it is worse by less than one
    standard error of the difference (Breiman et al. 1984, section 3.4.3).
    """
    blocks = np.array_split(np.arange(rows.left.size), FOLDS)
    losses = np.zeros((len(choices), FOLDS))
    for fold, held in enumerate(blocks):
        kept = np.setdiff1d(np.arange(rows.left.size), held)
        for k, choice in enumerate(choices):
            solved = np.linalg.lstsq(rows.right[np.ix_(kept, choice)], rows.left[kept], rcond=1e-10)[0]
            losses[k, fold] = np.sum((rows.left[held] - rows.right[np.ix_(held, choice)] @ solved) ** 2)
    return sparsest_within_error(losses)


def sparsest_within_error(losses: Array) -> int:
    """The first row of losses (choices, folds) not worse than the best by more than the difference's standard error.

    Losses are in squared units of the target.
    """
    best = int(np.argmin(losses.sum(axis=1)))
    difference = losses - losses[best]
    error = np.std(difference, axis=1, ddof=1) / np.sqrt(losses.shape[1])
    return int(np.argmax(np.mean(difference, axis=1) <= error))


# --------------------------------------------------------------------------- choices among compressed rows


Kept = tuple[int, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Compressed:
    """A least-squares problem with errors of unit variance, compressed to its triangular factor.

    ``rows`` (m, k + 1) are columns and target: any choice of columns leaves the same sum of squares as in all the rows
    that were compressed, without squaring their condition number. ``count`` is the number of independent samples.
    """

    rows: Array
    count: float

    @classmethod
    def of(cls, columns: Array, target: Array, share: float = 1.0) -> Compressed:
        """Compress rows; each counts as ``share`` independent samples.

        ``columns`` (n, k) and ``target`` (n,), whitened: dimensionless.
        """
        rows = np.sqrt(share) * np.column_stack([columns, target])
        return cls(_triangular(rows), share * target.size)

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.rows.shape[1] - 1

    @property
    def target(self) -> Array:
        """The target (m,)."""
        return self.rows[:, -1]

    def without(self, first: int) -> Compressed:
        """The problem of the first columns; the others are always fitted."""
        others = self.size - first
        order = [*range(first, self.size), *range(first), self.size]
        return Compressed(_triangular(self.rows[:, order])[others:, others:], self.count - others)

    def solved(self, kept: Sequence[int]) -> tuple[Array, Array]:
        """Coefficients of the kept columns and their covariance.

        Coefficients (c,) and covariance (c, c), in the units of the terms.
        """
        part = self.rows[:, list(kept)]
        length = _length(part)
        inverse = np.linalg.pinv(part / length, rcond=ALIKE) / length[:, None]
        return inverse @ self.target, inverse @ inverse.T

    def misfit(self, kept: Sequence[int], coefficients: Array) -> float:
        """Residual sum of squares with these coefficients of the kept columns.

        ``coefficients`` (c,), in the units of the terms.
        """
        left = self.target - self.rows[:, list(kept)] @ coefficients
        return float(left @ left)

    def residual(self, kept: Sequence[int]) -> float:
        """Residual sum of squares with the best coefficients of the kept columns."""
        return self.misfit(kept, self.solved(kept)[0]) if kept else float(self.target @ self.target)

    def gains(self, kept: Kept) -> tuple[float, Array]:
        """Residual sum of squares of the kept columns, and its decrease by each other column (-1 for the kept ones).

        Gains (k,) are in squared units of the target.
        """
        basis = np.linalg.qr(self.rows[:, list(kept)] / _length(self.rows[:, list(kept)]))[0]
        left = self.rows - basis @ (basis.T @ self.rows)
        columns, target = left[:, :-1], left[:, -1]
        own = _length(columns)
        new = own > ALIKE * _length(self.rows[:, :-1])
        taken = np.where(new, (columns.T @ target / own) ** 2, 0.0)
        taken[list(kept)] = -1.0
        return float(target @ target), taken


def together(parts: Sequence[Compressed]) -> Compressed:
    """All parts as one problem."""
    return Compressed(_triangular(np.vstack([part.rows for part in parts])), sum(part.count for part in parts))


def _triangular(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"))


def _length(columns: Array) -> Array:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-150)


def term_price(problem: Compressed) -> float:
    """The price of one more term, in squared standard errors: log n + 2 log p.

    The extended Bayesian information criterion, which also penalises the number p of candidate terms
    (Chen and Chen 2008, Biometrika 95, 759, with gamma = 1).
    """
    return float(np.log(max(problem.count, 3.0)) + 2 * np.log(max(problem.size, 1)))


def criterion(problem: Compressed, residual: float, size: int, price: float) -> float:
    """N log(RSS / n) and the price of the terms.

    Parameters
    ----------
    problem
        Gives the number of samples and their size.
    residual
        Residual sum of squares.
    size
        Number of terms.
    price
        Price of each term.
    """
    count = max(problem.count, 3.0)
    # rounding limits how small a residual can be resolved
    least = max(1e-24 * float(problem.target @ problem.target), 1e-300)
    return float(count * np.log(max(residual, least) / count) + size * price)


def significant(problem: Compressed, price: float, starts: Sequence[Kept] | None = None) -> Kept:
    """The choice of terms with the smallest criterion, by adding, removing and exchanging one term at a time.

    Parameters
    ----------
    problem
        The columns to choose from.
    price
        Price of a term, in squared standard errors.
    starts
        Choices to begin with; none and all terms when not given.
    """
    ends = [_improved(problem, start, price) for start in starts or ((), tuple(range(problem.size)))]
    return min(ends)[1]


def _improved(problem: Compressed, kept: Kept, price: float) -> tuple[float, Kept]:
    best = criterion(problem, problem.residual(kept), len(kept), price)
    while True:
        _, choice = min(_neighbours(problem, kept, price))
        value = criterion(problem, problem.residual(choice), len(choice), price)
        if not value < best - 1e-6:
            return best, kept
        best, kept = value, choice


def _neighbours(problem: Compressed, kept: Kept, price: float) -> Iterator[tuple[float, Kept]]:
    """Neighbouring choices with their criterion: the best with one more term, all with one less, the best exchanges."""
    for fewer in (kept, *(kept[:index] + kept[index + 1 :] for index in range(len(kept)))):
        residual, gains = problem.gains(fewer)
        yield criterion(problem, residual, len(fewer), price), fewer
        if len(fewer) < problem.size:
            added = int(np.argmax(gains))
            more = tuple(sorted((*fewer, added)))
            yield criterion(problem, residual - gains[added], len(more), price), more


def predictive_price(parts: Sequence[Compressed], first: int) -> float:
    """The price of a term that best predicts held-out data, see :func:`predicted_best`; at least term_price.

    Parameters
    ----------
    parts
        Compressed rows of the parts that are held out in turn.
    first
        Number of columns to choose from; the others are always fitted.
    """
    whole = together(parts)
    least = term_price(whole.without(first))
    prices = least * np.array(PRICES)
    always = tuple(range(first, whole.size))
    start = significant(whole.without(first), least)
    losses = np.zeros((len(prices), len(parts)))
    for fold, held in enumerate(parts):
        training = together([part for part in parts if part is not held])
        reduced, near = training.without(first), start
        for k, price in enumerate(prices):
            near = significant(reduced, price, (near,))
            losses[k, fold] = held.misfit(near + always, training.solved(near + always)[0])
    return float(prices[::-1][sparsest_within_error(losses[::-1])])
