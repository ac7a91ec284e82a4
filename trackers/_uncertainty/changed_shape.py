"""Position errors of a body that is not a disc: in a direction that turns with the body, and by its motion blur."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Mask
from trackers._uncertainty.error_correlation import ROUND
from trackers._uncertainty.running_median import running_median

# On cups (960x540, seed 4101, settings cone_45, cone_60 and cone_80, first clips), whose corners and rim are cut off
# as cords are: 0.34 px of shift over 3.0 px of the outline's third lobe; and the change of the shift with the blur,
# 0.25 px, over that of the lobe
SHIFT_OF_LOBE, CHANGE_OF_LOBE = 0.115, 0.8
NEIGHBOURS = 5  # samples whose median lobe counts: errors of single frames are in the errors already


def changed_shape(lobes: Array, radius: Array, moving: Mask) -> Array:
    """Additional standard errors (k,) of positions along each axis, px, by what changes the outline of a body.

    Corners and rims that are thin beside the body are cut off. That shifts the position by a vector fixed in the body,
    whose size goes with that of the outline's third lobe. A turn by alpha turns the lobe's phase by 3 alpha, and
    changes the shift by 2 sin(alpha/2) of its size. Motion blur changes how much is cut, and the size of the lobe.
    What the shift is in the typical shape is the same for all positions, and no error of the motion. Its direction
    counts as unknown: 1/sqrt(2) of it along each axis.

    Parameters
    ----------
    lobes
        Amplitudes (k, 4) of the outline's lobes, px.
    radius
        Radius (k,) of the disc of the same area, px.
    moving
        In which of these samples (k,) the body moves: they give the typical shape, all samples where it never moves.
    """
    third = lobes[:, 0] + 1j * lobes[:, 1]
    told = third[moving] if moving.any() else third
    typical = complex(np.median(told.real), np.median(told.imag))
    if abs(typical) <= ROUND * np.median(radius):
        return np.zeros(len(third))
    turned = np.angle(third * np.conj(typical)) / 3
    by_turn = SHIFT_OF_LOBE * abs(typical) * 2 * np.sin(turned / 2)
    size = running_median(np.abs(third), NEIGHBOURS, "edge")
    by_blur = CHANGE_OF_LOBE * (size - np.median(np.abs(told)))
    return np.asarray(np.hypot(by_turn, by_blur) / np.sqrt(2))
