"""What a model of the bank lacks, as terms: discovery on the residual of its fit.

The model's own terms are kept whatever else is chosen; all other candidates of the library compete to explain what its
fit leaves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.sindy_library import Library
from fitters.sindy_refine import Refined, folds_of, refined
from fitters.sindy_sparse import Compressed, Kept, predictive_price, significant, together
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Trajectory

ROUNDS = 4


def beyond(
    clips: Sequence[Trajectory], library: Library, own: Kept, rng: np.random.Generator, resampled: int
) -> tuple[Refined, Array]:
    """Fit terms that are kept, and those beside them that the residual calls for, until the choice stays.

    Parameters
    ----------
    clips, library
        What is fitted, with which candidates.
    own
        Places of the terms that are kept.
    rng
        Source of chance.
    resampled
        Number of resampled data sets.

    Returns
    -------
    found, shares
        The terms kept and added, fitted, and the inclusion (k,) of every term: 1 for those kept.

    Raises
    ------
    FitError
        When the terms that are kept cannot be fitted.
    """
    extra: Kept = ()
    for _ in range(ROUNDS):
        found = refined(clips, library, tuple(sorted((*own, *extra))), {})
        if not found.usable:
            raise FitError(f"the model whose residual is asked for cannot be fitted to this: {found.fits[0].message}")
        chosen = _called_for(found, own)
        if chosen == extra:
            break
        extra = chosen
    return found, _shares(found, own, rng, resampled)


def _rearranged(found: Refined, own: Kept) -> tuple[list[list[Compressed]], list[int], int]:
    """Compressed rows of each clip with the candidates first, their order, and how many candidates there are."""
    size = found.parts[0][0].size
    candidates = [k for k in range(found.terms) if k not in own]
    order = [*candidates, *own, *range(found.terms, size), size]
    clips = [[Compressed(part.rows[:, order], part.count) for part in clip] for clip in found.parts]
    return clips, order, len(candidates)


def _called_for(found: Refined, own: Kept) -> Kept:
    """The candidates that what is left calls for, at the price that held-out prediction sets."""
    clips, order, first = _rearranged(found, own)
    folds = [together(group) for group in folds_of(clips)]
    price = max(predictive_price(folds, first), found.least_seen)
    return tuple(sorted(order[k] for k in significant(together(folds).without(first), price)))


def _shares(found: Refined, own: Kept, rng: np.random.Generator, resampled: int) -> Array:
    """Share (k,) of resampled data sets in which each candidate is called for."""
    clips, order, first = _rearranged(found, own)
    price = max(predictive_price([together(group) for group in folds_of(clips)], first), found.least_seen)
    blocks = [part for clip in clips for part in clip]
    times = np.zeros(found.terms)
    for _ in range(resampled):
        drawn = together([blocks[k] for k in rng.integers(len(blocks), size=len(blocks))]).without(first)
        times[[order[k] for k in significant(drawn, price)]] += 1
    shares = times / max(resampled, 1)
    shares[list(own)] = 1.0
    return np.asarray(shares)
