"""What each effect of a model explains: alone, beside the others, and over blocks that its fit did not see."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.held_out_blocks import (
    ALIKE,
    MIN_SHARE,
    SURE,
    BlockErrors,
    every_block,
    held_out_errors,
)
from iris_sysid.diagnosis.linearised_blocks import linearised_errors
from iris_sysid.diagnosis.measurement_errors import is_resolved
from iris_sysid.diagnosis.refit import ModelWithEffects, Starts
from iris_sysid.diagnosis.relative_size import relative_size
from iris_sysid.types import Effect

WINS = 0.8  # share of block bootstraps in which a named effect must predict better than a rival
NAMED_SHARE = 0.25  # of the squared error over blocks left out that a named effect removes, others being in the model


class Contributions:
    """The share of each effect in what a model explains, and its errors over blocks left out, each computed once.

    Parameters
    ----------
    cache
        Refits of the clips.
    """

    def __init__(self, cache: FitCache) -> None:
        self._cache = cache
        self._blocks = every_block(cache.base.fits)
        self._errors: dict[frozenset[str], BlockErrors] = {}
        self._estimated: dict[frozenset[str], BlockErrors] = {}
        self._certain: frozenset[str] = frozenset()

    def trust(self, names: Iterable[str]) -> None:
        """From here on these effects, although they can imitate anything, are named: each other one acts beside them.

        Parameters
        ----------
        names
            Of the effects.
        """
        self._certain = frozenset(names)

    @property
    def base(self) -> ModelWithEffects:
        """The model without effects."""
        return self._cache.base

    @property
    def testable(self) -> bool:
        """Whether the clips are long enough to leave out blocks."""
        return bool(self._blocks)

    def errors(self, model: ModelWithEffects) -> BlockErrors:
        """The errors of a model over blocks that its fits did not see."""
        if model.key not in self._errors:
            self._cache.report(f"predicting blocks left out with {', '.join(model.names_in_order) or 'no effect'}")
            self._errors[model.key] = replace(
                held_out_errors(self._cache.clips, model, self._blocks), usual=self._usual
            )
        return self._errors[model.key]

    def estimate(self, model: ModelWithEffects) -> BlockErrors:
        """The same to first order, without a fit."""
        return replace(self._linearised(model), usual=self._usual)

    def _linearised(self, model: ModelWithEffects) -> BlockErrors:
        if model.key not in self._estimated:
            self._estimated[model.key] = linearised_errors(model, self._blocks)
        return self._estimated[model.key]

    @cached_property
    def _usual(self) -> float:
        """The median squared error over blocks of the model without effects; that of the noise where it is smaller."""
        return max(float(np.median(self._linearised(self.base).squares)), 1.0)

    def heldout(self, model: ModelWithEffects) -> tuple[float, float]:
        """The error over blocks left out: root mean square, in the observed unit and in units of the noise; or NaN."""
        if not self.testable:
            return float("nan"), float("nan")
        errors = self.errors(model)
        return errors.rms, float(np.sqrt(errors.mean))

    def predicts_as_well(self, model: ModelWithEffects, other: ModelWithEffects) -> bool:
        """Whether a model with possible sizes predicts blocks left out about as well as another one."""
        if not self.allows(model):
            return False
        errors, others = self.estimate(model), self.estimate(other)
        return errors.score <= ALIKE * others.score or others.share_below(errors) < WINS

    def allows(self, model: ModelWithEffects) -> bool:
        """Whether a refit succeeded, with sizes that are possible."""
        return model.usable and self._cache.library.allows_fit(model) and self._is_plausible(model)

    def _is_plausible(self, model: ModelWithEffects) -> bool:
        """Whether no effect is larger than it can be: beyond that it only cancels another one, or a fitted value."""
        clip, base = self._cache.clips[0], self._cache.base.fits[0].model
        return all(
            relative_size(effect, model.fits[0], base, clip.trajectory) <= effect.largest for effect in model.effects
        )

    def is_resolved(self, before: ModelWithEffects, after: ModelWithEffects) -> bool:
        """Whether a step changes the prediction of a clip by more than its stated errors."""
        if not before.usable:
            return True
        fits = zip(before.fits, after.fits, self._cache.clips, strict=True)
        return any(is_resolved(one, other, clip.trajectory) for one, other, clip in fits)

    def alone(self, model: ModelWithEffects, effect: Effect) -> float:
        """The fraction of the residual that an effect of a model removes without the others."""
        alone = self._cache.with_effects([effect], starts_of(model, [effect]))
        return removed_share(self._cache.base, alone) if alone.usable else 0.0

    def removed(self, model: ModelWithEffects, effect: Effect) -> float:
        """The fraction of the squared error over blocks left out that an effect removes beside the others.

        NaN where no model without the effect can be fitted.
        """
        each = [self.removed_in(context, effect) for context in self.contexts(model, effect)] if self.testable else []
        return max((share for share in each if not math.isnan(share)), default=math.nan)

    def removed_in(self, model: ModelWithEffects, effect: Effect) -> float:
        """The same in this model alone; NaN where the model without the effect cannot be fitted."""
        rest = self._cache.without(model, effect)
        if not rest.usable:
            return float("nan")
        before, after = self.estimate(rest).mean, self.estimate(model).mean
        return float(1.0 - after / before) if np.isfinite(after) and 0 < before < np.inf else float("nan")

    def share_of(self, model: ModelWithEffects, effect: Effect) -> float:
        """The fraction that an effect has in what the effects of a model remove of the residual.

        What others remove that imitate anything and are named for themselves does not count: it says nothing of this
        one, however large it is.
        """
        return max(self._share_in(each, effect) for each in self.contexts(model, effect))

    def _share_in(self, model: ModelWithEffects, effect: Effect) -> float:
        rest = self._cache.without(model, effect)
        certain = [other for other in model.effects if other.name in self._certain and other is not effect]
        known = self._cache.with_effects(certain, starts_of(model, certain)) if certain else self._cache.base
        explained = max((known if known.usable else self._cache.base).squares - model.squares, 1e-300)
        return (rest.squares - model.squares) / explained if rest.usable else 1.0

    def contexts(self, model: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """The models in which an effect counts: as it is, and of one curve without what can imitate it.

        What is named for itself stays: without it a curve would be credited with imitating it.
        """
        certain = self._certain
        kept = [other for other in model.effects if other is effect or not other.absorbs or other.name in certain]
        if effect.is_flexible or len(kept) == len(model.effects):
            return [model]
        alone = self._cache.with_effects(kept, starts_of(model, kept))
        return [model, alone] if alone.usable else [model]

    def is_small(self, model: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect is a small part of what the model explains, and of the error over blocks left out."""
        return self.share_of(model, effect) < MIN_SHARE and not self.removed(model, effect) >= NAMED_SHARE


def is_surely_better(model: ModelWithEffects, errors: BlockErrors, before: BlockErrors) -> bool:
    """Whether errors are smaller than those before in most bootstraps, and no size changes its sign without a block."""
    steady = all(errors.is_steady(effect.parameters[0].name) for effect in model.effects)
    return steady and errors.share_below(before) >= SURE


def removed_share(before: ModelWithEffects, after: ModelWithEffects) -> float:
    """The fraction of the residual's sum of squares that a step removes."""
    return (before.squares - after.squares) / max(before.squares, 1e-300)


def starts_of(model: ModelWithEffects, effects: Sequence[Effect]) -> tuple[Starts, ...]:
    """The fitted sizes and shapes of some effects of a model, one a clip."""
    return tuple(
        {
            effect.name: (values[0], tuple(values[1:]))
            for effect in effects
            for values in [[fitted.estimates[parameter.name].value for parameter in effect.parameters]]
        }
        for fitted in model.fits
    )
