"""The error of an effect's size when other effects may act too: Bayesian model averaging, to first order.

An interval that assumes no further missing effect is too narrow: a second effect, too small to be detected, can still
bias the size of the first. So the interval is that of a mixture of models: without a further effect, and with each one
more effect of the library (Hoeting, Madigan, Raftery and Volinsky 1999, Stat. Sci. 14, 382). All have the same prior
probability and the weight exp(-BIC / 2) (Raftery 1995, Sociol. Methodol. 25, 111).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from iris_sysid.diagnosis.score_test import combined
from iris_sysid.types import NORMAL_975, Estimate, Score, normal_cdf

FAR = 8.0  # standard errors that bracket the quantiles of a mixture: the probability beyond is 1e-15


@dataclass(frozen=True, slots=True)
class CompetingEffect:
    """How one more effect would change a size: it adds ``shift``, and the standard error ``spread``, in its unit.

    ``log_weight`` is the logarithm of its probability over that of no further effect.
    """

    log_weight: float
    shift: float
    spread: float


def averaged_over_alternatives(chosen: Estimate, alternatives: Sequence[tuple[Estimate, float]]) -> Estimate:
    """Widen the interval of a size for the choice among sets of effects that explain the data equally well.

    The value does not change; its error is the unconditional standard error of Buckland, Burnham and Augustin (1997,
    Biometrics 53, 603).

    Parameters
    ----------
    chosen
        The size in the model with the added effects.
    alternatives
        The size in each alternative model, and by how much its criterion is larger
        (:func:`iris_sysid.diagnosis.evidence.cost_above`).
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


def spanning(chosen: Estimate, alternatives: Sequence[Estimate]) -> Estimate:
    """Widen the interval of a value to those of models that predict as well: none of them can be ruled out.

    Parameters
    ----------
    chosen
        The value in one of the models.
    alternatives
        The value in each of the others.
    """
    if not alternatives:
        return chosen
    intervals = np.array([each.interval for each in (chosen, *alternatives)])
    low, high = float(np.nanmin(intervals[:, 0])), float(np.nanmax(intervals[:, 1]))
    reach = max(chosen.value - low, high - chosen.value)
    return replace(chosen, stderr=max(chosen.stderr, reach / NORMAL_975), ci95=(low, high))


def with_larger_error(known: Estimate, stderr: float) -> Estimate:
    """A value with a standard error at least so large; its interval, of few blocks perhaps, gets no narrower by it.

    Parameters
    ----------
    known
        The value.
    stderr
        In its unit.
    """
    if not stderr > known.stderr:
        return known
    return replace(spanning(known, [replace(known, stderr=stderr, ci95=None)]), stderr=stderr)


def competing_effect(scores: Sequence[Score], name: str, independent: float) -> CompetingEffect | None:
    """How an effect that was not added would change a size; None where the data cannot show it, or it changes nothing.

    Parameters
    ----------
    scores
        Scores of the effect in the final model, one a clip.
    name
        Parameter name of the size.
    independent
        Effective number of independent samples.
    """
    score = combined(scores)
    shifts = [clip.shifts[name] for clip in scores if name in clip.shifts]
    if not score.stderr > 0 or not shifts:
        return None
    shift = float(np.mean(shifts))
    log_weight = 0.5 * (score.z**2 - float(np.log(max(independent, 1.0))))
    return CompetingEffect(log_weight, shift * score.size, abs(shift) * score.stderr)


def averaged_over_competitors(chosen: Estimate, competitors: Sequence[CompetingEffect]) -> Estimate:
    """Widen the interval of a size for one more effect that may act. The value does not change.

    Parameters
    ----------
    chosen
        The size, assuming no further missing effect.
    competitors
        Alternative effects: one of them may act too.
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
