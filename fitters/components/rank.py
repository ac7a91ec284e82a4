"""Sets of effects ranked to first order, each beside the same flexible rest: a slow wander and noise with a memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitters.components.bases import Basis, wander
from fitters.components.layout import ClipResidual, Layout
from fitters.components.sets import SetSearch
from fitters.components.split import CORRELATIONS, tolerance
from iris_sysid.types import Array

REST = "zero-wander"


@dataclass(frozen=True, slots=True)
class RankedSet:
    """Effects with their sizes to first order, and the log evidence of the set."""

    sizes: Mapping[str, float]
    evidence: float

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(self.sizes)


def ranked_sets(
    clips: Sequence[ClipResidual],
    changes: Mapping[str, Sequence[Array]],
    log_odds: Mapping[str, float],
    largest: int,
) -> list[RankedSet]:
    """All sets of effects that were compared, the best first; the empty one is among them.

    Parameters
    ----------
    clips
        The residuals of the fits without the effects.
    changes
        By name of the effect, what a unit of its size changes in what is observed, (n, d) a clip.
    log_odds
        Of each effect before the data.
    largest
        Number of effects in a set.
    """
    by_clip = [
        [
            wander(clip.motion, clip.predicted),
            *(Basis(name, each[k][:, :, None], True) for name, each in changes.items()),
        ]
        for k, clip in enumerate(clips)
    ]
    layout = Layout.of(by_clip, clips)
    always = (REST,) if REST in layout.groups else ()
    searches = [
        SetSearch(layout.products(rho, tolerance(clips)), layout.groups, log_odds, always) for rho in CORRELATIONS
    ]
    search = max(searches, key=lambda each: each.evidence(()))
    search.run(largest)
    other = max(searches, key=lambda each: each.evidence(search.top()))
    if other is not search:
        other.run(largest)
        search = other
    return [
        RankedSet(_sizes(search, key, layout), search.found[key].evidence)
        for key in sorted(search.found, key=lambda key: -search.found[key].evidence)
    ]


def _sizes(search: SetSearch, key: tuple[str, ...], layout: Layout) -> dict[str, float]:
    """The sizes of the effects of a set, in their own units."""
    columns, mean, _ = search.variances(key).coefficients(search.products)
    weights = dict(zip(columns.tolist(), mean.tolist(), strict=True))
    return {name: float(np.nan_to_num(weights[int(layout.groups[name][0][0])])) / layout.scales[name] for name in key}
