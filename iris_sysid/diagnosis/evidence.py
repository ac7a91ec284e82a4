"""How much better one set of effects explains the data than another: a criterion for correlated noise.

The difference of two Bayesian information criteria (Schwarz 1978, Ann. Stat. 6, 461): that of chi-square, where the
residuals are whitened by the autoregression of the better model's residual, that of the number of free values times
the logarithm of the sample count, and twice the logarithm of the odds that the effects had before the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitters.noise.autoregression import MAX_ORDER, burg, choose_order, grid_positions, on_grid, whiten
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.types import Array, FitResult

DECISIVE = float(2 * np.log(20.0))  # odds of 20 to 1: "strong evidence" of Kass and Raftery (1995), JASA 90, 773
CREDIBLE = 0.99  # of the probability, which the names of a class hold


def cost_above(first: ModelWithEffects, second: ModelWithEffects) -> float:
    """By how much the criterion of ``first`` is larger than that of ``second``, both fitted to the same clips."""
    each_clip = zip(first.fits, second.fits, first.units, strict=True)
    chosen = chosen_values(first) - chosen_values(second)
    clips = sum(_clip_difference(*clip, chosen) for clip in each_clip)
    return clips + _whole_cost(first) - _whole_cost(second)


def best_first(models: Sequence[ModelWithEffects]) -> list[ModelWithEffects]:
    """The models, smallest criterion first."""
    if len(models) < 2:
        return list(models)
    closest = min(models, key=lambda model: model.squares)
    return sorted(models, key=lambda model: cost_above(model, closest))


def credible(above: Mapping[str, float], own: str) -> dict[str, float]:
    """The smallest set of names that holds CREDIBLE of the probability, and the probability of each, largest first.

    Parameters
    ----------
    above
        By name, how far the criterion is above that of a common model.
    own
        The name that is in the set in any case.
    """
    least = min(above.values())
    weights = {name: float(np.exp(-0.5 * (above[name] - least))) for name in sorted(above, key=above.__getitem__)}
    held = np.cumsum(list(weights.values())) / sum(weights.values())
    likely = {own, *list(weights)[: 1 + int(np.searchsorted(held, CREDIBLE))]}
    total = sum(weights[name] for name in likely)
    return {name: weight / total for name, weight in weights.items() if name in likely}


def chosen_values(model: ModelWithEffects) -> int:
    """How many values a clip has that were chosen among many and not fitted, such as the moment of a lost frame."""
    return sum(effect.is_placed for effect in model.effects)


def _whole_cost(model: ModelWithEffects) -> float:
    """Of the effects before the data, and of sizes that do not go with the bodies of the clips as they should."""
    return model.disagreement - 2.0 * sum(float(np.log(effect.plausibility)) for effect in model.effects)


def _clip_difference(first: FitResult, second: FitResult, unit: Array, chosen: int) -> float:
    """Difference of the criterion for one clip, over the samples that both fits use; ``unit`` (n, d) of residuals.

    ``chosen``: how many more values of the first were chosen and not fitted.
    """
    both = first.used & second.used
    residuals = [(fitted.residual[both] / unit[both]) for fitted in (first, second)]
    chi2 = sum(
        _whitened_difference(first.t_s[both], one, other) for one, other in zip(*(r.T for r in residuals), strict=True)
    )
    values = len(first.free) - len(second.free) + chosen
    priors = float(np.sum(first.prior_residual**2) - np.sum(second.prior_residual**2))
    return chi2 + priors + values * cost_of_value(int(both.sum()) * len(first.rms))


def cost_of_value(count: int) -> float:
    """What one more free value of a clip costs, by the ``count`` of the numbers that were measured."""
    return float(np.log(max(count, 2)))


def _whitened_difference(t_s: Array, first: Array, second: Array) -> float:
    """Chi-square of the first residual (n,) less that of the second, at times (n,) s; noise as the smaller one has."""
    sums = float(np.sum(first**2)), float(np.sum(second**2))
    sign, (better, worse) = (1.0, (second, first)) if sums[0] >= sums[1] else (-1.0, (first, second))
    positions = grid_positions(t_s)
    columns = np.column_stack([on_grid(positions, values, np.nan) for values in (better, worse)])
    partial, variance = burg(columns[:, 0], int(np.clip(better.size // 10, 0, MAX_ORDER)))
    white, _ = whiten(columns, partial[: choose_order(variance, better.size)])
    squares = np.sum(white**2, axis=0)
    return sign * float((squares[1] - squares[0]) * better.size / max(squares[0], 1e-300))
