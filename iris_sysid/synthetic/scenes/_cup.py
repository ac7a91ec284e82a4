"""A plastic cup, upside down: the benchmark's cone."""

from __future__ import annotations

import numpy as np

from iris_sysid.synthetic.scene import Curve
from iris_sysid.synthetic.shapes import Colour, Layer, Path, Shading, rigid
from iris_sysid.types import Array

RED: Colour = (188.0, 24.0, 34.0)
DARK_RED: Colour = (132.0, 14.0, 24.0)
# Half width over height, at the rim, above it, and at the top; the rim's height over the cup's.
RIM, BODY, TOP, RIM_HEIGHT = 0.50, 0.43, 0.27, 0.10


def outline(height_m: float) -> Array:
    """Corners (8, 2) m of a cup standing on its rim, about its centre of area."""
    profile = [(RIM, 0.0), (RIM, RIM_HEIGHT), (BODY, RIM_HEIGHT), (TOP, 1.0)]
    corners = np.array([*profile, *[(-x, z) for x, z in reversed(profile)]])
    return height_m * (corners - centre_of_area(corners))


def centre_of_area(corners: Array) -> Array:
    """Centre of area (2,) of a polygon (v, 2), by the shoelace formula. Both in m."""
    x, z = corners.T
    x_next, z_next = np.roll(x, -1), np.roll(z, -1)
    cross = x * z_next - x_next * z
    return np.array([((x + x_next) * cross).sum(), ((z + z_next) * cross).sum()]) / (3 * cross.sum())


def standing_height(height_m: float) -> float:
    """Height of the centre of area above the surface on which the cup stands, m."""
    return float(-outline(height_m)[:, 1].min())


def cup(centre: Path, angle: Curve, height_m: float, *, shaded: bool) -> list[Layer]:
    """Layers of a cup: its body and, where it is shaded, a darker band above its rim.

    The path is that of its centre of area, the angle in rad anticlockwise from upright.
    """
    shape = outline(height_m)
    light = Shading(centre, 0.5 * height_m, along=(0.14, 0.06), limb=0.08)
    layers = [Layer(rigid(shape, centre, angle), RED, shading=light)]
    if shaded:
        low = shape[:, 1].min()
        band = [(x * height_m, low + z * height_m) for x, z in ((-BODY, 0.1), (BODY, 0.1), (BODY, 0.13), (-BODY, 0.13))]
        layers.append(Layer(rigid(np.array(band), centre, angle), DARK_RED))
    return layers
