"""Cords and balls of the pendulum scenes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from iris_sysid.synthetic.props import SKIN_DIM, hand, shadow_of
from iris_sysid.synthetic.scene import Curve, Setup
from iris_sysid.synthetic.shapes import Colour, Layer, Path, Shading, disc, polyline, rigid
from iris_sysid.types import Array

CORD: Colour = (46.0, 44.0, 44.0)
CORD_POINTS = 24


def hanging(theta: Curve, distance: Curve, pivot: tuple[float, float] = (0.0, 0.0)) -> Path:
    """Path of a body at angle theta (rad, anticlockwise from straight down) and distance (m) from a pivot (x, z), m."""

    def path(t_s: Array) -> Array:
        angle = theta(t_s)
        return np.array(pivot) + distance(t_s)[:, np.newaxis] * np.stack([np.sin(angle), -np.cos(angle)], axis=-1)

    return path


def cord(centre: Path, pivot: tuple[float, float], length_m: float, width_m: float, gap_m: float = 0.0) -> Layer:
    """One strand from the pivot to a body's centre: straight when taut, sagging when the cord is slack.

    Of doubled cords, ``gap_m`` is the distance of its end from the centre.
    """
    along = np.linspace(0.0, 1.0, CORD_POINTS)[:, np.newaxis]

    def points(t_s: Array) -> Array:
        way = (centre(t_s) - np.array(pivot))[:, np.newaxis]
        distance = np.linalg.norm(way, axis=-1, keepdims=True)
        across = np.stack([-way[..., 1], way[..., 0]], axis=-1) / distance
        strand = np.array(pivot) + along * way + gap_m * along**0.25 * across
        # a shallow arc is longer than its chord by 8/3 sag^2 / chord
        sag = np.sqrt(np.maximum(0.375 * distance * (length_m - distance), 0.0))
        strand[..., 1:] -= 4 * sag * along * (1 - along)
        return strand

    return Layer(polyline(points, width_m), CORD, blur_step_px=2.0)


def ball(centre: Path, radius_m: float, colour: Colour, setup: Setup) -> list[Layer]:
    """The layers of a shaded ball, its shadow first where the setup has shadows."""
    outline = disc(centre, radius_m)
    shadow = [shadow_of(outline, centre, radius_m, setup.look.shadow)] if setup.look.shadow else []
    return [*shadow, Layer(outline, colour, shading=Shading(centre, radius_m))]


def seams(centre: Path, radius_m: float, turned: Curve, colour: Colour) -> list[Layer]:
    """The seam of a tennis ball as seen from the side: two curved strips that turn with it, rad."""
    angle = np.linspace(-0.75, 0.75, 24)
    curve = np.stack([0.62 * np.tan(angle) / math.tan(0.75), 0.28 + 0.42 * np.cos(angle) ** 2], axis=-1)
    width = np.array([0.0, 0.05])
    strip = radius_m * np.concatenate([curve + width, (curve - width)[::-1]])
    return [Layer(rigid(side * strip, centre, turned), colour, 0.7) for side in (1, -1)]


def holding_hand(
    centre: Path, pivot: tuple[float, float], radius_m: float, setup: Setup
) -> tuple[list[Layer], list[Layer]]:
    """A hand that holds a hanging ball from behind, and lets go at the release: layers behind and before the ball."""
    x, z = centre(np.array([-1.0]))[0]
    return hand(setup, (x, z), radius_m, math.atan2(pivot[1] - z, pivot[0] - x), SKIN_DIM)


def constant(value: float) -> Callable[[Array], Array]:
    """A curve that does not change. It takes times (n,), s, and gives ``value``, in its own unit, for each."""
    return lambda t_s: np.full(t_s.size, value)
