"""How the coordinates of a trajectory lie in the image: what effects of a camera need to know."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types._arrays import Array
from iris_sysid.types._numbers import Quantity

Sensor = Literal["camera", "encoder", "gauge", "unknown"]
ViewKind = Literal["angle", "line", "plane"]
PivotSource = Literal["marked", "arc", "arc-of-known-radius"]
Pair = tuple[float, float]

PLACES = ("m", "px", "rad", "")  # units of what has a place in an image; none may be any
FILLED = 0.6  # of the picture's height, which a motion takes that nothing is known of
WIDTH_OVER_HEIGHT = 16 / 9
FOCAL_PER_WIDTH = 26 / 36  # a phone's main camera: 26 mm equivalent on 36 mm of film
MAX_PX = 1e12
WORST_FIXED = 1e12  # condition of the normal equations beyond which points fix no circle
CIRCLE_STEPS = 3  # of Gauss and Newton from a centre that is nearly right; they converge quadratically


@dataclass(frozen=True, slots=True)
class View:
    """How the coordinates (n, d) of a track lie in the image (px; x right, y down).

    A position in the plane of motion is ``origin_px + a right_px + b up_px``, where (a, b) is (sin theta, -cos theta)
    for an angle theta about a pivot at the origin, (s, 0) for a way s along a line, and (x, z) in a plane: ``right_px``
    and ``up_px`` are the images of one unit, or of one lever's length. ``size_px`` is width and height of the picture,
    ``axis_px`` where the optical axis meets it, ``focal_px`` the focal length. ``pivot`` says where the pivot of an
    angle comes from: it was ``marked`` in the image, or is the centre of the circle through the ``arc`` of the motion,
    of a fitted or of a known radius. ``measured`` is False for :meth:`assumed`, where only the kind is known.
    """

    kind: ViewKind
    origin_px: Pair
    right_px: Pair
    up_px: Pair
    size_px: Pair
    axis_px: Pair
    focal_px: float
    pivot: PivotSource = "marked"
    measured: bool = True

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            numbers = value if isinstance(value, tuple) else (value,) if isinstance(value, float) else ()
            if not all(map(math.isfinite, numbers)):
                raise DataError(f"{field.name} of a view must be finite, not {value}")
        if not (self.focal_px > 0 and min(self.size_px) > 0):
            raise DataError(f"a view needs a focal length and a picture above zero: {self.focal_px:g}, {self.size_px}")
        lengths = math.hypot(*self.right_px) * math.hypot(*self.up_px)
        if not abs(self._determinant) > 1e-6 * lengths:
            raise DataError(f"right_px {self.right_px} and up_px {self.up_px} of a view must not be parallel, or zero")

    @property
    def _determinant(self) -> float:
        return self.right_px[0] * self.up_px[1] - self.right_px[1] * self.up_px[0]

    @property
    def along(self) -> Array:
        """Unit vector (2,) px of the motion along a line, and of the image's rows for other kinds."""
        right = np.array(self.right_px) if self.kind == "line" else np.array([1.0, 0.0])
        return np.asarray(right / np.linalg.norm(right))

    def shows(self, quantities: Sequence[Quantity]) -> bool:
        """Whether the view is of coordinates of this kind."""
        return kind_of(quantities) == self.kind

    def points_px(self, observed: Array) -> Array:
        """Image points (n, 2) px of coordinates (n, d) in their unit."""
        if self.kind == "angle":
            plane = np.column_stack([np.sin(observed[:, 0]), -np.cos(observed[:, 0])])
        elif self.kind == "line":
            plane = np.column_stack([observed[:, 0], np.zeros(len(observed))])
        else:
            plane = observed
        return np.asarray(np.array(self.origin_px) + plane @ np.array([self.right_px, self.up_px]))

    def coordinates(self, points_px: Array, pivot_px: Array, near: Array) -> Array:
        """Coordinates (n, d), in their unit, that a camera without any fault would have at these image points.

        Parameters
        ----------
        points_px
            (n, 2) px.
        pivot_px
            (2,) px, where the pivot of an angle is seen; not used for other kinds.
        near
            (n, d), from which angles differ by less than half a turn.
        """
        zero = pivot_px if self.kind == "angle" else np.array(self.origin_px)
        (x, y), away = (self.right_px, self.up_px), points_px - zero
        first = (away[:, 0] * y[1] - away[:, 1] * y[0]) / self._determinant
        second = (away[:, 1] * x[0] - away[:, 0] * x[1]) / self._determinant
        if self.kind == "line":
            return np.asarray((away @ np.array(x) / (x[0] ** 2 + x[1] ** 2))[:, None])
        if self.kind == "plane":
            return np.column_stack([first, second])
        turned = np.arctan2(first, -second) - near[:, 0]
        return np.asarray(near + (turned - 2 * np.pi * np.round(turned / (2 * np.pi)))[:, None])

    def pivot_px(self, points_px: Array, mapped_px: Array) -> Array:
        """Where the pivot (2,) px is taken to be: where it is seen, or the centre of the arc that is seen.

        Parameters
        ----------
        points_px
            (n, 2) px, the points seen.
        mapped_px
            (2,) px, where the true pivot is seen.
        """
        if self.kind != "angle" or self.pivot == "marked":
            return mapped_px
        radius = math.hypot(*self.right_px) if self.pivot == "arc-of-known-radius" else None
        return _circle_centre(points_px, mapped_px, radius)

    def corrected(self, present: View, pivot_px: Array, lever_px: float) -> View:
        """The view ``present`` of an angle, so changed that its pivot and lever would be seen where this view has them.

        Parameters
        ----------
        present
            A view of the same angle.
        pivot_px
            (2,) px, where the pivot of that view is seen.
        lever_px
            px, the mean distance from there at which the body is seen; a lever that is known otherwise stays.
        """
        if not (np.all(np.isfinite(pivot_px)) and 0 < lever_px < MAX_PX):
            return present
        longer = math.hypot(*self.right_px) / lever_px if self.pivot != "arc-of-known-radius" else 1.0
        return replace(
            present,
            origin_px=tuple(np.add(present.origin_px, np.subtract(self.origin_px, pivot_px)).tolist()),
            right_px=(longer * present.right_px[0], longer * present.right_px[1]),
            up_px=(longer * present.up_px[0], longer * present.up_px[1]),
        )

    @classmethod
    def assumed(cls, quantities: Sequence[Quantity], observed: Array) -> View:
        """The view of a table that says nothing of its camera.

        The optical axis is at the middle of the motion, which fills most of the picture of a phone's camera; a pivot
        is one lever off; a way called x runs along the rows, any other along the columns.

        Parameters
        ----------
        quantities
            One angle, one way, or x and z.
        observed
            (n, d) in their unit; samples that are not finite count for nothing.

        Raises
        ------
        DataError
            When the quantities are not of such a kind.
        """
        kind = kind_of(quantities)
        if kind is None:
            raise DataError(f"no view is known of {', '.join(quantity.name for quantity in quantities)}")
        upright = kind == "line" and not quantities[0].name.startswith("x")
        right, up = ((0.0, -1.0), (-1.0, 0.0)) if upright else ((1.0, 0.0), (0.0, -1.0))
        bare = cls(kind, (0.0, 0.0), right, up, (1.0, 1.0), (0.0, 0.0), 1.0, measured=False)
        return bare.about(bare.points_px(observed[np.isfinite(observed).all(axis=1)]))

    def about(self, points_px: Array) -> View:
        """The view whose picture lies about the points (n, 2) px of a motion, and about its pivot."""
        middle, extent = np.zeros(2), 0.0
        if len(points_px):
            low, high = points_px.min(axis=0), points_px.max(axis=0)
            middle = (low + high) / 2
            seen = np.vstack([points_px, [self.origin_px]]) if self.kind == "angle" else points_px
            extent = float(np.max(np.ptp(seen, axis=0)))
        if not 0 < extent < MAX_PX:  # one point, or a solution that diverges
            middle, extent = np.zeros(2), 1.0
        height = extent / FILLED
        size_px, axis_px = (WIDTH_OVER_HEIGHT * height, height), (float(middle[0]), float(middle[1]))
        return replace(self, size_px=size_px, axis_px=axis_px, focal_px=FOCAL_PER_WIDTH * size_px[0])


def kind_of(quantities: Sequence[Quantity]) -> ViewKind | None:
    """What a view of these quantities is: an angle, a way along a line, or x and z.

    None for what has no place in an image: a brightness, a voltage, a speed, a temperature, the radius r of a body's
    outline; and for several bodies.
    """
    if len(quantities) == 1:
        if quantities[0].unit not in PLACES or quantities[0].name == "r":
            return None
        return "angle" if quantities[0].unit == "rad" else "line"
    return "plane" if [quantity.name for quantity in quantities] == ["x", "z"] else None


def _circle_centre(points_px: Array, start_px: Array, radius: float | None) -> Array:
    """Centre (2,) px of the circle through points (n, 2) by least squares; where it starts if they fix none.

    The normal equations of the two coordinates, as one complex number, are written out, without the radius where that
    is free: the fit of an effect asks for thousands of circles.
    """
    points, n = points_px[:, 0] + 1j * points_px[:, 1], len(points_px)
    centre = complex(*start_px)
    for _ in range(CIRCLE_STEPS):
        outward = points - centre
        distance = np.abs(outward)
        outward /= distance
        total, turned, left = float(n), complex(outward @ outward), complex(outward @ distance)
        if radius is None:
            mean = complex(outward.sum()) / n
            total, turned = total - n * abs(mean) ** 2, turned - n * mean * mean
            left -= mean * float(distance.sum())
        else:
            left -= radius * complex(outward.sum())
        determinant = (total * total - abs(turned) ** 2) / 4
        if not determinant * WORST_FIXED > total * total:
            return start_px
        centre += (total * left - turned * left.conjugate()) / (2 * determinant)
    return np.array([centre.real, centre.imag])
