"""The error of an effect's size when it is not known what else is lacking, or which of two companions is.

An interval of a size holds if nothing else is. What the data cannot show beside an effect can still have taken part of
its size, or given it some. So the interval is that of a mixture over there being nothing else and there being one more
effect of the library: Bayesian model averaging (Hoeting, Madigan, Raftery and Volinsky 1999, Stat. Sci. 14, 382), each
effect as likely beforehand as none, with the weight exp(-BIC / 2) (Raftery 1995, Sociol. Methodol. 25, 111), to first
order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from iris_sysid.diagnosis.score_test import Score, combined
from iris_sysid.types import Estimate

FAR = 8.0  # standard errors within which quantiles of a mixture lie: beyond is 1e-15


@dataclass(frozen=True, slots=True)
class Companion:
    """What one more effect would do to a size: ``shift`` and the additional standard error ``spread``, in its unit.

    ``log_weight`` is how likely it is to be there beside nothing more being there.
    """

    log_weight: float
    shift: float
    spread: float


def among(chosen: Estimate, others: Sequence[tuple[Estimate, float]]) -> Estimate:
    """A size with the choice between companions that explain the data as well in its interval and standard error.

    The unconditional standard error of Buckland, Burnham and Augustin (1997, Biometrics 53, 603), about the value
    beside the effects that were added.

    Parameters
    ----------
    chosen
        Beside the effects that were added.
    others
        Beside others, and by how much these cost more (:attr:`State.cost`).
    """
    if not others or not chosen.stderr > 0:
        return chosen
    costs = np.array([0.0, *(cost for _, cost in others)])
    errors = [np.hypot(one.stderr, one.value - chosen.value) for one in (chosen, *(one for one, _ in others))]
    weights = np.exp(-0.5 * (costs - costs.min()))
    wider = max(float(np.average(np.nan_to_num(errors), weights=weights)) / chosen.stderr, 1.0)
    low, high = (chosen.value + wider * (end - chosen.value) for end in chosen.interval)
    return replace(chosen, stderr=wider * chosen.stderr, ci95=(low, high))


def companion(scores: Sequence[Score], name: str, independent: float) -> Companion | None:
    """The companion that an effect is to a size; None where the data cannot show it, or it does not concern the size.

    Parameters
    ----------
    scores
        Of the effect, one a clip, beside all that were added.
    name
        Of the size.
    independent
        How many independent samples the data are worth.
    """
    together = combined(scores)
    each = [one.shifts[name] for one in scores if name in one.shifts]
    if not together.stderr > 0 or not each:
        return None
    by_unit = float(np.mean(each))
    log_weight = 0.5 * (together.z**2 - float(np.log(max(independent, 1.0))))
    return Companion(log_weight, by_unit * together.size, abs(by_unit) * together.stderr)


def beside(chosen: Estimate, companions: Sequence[Companion]) -> Estimate:
    """A size with what else may be lacking in its interval and standard error; its value stays.

    Parameters
    ----------
    chosen
        If nothing else is.
    companions
        Any of which may be there as well.
    """
    if not companions or not chosen.stderr > 0:
        return chosen
    logs = np.array([0.0, *(one.log_weight for one in companions)])
    weights = np.exp(logs - logs.max())
    means = chosen.value + np.array([0.0, *(one.shift for one in companions)])
    spreads = np.hypot(chosen.stderr, [0.0, *(one.spread for one in companions)])
    ends = float(np.min(means - FAR * spreads)), float(np.max(means + FAR * spreads))

    def below(at: float) -> float:
        return float(np.average(norm.cdf((at - means) / spreads), weights=weights))

    low, high = (brentq(lambda at, share=share: below(at) - share, *ends) for share in (0.025, 0.975))
    narrow = chosen.interval
    wide = min(low, narrow[0]), max(high, narrow[1])  # Student's where that is wider
    wider = (wide[1] - wide[0]) / (narrow[1] - narrow[0])
    return replace(chosen, stderr=wider * chosen.stderr, ci95=wide)
