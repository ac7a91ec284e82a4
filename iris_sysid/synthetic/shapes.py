"""Shapes in the plane of motion, as functions of time, from which the image is painted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Array

# (times (k,) s, scale px/m) -> polygons (k, v, 2) in m; the scale decides how finely a curve is divided.
Outline = Callable[[Array, float], Array]
Path = Callable[[Array], Array]  # times (k,) s -> points (k, 2) in m
Colour = tuple[float, float, float]  # red, green, blue, 0 to 255

CURVE_ERROR_PX = 0.005  # largest distance between a polygon and its curve
PENUMBRA_STEPS = 5
SPLINE_STEPS = 6  # points a side of a rounded polygon
PENUMBRA_FINENESS = 0.05  # a blurred edge needs fewer vertices


@dataclass(frozen=True, slots=True)
class Shading:
    """Light on a round body: its centre as a path, radius, gradient along x and z, darkening at the limb.

    ``size`` scales the radius over time, for a body that comes nearer or goes away; None means that it does not.
    """

    centre: Path
    radius_m: float
    along: tuple[float, float] = (-0.05, 0.08)
    limb: float = 0.10
    size: Callable[[Array], Array] | None = None

    def radius(self, t_s: Array) -> float:
        """Mean radius over times (k,). In m; times are in s."""
        return self.radius_m * (1.0 if self.size is None else float(np.mean(self.size(t_s))))


@dataclass(frozen=True, eq=False, slots=True)
class Layer:
    """One painted shape: its outline over time, colour, opacity, and when it is visible.

    ``opacity`` (0 to 1) is a number or a function of the times (k,). ``start_s`` and ``stop_s`` bound when it is
    drawn. ``shading`` is applied when the look asks for it. ``blur_step_px`` is the travel between two
    sub-exposures: small where the edge matters, larger for what is soft or thin.
    """

    outline: Outline
    colour: Colour
    opacity: float | Callable[[Array], Array] = 1.0
    shading: Shading | None = None
    start_s: float = -math.inf
    stop_s: float = math.inf
    blur_step_px: float = 1.0

    def weights(self, t_s: Array) -> Array:
        """Weight (k,) of each sub-exposure: they sum to the mean opacity. Dimensionless; times are in s."""
        opacity = self.opacity(t_s) if callable(self.opacity) else np.full(t_s.size, self.opacity)
        return np.asarray(opacity, dtype=np.float64) / t_s.size


def still(x_m: float, z_m: float) -> Path:
    """A point that does not move."""
    return lambda t_s: np.broadcast_to(np.array([x_m, z_m]), (t_s.size, 2))


def circle(radius_m: float, scale: float) -> Array:
    """Polygon (v, 2) of the same area and centre as a circle about the origin, to 0.005 px at that scale (px/m)."""
    radius_px = max(radius_m * scale, 1.0)
    count = 4 * max(4, math.ceil(math.pi / 4 * math.sqrt(radius_px / (2 * CURVE_ERROR_PX))))
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    equal_area = math.sqrt(2 * math.pi / count / math.sin(2 * math.pi / count))
    return radius_m * equal_area * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def disc(centre: Path, radius_m: float | Callable[[Array], Array]) -> Outline:
    """A disc whose centre, and perhaps radius, moves.

    A path gives the centre (k, 2), m, and ``radius_m`` the radius (k,), m, at times (k,).
    """
    if callable(radius_m):
        return lambda t_s, scale: (
            centre(t_s)[:, np.newaxis]
            + radius_m(t_s)[:, np.newaxis, np.newaxis] * circle(1.0, scale * float(np.max(radius_m(t_s))))
        )
    return lambda t_s, scale: centre(t_s)[:, np.newaxis] + circle(radius_m, scale)


def soft(outline: Outline, centre: Path, spread: float, steps: int = PENUMBRA_STEPS) -> Outline:
    """A penumbra: an outline repeated at several sizes, which share the layer's weights.

    Parameters
    ----------
    outline, centre
        The shape, which is scaled about its centre.
    spread
        Sizes go from 1 - spread to 1 + spread.
    steps
        Number of sizes.
    """
    sizes = np.linspace(1 - spread, 1 + spread, steps)

    def grown(t_s: Array, scale: float) -> Array:
        shape, middle = outline(t_s, scale * PENUMBRA_FINENESS), centre(t_s)[:, np.newaxis]
        return np.concatenate([middle + size * (shape - middle) for size in sizes])

    return grown


def polyline(points: Callable[[Array], Array], width_m: float) -> Outline:
    """A strip of constant width along points (k, p, 2) in m, e.g. a slack cord."""

    def strip(t_s: Array, scale: float) -> Array:
        del scale
        line = points(t_s)
        along = np.gradient(line, axis=1)
        length = np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-12)
        side = width_m / 2 * np.stack([-along[..., 1], along[..., 0]], axis=-1) / length
        return np.concatenate([line + side, (line - side)[:, ::-1]], axis=1)

    return strip


def rigid(corners_m: Array, centre: Path, angle_rad: Callable[[Array], Array] | None = None) -> Outline:
    """A rigid polygon, corners (v, 2) m about its centre, carried along a path and turned anticlockwise."""
    corners = np.asarray(corners_m, dtype=np.float64)

    def placed(t_s: Array, scale: float) -> Array:
        del scale
        if angle_rad is None:
            return centre(t_s)[:, np.newaxis] + corners
        cosine, sine = np.cos(angle_rad(t_s))[:, np.newaxis], np.sin(angle_rad(t_s))[:, np.newaxis]
        x, z = corners[:, 0], corners[:, 1]
        return centre(t_s)[:, np.newaxis] + np.stack([cosine * x - sine * z, sine * x + cosine * z], axis=-1)

    return placed


def static(corners_m: Array) -> Outline:
    """A polygon that does not move, corners (v, 2) m in the plane."""
    return rigid(corners_m, still(0.0, 0.0))


def box(x_m: float, z_m: float, width_m: float, height_m: float, angle_rad: float = 0.0) -> Array:
    """Corners (4, 2) of a rectangle about (x, z), turned anticlockwise.

    Parameters
    ----------
    x_m, z_m
        Centre.
    width_m, height_m
        Full width and height.
    angle_rad
        Anticlockwise.
    """
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array([width_m, height_m]) / 2
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return corners @ np.array([[cosine, sine], [-sine, cosine]]) + np.array([x_m, z_m])


def rounded(points_m: Array, per_side: int = SPLINE_STEPS) -> Array:
    """Close a polygon (v, 2) by a smooth curve through its points (Catmull-Rom spline). In m."""
    points = np.asarray(points_m, dtype=np.float64)
    before, after, beyond = (np.roll(points, shift, axis=0) for shift in (1, -1, -2))
    u = (np.arange(per_side) / per_side)[:, np.newaxis, np.newaxis]
    curve = 0.5 * (
        2 * points
        + (after - before) * u
        + (2 * before - 5 * points + 4 * after - beyond) * u**2
        + (3 * points - before - 3 * after + beyond) * u**3
    )
    return curve.transpose(1, 0, 2).reshape(-1, 2)
