"""Sets of effects on a driven motion, ranked in weak form: without a free run, in milliseconds each.

Where an input drives a body against what its equation lacks, the free run leaves the data, and neither its residual nor
first-order tests along it tell what is missing. In weak form each window errs by itself (:mod:`fitters.ode.weak_fit`):
effects are added one by one while they remove a good part of what remains. The free run of the sets that come out of it
then decides, over blocks left out, as everywhere. All samples of a long record count: its first ones may hold no
reversal. Only what has a memory, which is followed from sample to sample, must first be the best in those.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitters.effect_sensitivity import forces_along
from fitters.effect_shapes import shapes_tried
from fitters.ode import FitRequest
from fitters.ode.weak_fit import WeakFit, is_observed, weak_fit, weak_gains
from iris_sysid.diagnosis.block_means import at_samples, first_samples
from iris_sysid.diagnosis.evidence import DECISIVE
from iris_sysid.diagnosis.held_out_blocks import ALIKE, MIN_SHARE, SURE, BlockErrors, wins
from iris_sysid.diagnosis.library import EffectLibrary, is_sensible
from iris_sysid.diagnosis.refit import ModelWithEffects, Starts, composed_model, estimate_values, weak_request
from iris_sysid.diagnosis.screening import Candidate
from iris_sysid.types import Array, Effect, OdeModel

MAX_SHAPES = 12  # of an effect that are tried
OVERLAP = 2.0  # windows that count as one independent value: they are half a window apart


@dataclass(frozen=True, eq=False, slots=True)
class WeakSet:
    """Effects and their weak fit to each clip."""

    effects: tuple[Effect, ...]
    fits: tuple[WeakFit, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects in the order in which they were added."""
        return tuple(effect.name for effect in self.effects)

    @property
    def squares(self) -> float:
        """Sum of squares of the residual in weak form."""
        return sum(fit.squares for fit in self.fits)

    @property
    def free(self) -> int:
        """Number of values fitted, in all clips."""
        return sum(len(fit.stderr) for fit in self.fits)

    @property
    def cost(self) -> float:
        """Bayesian information criterion of the windows."""
        independent = sum(fit.residual.size for fit in self.fits) / OVERLAP
        return float(independent * np.log(max(self.squares, 1e-300)) + self.free * np.log(max(independent, 2.0)))

    @property
    def starts(self) -> tuple[Starts, ...]:
        """The sizes and shapes of the effects, one a clip."""
        names = {effect.name: [parameter.name for parameter in effect.parameters] for effect in self.effects}
        return tuple(
            {name: (fit.values[own[0]], tuple(fit.values[each] for each in own[1:])) for name, own in names.items()}
            for fit in self.fits
        )

    @property
    def estimates(self) -> tuple[dict[str, tuple[float, float]], ...]:
        """The fitted values and their standard errors by name, one a clip."""
        return tuple({name: (fit.values[name], error) for name, error in fit.stderr.items()} for fit in self.fits)

    def errors(self) -> BlockErrors:
        """The mean squared residual of each block of windows by a fit without it."""
        parts = [fit.block_squares() for fit in self.fits]
        squares, counts = (np.concatenate(each) for each in zip(*parts, strict=True))
        return BlockErrors(squares, counts, float("nan"))

    def share_over(self, shorter: WeakSet) -> float:
        """The fraction of another set's squared residual over blocks left out that this one removes."""
        return 1.0 - self.errors().mean / max(shorter.errors().mean, 1e-300)


class WeakRanking:
    """Effects of a library that act on the force or on the input of driven clips, ranked in weak form.

    Parameters
    ----------
    clips
        The fit requests, whose trajectories are smoothed.
    model
        The governing equation without effects.
    library
        The effects to test.
    """

    def __init__(self, clips: Sequence[FitRequest], model: OdeModel, library: EffectLibrary) -> None:
        self._clips, self._model, self._library = clips, model, library
        self._found: dict[frozenset[str], list[WeakSet]] = {}
        first = [_first_samples(clip) for clip in clips]
        long = any(part is not whole for part, whole in zip(first, clips, strict=True))
        self._short = WeakRanking(first, model, library) if long else None

    def grown(self, base: ModelWithEffects, most: int) -> list[WeakSet]:
        """Sets of effects that each remove a good part of what remained: the largest, then without its last effect.

        Empty where the weak form does not apply, or no effect removes enough.

        Parameters
        ----------
        base
            The model without effects. Where its free run follows the data, that says more.
        most
            Largest number of effects.
        """
        smoothed = all(clip.trajectory.smoothed is not None for clip in self._clips)
        if not (self._model.inputs and is_observed(self._model) and smoothed and base.far_off):
            return []
        sets: list[WeakSet] = []
        current = self._bare(base)
        while current is not None and len(sets) < most:
            longer = next(iter(self._longer(current)), None)
            if longer is None or not _is_better(longer, current):
                break
            sets.append(longer)
            current = longer
        return sets[::-1]

    def explained(self, base: ModelWithEffects, found: WeakSet) -> float:
        """The fraction of the squares in blocks left out that the effects of a set remove; NaN where there is no base.

        Parameters
        ----------
        base
            The model without effects.
        found
            The set.
        """
        bare = self._bare(base)
        return float("nan") if bare is None else found.share_over(bare)

    def _bare(self, base: ModelWithEffects) -> WeakSet | None:
        return self._of((), [estimate_values(fitted) for fitted in base.fits])

    def judged(self, found: WeakSet, effect: Effect) -> tuple[float, dict[str, float]]:
        """The share of the squares that an effect removes beside the others, and the odds of it and its rivals by name.

        Parameters
        ----------
        found
            The set.
        effect
            One of its effects.
        """
        others = [other for other in found.effects if other.name != effect.name]
        rest = self._of(others, [fit.values for fit in found.fits])
        if rest is None:
            return float("nan"), {effect.name: 1.0}
        alike = [
            each
            for each in self._longer(rest)
            if each.names[-1] not in found.names
            and each.squares <= ALIKE * found.squares
            and (each.free <= found.free or each.cost < found.cost)
        ]
        odds = {effect.name: found, **{each.names[-1]: each for each in alike}}
        return found.share_over(rest), wins({name: each.errors() for name, each in odds.items()})

    def candidate(self, found: WeakSet) -> Candidate:
        """The effects of a set, to be refitted."""
        return Candidate(found.names, found.starts, 0.0, 1.0)

    def _longer(self, current: WeakSet) -> list[WeakSet]:
        """All sets with one more effect, each in its best shape and of a possible sign, least criterion first."""
        key = frozenset(current.names)
        if key not in self._found:
            others = [effect for effect in self._library.by_name.values() if _acts(effect) and effect.name not in key]
            sets = [self._added(current, effect) for effect in others]
            self._found[key] = sorted([each for each in sets if each is not None], key=lambda each: each.cost)
        return self._found[key]

    def _added(self, current: WeakSet, effect: Effect) -> WeakSet | None:
        if effect.memory and self._short is not None:
            return self._remembering(self._short, current, effect)
        clip = self._clips[0].trajectory
        valid = np.flatnonzero(clip.valid)
        given = clip.inputs_at(clip.t_s[valid])
        shapes = shapes_tried(effect, self._model, clip.t_s[valid], clip.position[valid], given)
        ranked = effect.acceleration is not None and len(shapes) > 1 and len(self._clips) == 1
        if ranked or (effect.memory and shapes):
            shapes = self._nearest(current, effect, shapes)
        names = [parameter.name for parameter in effect.parameters]
        sets: list[WeakSet] = []
        for shape in shapes[:MAX_SHAPES]:
            chosen = shape or [parameter.default or 0.0 for parameter in effect.parameters[1:]]
            begin = dict(zip(names, (0.0, *chosen), strict=True))
            found = self._of((*current.effects, effect), [{**fit.values, **begin} for fit in current.fits])
            if found is not None and self._library.allows(self.candidate(found)):
                sets.append(found)
                if ranked:
                    break
        if effect.memory:  # a slow or a long memory is any slow force
            sets = [each for each in sets if is_sensible(effect, clip.t_s[valid], each.fits[0].values)]
        return min(sets, key=lambda each: each.squares, default=None)

    def _remembering(self, short: WeakRanking, current: WeakSet, effect: Effect) -> WeakSet | None:
        """The set with an effect with a memory, where that is the best in the first samples: it is slow to follow."""
        before = short._of(current.effects, [fit.values for fit in current.fits])
        best = None if before is None else next(iter(short._longer(before)), None)
        if before is None or best is None or best.names[-1] != effect.name or not _is_better(best, before):
            return None
        whole = self._of(best.effects, [fit.values for fit in best.fits])
        return whole if whole is not None and self._library.allows(self.candidate(whole)) else None

    def _nearest(
        self, current: WeakSet, effect: Effect, shapes: Sequence[tuple[float, ...]]
    ) -> list[tuple[float, ...]]:
        """The shapes, those first that explain most to first order, as a force goes with its size.

        Of a memory, which takes long to follow in a fit of each, the first alone, if it explains enough.
        """
        sizes = np.array([[0.0, *shape] for shape in shapes])
        values = current.fits[0].values
        model = composed_model(self._clips[0], values, self._model, current.effects)

        def forces(t_s: Array, states: Array, slopes: Array) -> Array:
            return forces_along(effect, sizes, model, t_s, states, slopes)

        gains = weak_gains(weak_request(self._clips[0], model, values), values, forces)
        if gains is None:
            return []
        if effect.memory:
            return [shapes[int(np.argmax(gains))]] if np.max(gains) >= MIN_SHARE else []
        return [shapes[k] for k in np.argsort(-gains, kind="stable")]

    def _of(self, effects: Sequence[Effect], starts: Sequence[Mapping[str, float]]) -> WeakSet | None:
        fits: list[WeakFit] = []
        for clip, start in zip(self._clips, starts, strict=True):
            composed = composed_model(clip, start, self._model, effects)
            found = weak_fit(weak_request(clip, composed, start))
            if found is None:
                return None
            fits.append(found)
        return WeakSet(tuple(effects), tuple(fits))


def _first_samples(clip: FitRequest) -> FitRequest:
    """The request with the first samples of a long driven record alone; that of another one as it is."""
    used = np.flatnonzero(clip.trajectory.valid)
    kept = first_samples(used)
    if clip.trajectory.inputs is None or kept.size == used.size:
        return clip
    return clip.with_(trajectory=at_samples(clip.trajectory, kept))


def _acts(effect: Effect) -> bool:
    """Whether an effect is a force or changes the input, and cannot imitate a piece of anything."""
    return (effect.acceleration is not None or effect.drive is not None) and not effect.absorbs


def _is_better(longer: WeakSet, current: WeakSet) -> bool:
    """Whether one more effect removes enough, surely and in most block bootstraps."""
    enough = longer.share_over(current) >= MIN_SHARE and current.cost - longer.cost > DECISIVE
    return enough and longer.errors().share_below(current.errors()) >= SURE
