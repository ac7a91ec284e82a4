"""The calibration: the map from pixels to metres in the plane of motion, with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np

from iris_sysid.types._arrays import Array, frozen_array
from iris_sysid.types._display import text_of
from iris_sysid.types._numbers import Estimate
from iris_sysid.types._pickling import Portable
from iris_sysid.types._verdict import Doubt

# how the direction of gravity was determined: "unstated" where a calibration does not record it
VerticalSource = Literal["unstated", "image", "board-edge", "file-axes", "plumb-line", "flight"]
MEASURED_VERTICALS: tuple[VerticalSource, ...] = ("plumb-line", "flight")
N_VALUES = 18  # nine entries of the homography, row by row, then fx, fy, cx, cy, k1, k2, p1, p2, k3


@dataclass(frozen=True, eq=False, slots=True)
class Calibration(Portable):
    """The map from pixels to metres in the plane of motion; :func:`iris_sysid.to_world` applies it.

    ``homography`` (3, 3) maps homogeneous (x, y, 1) undistorted px, y down, to metres, x right, z up. ``scale`` is px
    per ``unit`` at ``centre_px``, where the calibration was made, with its standard error. ``unit`` is ``m``, or ``px``
    when no scale is known: then angles and times are still correct, lengths are not. ``camera_matrix`` (3, 3) and
    ``distortion`` (5,) k1, k2, p1, p2, k3, as OpenCV defines them, undistort.

    ``budget`` holds, by source, parts of the covariance (18, 18) of ``values``: common to all samples, so an average
    over frames does not shrink it. They are independent and add up to ``covariance``. ``image_size`` (width, height) px
    is that of the images it is valid for, None where it was not made from images. ``vertical_source`` is how the
    direction of gravity was determined. ``fixed`` lists in words what else the data determined, ``assumed`` the
    assumptions, ``notes`` other remarks, ``doubts`` the evidence against it. ``rms_px`` is the root mean square
    residual of the board's corners, NaN without a board.
    """

    homography: Array
    scale: Estimate
    unit: Literal["m", "px"] = "m"
    source: str = ""
    camera_matrix: Array = field(default_factory=lambda: np.eye(3))
    distortion: Array = field(default_factory=lambda: np.zeros(5))
    budget: Mapping[str, Array] = field(default_factory=dict)
    image_size: tuple[int, int] | None = None
    centre_px: tuple[float, float] = (0.0, 0.0)
    fixed: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    rms_px: float = math.nan
    vertical_source: VerticalSource = "unstated"
    doubts: tuple[Doubt, ...] = ()
    covariance: Array = field(init=False)

    def __post_init__(self) -> None:
        for name, shape in (("homography", (3, 3)), ("camera_matrix", (3, 3)), ("distortion", (5,))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))
        square = (N_VALUES, N_VALUES)
        parts = {name: frozen_array(part, square, f"budget[{name!r}]") for name, part in self.budget.items()}
        object.__setattr__(self, "budget", MappingProxyType(parts))
        total = sum(parts.values(), np.zeros(square))
        object.__setattr__(self, "covariance", frozen_array(total, square, "covariance"))

    @property
    def vertical_measured(self) -> bool:
        """Whether the direction of gravity was measured rather than assumed."""
        return self.vertical_source in MEASURED_VERTICALS

    @property
    def values(self) -> Array:
        """The 18 numbers that ``covariance`` belongs to: the homography row by row, fx, fy, cx, cy, the distortion.

        Shape (18,); focal lengths and centre in px.
        """
        matrix = self.camera_matrix
        return np.concatenate([self.homography.ravel(), np.diag(matrix)[:2], matrix[:2, 2], self.distortion])

    def __repr__(self) -> str:
        return text_of(f"Calibration: {self.scale} at {self.centre_px} px", self.source)
