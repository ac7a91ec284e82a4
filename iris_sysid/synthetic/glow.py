"""Light that a scene gives off: added to that of the rest in linear light, then coded by the camera's curve."""

from __future__ import annotations

import cv2
import numpy as np

from iris_sysid.synthetic.backdrop import NEUTRAL, Planes
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.scene import Curve
from iris_sysid.types import Array

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)  # over the exposure
WHITE = 255.0
TO_LUMA = np.array([0.2126, 0.7152, 0.0722])  # of red, green, blue: ITU-R BT.709
BLUE, RED = 1.8556, 1.5748  # colour difference over its plane's level


class Glow:
    """Still layers that shine more or less: the image at any time, of two painted images, dark and bright."""

    def __init__(self, dark: Planes, bright: Planes, box: tuple[int, int, int, int], look: Look, light: Curve) -> None:
        left, top, right, bottom = box
        height, width = dark.luma.shape
        self.rows = slice(max(0, top // 2 * 2), min(height, -(-bottom // 2) * 2))
        self.columns = slice(max(0, left // 2 * 2), min(width, -(-right // 2) * 2))
        self.curve, self.light, self.exposure_s = look.curve, light, look.exposure_s
        self.dark, self.bright = (self.curve.light(self._rgb(planes) / WHITE) for planes in (dark, bright))
        self.planes = dark.copy()

    def at(self, t_s: float) -> Planes:
        """The exact image exposed about time ``t_s``; valid until the next call."""
        shines = float(WEIGHTS @ self.light(t_s + self.exposure_s / 2 * NODES)) / 2
        rgb = WHITE * self.curve.code(self.dark + shines * (self.bright - self.dark))
        luma = rgb @ TO_LUMA
        half = cv2.resize(
            rgb - luma[..., np.newaxis], (luma.shape[1] // 2, luma.shape[0] // 2), None, 0, 0, cv2.INTER_AREA
        )
        self.planes.luma[self.rows, self.columns] = luma
        at = slice(self.rows.start // 2, self.rows.stop // 2), slice(self.columns.start // 2, self.columns.stop // 2)
        self.planes.blue[at], self.planes.red[at] = NEUTRAL + half[..., 2] / BLUE, NEUTRAL + half[..., 0] / RED
        return self.planes

    def _rgb(self, planes: Planes) -> Array:
        """Red, green and blue (h, w, 3) of the box, grey levels, within what the file can hold."""
        luma = planes.luma[self.rows, self.columns].astype(np.float64)
        size = (planes.luma.shape[1], planes.luma.shape[0])
        blue, red = (
            cv2.resize(plane, size, None, 0, 0, cv2.INTER_NEAREST)[self.rows, self.columns] - NEUTRAL
            for plane in (planes.blue, planes.red)
        )
        red, blue = luma + RED * red, luma + BLUE * blue
        green = (luma - TO_LUMA[0] * red - TO_LUMA[2] * blue) / TO_LUMA[1]
        return np.clip(np.stack([red, green, blue], axis=-1), 0.0, WHITE)
