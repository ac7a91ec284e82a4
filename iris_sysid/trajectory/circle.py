"""The circle through positions by least squares, without a judgement: that of a pendulum is in phenomena."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from iris_sysid.types import Array

MAX_CONDITION = 1e14  # of the information on centre and radius: beyond it the positions lie on a line


class CircleFit(NamedTuple):
    """Centre ``x``, ``z`` and ``radius`` of a circle, and the random standard error of the radius.

    All in the unit of the positions. Infinite for a line.
    """

    x: float
    z: float
    radius: float
    stderr: float


NO_CIRCLE = CircleFit(math.inf, math.inf, math.inf, math.inf)


def circle_through(position: Array, loss: Literal["linear", "soft_l1"] = "linear") -> CircleFit:
    """Least squares of the orthogonal distances of positions (n, 2), from Kasa's algebraic fit.

    Kasa (1976), IEEE Trans. Instrum. Meas. 25, 8. ``soft_l1`` weighs distances above 2 % of the extent less.
    """
    from scipy.optimize import least_squares  # here: what lists phenomena does not need it

    middle, size = position.mean(axis=0), float(np.std(position)) or 1.0
    x, z = ((position - middle) / size).T
    design = np.column_stack([2 * x, 2 * z, np.ones(x.size)])
    first = np.linalg.lstsq(design, x**2 + z**2, rcond=None)[0]
    start = [first[0], first[1], math.sqrt(max(first[2] + first[:2] @ first[:2], 1e-12))]

    def off(circle: Array) -> Array:
        return np.asarray(np.hypot(x - circle[0], z - circle[1]) - circle[2])

    found = least_squares(off, start, loss=loss, f_scale=0.02)
    jacobian: Array = np.asarray(found.jac)
    information = jacobian.T @ jacobian
    if not np.linalg.cond(information) < MAX_CONDITION:
        return NO_CIRCLE
    stderr = math.sqrt(float(np.mean(found.fun**2)) * np.linalg.inv(information)[2, 2]) * size
    centre = middle + size * found.x[:2]
    return CircleFit(float(centre[0]), float(centre[1]), abs(float(found.x[2])) * size, stderr)
