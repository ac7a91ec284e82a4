"""Errors of a body that is no disc and turns: its position is off in a direction that turns with it."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Mask

# shift of the position over the amplitude of the outline's third lobe: 0.34 px over 3.0 px of a cup (960x540, seed
# 4101, settings cone_45, cone_60 and cone_80, first clips), whose corners and rim are cut off as cords are
SHIFT_OF_LOBE = 0.115


def turned_shape(lobes: Array, moving: Mask) -> Array:
    """Standard errors (k,), px, of positions of a body that has turned since it moved.

    Corners and rims that are thin beside the body are cut off. That shifts the position by a vector fixed in the body,
    whose size goes with that of the outline's third lobe. A turn by alpha turns the lobe's phase by 3 alpha, and
    changes the shift by 2 sin(alpha/2) of its size. What the shift is in the typical orientation is the same for all
    positions, and no error of the motion.

    Parameters
    ----------
    lobes
        Amplitudes (k, 4) of the outline's lobes, px.
    moving
        In which of these samples (k,) the body moves: they tell the typical orientation, all where none does.
    """
    third = lobes[:, 0] + 1j * lobes[:, 1]
    told = third[moving] if moving.any() else third
    typical = complex(np.median(told.real), np.median(told.imag))
    turned = np.angle(third * np.conj(typical)) / 3
    return np.asarray(SHIFT_OF_LOBE * abs(typical) * 2 * np.abs(np.sin(turned / 2)))
