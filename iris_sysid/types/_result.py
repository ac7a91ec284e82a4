"""The result of a fit to one clip or several."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from iris_sysid.types._arrays import Array, Mask
from iris_sysid.types._display import Brief, Shown, text_of, values_of
from iris_sysid.types._model import OdeModel
from iris_sysid.types._numbers import Estimate
from iris_sysid.types._pickling import Portable
from iris_sysid.types._verdict import (
    Completeness,
    Doubt,
    FitReason,
    Verdict,
    VerdictWord,
    explained_percent,
    relative_text,
    worst_verdict,
)

FitStatus = Literal["ok", "at-bound", "singular", "diverged", "too-short", "not-converged", "misfit"]
USABLE: tuple[FitStatus, ...] = ("ok", "misfit", "at-bound", "singular")  # with estimates
IMPRECISE = 0.2  # relative standard error above which a value of an incomplete equation is doubtful
UNCERTAIN = 1 / 3  # of any equation: three standard errors then reach zero
FOLLOWED = 0.5  # fraction of the motion's variance that a free run explains which follows it at all
LITTLE_EXPLAINED = 0.9  # fraction of the motion's variance below which the values of an equation are doubtful
SETTLE = "Diagnose it: what the equation lacks may move this value by that much"
MORE_MOTION = "The motion says little about it: record more of the motion, or state another value that is known"
ANOTHER = "Another equation may describe the motion: try --model auto or iris-sysid discover, or look at the residual"


@dataclass(frozen=True, slots=True)
class FitProblem:
    """Why a fit gave no estimates, or why they need care.

    ``reason`` is a code for programs. ``finding`` describes the problem in one clause, ``detail`` adds the numbers, and
    ``remedy`` is a sentence with the action to take. ``to_set`` names values; knowing one of them helps
    (``fixed`` of :func:`iris_sysid.fit`, ``--set``), ``to_start`` those that want a better start (``start``,
    ``--start-at``).
    """

    reason: FitReason
    finding: str
    detail: str = ""
    remedy: str = ""
    to_set: tuple[str, ...] = ()
    to_start: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Finding, detail and remedy as text, without the last full stop."""
        sentence = f"{self.finding} ({self.detail})" if self.detail else self.finding
        return f"{sentence}. {self.remedy}" if self.remedy else sentence

    @property
    def doubt(self) -> Doubt:
        """The problem as a reason of a verdict."""
        return Doubt(self.reason, f"{self.finding} ({self.detail})" if self.detail else self.finding, self.remedy)


def _verdict(
    status: FitStatus, reasons: tuple[Doubt, ...], equation: Completeness | None, accuracy: Mapping[str, float]
) -> Verdict:
    """The verdict on a fit, with the reasons that follow from its accuracy and what its equation explains."""
    if status not in USABLE:
        return Verdict("failed", reasons)
    complete = equation is None or equation.complete
    reasons = (*reasons, *imprecise(accuracy, complete))
    if equation is not None and not complete and equation.explained < LITTLE_EXPLAINED:
        share = explained_percent(equation.explained)
        little = Doubt("little-explained", f"the equation explains only {share} of the motion", ANOTHER)
        reasons = (*reasons, little)
    verdict = Verdict("good", reasons, equation, accuracy)
    word: VerdictWord = "good" if status in ("ok", "misfit") and not verdict.number_reasons else "doubtful"
    return Verdict(word, reasons, equation, accuracy)


def imprecise(accuracy: Mapping[str, float], complete: bool) -> tuple[Doubt, ...]:
    """The doubt in the first value of :attr:`Verdict.accuracy` where its error is too large to use it; else none.

    ``complete`` says whether the equation is.
    """
    name, error = next(iter(accuracy.items()), ("", 0.0))
    if not error > (UNCERTAIN if complete else IMPRECISE):
        return ()
    finding = f"{name.replace('_', ' ')} is good to {relative_text(error)} only"
    return (Doubt("imprecise", finding, MORE_MOTION if complete else SETTLE),)


def relative_errors(estimates: Mapping[str, Estimate], names: Iterable[str]) -> dict[str, float]:
    """The relative error, for each name that has a value and an error; of the first whatever it is, else below 1.

    It is the standard error, or the half width of the 95 % interval over 1.96 where that is more: of few samples, or of
    noise that few samples tell.
    """
    found = {name: estimates[name] for name in names if name in estimates}
    errors = {name: abs(_error(one) / one.value) if one.value else math.nan for name, one in found.items()}
    first = next(iter(errors), "")
    return {name: error for name, error in errors.items() if 0 < error < (math.inf if name == first else 1.0)}


def _error(one: Estimate) -> float:
    """The standard error, or that of the 95 % interval where it is more and finite."""
    return max(one.stderr, one.interval_stderr) if math.isfinite(one.interval_stderr) else one.stderr


def _accuracy(model: OdeModel, free: Sequence[str], estimates: Mapping[str, Estimate]) -> dict[str, float]:
    """The relative errors of the physical values; without any, of what is derived, else of all but initial states.

    A value that is nominally zero, as the offset of a pivot, has no relative error that means something.
    """
    roles = {parameter.name: parameter.role for parameter in model.parameters}
    nominally_zero = {parameter.name for parameter in model.parameters if parameter.constant and parameter.default == 0}
    physical = [name for name in free if roles.get(name) in ("physical", "gravity") and name not in nominally_zero]
    derived = [name for name, one in estimates.items() if one.measurement_type == "derived"]
    choices = (physical, derived, [name for name in free if name in roles])
    return next(filter(None, (relative_errors(estimates, names) for names in choices)), {})


def _explained(motion: Array, residual: Array, units: Sequence[str]) -> float:
    """The fraction of the variance of a motion (n, d) that is not in the residual (n, d); NaN where nothing moves.

    Quantities of one unit are taken together; otherwise each has the same weight.
    """
    if not len(motion):
        return math.nan
    variance, left = np.var(motion, axis=0), np.mean(residual**2, axis=0)
    if len(set(units)) == 1:
        variance, left = variance.sum(keepdims=True), left.sum(keepdims=True)
    moves = variance > 0
    return float(1 - np.mean(left[moves] / variance[moves])) if moves.any() else math.nan


def _over_noise(rms: Array, noise: Array) -> float:
    """The residual (d,) over the noise (d,), root mean square over the quantities; NaN where no noise is known."""
    known = np.isfinite(noise) & (noise > 0) & np.isfinite(rms)
    return float(np.sqrt(np.mean((rms[known] / noise[known]) ** 2))) if known.any() else math.nan


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Identifiability(Brief):
    """Which of the k free values ``names`` the data determine.

    ``condition`` of the Fisher information after scaling each value to unit information; ``undetermined`` holds its
    null directions in words, ``weakest`` the direction that is known least. ``gradients``: norm of the gradient of
    the mean squared residual, in units of the noise, by the free values relative to their size, at each iteration.
    ``ode_residual`` (d,): mean squared error of one step of the equation from sample to sample, in squared units;
    ``ode_residual_noise`` (d,): the part due to noise alone. ``hessian`` (k, k), where it was requested: second
    derivatives of minus the log likelihood at the optimum by the free values, for white noise, and
    ``hessian_condition`` after scaling each value to a unit diagonal.
    """

    names: tuple[str, ...]
    condition: float
    undetermined: tuple[str, ...]
    weakest: str
    gradients: tuple[float, ...]
    ode_residual: Array
    ode_residual_noise: Array
    hessian: Array | None = None
    hessian_condition: float = float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class FitResult(Shown, Portable):
    """A model fitted to a trajectory.

    ``estimates`` by name: fitted parameters, constants, initial states and derived quantities.
    ``free`` names the fitted ones, in the order of ``covariance`` (p, p), which is that of autocorrelated noise and of
    priors, and of ``total_covariance`` (p, p), which is that of all sources of ``budget``: its diagonal is the squared
    ``stderr``; (0, 0) where there are no estimates. ``predicted`` and ``residual`` (n, d) at every sample of the
    trajectory, residual = observed - predicted, NaN outside ``used`` (n,). ``noise`` (d,) is the
    standard deviation of the measurement estimated independently of the model, ``rms`` (d,) that of
    the residual. ``jacobian`` (n_used * d, p) is d predicted / d free, time-major. Each of j priors is one more
    sample: ``prior_rows`` (j, p) and ``prior_residual`` (j,) are its row of the Jacobian and its residual
    expected - estimate, in units of the noise and weighted as they were in the fit.
    ``fisher`` (p, p) is the Fisher information for white noise, ``condition`` its condition number
    after scaling each parameter to unit information. ``budget[name][source]`` is the standard error
    of a parameter from each source. ``t0_s`` is the time at which the initial states hold.
    ``intervals[method][name]`` are 95 % intervals of the random part by other methods than that of the estimates.
    ``problems`` are the reasons why the status is not ``ok``, the most serious first; ``notes`` are further remarks.
    ``doubts`` are reasons to doubt the result although the equation may fit: of the track, the clock, the scale.
    """

    model: OdeModel
    status: FitStatus
    estimates: Mapping[str, Estimate]
    free: tuple[str, ...]
    covariance: Array
    t_s: Array
    used: Mask
    predicted: Array
    residual: Array
    noise: Array
    rms: Array
    aic: float
    bic: float
    jacobian: Array
    fisher: Array
    condition: float
    correlation: float
    t0_s: float
    prior_rows: Array = field(default_factory=lambda: np.zeros((0, 0)))
    prior_residual: Array = field(default_factory=lambda: np.zeros(0))
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    identifiability: Identifiability | None = None
    intervals: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    origin: Mapping[str, Any] = field(default_factory=dict)
    problems: tuple[FitProblem, ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    total_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def reason(self) -> FitReason | None:
        """Why the status is not ``ok``, as a code; None where it is."""
        return self.problems[0].reason if self.problems else None

    @property
    def finding(self) -> str:
        """What is wrong, in one clause; empty where nothing is."""
        return self.problems[0].finding if self.problems else ""

    @property
    def remedy(self) -> str:
        """What to do about it, as a sentence; empty where there is nothing to do."""
        return self.problems[0].remedy if self.problems else ""

    @property
    def message(self) -> str:
        """All problems with their remedies, then the notes, as text for a reader."""
        return ". ".join(filter(None, [*(problem.text for problem in self.problems), *self.notes]))

    @property
    def ok(self) -> bool:
        """Whether the estimates can be used as they are."""
        return self.status == "ok"

    @property
    def usable(self) -> bool:
        """Whether there are estimates at all; with a status other than ok they come with a reservation."""
        return self.status in USABLE

    @property
    def verdict(self) -> Verdict:
        """Whether the values can be used, and whether the equation is complete; the doubts, then the problems."""
        reasons = (*self.doubts, *(problem.doubt for problem in self.problems))
        if not self.usable:
            return Verdict("failed", reasons)
        lacking = ("residual-above-noise", "phenomenon")
        complete = self.status != "misfit" and not any(doubt.kind in lacking for doubt in reasons)
        equation = Completeness(self.explained, complete, _over_noise(np.asarray(self.rms), np.asarray(self.noise)))
        return _verdict(self.status, reasons, equation, _accuracy(self.model, self.free, self.estimates))

    @property
    def explained(self) -> float:
        """The fraction of the variance of the observed motion that the equation explains."""
        residual = self.residual[self.used]
        units = [quantity.unit for quantity in self.model.observed]
        return _explained(self.predicted[self.used] + residual, residual, units)

    @property
    def follows(self) -> bool:
        """Whether the free run follows the motion at all."""
        return self.usable and self.explained >= FOLLOWED

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """The estimates by name, under the word that fit.json has for them."""
        return self.estimates

    @property
    def n(self) -> int:
        """Number of samples used."""
        return int(self.used.sum())

    def informed_jacobian(self, noise: Array) -> Array:
        """The Jacobian (n_used * d + j, p) in units of the noise, with the rows of the j priors below it.

        ``noise`` (n_used, d) is that of each sample used, in the observed unit.
        """
        scaled = self.jacobian / noise.ravel()[:, None]
        return np.concatenate([scaled, self.prior_rows]) if self.prior_residual.size else scaled

    def __repr__(self) -> str:
        spread = (
            f"{quantity.name}: residual {rms:.3g} {quantity.unit}, noise {noise:.3g} {quantity.unit}"
            for quantity, rms, noise in zip(self.model.observed, self.rms, self.noise, strict=True)
        )
        return text_of(
            f"FitResult of {self.model.name}, {self.n} of {self.used.size} samples: {self.verdict.text}",
            values_of({name: self.estimates[name] for name in self.free}) if self.usable else "",
            "; ".join(spread),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Population:
    """The scatter of one value over clips, in excess of the error within each clip.

    ``mean`` over all clips that there could be; ``between`` the standard deviation from clip to clip, with its 95 %
    interval; ``within`` the typical random standard error in one clip. ``q`` is Cochran's sum of squared distances
    from the weighted mean in standard errors, over ``degrees`` degrees of freedom, and ``p_value`` the probability of
    a larger ``q`` if all clips have the same value.
    """

    mean: Estimate
    between: Estimate
    within: float
    q: float
    degrees: int
    p_value: float


@dataclass(frozen=True, eq=False, slots=True)
class PooledFit:
    """One model fitted to several clips at once.

    ``shared`` holds the values that are the same in all clips, and ``scatter`` how far those of each clip alone are
    spread; ``population`` the values that differ from clip to clip as random draws do. ``clips`` are the fits of
    each clip with the shared values held, in the order given; ``covariance`` (k, k) that of the shared values,
    random part. ``budget`` as in :class:`FitResult`.
    """

    model: OdeModel
    status: FitStatus
    message: str
    shared: Mapping[str, Estimate]
    scatter: Mapping[str, Population]
    population: Mapping[str, Population]
    clips: tuple[FitResult, ...]
    covariance: Array
    budget: Mapping[str, Mapping[str, float]]
    aic: float
    bic: float

    @property
    def usable(self) -> bool:
        """Whether there are estimates at all."""
        return self.status in USABLE

    @property
    def verdict(self) -> Verdict:
        """That of the fit over all clips, with the reasons of each clip."""
        clips = worst_verdict(clip.verdict for clip in self.clips)
        equation = clips.equation
        if equation is not None and self.status == "misfit":
            equation = replace(equation, complete=False)
        accuracy = _accuracy(self.model, list(self.estimates), self.estimates)
        reasons = tuple(doubt for doubt in clips.reasons if doubt.kind != "imprecise")  # of one clip: all know more
        return _verdict(self.status, reasons, equation, accuracy)

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The shared values, then the means of the population."""
        return {**self.shared, **{name: population.mean for name, population in self.population.items()}}

    def __repr__(self) -> str:
        return text_of(
            f"PooledFit of {self.model.name} to {len(self.clips)} clips: {self.verdict.text}",
            f"shared: {values_of(self.shared)}" if self.shared else "",
            f"means: {values_of({name: spread.mean for name, spread in self.population.items()})}",
        )
