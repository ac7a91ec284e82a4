"""Find the effects that a model lacks: residual, score tests, refits, then the error before and after.

1. Hold out the end of each third of every clip, and search in the rest: fit the model, test every effect that applies
by its score (its sensitivity, without what the fitted parameters can imitate, against the residual), refit with the
best few, and add the effect that explains most if it is significant at 5 % over the whole library (autocorrelation
allowed for), if it moves the trajectory by more than the stated errors of its samples, and if it improves the
prediction of samples left out here and there. If no single effect is significant, try pairs. Repeat until no effect is
significant. After each addition, remove the effects that are no longer needed and replace those with a better rival.
2. Predict the samples that were held out: nothing above has seen them.
3. Refit with all samples, and continue the search there: more samples show more. Effects whose interval holds zero are
left out. The result lists the effects that explain the data as well as an added one, and an upper limit on every
effect that was not added.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fitters.ode import FitRequest
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.missing_force import missing_forces
from iris_sysid.diagnosis.notes import diagnostic_notes, negative_damping_note, weak_notes
from iris_sysid.diagnosis.prediction_error import fitted_error
from iris_sysid.diagnosis.refit import ModelWithEffects, with_free_geometry
from iris_sysid.diagnosis.score_test import combined
from iris_sysid.diagnosis.search_report import SearchReport, holds_zero
from iris_sysid.diagnosis.stepwise_search import StepwiseSearch
from iris_sysid.diagnosis.training import Training
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Diagnosis, DiscoveredTerm, Effect, Errors, Estimate, FitResult, OdeModel, Trajectory

ABOVE_NOISE = 1.1  # residual / noise above which terms are suggested; the noise itself is known to a few percent


def diagnose(
    trajectories: Trajectory | Sequence[Trajectory],
    model: str | OdeModel,
    *,
    fixed: Mapping[str, float | Estimate] | None = None,
    free: Sequence[str] = (),
    effects: Sequence[str | Effect] | None = None,
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
        The governing equation to test, or the name of a registered one.
    fixed
        Known values by name.
    free
        Constants of the model to estimate as well.
    effects
        Effects to test, or their names; by default every registered effect that applies to the model.
    holdout
        Fraction of each third of a clip, at its end, that is held out: search and fits do not see it, and predict it.
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
    model, tested = MODELS.resolved(model), EFFECTS.all_resolved(EFFECTS if effects is None else effects)
    given = [trajectories] if isinstance(trajectories, Trajectory) else trajectories
    measured = [model.taken_from(clip)[0] for clip in given]
    requests = [FitRequest.stated(clip, model, dict(fixed or {}), free) for clip in measured]
    fitted = [with_free_geometry(request) for request in requests]
    clips = [request for request, _ in fitted]
    base = _base(clips, tuple(fit for _, fit in fitted))
    library = EffectLibrary(tested, model, measured)
    say = progress or (lambda text: None)
    trained = Training.of(clips, model, library, base, holdout, say)
    cache = FitCache(clips, model, library, base, holdout, say)
    search = StepwiseSearch(cache)
    known = trained.refitted(cache) if trained is not None else None
    path = search.run_from(known) if known is not None else search.run()
    return _diagnosis(cache, path, trained)


def _base(clips: Sequence[FitRequest], fits: tuple[FitResult, ...]) -> ModelWithEffects:
    for number, fitted in enumerate(fits, start=1):
        if not fitted.usable:
            which = f" to clip {number} of {len(fits)}" if len(fits) > 1 else ""
            raise FitError(
                f"the base model cannot be diagnosed, its fit{which} failed ({fitted.status}): {fitted.message}"
            )
    return ModelWithEffects.without_effects(clips, fits)


def _diagnosis(cache: FitCache, path: Sequence[ModelWithEffects], trained: Training | None) -> Diagnosis:
    """The diagnosis from the models that the search visited, the base first."""
    base, report, weak = path[0], *_without_weak(cache, path[-1])
    final = report.final
    path = [*path[:-1], final] if weak else path
    rounds = [tuple(combined(scores) for scores in cache.screening(model).scores) for model in path]
    noise = float(np.sqrt(np.mean([np.mean(fitted.noise**2) for fitted in base.fits])))
    unknown = (float("nan"), float("nan"))
    before, after = (trained.errors_before, trained.errors_after) if trained is not None else (unknown, unknown)
    errors = Errors(fitted_error(final.fits, base.fits), *after)
    lacking, remaining = missing_forces(
        cache.clips[0], base.fits[0], final.fits[0], final.effects, errors.fitted > ABOVE_NOISE * noise
    )
    return Diagnosis(
        bases=base.fits,
        finals=report.finals(),
        added=final.effects,
        sizes={name: report.size(name) for name in final.sizes},
        rounds=tuple(rounds),
        indistinguishable={effect.name: report.indistinguishable(effect) for effect in final.effects},
        probabilities={effect.name: report.probabilities(effect) for effect in final.effects},
        causes={effect.name: report.causes(effect) for effect in final.effects},
        ruled_out=tuple(report.limit(score) for score in rounds[-1]),
        before=Errors(fitted_error(base.fits, final.fits), *before),
        after=errors,
        noise_floor=noise,
        unit=base.fits[0].model.observed[0].unit,
        proposed=_proposed(cache.clips, final) if errors.fitted > ABOVE_NOISE * noise else (),
        notes=(
            *diagnostic_notes(base.fits, rounds[0], cache.failed),
            *negative_damping_note(final.fits),
            *report.rejected(),
            *weak_notes(weak),
            *(trained.notes(final) if trained is not None else ()),
        ),
        missing_force=lacking,
        remaining_force=remaining,
    )


def _without_weak(cache: FitCache, final: ModelWithEffects) -> tuple[SearchReport, list[tuple[str, Estimate]]]:
    """The report on the effects whose interval excludes zero, and the sizes of those that were left out."""
    weak: list[tuple[str, Estimate]] = []
    while True:
        report = SearchReport(cache, final)
        sizes = {effect.name: report.size(effect.parameters[0].name) for effect in final.effects}
        doubtful = [effect for effect in final.effects if holds_zero(sizes[effect.name])]
        if not doubtful:
            return report, weak
        least = min(doubtful, key=lambda effect: abs(sizes[effect.name].value) / sizes[effect.name].stderr)
        rest = cache.without(final, least)
        if not rest.usable:
            return report, weak
        weak.append((least.name, sizes[least.name]))
        final = rest


def _proposed(clips: Sequence[FitRequest], final: ModelWithEffects) -> tuple[DiscoveredTerm, ...]:
    """Terms without a named effect that the remaining residual suggests."""
    from fitters.sindy.proposals import proposals  # seldom needed

    return proposals([clip.trajectory for clip in clips], final.fits)
