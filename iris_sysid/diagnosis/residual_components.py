"""The components of the residuals of all clips, and effects ranked beside a flexible rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitters.components import ClipResidual, RankedSet, log_odds_over_curves, ranked_sets, split
from fitters.components.noisy_residual import NoisyResidual
from fitters.effect_sensitivity import motion_of, sensitivities
from fitters.ode import FitRequest
from iris_sysid.diagnosis.block_means import Residuals, block_means
from iris_sysid.diagnosis.evidence import chosen_values
from iris_sysid.diagnosis.measurement_errors import unit_noise
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.types import Array, Components, Effect, FitResult


def components_of(clips: Sequence[FitRequest], fits: Sequence[FitResult]) -> Components | None:
    """The components of the residual of one fit, or of the fits of several clips together.

    Parameters
    ----------
    clips
        The fit requests.
    fits
        Their fits, all of one model.

    Returns
    -------
    Components or None
        None where there are too few samples, or where the motion is not smooth enough for its linear response; nor
        where a fit does not follow the motion: its residual is too large for that.
    """
    if not all(fitted.follows for fitted in fits):
        return None
    residuals = _every_residual(clips, fits)
    return split(residuals) if residuals else None


def clip_residual(clip: FitRequest, fitted: FitResult) -> ClipResidual | None:
    """The residual of one fit as the components need it; None where a number of it is not finite."""
    means = _means(clip, fitted)
    motion = motion_of(means.fitted, means.trajectory)
    used = means.fitted.used
    jacobian = means.fitted.jacobian.reshape(*means.noise.shape, -1)
    residual = NoisyResidual(motion.grid[motion.at_samples], means.fitted.residual[used], jacobian, means.noise)
    finite = all(np.all(np.isfinite(each)) for each in (jacobian, residual.values, motion.states, motion.slopes))
    if not finite or not np.all(means.noise > 0) or used.sum() < 4:
        return None
    return ClipResidual(motion, residual, means.fitted.predicted[used])


def odds_over_curves(clips: Sequence[FitRequest], without: ModelWithEffects, beside: ModelWithEffects) -> float:
    """Log odds that what a model adds explains the data, and not curves of any shape in its place.

    Minus infinity where the residuals cannot be split.

    Parameters
    ----------
    clips
        The fit requests.
    without, beside
        The models without the effect and with it, both fitted.
    """
    before, after = (_every_residual(clips, model.fits) for model in (without, beside))
    if not before or not after:
        return -np.inf
    return log_odds_over_curves(before, after, _count_values(beside) - _count_values(without))


def _count_values(model: ModelWithEffects) -> int:
    """How many values are fitted to all clips, or chosen among many and not fitted."""
    return sum(len(fitted.free) + chosen_values(model) for fitted in model.fits)


def _every_residual(clips: Sequence[FitRequest], fits: Sequence[FitResult]) -> list[ClipResidual]:
    """The residuals of fits, one a clip; none where one of them cannot be split."""
    residuals = [clip_residual(clip, fitted) for clip, fitted in zip(clips, fits, strict=True)]
    known = [residual for residual in residuals if residual is not None]
    return known if len(known) == len(residuals) else []


def _means(clip: FitRequest, fitted: FitResult) -> Residuals:
    noise = unit_noise(fitted, clip.trajectory)[fitted.used]
    return block_means(Residuals(fitted, clip.trajectory, noise, np.zeros_like(noise)))


def ranked_effects(
    clips: Sequence[FitRequest],
    fits: Sequence[FitResult],
    effects: Mapping[str, tuple[Effect, tuple[float, ...]]],
    log_odds: Mapping[str, float],
    largest: int,
) -> list[RankedSet]:
    """Sets of effects, the best first, each with its log evidence beside a slow wander and noise with a memory.

    Parameters
    ----------
    clips, fits
        The fits without the effects, one a clip.
    effects
        By name, each with the values of its parameters after the first.
    log_odds
        Of each effect before the data.
    largest
        Number of effects in a set.
    """
    residuals: list[ClipResidual] = []
    changes: dict[str, list[Array]] = {name: [] for name in effects}
    for clip, fitted in zip(clips, fits, strict=True):
        residual = clip_residual(clip, fitted)
        if residual is None:
            return []
        residuals.append(residual)
        means = _means(clip, fitted)
        for name, (effect, shape) in effects.items():
            shapes = [shape]
            changes[name].append(sensitivities(effect, shapes, means.fitted, means.trajectory, residual.motion)[0])
    seen = {name: each for name, each in changes.items() if _is_seen(each)}
    return ranked_sets(residuals, seen, log_odds, largest)


def _is_seen(changes: Sequence[Array]) -> bool:
    return all(np.all(np.isfinite(change)) and np.any(change) for change in changes)
