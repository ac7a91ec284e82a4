"""The share of the residual's variance that each component explains, so that shares never exceed the whole.

Components overlap: what two explain together is not the sum of what each explains alone. Each gets what it explains
beyond those before it, the likeliest first, so that the shares are of orthogonal parts. Their range runs over all
orders, from what a component explains after all others to what it explains first (Lindeman, Merenda and Gold 1980).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from fitters.components.likelihood import Products, Variances


@dataclass(frozen=True, slots=True)
class Shares:
    """The share of each component and its range; ``total`` is what all explain together."""

    share: dict[str, float]
    low: dict[str, float]
    high: dict[str, float]
    total: float


def shares_of(plain: Products, white: Products, kinds: tuple[str, ...], variances: Variances) -> Shares:
    """The shares of some components.

    Parameters
    ----------
    plain, white
        Products of the residual as it is, and whitened as it was for the variances.
    kinds
        The components, the likeliest first, in the order of ``variances.groups``.
    variances
        Their variances.
    """
    explains = {
        members: explained(plain, white, variances, members)
        for size in range(len(kinds) + 1)
        for members in combinations(range(len(kinds)), size)
    }
    share, low, high = {}, {}, {}
    for k, kind in enumerate(kinds):
        gains = {
            members: min(max(explains[tuple(sorted((*members, k)))] - value, 0.0), 1.0)
            for members, value in explains.items()
            if k not in members
        }
        share[kind], low[kind], high[kind] = gains[tuple(range(k))], min(gains.values()), max(gains.values())
    return Shares(share, low, high, explains[tuple(range(len(kinds)))])


def explained(plain: Products, white: Products, variances: Variances, members: tuple[int, ...] | None = None) -> float:
    """The fraction of the residual's sum of squares that components explain, at least 0.

    Parameters
    ----------
    plain, white, variances
        As for :func:`shares_of`.
    members
        The places of some of the components; by default all.
    """
    columns, mean, _ = variances.coefficients(white, members)
    if not columns.size:
        return 0.0
    inside = plain.information[(columns[:, None], columns)]
    rest = plain.squares - 2 * mean @ plain.along[columns] + mean @ inside @ mean
    return min(max(1.0 - float(rest) / max(plain.squares, 1e-300), 0.0), 1.0)
