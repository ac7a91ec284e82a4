"""Find the effects that a model lacks: residual, score tests, refits, then the error before and after.

1. Fit the model to every clip. 2. Test every effect that applies by its score: its sensitivity, without what the fitted
parameters can imitate, against the residual. 3. Refit with the best few. Add the effect that explains most if it is
significant at 5 % over the whole library (autocorrelation allowed for), if it moves the trajectory by more than the
stated errors of its samples, and if it improves the prediction of held-out samples. If no single effect is significant,
try pairs. 4. Repeat until no effect is significant. After each addition, remove the effects that are no longer needed
and replace those with a better rival. The result also lists the effects that explain the data as well as an added one,
and an upper limit on every effect that was not added.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fitters.image_effects import offered
from fitters.ode import FitRequest
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.notes import diagnostic_notes, negative_damping_note
from iris_sysid.diagnosis.refit import ModelWithEffects, with_free_geometry
from iris_sysid.diagnosis.score_test import combined
from iris_sysid.diagnosis.search_report import SearchReport
from iris_sysid.diagnosis.stepwise_search import StepwiseSearch
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Diagnosis, DiscoveredTerm, Effect, Estimate, FitResult, OdeModel, Trajectory

ABOVE_NOISE = 1.1  # residual / noise above which terms are suggested; the noise itself is known to a few percent


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
    """Find the effects that a model lacks by score tests and refits, and measure the error before and after.

    Parameters
    ----------
    trajectories
        One clip, or several of the same kind. Each clip has its own values of the model's
        parameters; an effect has the same size in all clips, apart from the scatter that the data show.
    model
        The governing equation to test.
    fixed
        Known values by name.
    free
        Constants of the model to estimate as well.
    effects
        Effects to test; by default every registered effect that applies to the model.
    holdout
        Fraction of each clip, at its end, that is held out: the model is fitted to the rest and predicts it.
    progress
        Called with a line of text at each step.

    Returns
    -------
    Diagnosis
        Without added effects when no effect is significant.

    Raises
    ------
    FitError
        When the base model cannot be fitted to a clip, so that there is no residual to explain.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import EFFECTS, MODELS, Trajectory, diagnose, simulate, with_effects
    >>> pendulum, drag, t_s = MODELS["pendulum"], EFFECTS["quadratic-drag"], np.arange(300) / 60
    >>> truth = {"length": 0.5, "damping": 0.1, "quadratic_drag": 0.2, "theta_0": 0.8, "omega_0": 0.0}
    >>> theta = simulate(with_effects(pendulum, [drag]), t_s, truth).observed
    >>> theta += 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    >>> clip = Trajectory(t_s, pendulum.observed, theta, np.full_like(theta, np.nan), np.ones(300, bool))
    >>> [effect.name for effect in diagnose(clip, pendulum).added]
    ['quadratic-drag']
    """
    measured = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    requests = [FitRequest(clip, model, fixed=dict(fixed or {}), free=free) for clip in measured]
    fitted = [with_free_geometry(request) for request in requests]
    clips = [request for request, _ in fitted]
    base = _base(clips, tuple(fit for _, fit in fitted))
    applicable = offered(EFFECTS.values() if effects is None else effects, model, measured)
    cache = FitCache(clips, model, EffectLibrary(applicable), base, holdout, progress or (lambda text: None))
    return _diagnosis(cache, StepwiseSearch(cache).run())


def _base(clips: Sequence[FitRequest], fits: tuple[FitResult, ...]) -> ModelWithEffects:
    for number, fitted in enumerate(fits, start=1):
        if not fitted.usable:
            which = f" to clip {number} of {len(fits)}" if len(fits) > 1 else ""
            raise FitError(
                f"the base model cannot be diagnosed, its fit{which} failed ({fitted.status}): {fitted.message}"
            )
    return ModelWithEffects.without_effects(clips, fits)


def _diagnosis(cache: FitCache, path: Sequence[ModelWithEffects]) -> Diagnosis:
    """The diagnosis from the models that the search visited, the base first."""
    base, final = path[0], path[-1]
    report = SearchReport(cache, final)
    rounds = [tuple(combined(scores) for scores in cache.screening(model).scores) for model in path]
    before, after = cache.errors(base), cache.errors(final)
    noise = float(np.sqrt(np.mean([np.mean(fitted.noise**2) for fitted in base.fits])))
    return Diagnosis(
        bases=base.fits,
        finals=final.fits,
        added=final.effects,
        sizes={name: report.size(name) for name in final.sizes},
        rounds=tuple(rounds),
        indistinguishable={effect.name: report.indistinguishable(effect) for effect in final.effects},
        ruled_out=tuple(report.limit(score) for score in rounds[-1]),
        before=before,
        after=after,
        noise_floor=noise,
        unit=base.fits[0].model.observed[0].unit,
        proposed=_proposed(cache.clips, final) if after.fitted > ABOVE_NOISE * noise else (),
        notes=(
            *diagnostic_notes(base.fits, rounds[0], cache.failed),
            *negative_damping_note(final.fits),
            *report.rejected(),
        ),
    )


def _proposed(clips: Sequence[FitRequest], final: ModelWithEffects) -> tuple[DiscoveredTerm, ...]:
    """Terms without a named effect that the remaining residual suggests."""
    from fitters.sindy.proposals import proposals  # pysindy takes half a second to import

    return proposals([clip.trajectory for clip in clips], final.fits)
