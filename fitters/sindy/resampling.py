"""Inclusion of terms in resampled data sets, and removal of the terms that few of them include."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.sindy.library import Library
from fitters.sindy.refinement import Refined, price_about, refined, start_about
from fitters.sindy.sparse_regression import significant, together
from iris_sysid.types import Array, Trajectory

RESAMPLED = 100
STABLE = 0.5  # a term with at least this inclusion stays
SURE = 10.0  # difference of the information criterion: very strong evidence (Kass and Raftery 1995, JASA 90, 773)


def inclusion(found: Refined, rng: np.random.Generator, count: int = RESAMPLED) -> Array:
    """Share of resampled data sets in which each term is chosen (k,).

    Blocks of time are drawn with replacement within each clip, and clips as well where there are at least three
    (moving-block bootstrap, Kuensch 1989, Ann. Statist. 17, 1217; stability selection, Meinshausen and Buehlmann 2010,
    J. R. Stat. Soc. B 72, 417; ensemble SINDy, Fasel et al. 2022, Proc. R. Soc. A 478, 20210904).

    Parameters
    ----------
    found
        A fitted choice.
    rng
        Source of chance.
    count
        Number of resampled data sets.
    """
    times, price = np.zeros(found.terms), price_about(found)
    for _ in range(count):
        clips = (
            rng.integers(len(found.parts), size=len(found.parts)) if len(found.parts) > 2 else range(len(found.parts))
        )
        drawn = [found.parts[c][k] for c in clips for k in rng.integers(len(found.parts[c]), size=len(found.parts[c]))]
        resampled = together(drawn).without(found.terms)
        times[list(significant(resampled, price, ((), found.kept)))] += 1
    return times / count


def stable(
    clips: Sequence[Trajectory], library: Library, found: Refined, rng: np.random.Generator, count: int
) -> tuple[Refined, Array]:
    """Remove terms that fewer than half of the resampled data sets include, the least included first.

    A term without which the fit is clearly worse stays: a similar term is needed; see ``alternatives``.

    Parameters
    ----------
    clips, library
        The clips, and the library of candidates.
    found
        A fitted choice.
    rng
        Source of chance.
    count
        Number of resampled data sets.

    Returns
    -------
    found, shares
        The remaining choice, fitted, and the inclusion (k,) of every term.
    """
    shares, needed = inclusion(found, rng, count), set[int]()
    while unsure := [k for k in found.kept if shares[k] < STABLE and k not in needed]:
        least = min(unsure, key=lambda k: float(shares[k]))
        kept = tuple(k for k in found.kept if k != least)
        fewer = refined(clips, library, kept, start_about(found, library, kept))
        worth = max(found.count, fewer.count)
        if fewer.criterion(worth) > found.criterion(worth) + SURE:
            needed.add(least)
        else:
            found, shares = fewer, inclusion(fewer, rng, count)
    return found, shares
