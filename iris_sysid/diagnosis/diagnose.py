"""Close the loop: find what a fit leaves over, name the effect that the model lacks, add it, say what changed.

1. Fit the model to every clip. 2. Screen every effect that applies by a score test: its sensitivity, freed of what
the fitted parameters can imitate, against the residual. 3. Refit with the best few; the one that explains most is
added when it is significant at 5 % over the whole library, autocorrelation allowed for, when it moves the trajectory
by more than its samples are said to be wrong by, and when samples that were held out are predicted better. Where no
single effect is, pairs are tried. 4. Repeat until nothing is significant; each time, effects that the others have made
needless go, and those with a better rival are replaced. Effects that do as well as the one added are named beside it,
and for every effect that was not added there is an upper limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from iris_sysid.diagnosis.notes import gains, reservations
from iris_sysid.diagnosis.refit import Clip, Errors, State
from iris_sysid.diagnosis.score_test import Score, combined
from iris_sysid.diagnosis.stepwise_search import Search
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.types import DiscoveredTerm, Effect, Estimate, FitResult, OdeModel, Trajectory

ABOVE_NOISE = 1.1  # times the noise floor, which is itself known to a few percent: more is left than noise


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest size of an effect that the data allow, at 95 % confidence; NaN where they say nothing.

    No less than what the errors that the track states may hide.
    """

    effect: str
    parameter: str
    upper_95: float
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class Diagnosis:
    """What a model lacks, if anything.

    ``bases`` and ``finals`` are fits to the same samples, one a clip, without and with the effects; ``added`` are
    the effects in the order in which they were found, ``sizes`` by parameter name their size over all clips, with what
    else the library has that may be there instead, or as well, in its error.
    ``rounds`` hold the screen of each round, best first. ``indistinguishable`` names, for each effect added, those
    that explain the data as well. ``noise_floor`` is the noise of the measurement. ``proposed`` are terms without a
    named effect, for what is left above that floor. ``notes`` say what could not be asked, or answered, and why.
    """

    bases: tuple[FitResult, ...]
    finals: tuple[FitResult, ...]
    added: tuple[Effect, ...]
    sizes: Mapping[str, Estimate]
    rounds: tuple[tuple[Score, ...], ...]
    indistinguishable: Mapping[str, tuple[str, ...]]
    ruled_out: tuple[Limit, ...]
    before: Errors
    after: Errors
    noise_floor: float
    unit: str
    proposed: tuple[DiscoveredTerm, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def base(self) -> FitResult:
        """The first clip's fit without the effects."""
        return self.bases[0]

    @property
    def final(self) -> FitResult:
        """The first clip's fit with the effects."""
        return self.finals[0]


def diagnose(
    trajectories: Trajectory | Sequence[Trajectory],
    model: OdeModel,
    *,
    fixed: Mapping[str, float | Estimate] | None = None,
    free: Sequence[str] = (),
    effects: Sequence[Effect] | None = None,
    holdout: float = 0.3,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find the effects that a model lacks, add them, and measure the error before and after.

    Parameters
    ----------
    trajectories
        What was measured: one clip, or several of the same kind. Each clip has its own values of the model's
        parameters; an effect has the same size in all, up to the scatter that they show.
    model
        The governing equation to question.
    fixed
        Known values by name.
    free
        Constants of the model to estimate as well.
    effects
        What it may lack; every registered effect that applies when not given.
    holdout
        Share of each clip, at its end, that the held-out error is computed on after fitting the rest.
    progress
        Called with a line of text at each step.

    Returns
    -------
    Diagnosis
        With nothing added when the model lacks nothing that the data can show.

    Raises
    ------
    FitError
        When the base model cannot be fitted to a clip, so that there is no residual to explain.
    """
    measured = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    asked = [Clip(one, dict(fixed or {}), free).with_open_geometry(model) for one in measured]
    clips = [clip for clip, _ in asked]
    base = _base(clips, tuple(fitted for _, fitted in asked))
    library = [one for one in (effects if effects is not None else EFFECTS.values()) if one.applies(model)]
    search = Search(clips, model, library, base, holdout, progress or (lambda text: None))
    path = search.run()
    final = path[-1]
    screens = [tuple(combined(one) for one in search.screened(state).scores) for state in path]
    before, after = search.errors(base), search.errors(final)
    floor = float(np.sqrt(np.mean([np.mean(one.noise**2) for one in base.fits])))
    return Diagnosis(
        bases=base.fits,
        finals=final.fits,
        added=final.effects,
        sizes={name: search.size(final, name) for name in final.sizes},
        rounds=tuple(screens),
        indistinguishable={one.name: search.equals(final, one) for one in final.effects},
        ruled_out=tuple(_limit(score, library) for score in screens[-1]),
        before=before,
        after=after,
        noise_floor=floor,
        unit=base.fits[0].model.observed[0].unit,
        proposed=_proposed(clips, final, after.fitted, floor),
        notes=(*reservations(base.fits, screens[0], search.failed), *gains(final.fits), *search.refused(final)),
    )


def _proposed(clips: Sequence[Clip], final: State, error: float, floor: float) -> tuple[DiscoveredTerm, ...]:
    """Terms for what the effects have left, if that is more than noise."""
    if not error > ABOVE_NOISE * floor:
        return ()
    from fitters.sindy.proposals import proposals  # pysindy takes half a second to import

    return proposals([clip.trajectory for clip in clips], final.fits)


def _base(clips: Sequence[Clip], fits: tuple[FitResult, ...]) -> State:
    for number, one in enumerate(fits, start=1):
        if not one.usable:
            which = f" to clip {number} of {len(fits)}" if len(fits) > 1 else ""
            raise FitError(f"the base model cannot be diagnosed, its fit{which} failed ({one.status}): {one.message}")
    return State.without_effects(clips, fits)


def _limit(score: Score, effects: Sequence[Effect]) -> Limit:
    effect = next(one for one in effects if one.name == score.effect)
    upper = abs(score.size) + float(norm.isf(0.05)) * score.stderr
    return Limit(effect.name, effect.parameters[0].name, max(upper, score.stands_out), score.unit)
