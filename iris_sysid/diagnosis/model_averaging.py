"""The error of an effect's size when other effects may act as well: Bayesian model averaging, to first order.

An interval that assumes no further missing effect is too narrow: an effect too small to be detected beside the one
found has still taken part of its size, or added to it. So the interval is that of a mixture over no further effect and
each one more effect of the library (Hoeting, Madigan, Raftery and Volinsky 1999, Stat. Sci. 14, 382), each as likely
beforehand as none, with the weight exp(-BIC / 2) (Raftery 1995, Sociol. Methodol. 25, 111).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from iris_sysid.diagnosis.score_test import combined
from iris_sysid.types import Estimate, Score, normal_cdf

FAR = 8.0  # standard errors within which the quantiles of a mixture lie: beyond is 1e-15


@dataclass(frozen=True, slots=True)
class CompetingEffect:
    """What one more effect would do to a size: ``shift`` it, and add the standard error ``spread``, in its unit.

    ``log_weight`` is the logarithm of its probability over that of no further effect.
    """

    log_weight: float
    shift: float
    spread: float


def averaged_over_alternatives(chosen: Estimate, alternatives: Sequence[tuple[Estimate, float]]) -> Estimate:
    """Widen a size for the choice among sets of effects that explain the data as well; its value stays.

    The unconditional standard error of Buckland, Burnham and Augustin (1997, Biometrics 53, 603), about the value
    beside the effects that were added.

    Parameters
    ----------
    chosen
        The size beside the effects that were added.
    alternatives
        The size beside others, and by how much their fit costs more (:attr:`ModelWithEffects.cost`).
    """
    if not alternatives or not chosen.stderr > 0:
        return chosen
    costs = np.array([0.0, *(cost for _, cost in alternatives)])
    sizes = (chosen, *(size for size, _ in alternatives))
    errors = [np.hypot(size.stderr, size.value - chosen.value) for size in sizes]
    weights = np.exp(-0.5 * (costs - costs.min()))
    factor = max(float(np.average(np.nan_to_num(errors), weights=weights)) / chosen.stderr, 1.0)
    low, high = (chosen.value + factor * (end - chosen.value) for end in chosen.interval)
    return replace(chosen, stderr=factor * chosen.stderr, ci95=(low, high))


def competing_effect(scores: Sequence[Score], name: str, independent: float) -> CompetingEffect | None:
    """What an effect that was not added would do to a size; None where the data cannot show it, or it does nothing.

    Parameters
    ----------
    scores
        Of the effect, one a clip, beside all that were added.
    name
        Parameter name of the size.
    independent
        Number of independent samples that the data are worth.
    """
    score = combined(scores)
    shifts = [clip.shifts[name] for clip in scores if name in clip.shifts]
    if not score.stderr > 0 or not shifts:
        return None
    shift = float(np.mean(shifts))
    log_weight = 0.5 * (score.z**2 - float(np.log(max(independent, 1.0))))
    return CompetingEffect(log_weight, shift * score.size, abs(shift) * score.stderr)


def averaged_over_competitors(chosen: Estimate, competitors: Sequence[CompetingEffect]) -> Estimate:
    """Widen a size for one more effect that may act; its value stays.

    Parameters
    ----------
    chosen
        The size, assuming no further missing effect.
    competitors
        Any one of which may act as well.
    """
    if not competitors or not chosen.stderr > 0:
        return chosen
    logs = np.array([0.0, *(competitor.log_weight for competitor in competitors)])
    weights = np.exp(logs - logs.max())
    means = chosen.value + np.array([0.0, *(competitor.shift for competitor in competitors)])
    spreads = np.hypot(chosen.stderr, [0.0, *(competitor.spread for competitor in competitors)])
    ends = float(np.min(means - FAR * spreads)), float(np.max(means + FAR * spreads))

    def below(value: float) -> float:
        return float(np.average(normal_cdf((value - means) / spreads), weights=weights))

    low, high = (brentq(lambda value, share=share: below(value) - share, *ends) for share in (0.025, 0.975))
    narrow = chosen.interval
    wide = min(low, narrow[0]), max(high, narrow[1])  # Student's t where that is wider
    factor = (wide[1] - wide[0]) / (narrow[1] - narrow[0])
    return replace(chosen, stderr=factor * chosen.stderr, ci95=wide)
