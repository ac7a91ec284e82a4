"""The error over blocks left out to first order, from the fit to all samples alone: no fit is made anew.

With the residual r in units of the noise, its derivatives -J by the free values, and A = J'J, a fit without the samples
of a block B moves the values by -(A - J_B' J_B)^-1 J_B' r_B; its error over the block is r_B less J_B times that (Cook
and Weisberg 1982, Residuals and Influence in Regression, section 2.2). A prior is one more sample, in no block.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.diagnosis.held_out_blocks import BlockErrors
from iris_sysid.diagnosis.prediction_error import Indices
from iris_sysid.diagnosis.refit import ModelWithEffects, pooled
from iris_sysid.types import Array, FitResult

SINGULAR = 1e-12  # of the largest eigenvalue: in directions below it the samples say nothing, and values stay


@dataclass(frozen=True, eq=False, slots=True)
class _Linear:
    """A fit to first order, without one block after the other.

    ``residual`` (n, d), ``noise`` (n, d) and ``jacobian`` (n, d, k) at the samples used, the latter in units of the
    noise; ``information`` (k, k) is J'J with the priors. J'r is zero at a minimum: where it is not, a value that the
    samples do not determine would move without limit.
    """

    fitted: FitResult
    residual: Array
    noise: Array
    jacobian: Array
    information: Array

    @classmethod
    def of(cls, fitted: FitResult, unit: Array) -> _Linear:
        noise = unit[fitted.used]
        weighed = fitted.residual[fitted.used] / noise
        rows = fitted.informed_jacobian(noise)
        jacobian = rows[: weighed.size].reshape(*weighed.shape, -1)
        with np.errstate(all="ignore"):
            return cls(fitted, weighed, noise, jacobian, rows.T @ rows)

    def without(self, block: Indices, given: Mapping[str, float] | None = None) -> Array:
        """The change (k,) of each free value without a block, some of the values moved to where others say."""
        rows, seen = self._rows(block), self.fitted.free
        with np.errstate(all="ignore"):
            information = self.information - np.einsum("ndk,ndl->kl", self.jacobian[rows], self.jacobian[rows])
        slope = -np.einsum("ndk,nd->k", self.jacobian[rows], self.residual[rows])
        change, held = np.zeros(len(seen)), np.isin(seen, self._unknown_forms)
        for name, value in (given or {}).items():
            k = seen.index(name)
            held[k], change[k] = True, value - self.fitted.estimates[name].value
        left = ~held
        with np.errstate(all="ignore"):  # of derivatives that are not finite the solution is infinite
            change[left] = _solved(information[np.ix_(left, left)], (slope - information @ change)[left])
        return change

    @property
    def _unknown_forms(self) -> list[str]:
        """The forms of effects that the samples do not determine: a small change says nothing of a large one there."""
        known = {each.name: self.fitted.estimates[each.name] for each in self.fitted.model.with_role("form")}
        return [name for name, each in known.items() if not each.stderr < abs(each.value)]

    def errors(self, block: Indices, change: Array) -> Array:
        """The errors (m, d) over a block, in units of the noise, of values moved by ``change`` (k,)."""
        rows = self._rows(block)
        with np.errstate(all="ignore"):  # a change without limit is infinitely wrong
            return np.asarray(self.residual[rows] - self.jacobian[rows] @ change)

    def plain(self, block: Indices, errors: Array) -> Array:
        """Errors (m, d) in observed units."""
        return np.asarray(errors * self.noise[self._rows(block)])

    def _rows(self, block: Indices) -> Indices:
        return np.searchsorted(np.flatnonzero(self.fitted.used), block[self.fitted.used[block]])


def _solved(information: Array, slope: Array) -> Array:
    """The solution (k,) of the normal equations, zero along directions that the samples do not determine.

    Infinite where a derivative is not finite.
    """
    if not slope.size:
        return slope
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    with np.errstate(all="ignore"):
        scaled = information / scale / scale[:, None]
    if not np.all(np.abs(scaled) < 2.0):  # of what is one on the diagonal: derivatives that are not finite
        return np.full(slope.size, np.inf)
    values, vectors = np.linalg.eigh(scaled)
    known = values > SINGULAR * values[-1]
    along = vectors[:, known].T @ (slope / scale)
    return np.asarray(vectors[:, known] @ (along / values[known]) / scale)


def linearised_errors(model: ModelWithEffects, blocks: Sequence[Sequence[Indices]]) -> BlockErrors:
    """:func:`held_out_errors` to first order: the same blocks, no new fit.

    Parameters
    ----------
    model
        The fits to all samples.
    blocks
        Those of each clip.
    """
    linear = [_Linear.of(fitted, unit) for fitted, unit in zip(model.fits, model.units, strict=True)]
    squares, counts, sums = [], [], []
    values: list[dict[str, list[float]]] = [{name: [] for name in fitted.free} for fitted in model.fits]
    for left_out in zip(*blocks, strict=True):
        changes = [clip.without(block) for clip, block in zip(linear, left_out, strict=True)]
        for kept, clip, change in zip(values, linear, changes, strict=True):
            for name, shift in zip(clip.fitted.free, change, strict=True):
                kept[name].append(clip.fitted.estimates[name].value + float(shift))
        if len(linear) > 1 and model.effects:
            given = [_sizes_of_others(k, model, values) for k in range(len(linear))]
            changes = [clip.without(*each) for clip, *each in zip(linear, left_out, given, strict=True)]
        for clip, block, change in zip(linear, left_out, changes, strict=True):
            errors = clip.errors(block, change)
            squares.append(_mean_square(errors))
            sums.append(_mean_square(clip.plain(block, errors)))
            counts.append(len(errors))
    every = np.array(counts, dtype=np.float64)
    rms = float(np.sqrt(np.average(np.array(sums), weights=every))) if every.size else float("nan")
    each = tuple({name: np.array(kept) for name, kept in clip.items()} for clip in values)
    return BlockErrors(np.array(squares), every, rms, each)


def _mean_square(errors: Array) -> float:
    """Infinite where an error is not a number."""
    with np.errstate(all="ignore"):
        square = float(np.mean(errors**2))
    return square if np.isfinite(square) else float("inf")


def _sizes_of_others(
    k: int, model: ModelWithEffects, values: Sequence[Mapping[str, Sequence[float]]]
) -> dict[str, float]:
    """The size of each effect in the k-th clip as the other clips have it without their last block."""
    given = {}
    for effect in model.effects:
        name, factors = effect.parameters[0].name, model.factors(effect)
        others = [
            replace(size, value=values[j][name][-1] / factors[j])
            for j, size in enumerate(model.sizes_of(name))
            if j != k
        ]
        given[name] = factors[k] * pooled(others).value
    return given
