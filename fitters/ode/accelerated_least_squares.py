"""Least squares inside bounds by the method of Levenberg and Marquardt with geodesic acceleration.

Over many periods a motion bends the residual: where a frequency and a damping change together, the sum of squares has a
long and narrow curved valley, along which a straight step has to be short. Half the second derivative of the residual
along the step, known from one more prediction, bends the step into the valley (Transtrum and Sethna 2012,
arXiv:1201.5885). The damping follows the gain as in Nielsen (1999, Damping Parameter in Marquardt's Method, IMM, DTU).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from iris_sysid.types import Array, Mask

DAMPING = 1e-12, 1e-3, 1e6  # the least, the first and the largest, relative to the squares of the derivatives
MIN_FACTOR = 0.2  # of the damping after a step whose gain was as expected
PROBE = 0.1  # of a step, at which the residual is predicted for its second derivative; Transtrum and Sethna have it
BEND = 0.75  # largest acceleration over the step for which the second order holds, by the same authors


@dataclass(frozen=True, eq=False, slots=True)
class LeastSquaresEnd:
    """Where a minimisation ended: values ``x`` (k,), ``residual`` (r,) there, whether it ``converged``, and why."""

    x: Array
    residual: Array
    converged: bool
    message: str


@dataclass(frozen=True, eq=False, slots=True)
class _Quadratic:
    """The sum of squares about values ``x`` (k,); those that ``moving`` (k,) marks are changed.

    ``residual`` (r,) there and its derivatives ``slopes`` (r, m) by the moving values in units of ``size`` (k,); their
    products with themselves ``square`` (m, m) and with the residual ``gradient`` (m,).
    """

    x: Array
    residual: Array
    slopes: Array
    square: Array
    gradient: Array
    moving: Mask
    size: Array
    bounds: tuple[Array, Array]

    @classmethod
    def about(cls, x: Array, residual: Array, jacobian: Array, size: Array, bounds: tuple[Array, Array]) -> _Quadratic:
        """Values at a bound, behind which the sum of squares falls, do not move."""
        uphill = jacobian.T @ residual
        moving = ~(((x <= bounds[0]) & (uphill > 0)) | ((x >= bounds[1]) & (uphill < 0)))
        slopes = (jacobian / size)[:, moving]
        return cls(x, residual, slopes, slopes.T @ slopes, slopes.T @ residual, moving, size, bounds)

    def tried(self, damping: float, residual: Callable[[Array], Array]) -> tuple[Array | None, float]:
        """The values (k,) to try next, None where the step bends too much, and the fall expected of a straight step."""
        factor = cho_factor(self.square + damping * np.eye(len(self.square)))
        straight = -cho_solve(factor, self.gradient)
        linear = self.slopes @ straight
        expected = float(self.residual @ self.residual - np.sum((self.residual + linear) ** 2))
        probed = residual(self._moved(PROBE * straight))
        second = 2.0 / PROBE * ((probed - self.residual) / PROBE - linear)
        turn = -cho_solve(factor, self.slopes.T @ second, check_finite=False)
        follows = np.linalg.norm(turn) <= BEND * np.linalg.norm(straight)  # not where a prediction diverges either
        return (self._moved(straight + turn / 2) if follows else None), expected

    def _moved(self, step: Array) -> Array:
        """The values (k,) after a step (m,) of the moving ones, inside the bounds."""
        moved = self.x.copy()
        moved[self.moving] += step / self.size[self.moving]
        return np.clip(moved, *self.bounds)


def accelerated_least_squares(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    start: Array,
    bounds: tuple[Array, Array],
    tolerance: float,
    evaluations: int,
) -> LeastSquaresEnd:
    """Minimise a sum of squares.

    Parameters
    ----------
    residual
        ``residual(x (k,))`` (r,), large and finite where the prediction diverges.
    jacobian
        ``jacobian(x (k,))`` (r, k).
    start
        (k,), inside the bounds.
    bounds
        Lower and upper ones, (k,) each, infinite where there are none.
    tolerance
        It ends where a step changes the sum of squares, and was expected to change it, by less than this share.
    evaluations
        Largest number of residuals; those of the derivatives are not counted.

    Examples
    --------
    >>> import numpy as np
    >>> from fitters.ode.accelerated_least_squares import accelerated_least_squares
    >>> valley = lambda x: np.array([100 * (x[1] - x[0] ** 2), 1 - x[0]])
    >>> slopes = lambda x: np.array([[-200 * x[0], 100.0], [-1.0, 0.0]])
    >>> free = np.full(2, np.inf)
    >>> end = accelerated_least_squares(valley, slopes, np.array([-1.2, 1.0]), (-free, free), 1e-8, 100)
    >>> end.converged, np.allclose(end.x, 1.0, atol=1e-6)
    (True, True)
    """
    x = np.clip(start, *bounds)
    now = residual(x)
    cost, count, damping, growth = float(now @ now), 1, DAMPING[1], 2.0
    size, about = np.zeros(x.size), None
    while count < evaluations:
        if about is None:
            slopes = jacobian(x)
            size = np.maximum(size, np.linalg.norm(slopes, axis=0))
            about = _Quadratic.about(x, now, slopes, np.where(size > 0, size, 1.0), bounds)
        if damping > DAMPING[2] or not about.moving.any():
            return LeastSquaresEnd(x, now, True, "no step lowers the sum of squares")
        trial, expected = about.tried(damping, residual)
        found = now if trial is None else residual(trial)
        count += 1 if trial is None else 2
        after = float(found @ found)
        if trial is None or not after < cost:
            damping, growth = damping * growth, growth * 2
            continue
        fall, gain = cost - after, (cost - after) / max(expected, cost - after)
        x, now, before, cost, about = trial, found, cost, after, None
        if max(fall, expected) < tolerance * before:
            return LeastSquaresEnd(x, now, True, "a step changes the sum of squares no more")
        damping, growth = max(damping * max(MIN_FACTOR, 1 - (2 * gain - 1) ** 3), DAMPING[0]), 2.0
    return LeastSquaresEnd(x, now, False, "the largest number of evaluations was reached")
