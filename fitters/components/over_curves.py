"""Whether an effect explains more than a curve of any shape would: evidence of its formula, not of a part alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitters.components.layout import ClipResidual, Layout
from fitters.components.likelihood import likeliest
from fitters.components.split import CORRELATIONS, LOG_ODDS, searched, thinned


def log_odds_over_curves(without: Sequence[ClipResidual], beside: Sequence[ClipResidual], values: int) -> float:
    """Log odds that an effect explains the data, and not the likeliest curves of any components in its place.

    A curve has a value for each detail that the data show, a formula has few: one that explains the same to the noise
    is likelier by what those details were worth (Bayesian information criterion: Schwarz 1978, Ann. Stat. 6, 461). What
    can imitate a part of anything explains no more than a curve there. Before the data an effect is as rare as a
    component. Curves are a linear response, right to a few per cent of the residual: a fit that is better than that
    counts no more.

    Parameters
    ----------
    without
        The residuals of the model without the effect, one a clip.
    beside
        Those of the model with it.
    values
        How many values the effect has, moments that were chosen among the samples included.

    Returns
    -------
    float
        Above ln 20 the odds are 20 to 1: "strong evidence" of Kass and Raftery (1995, JASA 90, 773).
    """
    found = searched([thinned(clip, len(without)) for clip in without])
    products = found.search.products
    curves = found.search.evidence(found.search.top()) + products.volume
    layout = Layout.bare([thinned(clip, len(beside)) for clip in beside])
    count = sum(clip.residual.values.size for clip in layout.clips)
    noises = [replace(layout.products(rho), floor=products.floor) for rho in CORRELATIONS]
    effect = max(likeliest(noise, ()).log_likelihood + noise.volume for noise in noises)
    return effect + LOG_ODDS - 0.5 * values * float(np.log(count)) - curves
