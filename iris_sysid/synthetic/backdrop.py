"""The wall: its colour, texture, reflections, and the light that falls on it unevenly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.synthetic.coverage import Plane
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.shapes import Colour
from iris_sysid.types import Array

NEUTRAL = 128.0  # level of no colour in the colour-difference planes

# Reflections of lamps on a glossy board: centre, size (fractions of the image), added grey levels.
LAMPS = (
    *[(0.455 + 0.1 * k, 0.108, 0.036, 0.07, 6.0 + 6.0 * k) for k in range(5)],
    *[(x, 0.40, 0.032, 0.08, grey) for x, grey in ((0.36, 6.0), (0.535, 7.0), (0.755, 14.0), (0.857, 11.0))],
    (0.097, 0.31, 0.006, 0.05, 25.0),
    (0.444, 0.578, 0.012, 0.012, 90.0),
)


@dataclass(frozen=True, eq=False, slots=True)
class Planes:
    """An image as the encoder takes it: ``luma`` (h, w), ``blue`` and ``red`` difference (h/2, w/2), float32 0-255."""

    luma: Plane
    blue: Plane
    red: Plane

    def copy(self) -> Planes:
        """A copy of the planes."""
        return Planes(self.luma.copy(), self.blue.copy(), self.red.copy())


def ycbcr(colour: Colour) -> tuple[float, float, float]:
    """Luma and colour differences of a colour, full range (ITU-R BT.709, table 4)."""
    red, green, blue = colour
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return luma, NEUTRAL + (blue - luma) / 1.8556, NEUTRAL + (red - luma) / 1.5748


def light_field(size: tuple[int, int], look: Look) -> Plane:
    """Fraction of the light that reaches each pixel, (h, w): lower in the corners and towards the left."""
    width, height = size
    x = np.linspace(-1, 1, width, dtype=np.float32)[np.newaxis]
    y = np.linspace(-1, 1, height, dtype=np.float32)[:, np.newaxis] * np.float32(height / width)
    corner = 1 + (height / width) ** 2
    vignette = 1 - look.vignetting * ((x**2 + y**2) / corner) ** 1.5
    side = 1 - look.uneven_light * (0.5 - 0.35 * x - 0.25 * y)
    return np.asarray(vignette * side, dtype=np.float32)


def wall(size: tuple[int, int], colour: Colour, glossy: bool, look: Look, rng: np.random.Generator) -> Planes:
    """A wall without light and shade: even colour, texture, reflections when it is glossy.

    Parameters
    ----------
    size
        Width and height, px.
    colour
        Colour of the wall.
    glossy
        Whether lamps are reflected in it.
    look
        Strength of the texture, and whether marks are drawn.
    rng
        Source of the texture.
    """
    width, height = size
    luma, blue, red = ycbcr(colour)
    planes = Planes(
        np.full((height, width), luma, dtype=np.float32),
        np.full((height // 2, width // 2), blue, dtype=np.float32),
        np.full((height // 2, width // 2), red, dtype=np.float32),
    )
    if look.texture > 0:
        planes.luma[:] += look.texture * texture(size, rng)
    if glossy and look.marks:
        planes.luma[:] += _reflections(size)
    return planes


def texture(size: tuple[int, int], rng: np.random.Generator) -> Plane:
    """A random texture (h, w) of mean 0 and standard deviation 1: blotches of all sizes, and grain."""
    width, height = size
    total = np.zeros((height, width), dtype=np.float32)
    for cell, strength in ((1.0, 0.8), (3.0, 0.6), (width / 90, 0.5), (width / 20, 0.7), (width / 5, 0.8)):
        if cell < 1:
            continue
        coarse = rng.standard_normal((math.ceil(height / cell) + 1, math.ceil(width / cell) + 1), dtype=np.float32)
        total += np.float32(strength) * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    total -= total.mean()
    return np.asarray(total / total.std(), dtype=np.float32)


def _reflections(size: tuple[int, int]) -> Plane:
    width, height = max(64, size[0] // 4), max(36, size[1] // 4)
    small = np.zeros((height, width), dtype=np.float32)
    for x, y, wide, high, grey in LAMPS:
        corner = (round((x - wide / 2) * width), round((y - high / 2) * height))
        opposite = (round((x + wide / 2) * width), round((y + high / 2) * height))
        cv2.rectangle(small, corner, opposite, grey, cv2.FILLED)
    blurred = cv2.GaussianBlur(small, (0, 0), width / 400)
    return np.asarray(cv2.resize(blurred, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def lit(planes: Planes, light: Plane) -> Planes:
    """The planes under that light (h, w)."""
    half = cv2.resize(light, planes.blue.shape[::-1], interpolation=cv2.INTER_AREA)
    neutral = np.float32(NEUTRAL)
    return Planes(
        planes.luma * light, neutral + (planes.blue - neutral) * half, neutral + (planes.red - neutral) * half
    )


def shifted(planes: Planes, by_px: Array) -> Planes:
    """The planes moved by (x, y) px with linear interpolation, as by a camera that shakes."""
    return Planes(
        _moved(planes.luma, by_px),
        _moved(planes.blue, by_px / 2),
        _moved(planes.red, by_px / 2),
    )


def _moved(plane: Plane, by_px: Array) -> Plane:
    height, width = plane.shape
    matrix = np.array([[1, 0, by_px[0]], [0, 1, by_px[1]]])
    moved = cv2.warpAffine(plane, matrix, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.float32)
