"""The error of a model over blocks that its fit did not see, and how sure a difference of two such errors is.

The used samples of a clip are cut into blocks of equal length. All but the first, which fixes the initial state, are
left out in turn as a whole; the model is fitted to the rest and predicts them from the initial state, without looking
at a sample in between. Neighbouring samples share their noise and what the model lacks; blocks do so far less, so that
the scatter over blocks tells how sure a difference is (block bootstrap: Kuensch 1989, Ann. Stat. 17, 1217).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitters.ode import FitRequest
from iris_sysid.diagnosis.prediction_error import Indices, block_errors, without_samples
from iris_sysid.diagnosis.refit import DETERMINED, ModelWithEffects, fit_from, free_values
from iris_sysid.types import Array, Effect, Estimate, FitResult, student_ppf

BLOCKS = 8  # of a clip that are left out in turn
BLOCKS_OF_SEVERAL = 4  # the same where there are several clips, or a driven motion, whose fits take long
SAMPLES_A_VALUE = 2  # samples per free value that a fit needs after a block is left out
MIN_FITS = 3  # without a block, whose scatter tells an error
DRAWS = 2000  # of blocks with replacement
MIN_SHARE = 0.03  # of a sum of squares, that an effect must remove to be kept
SURE = 0.9  # share of block bootstraps in which it must improve the prediction
ALIKE = 1.2  # ratio of squared errors over blocks, up to which two models explain them alike
SEED = 0


@dataclass(frozen=True, eq=False, slots=True)
class BlockErrors:
    """Mean squared errors over blocks (b,), in units of the noise, and (b,) their samples; ``rms`` in observed units.

    Infinite where a fit without a block failed. ``values`` holds, one a clip and by name, what each fit without a block
    gave for a free value. Beyond ``usual``, a squared error that is not unusual without any effect, a larger one counts
    by its logarithm (Student's t): a block that nothing predicts decides no more than others.
    """

    squares: Array
    counts: Array
    rms: float
    values: tuple[Mapping[str, Array], ...] = ()
    usual: float = np.inf

    @property
    def scores(self) -> Array:
        """The squared errors (b,), what is beyond the usual size damped."""
        return self.usual * np.log1p(self.squares / self.usual) if np.isfinite(self.usual) else self.squares

    @property
    def mean(self) -> float:
        """The mean squared error of a sample, in units of the noise."""
        return float(np.average(self.squares, weights=self.counts))

    @property
    def score(self) -> float:
        """The same of the damped errors, by which models are compared."""
        return float(np.average(self.scores, weights=self.counts))

    def share_below(self, other: BlockErrors) -> float:
        """The share of block bootstraps in which this error is smaller than another one over the same blocks."""
        return float(np.mean(_draws(other, self) > 0))

    def gain_over(self, other: BlockErrors) -> tuple[float, float]:
        """By how much the mean score is smaller than another one, and the block standard error of that."""
        return other.score - self.score, float(np.std(_draws(other, self)))

    def is_steady(self, name: str) -> bool:
        """Whether a value has the same sign in each fit without a block that determines it, in the mean over clips."""
        each = np.mean([clip[name] for clip in self.values if name in clip], axis=0)
        known = each[np.isfinite(each)]
        return known.size >= min(MIN_FITS, each.size) and bool(np.all(known > 0) or np.all(known < 0))

    def estimates(self, clip: int, fitted: FitResult) -> dict[str, Estimate]:
        """The free values of a clip's fit with errors from their scatter without a block (delete-a-block jackknife).

        It holds where the residual is not noise as well. The interval is Student's t.

        Parameters
        ----------
        clip
            Its number.
        fitted
            Its fit to all samples.
        """
        found = {}
        for name in fitted.free:
            each = self.values[clip].get(name, np.zeros(0))
            each = each[np.isfinite(each)]
            if each.size < MIN_FITS:
                continue
            stderr = float(np.sqrt((each.size - 1) / each.size * np.sum((each - each.mean()) ** 2)))
            value, half = fitted.estimates[name].value, stderr * student_ppf(0.975, each.size - 1)
            found[name] = replace(fitted.estimates[name], stderr=stderr, ci95=(value - half, value + half))
        return found


def _draws(worse: BlockErrors, better: BlockErrors) -> Array:
    """Differences of the mean scores in bootstraps of the blocks (DRAWS,)."""
    with np.errstate(invalid="ignore"):
        difference = np.nan_to_num(worse.scores - better.scores, nan=0.0, posinf=1e30, neginf=-1e30)
    drawn = np.random.default_rng(SEED).integers(difference.size, size=(DRAWS, difference.size))
    weights = worse.counts[drawn]
    return np.asarray(np.sum(weights * difference[drawn], axis=1) / np.sum(weights, axis=1))


def wins(errors: Mapping[str, BlockErrors]) -> dict[str, float]:
    """The share of block bootstraps in which each of several models has the smallest error, the largest share first.

    Parameters
    ----------
    errors
        By name, over the same blocks.
    """
    names = list(errors)
    first = errors[names[0]]
    means = np.stack([_draws(first, errors[name]) for name in names])
    counts = np.bincount(np.argmax(means, axis=0), minlength=len(names)) / means.shape[1]
    return {names[k]: float(counts[k]) for k in np.argsort(-counts, kind="stable")}


def blocks_of(fitted: FitResult, count: int) -> list[Indices]:
    """Indices (m,) of the samples of each block that is left out; empty where too few would be left, or in a block."""
    used = np.flatnonzero(fitted.used)
    parts = np.array_split(used, count + 1)[1:]
    sizes = [part.size for part in parts]
    enough = min(sizes, default=0) > 0 and used.size - max(sizes) >= SAMPLES_A_VALUE * len(fitted.free)
    return [np.asarray(part, dtype=np.intp) for part in parts] if enough else []


def held_out_errors(
    clips: Sequence[FitRequest], model: ModelWithEffects, blocks: Sequence[Sequence[Indices]]
) -> BlockErrors:
    """The errors of a model over blocks that its fits did not see; with several clips sizes come from the others.

    Parameters
    ----------
    clips
        The fit requests with all samples.
    model
        The fits to them.
    blocks
        Those of each clip, from :func:`blocks_of`.
    """
    clips = [_in_blocks(clip, own) for clip, own in zip(clips, blocks, strict=True)]
    squares, counts, sums = [], [], []
    values: list[dict[str, list[float]]] = [{} for _ in clips]
    for left_out in zip(*blocks, strict=True):
        fits = tuple(
            _fitted_without(clip, fitted, later, model.effects)
            for clip, fitted, later in zip(clips, model.fits, left_out, strict=True)
        )
        for kept, whole, fitted in zip(values, model.fits, fits, strict=True):
            for name in whole.free:
                known = fitted.status in DETERMINED and name in fitted.free
                kept.setdefault(name, []).append(fitted.estimates[name].value if known else float("nan"))
        judged = [_in_fit(fitted, later) for fitted, later in zip(model.fits, left_out, strict=True)]
        for weighed, plain in block_errors(clips, replace(model, fits=fits), judged):
            squares.append(weighed)
            sums.append(plain)
        counts += [later.size for later in left_out]
    every = np.array(counts, dtype=np.float64)
    rms = float(np.sqrt(np.average(np.array(sums), weights=every))) if every.size else float("nan")
    each = tuple({name: np.array(kept) for name, kept in clip.items()} for clip in values)
    return BlockErrors(np.array(squares), every, rms, each)


def _in_fit(fitted: FitResult, block: Indices) -> Indices:
    """The samples of a block without those that the fit to all of them takes for outliers."""
    kept = block[fitted.used[block]]
    return kept if kept.size else block


def _in_blocks(clip: FitRequest, blocks: Sequence[Indices]) -> FitRequest:
    """The clip without the samples between its blocks, e.g. outliers: every fit would see them."""
    between = np.setdiff1d(np.arange(blocks[0][0], clip.trajectory.t_s.size), np.concatenate(blocks))
    return without_samples(clip, between)


def _fitted_without(clip: FitRequest, fitted: FitResult, later: Indices, effects: Sequence[Effect]) -> FitResult:
    """The fit without some samples, from the minimum of nearly the same ones; roughly, where that is enough.

    Where the rest says nothing of an effect, e.g. of a frame lost in the last block, it is absent.
    """
    known, start = without_samples(clip, later), free_values(fitted)
    rough = known.roughly()
    found = fit_from(rough, fitted.model, start)
    unknown = [each for each in effects if _is_undetermined(found, each.parameters[0].name)]
    if unknown:
        shapes = {each.name: fitted.estimates[each.name].value for effect in unknown for each in effect.parameters}
        absent = {**shapes, **{effect.parameters[0].name: 0.0 for effect in unknown}}
        left = {name: value for name, value in start.items() if name not in absent}
        found = fit_from(rough.with_(fixed={**clip.fixed, **absent}), fitted.model, left)
    return found if found.usable else fit_from(known, fitted.model, start)


def _is_undetermined(fitted: FitResult, name: str) -> bool:
    return fitted.usable and name in fitted.free and not np.isfinite(fitted.estimates[name].stderr)


def every_block(fits: Sequence[FitResult]) -> list[list[NDArray[np.intp]]]:
    """The blocks of all clips, as many of each; none where a clip is too short."""
    count = BLOCKS if len(fits) == 1 and not fits[0].model.inputs else BLOCKS_OF_SEVERAL
    blocks = [blocks_of(fitted, count) for fitted in fits]
    return blocks if all(blocks) else []
