"""Starting values from motions that impacts cut into pieces."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from fitters.models._gravity import STANDARD_GRAVITY
from fitters.starting_values import solved, start_of, weak_system
from iris_sysid.types import Array

NEAR = 0.3  # share of the range of the distance above its smallest value that still counts as near
MIN_SAMPLES = 4  # samples of a piece

Piece = tuple[Array, Array, Array]  # times (n,) s, values (n,), terms (n, k)


def between_contacts(apart: Array) -> tuple[float, list[slice]]:
    """Smallest distance of two bodies (n,) and the stretches between the samples at which they come near.

    Both in the unit of the distance.
    """
    from scipy.signal import argrelmin  # here: it takes a second to load, and only this model needs it

    nearest = float(np.min(apart))
    near = nearest + NEAR * float(np.ptp(apart))
    contacts = [int(k) for k in argrelmin(apart, order=1, mode="wrap")[0] if apart[k] < near]
    edges = [-1, *contacts, apart.size]
    stretches = [slice(a + 1, b) for a, b in pairwise(edges) if b - a - 1 >= MIN_SAMPLES]
    return nearest, stretches or [slice(0, apart.size)]


def bounces(t_s: Array, height: Array) -> tuple[dict[str, float], list[slice]]:
    """Restitution, floor, gravity, and height and speed at the first sample of a body that bounces, and its flights.

    ``t_s`` (n,), s; ``height`` (n,), m or px; speed and gravity per s and s^2.

    The floor is where the height (n,) is least, the restitution comes from the heights of successive flights.
    """
    floor, flights = between_contacts(height)
    start = start_of(t_s[flights[0]], height[flights[0]], np.inf, degree=2)
    tops = np.array([np.max(height[flight]) for flight in flights]) - floor
    after = tops[2:] / tops[1:-1] if tops.size > 2 else tops[1:] / tops[:-1]
    values = {
        "restitution": float(np.clip(np.sqrt(np.median(after)), 0.1, 0.95)) if after.size else 0.7,
        "floor": floor,
        "gravity": -float(start[2]) if start[2] < 0 else STANDARD_GRAVITY,
        "z_0": float(start[0]),
        "vz_0": float(start[1]),
    }
    return values, flights


def pieces_regression(pieces: Sequence[Piece]) -> tuple[Array, float]:
    """Coefficients c (k + 1,) of ``y'' = c[0] f_0(y) + ... + c[-1] y'`` common to all pieces, in weak form.

    Where the pieces are too short for that, at a low frame rate, second differences stand for the derivative.

    Parameters
    ----------
    pieces
        Each without an impact inside.

    Returns
    -------
    coefficients : (k + 1,)
        NaN where the pieces do not determine them.
    half_width_s : float
        Half the width of the widest window.
    """
    left, right, widest_s = [], [], 0.0
    for t_s, values, terms in pieces:
        half_width_s = 0.45 * float(t_s[-1] - t_s[0])
        rows = weak_system(t_s, values, terms, 2, half_width_s)
        left.append(rows[0])
        right.append(rows[1])
        widest_s = max(widest_s, half_width_s)
    sides = np.concatenate(left), np.concatenate(right)
    if sides[0].size <= 2 * sides[1].shape[1]:
        sides = _differences(pieces)
    if sides[0].size <= sides[1].shape[1]:
        return np.full(sides[1].shape[1], np.nan), widest_s
    return solved(*sides)[0], widest_s


def _differences(pieces: Sequence[Piece]) -> tuple[Array, Array]:
    """Second differences (m,) of the values, and the terms with the first differences (m, k + 1) beside them."""
    second, beside = [], []
    for t_s, values, terms in pieces:
        slope = np.diff(values) / np.diff(t_s)
        across_s = t_s[2:] - t_s[:-2]
        second.append(2.0 * np.diff(slope) / across_s)
        beside.append(np.column_stack([terms[1:-1], (values[2:] - values[:-2]) / across_s]))
    return np.concatenate(second), np.concatenate(beside)
