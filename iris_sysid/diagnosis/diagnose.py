"""Find the effects that a model lacks: where the residual lies, then names, then the error before and after.

1. Split the residual into components: force, reading, clock, input and noise, each with its share.
2. Search the library by the prediction of blocks that a fit did not see: effects with a formula first, one or two at a
time, then those that can imitate a piece of anything (:mod:`iris_sysid.diagnosis.open_world`).
3. Where a set explains the data to the noise, a likelihood compares it with its rivals and may add effects
(:mod:`iris_sysid.diagnosis.stepwise_search`). Elsewhere the blocks say what is named.
4. The errors before and after over those blocks, the components that remain, values with errors that allow for them,
and an upper limit on every effect that was not added.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitters.components import marginal
from fitters.ode import FitRequest, solve, with_rest
from fitters.ode.error_budget import with_derived_errors
from fitters.ode.result import energy_gains
from fitters.ode.weak_fit import is_observed, weak_fit
from iris_sysid.diagnosis.contributions import starts_of
from iris_sysid.diagnosis.evidence import best_first
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.held_out_blocks import ALIKE
from iris_sysid.diagnosis.kept_component import kept_effects
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.model_averaging import spanning, with_larger_error
from iris_sysid.diagnosis.noise_notes import noise_notes
from iris_sysid.diagnosis.notes import diagnostic_notes, input_gap_notes, negative_damping_note, weak_notes
from iris_sysid.diagnosis.open_world import Judgement, OpenWorld, with_components
from iris_sysid.diagnosis.prediction_error import fitted_error
from iris_sysid.diagnosis.refit import (
    AT_NOISE,
    COMPLETE,
    ModelWithEffects,
    pooled,
    with_free_geometry,
    with_values,
)
from iris_sysid.diagnosis.residual_components import clip_residual, components_of
from iris_sysid.diagnosis.score_test import combined
from iris_sysid.diagnosis.search_report import SearchReport, holds_zero
from iris_sysid.diagnosis.stepwise_search import StepwiseSearch
from iris_sysid.diagnosis.time_budget import STOPPED, TimeBudget
from iris_sysid.errors import FitError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.trajectory.smoothing import smooth
from iris_sysid.types import (
    LITTLE_EXPLAINED,
    NOISE_UNSURE,
    ComponentKind,
    Components,
    Diagnosis,
    DiagnosticNote,
    DiscoveredTerm,
    Effect,
    EffectCause,
    Estimate,
    Finding,
    FitResult,
    OdeModel,
    PredictionErrors,
    Trajectory,
    normal_isf,
)

ABOVE_NOISE = 1.1  # residual / noise above which terms are suggested; the noise itself is known to a few percent
NOISE_SHARE = 0.9  # of the residual's variance that components leave, where it is noise
LIKELIEST = 2  # models of the search that explain the data to the noise, refitted with all samples
SIGN_KNOWN = 2.0  # standard errors of a size whose 95 % interval ends at zero
LOSS: ComponentKind = "force-of-velocity"
SEARCH_SHARE = 0.7  # of the time allowed, for the search by blocks


@on_one_thread
def diagnose(
    trajectories: Trajectory | Sequence[Trajectory],
    model: str | OdeModel,
    *,
    fixed: Mapping[str, float | Estimate] | None = None,
    free: Sequence[str] = (),
    effects: Sequence[str | Effect] | None = None,
    holdout: float = 0.3,
    seconds: float | None = None,
    keep: Sequence[ComponentKind] = (),
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Split a residual into components, name the effects that a model lacks, and measure the error before and after.

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
        Fraction of each short part of a clip, at its end, that is left out to validate an effect in the search.
    seconds
        After which the best answer so far is returned, with a note; no limit by default. So is it when the program is
        interrupted (Ctrl-C) after the fit without effects.
    keep
        Kinds of components that are added as they are, their curve as the form, whatever else is found.
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
    DataError
        When a component to keep is not there.

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
    budget = TimeBudget(seconds, progress or (lambda text: None))
    model, tested = MODELS.resolved(model), EFFECTS.all_resolved(EFFECTS if effects is None else effects)
    given = [trajectories] if isinstance(trajectories, Trajectory) else trajectories
    measured = [_smoothed(model.taken_from(clip)[0], model) for clip in given]
    model = model.in_unit_of(measured[0]) if measured else model
    requests = [FitRequest.stated(clip, model, dict(fixed or {}), free) for clip in measured]
    fitted = [_with_run(*with_free_geometry(request)) for request in requests]
    clips = [request for request, _ in fitted]
    base = _base(clips, tuple(fit for _, fit in fitted))
    library = EffectLibrary(tested, model, measured)
    cache = FitCache(clips, model, library, base, holdout, budget.report)
    search = StepwiseSearch(cache)
    components = components_of(clips, base.fits)
    kept = kept_effects(components, keep, model)
    every = world = OpenWorld(cache, components)
    stopped = []
    answer, judgement = None, None
    try:
        budget.allow(SEARCH_SHARE)
        judgement = every.in_weak_form()  # windows of all samples cost little
        world = OpenWorld(cache.for_search(), components) if judgement is None else every
        found = judgement.model if judgement is not None else world.searched()
        if judgement is None and not found.explains:  # there the likelihood compares rivals, as a rule
            judgement = world.judged(found)
        budget.allow(1.0)
        start = _complete_start(cache, world, _with_all_samples(cache, found))
        if start is not None and not every.rests_on_imitation(start):
            search.run(start, extend=_residual_ratio(start, base) <= COMPLETE)
            if _is_complete(clips, search.reached[-1], base):
                answer = _of_complete(cache, every, world, search.reached)
        if answer is not None and _is_worse(answer, world, found):
            answer = None
        if answer is None and judgement is None:
            judgement = world.judged(found)
    except STOPPED as why:
        answer, stopped = None, [budget.note(why)]
    budget.end()
    answer = answer or _of_open(cache, world, judgement or world.so_far())
    if not answer.added and _is_noise(base, components):
        answer = _of_open(cache, world, Judgement(base, (), {}))
    answer = _with_losses(answer, base)
    return _diagnosis(cache, answer.with_kept(cache, kept), components, stopped)


def _smoothed(clip: Trajectory, model: OdeModel) -> Trajectory:
    """The clip, smoothed where an input drives the motion: its equation is then fitted in weak form as well."""
    needed = bool(model.inputs) and is_observed(model) and clip.smoothed is None and clip.valid.any()
    return smooth(clip) if needed else clip


def _with_run(request: FitRequest, fitted: FitResult) -> tuple[FitRequest, FitResult]:
    """A request and its fit; where a driven model cannot follow the data, the free run with the values in weak form.

    A drive without its friction, for one, fits best with a mass so large that nothing moves.
    """
    if not fitted.follows:
        request, fitted = with_rest(request, fitted)
    found = weak_fit(request) if request.model.inputs and not fitted.follows else None
    if found is None:
        return request, fitted
    own = {name: found.values[name] for name in found.stderr}
    start = {name: found.values[name] for name in request.model.initial_names}
    return request, solve(request.with_(fixed={**own, **request.fixed}, free=()).from_near(start))


def _complete_start(cache: FitCache, world: OpenWorld, judged: ModelWithEffects) -> ModelWithEffects | None:
    """The likeliest of the models that were tried that explains the data to the noise; None where none does.

    Where the size of the noise is unsure, only the judged one counts.
    """
    near = [model for model in world.tried if model.effects and _residual_ratio(model, world.shares.base) <= COMPLETE]
    alone = [model for model in near if len(model.effects) == 1]
    searched = {model.key: model for model in (*best_first(near)[:LIKELIEST], *alone)}
    tried = [judged, *(_with_all_samples(cache, model) for model in searched.values())]
    near = [model for model in tried if world.shares.allows(model) and _residual_ratio(model, cache.base) <= COMPLETE]
    if near:
        return best_first(near)[0]
    return judged if _is_complete(cache.clips, judged, cache.base) else None


def _is_worse(answer: _Answer, world: OpenWorld, judged: ModelWithEffects) -> bool:
    """Whether a judged model with no more effects predicts blocks left out better: the answer absorbs what it lacks."""
    if len(judged.effects) > len(answer.final.effects) or not world.shares.testable:
        return False
    (_, own), (_, others) = answer.heldout[1], world.shares.heldout(judged)
    return own**2 > ALIKE * others**2


def _is_complete(clips: Sequence[FitRequest], model: ModelWithEffects, base: ModelWithEffects) -> bool:
    """Whether a model explains the data to the noise: by its size, or as a residual without components."""
    ratio = _residual_ratio(model, base)
    if ratio <= COMPLETE or ratio > NOISE_UNSURE:
        return ratio <= COMPLETE
    remaining = components_of(clips, model.fits)
    return remaining is not None and remaining.noise_share >= NOISE_SHARE


def _is_noise(base: ModelWithEffects, components: Components | None) -> bool:
    """Whether neither the components nor the fits say that anything is missing: what is not named only fits noise."""
    return components is not None and not components.parts and all(fitted.ok for fitted in base.fits)


def _residual_ratio(model: ModelWithEffects, base: ModelWithEffects) -> float:
    """The residual over the noise of the measurement; 1 where that is zero."""
    noise = _noise(base)
    return fitted_error(model.fits, base.fits) / noise if noise > 0 else 1.0


def _noise(base: ModelWithEffects) -> float:
    return float(np.sqrt(np.mean([np.mean(fitted.noise**2) for fitted in base.fits])))


def _base(clips: Sequence[FitRequest], fits: tuple[FitResult, ...]) -> ModelWithEffects:
    for number, fitted in enumerate(fits, start=1):
        if not fitted.usable:
            which = f" to clip {number} of {len(fits)}" if len(fits) > 1 else ""
            raise FitError(
                f"the base model cannot be diagnosed, its fit{which} failed ({fitted.status}): {fitted.message}"
            )
    return ModelWithEffects.without_effects(clips, fits)


@dataclass(frozen=True, eq=False, slots=True)
class _Answer:
    """What a search ended with, in the words of :class:`Diagnosis`; ``path`` are the models of each step.

    ``world`` says how well blocks left out are predicted by ``judged``, the final model as it was fitted there.
    """

    world: OpenWorld
    judged: ModelWithEffects
    path: tuple[ModelWithEffects, ...]
    finals: tuple[FitResult, ...]
    added: tuple[Effect, ...]
    nuisances: tuple[Effect, ...]
    sizes: Mapping[str, Estimate]
    probabilities: Mapping[str, Mapping[str, float]]
    findings: tuple[Finding, ...]
    report: SearchReport
    weak: Sequence[tuple[str, Estimate]] = ()

    @property
    def final(self) -> ModelWithEffects:
        """The model in the end."""
        return self.path[-1]

    @property
    def heldout(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The errors over blocks left out without effects, and with them."""
        return self.world.shares.heldout(self.world.shares.base), self.world.shares.heldout(self.judged)

    def with_kept(self, cache: FitCache, kept: Sequence[Effect]) -> _Answer:
        """The answer with components that are kept as effects; unchanged where their fit fails."""
        if not kept:
            return self
        starts = [dict(start) for start in starts_of(self.final, self.final.effects)]
        each = tuple({**start, **{effect.name: (1.0, ()) for effect in kept}} for start in starts)
        model = cache.with_effects([*self.final.effects, *kept], each)
        if not model.usable:
            return self
        return replace(
            self,
            world=OpenWorld(cache, None),
            judged=model,
            path=(*self.path, model),
            finals=model.fits,
            added=(*self.added, *kept),
            sizes={name: pooled(model.sizes_of(name)) for name in model.sizes},
            probabilities={**self.probabilities, **{effect.name: {effect.name: 1.0} for effect in kept}},
            report=SearchReport(cache, model),
        )


def _of_complete(
    cache: FitCache, world: OpenWorld, searched: OpenWorld, path: Sequence[ModelWithEffects]
) -> _Answer | None:
    """The answer where the library explains the data to the noise: a likelihood can compare its effects.

    None where that is so only with effects whose intervals hold zero, or with effects that can imitate anything and
    have no other evidence: then blocks left out decide.
    """
    settled = _settled(cache, world, path[-1])
    if settled is None or world.rests_on_imitation(settled[0].final):
        return None
    report, weak = settled
    final = report.final
    sure = _residual_ratio(final, cache.base) <= COMPLETE
    shares, finals = {}, list(report.finals())
    for effect in final.effects:
        decided = sure and _residual_ratio(world.without_absorbing(final, effect), cache.base) <= AT_NOISE
        alike = report.probabilities(effect)
        odds = world.rivals.with_alone(alike, final, effect, sure=decided)
        # most effects were fitted alone only in the search
        shares[effect.name] = searched.rivals.with_alone(odds, final, effect, sure=decided)
        alone = {*shares[effect.name]} - {*alike}
        others = [each for tried in (world, searched) for each in tried.rivals.instead_of(final, effect, alone)]
        finals = [_spanning_rivals(fitted, final, others, k) for k, fitted in enumerate(finals)]
    rivals = {name: [other for other in names if other != name] for name, names in shares.items()}
    findings = world.of_complete(final, rivals)
    said = {name for finding in findings if finding.word in ("named", "group") for name in finding.effects[:1]}
    added = tuple(effect for effect in final.effects if effect.name in said)
    return _Answer(
        world,
        final,
        (*path[:-1], final),
        tuple(finals),
        added,
        tuple(effect for effect in final.effects if effect.name not in said),
        {name: report.size(name) for name in final.sizes},
        {effect.name: shares[effect.name] for effect in added},
        findings,
        report,
        weak,
    )


def _of_open(cache: FitCache, world: OpenWorld, judgement: Judgement) -> _Answer:
    """The answer where nothing explains the data to the noise."""
    final = _with_all_samples(cache, judgement.model)
    if not final.effects:
        judgement = Judgement(world.shares.base, (), {})
    order = {effect.name: k for k, effect in enumerate(judgement.model.effects)}
    final = replace(final, effects=tuple(sorted(final.effects, key=lambda effect: order[effect.name])))
    follows = _residual_ratio(final, cache.base) <= NOISE_UNSURE
    finals = tuple(
        _in_weak_form(world, judgement, fitted, k, cache.clips[k], follows=follows)
        if judgement.weak
        else _in_open_world(world, judgement, fitted, k, cache.clips[k])
        for k, fitted in enumerate(final.fits)
    )
    model = replace(final, fits=finals)
    found = dict(zip(order, judgement.findings, strict=True)) if final.effects else {}
    findings = tuple(found[effect.name] for effect in final.effects)
    if not judgement.weak and final.effects and not _explained(world, judgement.model) > LITTLE_EXPLAINED:
        findings = tuple(_without_name(finding, "the free run does not follow the motion") for finding in findings)
    findings = tuple(
        _without_name(finding, "the interval of its size holds zero")
        if holds_zero(pooled(model.sizes_of(effect.parameters[0].name)))
        else finding
        for finding, effect in zip(findings, final.effects, strict=True)
    )
    words = zip(findings, final.effects, strict=True)
    added = tuple(effect for finding, effect in words if finding.word in ("named", "group"))
    return _Answer(
        world,
        judgement.model,
        (cache.base, model if judgement.weak else final) if final.effects else (cache.base,),
        finals,
        added,
        tuple(effect for effect in final.effects if effect not in added),
        {name: pooled(model.sizes_of(name)) for name in model.sizes},
        {effect.name: judgement.rivals[effect.name] for effect in added},
        findings,
        SearchReport(cache, final),
    )


def _with_losses(answer: _Answer, base: ModelWithEffects) -> _Answer:
    """The answer without names of losses beside which a damping adds energy, unless it does without them as well.

    Their form makes up for another one, which the library may not have.
    """
    if not _gains_energy(answer.finals) or _gains_energy(base.fits):
        return answer
    findings = tuple(
        _without_name(finding, "beside it a damping would add energy") if finding.component == LOSS else finding
        for finding in answer.findings
    )
    kept = {each.effects[0] for each in findings if each.word in ("named", "group")}
    added = tuple(effect for effect in answer.added if effect.name in kept)
    unnamed = tuple(effect for effect in answer.added if effect not in added)
    probabilities = {effect.name: answer.probabilities[effect.name] for effect in added}
    nuisances = (*answer.nuisances, *unnamed)
    return replace(answer, findings=findings, added=added, nuisances=nuisances, probabilities=probabilities)


def _gains_energy(fits: Sequence[FitResult]) -> bool:
    return any(energy_gains(fitted.model, fitted.estimates) for fitted in fits)


def _without_name(finding: Finding, reason: str) -> Finding:
    """The finding on an effect without its name, and the reason; one that has no name keeps its own reason."""
    return replace(finding, word="located", reason=reason) if finding.word in ("named", "group") else finding


def _explained(world: OpenWorld, model: ModelWithEffects) -> float:
    """The share of the motion's variance that a model predicts of blocks left out; NaN where there are none.

    Where it is small, the free run leaves the motion soon, as of a chaotic one, and names would hang on rounding.
    """
    motion = [(fitted.predicted + fitted.residual)[fitted.used] for fitted in model.fits]
    variance = sum(float(np.sum(np.var(each, axis=0))) * len(each) for each in motion)
    samples = sum(each.size for each in motion)
    return 1.0 - world.shares.heldout(model)[0] ** 2 * samples / variance


def _with_all_samples(cache: FitCache, judged: ModelWithEffects) -> ModelWithEffects:
    """A model that was fitted roughly, and perhaps to few samples, fitted to all; the base where that fails.

    An effect that leads the fit astray is left out. Moments are looked for again where they may lie between samples
    that were left out.
    """
    few = judged.fits[0].used.size < cache.base.fits[0].used.size
    again = [effect for effect in judged.effects if few and effect.is_placed]
    lasting = [effect for effect in judged.effects if effect not in again]
    final = cache.continued(judged, lasting) if lasting else cache.base
    astray = cache.library.astray(final) if final.usable else []
    if astray:
        rest = [effect for effect in lasting if effect not in astray]
        final = cache.continued(judged, rest) if rest else cache.base
    for effect in again:
        if final.usable:
            final = cache.with_added(final, cache.screening(final).single(effect.name))
    if again and not final.usable:
        final = cache.refitted_again(judged)
    if not final.usable:  # many samples, or a moment that moves by them, take more steps than a fit has
        final = cache.refitted_again(final, rough=True)
    return final if final.usable else cache.base


def _in_weak_form(
    world: OpenWorld, judgement: Judgement, fitted: FitResult, k: int, clip: FitRequest, *, follows: bool
) -> FitResult:
    """The fit of the k-th clip with values in weak form as well.

    What is missing of a force errs each window by itself, but adds up in a free run, whose residual is then correlated
    from end to end: no error of its values can be told from one record, and they are worse. So where the two disagree,
    the values are those of the weak form, and only the start of the run is fitted. Where they agree, or the run
    ``follows`` the data, the weak form is a prior. As both are of one record, errors beside a prior are a little small:
    they are at least those by fits without a block.
    """
    weak, level = judgement.weak[k], normal_isf(0.025 / len(judgement.weak[k]))
    agree = all(abs(fitted.estimates[name].value - value) <= level * error for name, (value, error) in weak.items())
    run = with_values(clip, fitted, weak, free=agree or follows)
    if not run.usable:
        return fitted
    estimates = world.shares.errors(judgement.model).estimates(k, run) if agree and not follows else {}
    wider = {name: each for name, each in estimates.items() if each.stderr > run.estimates[name].stderr}
    return replace(run, estimates={**run.estimates, **wider})


def _in_open_world(world: OpenWorld, judgement: Judgement, fitted: FitResult, k: int, clip: FitRequest) -> FitResult:
    """The fit of the k-th clip with errors that hold where the residual is not noise.

    They come from the scatter of fits without a block, and of those with a rival in the place of an effect. They are at
    least those of the fit, and those beside the components of the residual, which may have moved the values; but blocks
    tell the sign of an effect's size, so that neither stretches its interval to zero.
    """
    judged = judgement.model
    sizes = {effect.parameters[0].name for effect in judged.effects}
    estimates = world.shares.errors(judged).estimates(k, fitted) if world.shares.testable else {}
    residual = clip_residual(clip, fitted)
    beside = None if residual is None else marginal(residual)
    errors = np.zeros(len(fitted.free))
    if beside is not None:
        errors = np.sqrt(np.maximum(np.diag(beside[1]), 0.0) + beside[0] ** 2)
    for name, error in zip(fitted.free, errors, strict=True):
        of_fit = fitted.estimates[name]
        known = estimates.get(name, of_fit)
        wider = max(float(error), of_fit.stderr)
        wider = min(wider, abs(known.value) / SIGN_KNOWN) if name in sizes else wider
        estimates[name] = with_larger_error(known, wider)
    every = replace(fitted, estimates={**fitted.estimates, **estimates})
    for effect in judged.effects:
        rivals = world.rivals.instead_of(judged, effect, judgement.rivals[effect.name])
        every = _spanning_rivals(every, judged, rivals, k)
    return every


def _spanning_rivals(
    fitted: FitResult, model: ModelWithEffects, rivals: Sequence[ModelWithEffects], k: int
) -> FitResult:
    """The fit of the k-th clip with intervals of the equation's own values that hold those of some rivals as well."""
    own = {*fitted.free} - {*model.sizes}
    every = {
        name: spanning(
            fitted.estimates[name], [each.fits[k].estimates[name] for each in rivals if name in each.fits[k].free]
        )
        for name in own
    }
    return replace(fitted, estimates={**fitted.estimates, **every})


def _diagnosis(
    cache: FitCache,
    answer: _Answer,
    components: Components | None,
    stopped: Sequence[DiagnosticNote],
) -> Diagnosis:
    """The diagnosis from the answer of the search."""
    base, final, report = cache.base, answer.final, answer.report
    rounds = [tuple(combined(scores) for scores in cache.screening(model).scores) for model in answer.path]
    noise, fitted = _noise(base), fitted_error(final.fits, base.fits)
    remaining = components_of(cache.clips, final.fits) if final.effects else components
    before, after = answer.heldout
    above = fitted > ABOVE_NOISE * noise
    effects = {effect.name: effect for effect in (*cache.library.by_name.values(), *final.effects)}
    return Diagnosis(
        bases=base.fits,
        finals=_without_nuisances(cache, answer),
        added=answer.added,
        sizes=answer.sizes,
        rounds=tuple(rounds),
        indistinguishable={
            name: tuple(other for other in shares if other != name) for name, shares in answer.probabilities.items()
        },
        probabilities=answer.probabilities,
        causes={name: _causes(shares, effects) for name, shares in answer.probabilities.items()},
        ruled_out=tuple(report.limit(score) for score in rounds[-1]),
        before=PredictionErrors(fitted_error(base.fits, final.fits), *before),
        after=PredictionErrors(fitted, *after),
        noise_floor=noise,
        unit=base.fits[0].model.observed[0].unit,
        proposed=_proposed(cache.clips, final) if above else (),
        notes=(
            *stopped,
            *diagnostic_notes(base.fits, rounds[0], cache.failed),
            *input_gap_notes(cache.clips),
            *negative_damping_note(final.fits),
            *report.rejected(),
            *weak_notes(answer.weak),
            *(noise_notes(cache.clips, final.fits) if fitted <= NOISE_UNSURE * noise else ()),
        ),
        components=components,
        remaining=remaining,
        findings=with_components(answer.findings, components, remaining),
        nuisances=answer.nuisances,
    )


def _without_nuisances(cache: FitCache, answer: _Answer) -> tuple[FitResult, ...]:
    """The final fits with intervals that hold the values without what is in the fit but not named: it may not act."""
    final, finals = answer.final, answer.finals
    if answer.nuisances and final.effects:
        named = [effect for effect in final.effects if effect in answer.added]
        rest = cache.with_effects(named, starts_of(final, named)) if named else cache.base
        if rest.usable:
            finals = tuple(_spanning_rivals(fitted, final, [rest], k) for k, fitted in enumerate(finals))
    return tuple(with_derived_errors(fitted) for fitted in finals)


def _causes(shares: Mapping[str, float], effects: Mapping[str, Effect]) -> dict[EffectCause, float]:
    """The share of the physics, the measurement and the clock in the names that explain the data, largest first."""
    causes: dict[EffectCause, float] = {}
    for name, share in shares.items():
        cause = effects[name].cause
        causes[cause] = causes.get(cause, 0.0) + share
    return dict(sorted(causes.items(), key=lambda item: -item[1]))


def _settled(
    cache: FitCache, world: OpenWorld, final: ModelWithEffects
) -> tuple[SearchReport, list[tuple[str, Estimate]]] | None:
    """The report on the effects whose interval excludes zero, and the sizes of those that were left out.

    One whose size is not known, or that may imitate what it explains, gives way to a rival that explains it as well.
    One without which the others are of impossible sizes stays as long as another one can go: they make up for it.
    None where the data are not explained without one whose interval holds zero.
    """
    weak: list[tuple[str, Estimate]] = []
    while True:
        report = SearchReport(cache, final)
        unsized = _unsized(report)
        doubtful = [*unsized, *(each for each in world.imitating(final) if each not in unsized)]
        rivals = (rival for effect in doubtful for rival in cache.equally_good(final, effect))
        rival = next(
            (each for each in rivals if not world.imitating(each) and _is_sized(SearchReport(cache, each))), None
        )
        if rival is not None:
            final = rival
            continue
        left_out = next((each for each in unsized if world.shares.allows(cache.without(final, each))), None)
        left_out = left_out or next((each for each in unsized if cache.without(final, each).usable), None)
        if left_out is None:
            return report, weak
        weak.append((left_out.name, report.size(left_out.parameters[0].name)))
        final = cache.without(final, left_out)
        if not _is_complete(cache.clips, final, cache.base):
            return None


def _unsized(report: SearchReport) -> list[Effect]:
    """The effects whose size has an interval that holds zero, the least known first."""
    sizes = {effect.name: report.size(effect.parameters[0].name) for effect in report.final.effects}
    unsized = [effect for effect in report.final.effects if holds_zero(sizes[effect.name])]
    return sorted(unsized, key=lambda effect: _relative(sizes[effect.name]))


def _relative(size: Estimate) -> float:
    """A size in standard errors; 0 where its error is not known."""
    return abs(size.value) / size.stderr if size.stderr > 0.0 else 0.0


def _is_sized(report: SearchReport) -> bool:
    """Whether no size has an interval that holds zero; rivals are refitted only where it is not so without them."""
    names = [effect.parameters[0].name for effect in report.final.effects]
    alone = (pooled(report.final.sizes_of(name)) for name in names)
    return not any(holds_zero(size) for size in alone) and not _unsized(report)


def _proposed(clips: Sequence[FitRequest], final: ModelWithEffects) -> tuple[DiscoveredTerm, ...]:
    """Terms without a named effect that the remaining residual suggests."""
    from fitters.sindy.proposals import proposals  # rarely needed

    return proposals([clip.trajectory for clip in clips], final.fits)
