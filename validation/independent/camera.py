"""What a camera makes of a motion: OpenCV projects the true positions, naive geometry reads them back.

The naive reading takes the camera as square to the plane of motion, without distortion, and every row as exposed at
the same time: what an ordinary analysis does. World: x right, z up, m; image: x right, y down, px.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIZE_PX = (1280, 720)
FILLED = 0.6  # of the picture's height that the motion takes
ROUNDS = 4  # of the fixed point for the time at which a row is exposed


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole camera whose axis meets the plane of motion at ``centre_m``.

    ``tilt_rad`` turns it about the vertical, ``distortion`` is the first radial coefficient of normalised radius,
    ``line_s`` the time from one row to the next, ``aspect`` the width of a pixel over its height.
    """

    centre_m: tuple[float, float]
    distance_m: float
    focal_px: float
    tilt_rad: float = 0.0
    distortion: float = 0.0
    line_s: float = 0.0
    aspect: float = 1.0

    @classmethod
    def facing(cls, positions_m: Array) -> Camera:
        """The camera that sees positions (n, 2) m in the middle of its picture, from 3 times their extent away."""
        low, high = positions_m.min(axis=0), positions_m.max(axis=0)
        extent = float(max(high - low))
        distance = 3.0 * extent
        return cls(tuple((low + high) / 2), distance, FILLED * SIZE_PX[1] / extent * distance)

    def project(self, positions_m: Array) -> Array:
        """Pixels (n, 2) of positions (n, 2) m in the plane of motion."""
        flat = positions_m - np.array(self.centre_m)
        points = np.column_stack([flat[:, 0], -flat[:, 1], np.zeros(len(flat))])
        matrix = np.array(
            [[self.focal_px * self.aspect, 0, SIZE_PX[0] / 2], [0, self.focal_px, SIZE_PX[1] / 2], [0, 0, 1.0]]
        )
        rotation = np.array([0.0, self.tilt_rad, 0.0])
        lens = np.array([self.distortion, 0.0, 0.0, 0.0])
        seen, _ = cv2.projectPoints(points, rotation, np.array([0.0, 0.0, self.distance_m]), matrix, lens)
        return np.asarray(seen.reshape(-1, 2), dtype=np.float64)

    def film(self, position_at: Callable[[Array], Array], t_s: Array) -> Array:
        """Pixels (n, 2) of a body that is at ``position_at(t)`` (n, 2) m, each row exposed at its own time."""
        exposed = t_s
        for _ in range(ROUNDS):
            pixels = self.project(position_at(exposed))
            exposed = t_s + self.line_s * (pixels[:, 1] - SIZE_PX[1] / 2)
        return pixels

    def naive(self, pixels: Array) -> Array:
        """Positions (n, 2) m that the naive geometry reads from pixels (n, 2)."""
        flat = (pixels - np.array(SIZE_PX) / 2) * self.distance_m / self.focal_px
        return np.column_stack([flat[:, 0], -flat[:, 1]]) + np.array(self.centre_m)

    def with_(self, **changes: float) -> Camera:
        """The camera with other values."""
        return replace(self, **changes)
