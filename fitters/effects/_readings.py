"""Readings that are a curve of the position: its middle and its reach are taken from the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Array, Parameter

MAX_SHARE = 0.3  # of the motion's reach: a reading that is farther off is not an error of a reading


def middle_and_reach(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """The middle of the motion, where a swing rests, and its largest distance from there, as the only values to try.

    The mean under a window of Hann, to which whole swings and parts of them add nothing. ``t_s`` (n,), s;
    ``observed`` (n, d), in the observed unit.
    """
    known = observed[np.isfinite(observed).all(axis=1)]
    middle = float(np.average(known[:, 0], weights=np.hanning(len(known) + 2)[1:-1]))
    return [(middle, float(np.max(np.abs(known - middle))))]


def middle_parameter(name: str) -> Parameter:
    """The position from which the curve is counted, so that no result depends on the zero of the scale."""
    return Parameter(
        name, "{x}", "x_m", default=0.0, constant=True, role="shape",
        source="a diagnosis takes the mean of the motion, its ends weighed less",
    )  # fmt: skip


def reach_parameter(name: str) -> Parameter:
    """The largest distance from the middle, at which an error of the reading must still be a small part."""
    return Parameter(
        name, "{x}", "x_r", lower=1e-12, default=1.0, constant=True, role="shape",
        source="a diagnosis takes the largest distance from the middle",
    )  # fmt: skip


def small_part(power: int, t_s: Array, params: Sequence[float]) -> bool:
    """Whether the error at the motion's reach is a small part of it.

    Parameters
    ----------
    power
        Of the distance from the middle, with which the error grows.
    t_s
        (n,) s, not used.
    params
        Size, middle and reach.
    """
    size, _, reach = params
    return abs(size) * reach ** (power - 1) < MAX_SHARE
