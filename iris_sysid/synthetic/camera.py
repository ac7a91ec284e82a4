"""A pinhole camera with a lens, looking at the plane of motion: metres to pixels, exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from iris_sysid.types import Array

# Of a phone's main camera: 26 mm equivalent, so the image is 36/26 focal lengths wide.
FOCAL_PER_WIDTH = 26 / 36


@dataclass(frozen=True, slots=True)
class CameraView:
    """The part of the plane of motion (m; x right, z up) that must be in the image, and its distance.

    ``distance_m`` None means the distance that a phone's main camera needs.
    """

    left: float
    right: float
    bottom: float
    top: float
    distance_m: float | None = None


@dataclass(frozen=True, slots=True)
class Camera:
    """Position and projection of the camera.

    ``size`` (width, height) px. ``aim_m`` (x, z) is the point of the plane of motion seen at the centre of the
    image, ``pixels_per_metre`` the scale there, ``distance_m`` its distance.
    ``tilt_rad`` turns the plane about the camera's horizontal and vertical axis, ``roll_rad`` about the line of
    sight; ``distortion`` is k1, k2 of OpenCV's radial model; ``aspect`` stretches the image horizontally.
    """

    size: tuple[int, int]
    pixels_per_metre: float
    aim_m: tuple[float, float]
    distance_m: float
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    roll_rad: float = 0.0
    distortion: tuple[float, float] = (0.0, 0.0)
    aspect: float = 1.0

    @property
    def focal_px(self) -> float:
        """Focal length, px."""
        return self.pixels_per_metre * self.distance_m

    @property
    def centre_px(self) -> tuple[float, float]:
        """Principal point, px: the centre of the image, with the origin at the centre of pixel (0, 0)."""
        return (self.size[0] - 1) / 2, (self.size[1] - 1) / 2

    @property
    def is_flat(self) -> bool:
        """Whether the image is a similar copy of the plane: no tilt, roll, distortion or stretching."""
        return not any((*self.tilt_rad, self.roll_rad, *self.distortion)) and self.aspect == 1.0

    def rotation(self) -> Array:
        """Rotation (3, 3) from the plane's axes (x right, down, away from the camera) to the camera's.

        It is dimensionless.
        """
        (sin_x, sin_y, sin_z), (cos_x, cos_y, cos_z) = (
            f(np.array([*self.tilt_rad, self.roll_rad])) for f in (np.sin, np.cos)
        )
        about_x = np.array([[1, 0, 0], [0, cos_x, -sin_x], [0, sin_x, cos_x]])
        about_y = np.array([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]])
        about_z = np.array([[cos_z, -sin_z, 0], [sin_z, cos_z, 0], [0, 0, 1]])
        return about_z @ about_y @ about_x

    def project(self, xz_m: Array) -> Array:
        """Pixels (..., 2) of points (..., 2) of the plane of motion, given as x right, z up, in m."""
        if self.is_flat:
            return self._similar(xz_m)
        down = np.stack([xz_m[..., 0] - self.aim_m[0], self.aim_m[1] - xz_m[..., 1], np.zeros(xz_m.shape[:-1])], -1)
        return self.project_space(down)

    def project_space(self, points_m: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in m: right, down, away, from the aim point, before tilt and roll."""
        seen = points_m @ self.rotation().T
        flat = seen[..., :2] / (seen[..., 2:] + self.distance_m)
        square = np.sum(flat**2, axis=-1, keepdims=True)
        lens = 1 + square * (self.distortion[0] + square * self.distortion[1])
        stretch = np.array([self.aspect, 1.0])
        return self.focal_px * stretch * flat * lens + np.array(self.centre_px)

    def _similar(self, xz_m: Array) -> Array:
        out = np.empty_like(xz_m)
        out[..., 0] = self.centre_px[0] + self.pixels_per_metre * (xz_m[..., 0] - self.aim_m[0])
        out[..., 1] = self.centre_px[1] - self.pixels_per_metre * (xz_m[..., 1] - self.aim_m[1])
        return out

    def description(self) -> dict[str, Any]:
        """True values of a calibration, by name, for the truth file."""
        return {
            "size_px": list(self.size),
            "pixels_per_metre": self.pixels_per_metre,
            "aim_m": list(self.aim_m),
            "distance_m": self.distance_m,
            "focal_px": [self.focal_px * self.aspect, self.focal_px],
            "centre_px": list(self.centre_px),
            "rotation": self.rotation().tolist(),
            "distortion": [*self.distortion, 0.0, 0.0, 0.0],
        }


def camera_for(view: CameraView, size: tuple[int, int], **lens: Any) -> Camera:
    """A camera of that size (width, height) px that shows the whole view; ``lens`` sets tilt, roll and distortion."""
    scale = min(size[0] / (view.right - view.left), size[1] / (view.top - view.bottom))
    distance = view.distance_m if view.distance_m is not None else FOCAL_PER_WIDTH * size[0] / scale
    aim = ((view.left + view.right) / 2, (view.bottom + view.top) / 2)
    return Camera(size, scale, aim, distance, **lens)
