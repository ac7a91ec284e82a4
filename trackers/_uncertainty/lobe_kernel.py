"""Lobes of an outline from the coverage of the pixels about it (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

LOBES = (3, 5)  # odd as a shift is: a shape with a centre of symmetry, a disc or its streak, has none
INNER, OUTER = 0.5, 1.8  # of the radius, between which the outline lies


@kernel(nogil=True)
def lobes_of(share: Array, x: float, y: float, area: float) -> Array:
    """Amplitudes (4,), px, of the outline's lobes of order three and five: (cosine, sine) of each.

    An edge in which the coverage falls linearly over the width w holds sum(a (1 - a)) = 2 pi r w / 6. The pixels alone
    give a sharp disc lobes of a few hundredths of a pixel; those of a disc with an edge as wide are taken off.

    Parameters
    ----------
    share
        Coverage (h, w) of each pixel by the body, 0 to 1.
    x, y, area
        Its centre, px from the centre of pixel (0, 0), and its area, px^2.
    """
    radius = math.sqrt(area / math.pi)
    nearest, farthest = (INNER * radius) ** 2, (OUTER * radius) ** 2
    mixed = 0.0
    for row in range(share.shape[0]):
        for column in range(share.shape[1]):
            if nearest < (column - x) ** 2 + (row - y) ** 2 < farthest:
                covered = min(max(share[row, column], 0.0), 1.0)
                mixed += covered * (1 - covered)
    width = max(1.0, 6 * mixed / (2 * math.pi * radius))
    sums = np.zeros(2, dtype=np.complex128)
    for row in range(share.shape[0]):
        for column in range(share.shape[1]):
            squared = (column - x) ** 2 + (row - y) ** 2
            if nearest < squared < farthest:
                away = math.sqrt(squared)
                off = share[row, column] - min(max((radius - away) / width + 0.5, 0.0), 1.0)
                if off == 0.0:
                    continue
                direction = complex(column - x, row - y) / max(away, 1e-9)
                turned = off * direction * direction * direction
                sums[0] += turned
                sums[1] += turned * direction * direction
    sums /= math.pi * radius
    return np.array([sums[0].real, sums[0].imag, sums[1].real, sums[1].imag])
