"""The library of effects to test, and the sign that the size of each effect may have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitters.image_effects import offered
from iris_sysid.diagnosis.refit import ModelWithEffects, pooled
from iris_sysid.diagnosis.screening import Candidate
from iris_sysid.types import ANY_SENSOR, Array, Effect, OdeModel, Sensor, Trajectory

FILMED = 0.1  # odds that a table whose sensor is not stated has the faults of a certain one, such as a camera


def two_sided(effect: Effect) -> Effect:
    """The effect without a lower bound of zero on its size, so that sizes near zero are estimated without bias."""
    size, *rest = effect.parameters
    return replace(effect, parameters=(replace(size, lower=-np.inf), *rest)) if size.lower == 0.0 else effect


def _as_plausible_as(effect: Effect, sensors: set[Sensor]) -> Effect:
    """The effect, less plausible where only some sensors can have it and none is stated."""
    unsure = "unknown" in sensors and effect.sensors != ANY_SENSOR
    return replace(effect, plausibility=FILMED * effect.plausibility) if unsure else effect


class EffectLibrary:
    """The effects to search, by name, with two-sided sizes. A purely dissipative effect must have a positive size.

    Parameters
    ----------
    effects
        The registered effects.
    model
        Only the effects that apply to it are searched,
    clips
        and of them those that the sensor of every clip can have.
    """

    def __init__(self, effects: Iterable[Effect], model: OdeModel, clips: Sequence[Trajectory]) -> None:
        sensors = {clip.sensor for clip in clips}
        effects = [_as_plausible_as(effect, sensors) for effect in offered(effects, model, clips)]
        self.by_name = {effect.name: two_sided(effect) for effect in effects}
        self._one_sided = frozenset(effect.name for effect in effects if effect.parameters[0].lower == 0.0)

    def allows(self, candidate: Candidate) -> bool:
        """Whether the first-order sizes of a candidate have an allowed sign in every clip."""
        names = self._one_sided & set(candidate.names)
        return all(start[name][0] >= 0.0 for start in candidate.starts for name in names)

    def allows_fit(self, model: ModelWithEffects) -> bool:
        """Whether the fitted sizes, averaged over all clips, have an allowed sign, and the shapes mean the effect."""
        if self.astray(model):
            return False
        sizes = [effect.parameters[0].name for effect in model.effects if effect.name in self._one_sided]
        return all(pooled(model.sizes_of(name)).value >= 0.0 for name in sizes)

    def astray(self, model: ModelWithEffects) -> list[Effect]:
        """The effects of a model whose fitted shapes no longer mean them in some clip, e.g. a moment outside it."""
        clips = [
            (fitted.t_s[fitted.used], {name: each.value for name, each in fitted.estimates.items()})
            for fitted in model.fits
        ]
        return [effect for effect in model.effects if not all(is_sensible(effect, *clip) for clip in clips)]


def is_sensible(effect: Effect, t_s: Array, values: Mapping[str, float]) -> bool:
    """Whether fitted parameters, by name, still mean an effect in a clip with samples at ``t_s`` (n,), s."""
    return effect.is_meant(t_s, [values[each.name] for each in effect.parameters])
