"""Things that stand or move beside the bodies: hand, clamp, tape, cords."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from iris_sysid.synthetic.scene import Setup
from iris_sysid.synthetic.shapes import SPLINE_STEPS, Colour, Layer, Outline, Path, box, rigid, rounded, soft, static
from iris_sysid.types import Array

SKIN: tuple[Colour, Colour] = ((194.0, 146.0, 116.0), (150.0, 104.0, 82.0))  # in the light, in the shade
SKIN_DIM: tuple[Colour, Colour] = ((104.0, 72.0, 62.0), (78.0, 52.0, 46.0))
METAL: Colour = (138.0, 138.0, 136.0)
METAL_DARK: Colour = (84.0, 84.0, 84.0)
BLACK: Colour = (24.0, 24.0, 26.0)
CORD: Colour = (44.0, 42.0, 42.0)

Points = Sequence[tuple[float, float]]

HAND_ACCELERATION = 14.0  # m/s^2, of a hand that lets go; it leaves the bob behind within a few frames

# Silhouettes in units of the ball's radius, ball at the origin, the arm coming from the left.
_FINGERS_BEHIND = [
    *[(-9, 2.5), (-7, 2.5), (-5.2, 2.6), (-3.4, 2.7), (-1.8, 2.1), (-0.5, 1.5), (0.35, 1.3), (0.3, 1.0), (-0.4, 0.9)],
    *[(-0.6, 0.1), (-0.5, -0.7), (0.1, -1.0), (0.3, -1.3), (-0.4, -1.6), (-1.7, -1.8), (-3.0, -2.3)],
    *[(-5.0, -2.4), (-7, -2.3), (-9, -2.3)],
]
_ELBOW = [(-120, -2.4), (-120, 2.6)]
_FINGERS_BEFORE = [(-2.6, 0.9), (-1.3, 1.25), (-0.35, 1.15), (-0.1, 0.9), (-0.7, 0.72), (-1.6, 0.3), (-2.6, 0.1)]
_THUMB_BEFORE = [(-2.8, -0.4), (-1.5, -0.6), (-0.6, -0.85), (-0.3, -1.1), (-0.8, -1.3), (-1.7, -1.3), (-2.8, -1.4)]


def hand(
    setup: Setup,
    held: ArrayLike,
    radius_m: float,
    towards: float,
    skin: tuple[Colour, Colour] = SKIN,
) -> tuple[list[Layer], list[Layer]]:
    """A hand that holds a ball until the release and then draws back, out of the image, where the look has one.

    Parameters
    ----------
    setup
        Says when it lets go.
    held
        Centre (x, z) of the ball while it is held, m.
    radius_m
        The ball's radius.
    towards
        Direction in which the hand reaches, rad anticlockwise from x.
    skin
        Colours in the light and in the shade.

    Returns
    -------
    behind, before : list of Layer
        What to paint behind and before the ball.
    """
    if not setup.look.hand:
        return [], []
    release_s = setup["release_time"]
    back = np.array([-math.cos(towards), -math.sin(towards)])

    def path(t_s: Array) -> Array:
        since = np.maximum(t_s - release_s, 0.0)[:, np.newaxis]
        return np.array(held) + 0.5 * HAND_ACCELERATION * since**2 * back

    def layer(points: Points, colour: Colour, beyond: Points) -> Layer:
        curve = rounded(np.array(points))
        corners = np.concatenate([curve[:-SPLINE_STEPS], np.array(beyond)]) if beyond else curve
        turned = _turn(corners * radius_m, towards)
        return Layer(rigid(turned, path), colour, stop_s=release_s + 0.6)

    return (
        [layer(_FINGERS_BEHIND, skin[1], _ELBOW)],
        [layer(_FINGERS_BEFORE, skin[0], []), layer(_THUMB_BEFORE, skin[0], [])],
    )


def _turn(points: Array, angle_rad: float) -> Array:
    """Turn points about the origin; mirrored when that would put the thumb on top."""
    upright = points * np.array([1.0, 1.0 if math.cos(angle_rad) >= 0 else -1.0])
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return upright @ np.array([[cosine, sine], [-sine, cosine]])


def clamp(x_m: float, z_m: float, top_m: float) -> list[Layer]:
    """A stand's clamp that comes in from the top edge and holds cords at (x, z); ``top_m`` is beyond that edge."""
    height = top_m - z_m
    arm = [(x_m - 0.012, z_m), (x_m + 0.006, z_m), (x_m + 0.42 * height, top_m), (x_m + 0.17 * height, top_m)]
    jaw = [(x_m - 0.002, z_m - 0.002), (x_m + 0.006, z_m), (x_m + 0.75 * height, top_m), (x_m + 0.6 * height, top_m)]
    ring = _ring(x_m, z_m, 0.011, 0.003)
    return [
        Layer(static(np.array(arm)), METAL_DARK),
        Layer(static(np.array(jaw)), METAL),
        Layer(static(ring), BLACK),
    ]


def _ring(x_m: float, z_m: float, radius_m: float, width_m: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, 48)
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    both = np.concatenate([radius_m * unit, (radius_m - width_m) * unit[::-1]])
    return both + np.array([x_m, z_m])


def tape(places: list[tuple[float, float]], width_m: float = 0.014, height_m: float = 0.008) -> list[Layer]:
    """Small pieces of black tape of that size on the wall, slightly askew, centred at the places (x, z), m."""
    return [Layer(static(box(x, z, width_m, height_m, 0.12 * math.sin(17 * x + 5 * z))), BLACK) for x, z in places]


def shadow_of(outline: Outline, centre: Path, radius_m: float, darkness: float) -> Layer:
    """The soft shadow of a round body on the wall behind it, below and to the right.

    Parameters
    ----------
    outline, centre, radius_m
        The body's.
    darkness
        Fraction of the light that it takes away.
    """
    shift = radius_m * np.array([1.1, -1.5])

    def place(t_s: Array) -> Array:
        return centre(t_s) + shift

    def cast(t_s: Array, scale: float) -> Array:
        return outline(t_s, scale) + shift

    return Layer(soft(cast, place, 0.45), (0.0, 0.0, 0.0), darkness, blur_step_px=12.0)


CARPET: Colour = (150.0, 128.0, 104.0)
SKIRTING: Colour = (150.0, 146.0, 96.0)
SKIRTING_M = 0.06  # height of the strip
BEIGE: Colour = (204.0, 202.0, 190.0)


def floor(level_m: float, left_m: float, right_m: float, bottom_m: float) -> list[Layer]:
    """A carpet seen along its surface, with a strip of skirting on the wall behind it.

    Parameters
    ----------
    level_m
        Height at which the props stand.
    left_m, right_m, bottom_m
        Its length; it extends beyond the image.
    """
    middle, width = (left_m + right_m) / 2, right_m - left_m
    strip = box(middle, level_m + SKIRTING_M / 2 + 0.02, width, SKIRTING_M)
    carpet = box(middle, (level_m + 0.02 + bottom_m) / 2, width, level_m + 0.02 - bottom_m)
    edge = box(middle, level_m + 0.02, width, 0.004)
    return [Layer(static(strip), SKIRTING), Layer(static(carpet), CARPET), Layer(static(edge), METAL_DARK)]
