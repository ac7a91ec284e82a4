"""Find the terms that a model of the bank lacks, by discovery on the residual of its fit.

The model's own terms are always kept; all other candidates of the library compete to explain the residual.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.sindy.library import Library
from fitters.sindy.refinement import Refined, folds_of, refined
from fitters.sindy.sparse_regression import Compressed, Kept, predictive_price, significant, together
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Trajectory

Blocks = Sequence[Sequence[Compressed]]  # of every clip, the blocks of time

ROUNDS = 4


def beyond(
    clips: Sequence[Trajectory], library: Library, own: Kept, rng: np.random.Generator, resampled: int
) -> tuple[Refined, Array]:
    """Fit the kept terms and those that the residual requires, and repeat until the choice does not change.

    Inclusion is dimensionless.

    Parameters
    ----------
    clips, library
        The clips, and the library of candidates.
    own
        Indices of the terms that are kept.
    rng
        Source of chance.
    resampled
        Number of resampled data sets.

    Returns
    -------
    choice, shares
        The terms kept and added, fitted, and the inclusion (k,) of every term: 1 for those kept.

    Raises
    ------
    FitError
        When the terms that are kept cannot be fitted.
    """
    extra: Kept = ()
    for _ in range(ROUNDS):
        choice = refined(clips, library, tuple(sorted((*own, *extra))), {})
        if not choice.usable:
            raise FitError(f"the model whose residual is requested cannot be fitted to this: {choice.fits[0].message}")
        rows, candidates = _rearranged(choice, own)
        chosen, price = called_for(rows, len(candidates), choice.least_seen)
        called = tuple(candidates[k] for k in chosen)
        if called == extra:
            break
        extra = called
    shares = np.ones(choice.terms)
    shares[candidates] = share_called_for(rows, len(candidates), price, rng, resampled)
    return choice, shares


def _rearranged(choice: Refined, own: Kept) -> tuple[Blocks, list[int]]:
    """Compressed rows of each clip with the candidates first, and the indices of the candidates."""
    size = choice.parts[0][0].size
    candidates = [k for k in range(choice.terms) if k not in own]
    order = [*candidates, *own, *range(choice.terms, size), size]
    return [[Compressed(part.rows[:, order], part.count) for part in clip] for clip in choice.parts], candidates


def called_for(clips: Blocks, first: int, least: float = 0.0) -> tuple[Kept, float]:
    """The columns among the ``first`` that the residual requires, and the price of a term from held-out prediction.

    Parameters
    ----------
    clips
        Compressed rows of each block of each clip; the columns after the first ones are always fitted.
    first
        Number of columns to choose from.
    least
        Smallest price of a term, in squared standard errors.
    """
    folds = [together(group) for group in folds_of(clips)]
    price = max(predictive_price(folds, first), least)
    return significant(together(folds).without(first), price), price


def share_called_for(clips: Blocks, first: int, price: float, rng: np.random.Generator, resampled: int) -> Array:
    """Share (first,) of resampled data sets in which each column is selected at a price, see :func:`called_for`.

    Shares are dimensionless.

    Parameters
    ----------
    clips, first
        As for :func:`called_for`.
    price
        Price of a term.
    rng
        Source of chance.
    resampled
        Number of resampled data sets.
    """
    blocks = [part for clip in clips for part in clip]
    times = np.zeros(first)
    for _ in range(resampled):
        drawn = together([blocks[k] for k in rng.integers(len(blocks), size=len(blocks))]).without(first)
        times[list(significant(drawn, price))] += 1
    return times / max(resampled, 1)
