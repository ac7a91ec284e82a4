"""Score every effect that a model may lack against what a fit leaves over, without refitting.

With s the effect's sensitivity, J those of the fitted parameters and r the residual, all in units of the noise,
s' = s - J (J'J)^-1 J's is what the parameters cannot imitate, (s'r) / (s's') estimates the size to first order
(Rao 1948, Proc. Camb. Phil. Soc. 44, 50), and (s'r)^2 / (s's' r'r) is the share of the residual that it explains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from fitters._autoregression import Autoregression, grid_positions, on_grid
from fitters._covariance import inverse_normal, middle, random_uncertainty
from fitters.screen import motion_of, sensitivity
from iris_sysid.types import Array, Effect, FitResult, Trajectory

HIDDEN = 1e-4  # share of a sensitivity that must be left after the parameters have taken theirs


@dataclass(frozen=True, slots=True)
class Score:
    """One effect in one round of the screen.

    ``size`` and ``stderr`` are its first-order estimate in ``unit``; ``gain`` is the share of the residual's
    sum of squares ``total``, in units of the noise, that it would take away; ``chi2`` is what that would take off
    the chi-square of white noise. ``size`` and ``stderr`` are NaN when the data cannot show the effect.
    """

    effect: str
    size: float
    stderr: float
    unit: str
    gain: float
    total: float
    chi2: float
    shape: tuple[float, ...] = ()
    tried: int = 1

    @property
    def z(self) -> float:
        """Size in standard errors."""
        return self.size / self.stderr if self.stderr > 0 else float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class _Residual:
    """What a fit leaves over, in units of the noise, and how it hangs together in time.

    ``values`` (n, d); ``basis`` (n * d, k) orthonormal, spans what the fitted parameters can imitate; ``process``
    one autoregression a quantity.
    """

    t_s: Array
    values: Array
    basis: Array
    process: tuple[Autoregression, ...]

    @classmethod
    def of(cls, fitted: FitResult, noise: Array) -> _Residual:
        values = fitted.residual[fitted.used] / noise
        jacobian = fitted.jacobian / np.tile(noise, len(values))[:, None]
        jacobian = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        shaped = jacobian.reshape(*values.shape, -1)
        t_s = fitted.t_s[fitted.used]
        process = random_uncertainty(t_s, values, shaped, inverse_normal(jacobian)).noise
        return cls(t_s, values, np.linalg.qr(jacobian)[0], process)

    @property
    def total(self) -> float:
        """Sum of squares."""
        return max(float(np.sum(self.values**2)), 1e-300)

    def variance_along(self, direction: Array) -> float:
        """Variance of the residual's component along a unit vector (n * d,): 1 for white noise of sigma."""
        positions = grid_positions(self.t_s)
        shaped = direction.reshape(self.values.shape)
        parts = [
            middle(on_grid(positions, shaped[:, [k]], 0.0), process.coefficients)[0, 0] * process.innovation_sd**2
            for k, process in enumerate(self.process)
        ]
        return float(sum(parts))


def screen(
    effects: Sequence[Effect], fitted: FitResult, trajectory: Trajectory
) -> tuple[tuple[Score, ...], dict[str, Array]]:
    """Score each effect against the residual of a fit, best first.

    Parameters
    ----------
    effects
        All apply to the fitted model.
    fitted
        The model without them.
    trajectory
        What it was fitted to.

    Returns
    -------
    scores : tuple of Score
        In falling order of gain.
    projected : dict of str to ndarray
        s' of each effect, of unit length; absent when the parameters imitate it entirely.
    """
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    residual = _Residual.of(fitted, noise)
    scores, projected = [], {}
    forces = any(effect.acceleration is not None for effect in effects)
    motion = motion_of(fitted, trajectory) if forces else None
    for effect in effects:
        best, direction = _best_shape(
            effect, fitted, residual, lambda one: sensitivity(one, fitted, trajectory, motion) / noise
        )
        scores.append(best)
        if direction is not None:
            projected[effect.name] = direction
    return tuple(sorted(scores, key=lambda score: -score.gain)), projected


def shaped(effect: Effect, shape: Sequence[float]) -> Effect:
    """The effect with other values of its parameters after the first as their defaults; as it is when there are none.

    Parameters
    ----------
    effect
        The effect.
    shape
        As many values as parameters after the first, or none.
    """
    if not shape:
        return effect
    size, *rest = effect.parameters
    changed = (replace(one, default=value) for one, value in zip(rest, shape, strict=True))
    return replace(effect, parameters=(size, *changed))


def _best_shape(
    effect: Effect, fitted: FitResult, residual: _Residual, sensitivity_of: Callable[[Effect], Array]
) -> tuple[Score, Array | None]:
    """The score of the effect in the shape that explains most, and its direction; None when it cannot be seen."""
    seen = (fitted.predicted + fitted.residual)[fitted.used]
    shapes = list(effect.trials(residual.t_s, seen)) if effect.trials is not None else [()]
    unit = effect.parameters[0].unit.replace("{x}", fitted.model.observed[0].unit)
    best = Score(effect.name, np.nan, np.nan, unit, 0.0, residual.total, 0.0, tried=len(shapes))
    seen_best: tuple[float, Array, tuple[float, ...]] | None = None
    for shape in shapes:
        along = sensitivity_of(shaped(effect, shape)).ravel()
        apart = along - residual.basis @ (residual.basis.T @ along)
        length = float(np.linalg.norm(apart))
        if not np.isfinite(length) or length <= HIDDEN * float(np.linalg.norm(along)):
            continue
        explained = abs(float(apart @ residual.values.ravel())) / length
        if seen_best is None or explained > seen_best[0]:
            seen_best = (explained, apart, shape)
    if seen_best is None:
        return best, None
    length = float(np.linalg.norm(seen_best[1]))
    direction = seen_best[1] / length
    return replace(_scored(best, direction, length, residual), shape=seen_best[2]), direction


def _scored(score: Score, direction: Array, length: float, residual: _Residual) -> Score:
    """The score with its numbers along a direction of unit length."""
    along = float(direction @ residual.values.ravel())
    gain = min(along**2 / residual.total, 1.0)
    degrees = max(direction.size - residual.basis.shape[1] - 1, 1)
    return replace(
        score,
        size=along / length,
        stderr=float(np.sqrt(residual.variance_along(direction))) / length,
        gain=gain,
        chi2=degrees * gain / max(1.0 - gain, 1e-12),
    )


def significant_from(share: float, tries: int) -> float:
    """Standard errors from which a size differs from zero at the level ``share``, two-sided, in so many tries."""
    return float(norm.isf(share / 2 / tries))


def combined(scores: Sequence[Score]) -> Score:
    """One effect's scores in several clips, as of one effect of one size; the only one, where there is but one."""
    first = scores[0]
    if len(scores) == 1:
        return first
    weights = np.array([1.0 / one.stderr**2 if one.stderr > 0 else 0.0 for one in scores])
    total = sum(one.total for one in scores)
    gain = sum(one.gain * one.total for one in scores) / total
    chi2 = sum(one.chi2 for one in scores)
    together = replace(first, size=np.nan, stderr=np.nan, gain=gain, total=total, chi2=chi2)
    if not weights.sum() > 0:
        return together
    size = float(np.sum(weights * np.nan_to_num([one.size for one in scores])) / weights.sum())
    return replace(together, size=size, stderr=float(weights.sum() ** -0.5))
