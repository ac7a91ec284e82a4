"""Refine proposed equations: trajectory fits of a choice of terms, and selection among all terms about the fit.

About a fitted motion the samples are, to first order, a linear function of all coefficients of the library, also of
those that are zero: y = prediction + S dc + noise. The sensitivities S come from the ODE engine. So sparse regression
on S weighs every term by its effect on the trajectory, with the noise of the samples, and without any derivative.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitters.ode import FitOptions, fit, sensitivity
from fitters.sindy.library import Library
from fitters.sindy.model import model_of
from fitters.sindy.sparse_regression import Compressed, Kept, predictive_price, significant, together
from fitters.sindy.weak_form import grid_step, inputs_of
from iris_sysid.types import Array, FitResult, OdeModel, Trajectory

BLOCKS = 24  # largest number of blocks of a clip, for resampling
MIN_IN_BLOCK = 4
ROUNDS = 8
FOLDS = 5  # parts of every clip, to hold out
MAX_CORRELATION = 0.98


@dataclass(frozen=True, eq=False, slots=True)
class Refined:
    """A choice of terms fitted to all clips.

    ``kept`` are indices in the library, with their ``coefficients`` and ``covariance``; one fit a clip; ``parts`` are
    compressed rows about the fits, of every block of every clip, with a column for each of the ``terms`` of the
    library and then for each initial state of each clip.
    """

    kept: Kept
    coefficients: Array
    covariance: Array
    fits: tuple[FitResult, ...]
    parts: tuple[tuple[Compressed, ...], ...]
    terms: int

    @property
    def usable(self) -> bool:
        """Whether every clip could be fitted."""
        return bool(self.parts)

    @property
    def total(self) -> Compressed:
        """All blocks of all clips as one problem; initial states are fitted for any choice of terms."""
        return together([part for clip in self.parts for part in clip]).without(self.terms)

    @property
    def count(self) -> float:
        """Effective number of independent samples of the residuals."""
        return sum(part.count for clip in self.parts for part in clip)

    @property
    def least_seen(self) -> float:
        """The chi-square explained by a term that moves the samples by their rounding error.

        Samples on a grid (whole pixels, whole millimetres) are off by up to half a step, which is a function of the
        motion and does not average out. So terms with a smaller effect than that (step / sqrt 12) cannot be detected.
        """
        shares = [
            sum(part.count for part in parts) * np.log1p(np.mean((_steps(fit) / fit.rms) ** 2 / 12))
            for parts, fit in zip(self.parts, self.fits, strict=True)
        ]
        return float(sum(shares) / len(self.fits[0].rms))

    def criterion(self, count: float, least: float = 0.0) -> float:
        """Information criterion of this choice, from its own residual.

        ``count`` is the number of independent samples, ``least`` the smallest price of a term.
        """
        if not self.usable:
            return np.inf
        spread = np.mean([np.log(np.mean((fitted.rms / _noise(fitted)) ** 2)) for fitted in self.fits])
        price = max(np.log(max(count, 3.0)) + 2 * np.log(self.terms), least)
        return float(count * spread + len(self.kept) * price)


def _noise(fit: FitResult) -> Array:
    return np.where(np.isfinite(fit.noise) & (fit.noise > 0), fit.noise, np.maximum(fit.rms, 1e-300))


def _steps(fit: FitResult) -> Array:
    """Step (d,) of the grid of rounded samples of each quantity; 0 where there is no grid."""
    return np.array([grid_step(column) for column in (fit.predicted + fit.residual)[fit.used].T])


# --------------------------------------------------------------------------- fitting a choice


def refined(clips: Sequence[Trajectory], library: Library, kept: Kept, start: Mapping[str, float]) -> Refined:
    """Fit the chosen terms to all clips together by trajectories.

    Parameters
    ----------
    clips
        Trajectories of the library's quantities.
    library
        All candidates.
    kept
        Indices of the chosen terms.
    start
        Starting values by parameter name.
    """
    model = model_of(library)
    names = library.names
    chosen = [names[k] for k in kept]
    fixed = {name: 0.0 for name in names if name not in chosen}
    states = [f"{state.name}_0" for state in model.states]
    first = {name: value for name, value in start.items() if name in chosen or name in states}
    fits = [_fit(clip, model, fixed, first) for clip in clips]
    if not all(fitted.usable and np.all(np.isfinite(fitted.rms)) for fitted in fits):
        return Refined(kept, np.full(len(kept), np.nan), np.full((len(kept),) * 2, np.nan), tuple(fits), (), len(names))
    if len(clips) == 1:
        return _of_one(clips[0], library, kept, fits[0])
    return _jointly(clips, library, kept, fits)


def _fit(clip: Trajectory, model: OdeModel, fixed: Mapping[str, float], start: Mapping[str, float]) -> FitResult:
    return fit(clip, model, fixed=fixed, start=start, options=FitOptions(multistart=0))


def _of_one(clip: Trajectory, library: Library, kept: Kept, fit: FitResult) -> Refined:
    indices = [fit.free.index(library.names[k]) for k in kept]
    values = np.array([fit.estimates[library.names[k]].value for k in kept])
    covariance = fit.covariance[np.ix_(indices, indices)]
    parts = (tuple(_linearised(clip, library, fit, 0, 1)),)
    return Refined(kept, values, covariance, (fit,), parts, len(library.names))


def _jointly(clips: Sequence[Trajectory], library: Library, kept: Kept, fits: list[FitResult]) -> Refined:
    """Gauss-Newton steps for coefficients that all clips share, each clip with its own initial states."""
    names, model = library.names, model_of(library)
    values, covariance = _averaged(library, kept, fits)
    for _ in range(4):
        fixed = dict.fromkeys(names, 0.0) | {names[k]: float(c) for k, c in zip(kept, values, strict=True)}
        fits = [_fit(clip, model, fixed, {}) for clip in clips]
        if not all(fitted.usable and np.all(np.isfinite(fitted.rms)) for fitted in fits):
            return Refined(kept, values, covariance, tuple(fits), (), len(names))
        parts = tuple(
            tuple(_linearised(clip, library, fit, index, len(clips)))
            for index, (clip, fit) in enumerate(zip(clips, fits, strict=True))
        )
        joint = Refined(kept, values, covariance, tuple(fits), parts, len(names))
        better, covariance = joint.total.solved(kept)
        moved = np.abs(better - values) / np.sqrt(np.diag(covariance))
        values = better
        if np.max(moved, initial=0.0) < 0.1:
            break
    return Refined(kept, values, covariance, tuple(fits), parts, len(names))


def _averaged(library: Library, kept: Kept, fits: Sequence[FitResult]) -> tuple[Array, Array]:
    """Mean of the clips' coefficients, weighted by the inverse of their covariance."""
    weight, weighted = np.zeros((len(kept), len(kept))), np.zeros(len(kept))
    for fitted in fits:
        indices = [fitted.free.index(library.names[k]) for k in kept]
        inverse = np.linalg.pinv(np.nan_to_num(fitted.covariance[np.ix_(indices, indices)], nan=1e12))
        weight += inverse
        weighted += inverse @ np.array([fitted.estimates[library.names[k]].value for k in kept])
    covariance = np.linalg.pinv(weight)
    return covariance @ weighted, np.asarray(covariance, dtype=np.float64)


# --------------------------------------------------------------------------- linear in all coefficients


def _linearised(clip: Trajectory, library: Library, fit: FitResult, index: int, clips: int) -> list[Compressed]:
    """Compressed rows of each block of one clip about its fit."""
    model, used = fit.model, np.flatnonzero(fit.used)
    first = int(np.searchsorted(clip.t_s, fit.t0_s))  # earlier than the first one used, when that is an outlier
    span = slice(first, int(used[-1]) + 1)
    states = [f"{state.name}_0" for state in model.states]
    values = {name: estimate.value for name, estimate in fit.estimates.items()}
    known, names = inputs_of(clip, library, span), [*library.names, *states]
    slopes = sensitivity(model, clip.t_s[span], values, names, inputs=known, hold=clip.hold, tolerance=1e-7)
    slopes = slopes[used - first]
    residual = fit.residual[used]
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    coefficients = np.array([values[name] for name in library.names])
    target = residual + slopes[:, :, : coefficients.size] @ coefficients
    scale = np.maximum(fit.rms, 1e-300)
    return blocks_of(slopes / scale[:, None], target / scale, fit, coefficients.size, (index, clips))


def blocks_of(columns: Array, target: Array, one: FitResult, shared: int, where: tuple[int, int]) -> list[Compressed]:
    """Compressed rows of each block of time of one clip.

    Parameters
    ----------
    columns, target
        (n, d, k) and (n, d), in units of the noise.
    one
        The fit, which gives the autocorrelation of the residual.
    shared
        Number of columns that all clips share, the first ones; the others are this clip's own.
    where
        Number of this clip, and number of clips, each with as many columns.
    """
    index, clips = where
    own = columns.shape[2] - shared
    wide = np.zeros((*target.shape, shared + clips * own))
    wide[:, :, :shared] = columns[:, :, :shared]
    wide[:, :, shared + index * own : shared + (index + 1) * own] = columns[:, :, shared:]
    count = int(np.clip(len(target) // MIN_IN_BLOCK, 1, BLOCKS))
    share = 1.0 / _inflation(one)
    return [
        Compressed.of(wide[part].reshape(-1, wide.shape[2]), target[part].ravel(), share)
        for part in np.array_split(np.arange(len(target)), count)
    ]


def _inflation(fit: FitResult) -> float:
    """Number of neighbouring samples per independent sample, from their correlation."""
    correlation = float(np.clip(np.nan_to_num(fit.correlation), 0.0, MAX_CORRELATION))
    return (1 + correlation) / (1 - correlation)


# --------------------------------------------------------------------------- selection


def disposed(
    clips: Sequence[Trajectory], library: Library, starts: Sequence[tuple[Kept, Mapping[str, float]]]
) -> Refined:
    """Refine proposed structures: fit, select terms about the fit, and repeat until the choice does not change.

    Parameters
    ----------
    clips
        Trajectories.
    library
        All candidates.
    starts
        Proposed choices with starting values, in the order of trust; the next one is tried when none fits to the noise.
    """
    visited: dict[Kept, Refined] = {}
    for kept, start in starts:
        if any(choice.usable and all(fit.status == "ok" for fit in choice.fits) for choice in visited.values()):
            break
        for _ in range(ROUNDS):
            if kept in visited:
                break
            visited[kept] = now = refined(clips, library, kept, start)
            if not now.usable:
                break
            kept = chosen_about(now)
            start = start_about(now, library, kept)
    count = max(choice.count for choice in visited.values())
    least = max((choice.least_seen for choice in visited.values() if choice.usable), default=0.0)
    return min(visited.values(), key=lambda choice: choice.criterion(count, least))


def start_about(found: Refined, library: Library, kept: Kept) -> dict[str, float]:
    """Starting values for a fit of other terms, from the linear problem about a fit; for one clip, also initial states.

    Parameters
    ----------
    found
        A fitted choice.
    library
        All candidates.
    kept
        Indices of the other terms.
    """
    start = {library.names[k]: float(value) for k, value in zip(kept, found.total.solved(kept)[0], strict=True)}
    if len(found.fits) == 1:
        estimates = found.fits[0].estimates
        start |= {
            name: estimate.value for name, estimate in estimates.items() if name in found.fits[0].model.initial_names
        }
    return start


def chosen_about(found: Refined) -> Kept:
    """The terms that the linear problem about a fit supports, at the price that best predicts held-out data."""
    total, price = found.total, price_about(found)
    chosen = significant(total, price, ((), tuple(range(found.terms)), found.kept))
    # no exchange of single terms replaces two terms that together imitate a third
    pairs = [tuple(k for k in chosen if k not in gone) for gone in itertools.combinations(chosen, 2)]
    return significant(total, price, (chosen, *pairs)) if pairs else chosen


def price_about(found: Refined) -> float:
    """The price of a term: the one that best predicts held-out parts of the clips, at least that of rounding."""
    return max(predictive_price([together(group) for group in folds_of(found.parts)], found.terms), found.least_seen)


def folds_of(parts: Sequence[Sequence[Compressed]]) -> list[list[Compressed]]:
    """Contiguous blocks of every clip, in groups to hold out."""
    groups: list[list[Compressed]] = [[] for _ in range(FOLDS)]
    for clip in parts:
        for k, group in enumerate(np.array_split(np.arange(len(clip)), FOLDS)):
            groups[k] += [clip[j] for j in group]
    return [group for group in groups if group]


def added_alone(found: Refined) -> tuple[Array, Array]:
    """Coefficient and standard error (k,) of each term: in the choice, or as if added to it.

    Each has the unit of its term.
    """
    total = found.total
    values, errors = np.zeros(found.terms), np.zeros(found.terms)
    for k in range(found.terms):
        kept = found.kept if k in found.kept else (*found.kept, k)
        solved, covariance = total.solved(kept)
        index = kept.index(k)
        values[k], errors[k] = solved[index], np.sqrt(max(covariance[index, index], 0.0))
    return values, errors


def as_good(found: Refined, library: Library, worse: float) -> list[Kept]:
    """Choices of the same size, one term exchanged for another of its equation, that explain the data nearly as well.

    Parameters
    ----------
    found
        A fitted choice.
    library
        All candidates.
    worse
        By how much the sum of squares, in units of the noise, may be larger.
    """
    total = found.total
    base, choices = total.residual(found.kept), []
    for index, k in enumerate(found.kept):
        for other in library.of_equation(library.terms[k].equation):
            if other in found.kept:
                continue
            swapped = tuple(sorted((*found.kept[:index], *found.kept[index + 1 :], other)))
            if base > 0 and total.residual(swapped) < base * np.exp(worse / total.count):
                choices.append(swapped)
    return choices
