"""Pixels of one colour, and the chroma planes of a frame."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.errors import UnknownNameError
from iris_sysid.types import Frame
from trackers._frames.arrays import Box, Bytes, Flags

NAMED_RGB = {
    "red": (220, 0, 0), "orange": (255, 128, 0), "yellow": (240, 240, 0), "lime": (170, 255, 0),
    "green": (0, 180, 0), "cyan": (0, 220, 220), "blue": (0, 60, 255), "purple": (128, 0, 255),
    "magenta": (255, 0, 255), "pink": (255, 105, 180), "brown": (140, 75, 20),
    "white": (255, 255, 255), "grey": (128, 128, 128), "gray": (128, 128, 128), "black": (0, 0, 0),
}  # fmt: skip
HUE_TOLERANCE = 13  # of OpenCV's 180 steps of hue: 26 degrees
MIN_SATURATION = 0.6  # of the saturation of the moving pixels in that hue
MIN_VALUE = 30  # of 255: a darker pixel has no hue
SATURATED = 60  # of 255: a paler pixel has no reliable hue
GREY_TOLERANCE = 60  # grey levels


@dataclass(frozen=True, slots=True)
class Colour:
    """A colour in OpenCV's hue (0-179), saturation and value (0-255).

    ``least`` is the smallest saturation of a pixel that matches.
    """

    hue: int
    saturation: int
    value: int
    least: int = SATURATED

    def mask(self, bgr: Bytes) -> Flags:
        """True for pixels of about this colour; grey is matched by brightness, other colours by hue."""
        hsv = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV).astype(np.int16)
        hue, saturation, value = hsv[..., 0], hsv[..., 1], hsv[..., 2]
        if self.saturation < SATURATED:
            return np.asarray((saturation < SATURATED) & (np.abs(value - self.value) < GREY_TOLERANCE))
        turn = np.abs(hue - self.hue)
        near = np.minimum(turn, 180 - turn) <= HUE_TOLERANCE
        return np.asarray(near & (saturation >= self.least) & (value >= MIN_VALUE))

    def fitted(self, bgr: Bytes) -> Colour:
        """The same colour with the least saturation set by moving pixels (n, 3): skin is a pale orange."""
        saturation = cv2.cvtColor(bgr[np.newaxis], cv2.COLOR_BGR2HSV)[0, :, 1]
        of_it = saturation[self.mask(bgr[np.newaxis])[0]]
        if self.saturation < SATURATED or of_it.size == 0:
            return self
        return replace(self, least=max(SATURATED, int(MIN_SATURATION * np.percentile(of_it, 90))))


def read_colour(text: str) -> Colour:
    """The colour that a name or ``#rrggbb`` means; UnknownNameError lists the names there are."""
    name = text.strip().lower()
    if re.fullmatch(r"#[0-9a-f]{6}", name):
        rgb = (int(name[1:3], 16), int(name[3:5], 16), int(name[5:7], 16))
    elif name in NAMED_RGB:
        rgb = NAMED_RGB[name]
    else:
        raise UnknownNameError(f"no colour is named {text!r}; write #rrggbb or one of: {', '.join(NAMED_RGB)}")
    pixel = np.array([[rgb[::-1]]], dtype=np.uint8)
    hue, saturation, value = (int(part) for part in cv2.cvtColor(pixel, cv2.COLOR_BGR2HSV)[0, 0])
    return Colour(hue, saturation, value)


def colour_planes(frame: Frame, box: Box, step: int) -> tuple[Bytes, Bytes]:
    """The planes cr and cb of a part of a frame, each pixel the mean of ``step`` x ``step``.

    ``box`` is left, top, right, bottom (exclusive) in px of the frame. Planes as coded are used where there are some:
    they need no conversion of the whole frame.
    """
    planes = frame.chroma()
    if planes is None:
        left, top, right, bottom = box
        image = cv2.cvtColor(np.ascontiguousarray(frame.bgr()[top:bottom, left:right]), cv2.COLOR_BGR2YCrCb)
        return reduced(image[..., 1], step), reduced(image[..., 2], step)
    blue, red = (_coded(plane, frame.luma.shape, box, step) for plane in planes)
    return red, blue


def _coded(plane: Bytes, shape: tuple[int, ...], box: Box, step: int) -> Bytes:
    """A part of one colour plane, which may have half as many pixels a side as the frame of that shape."""
    left, top, right, bottom = box
    across, down = -(-shape[1] // plane.shape[1]), -(-shape[0] // plane.shape[0])
    cut = plane[top // down : -(-bottom // down), left // across : -(-right // across)]
    if across == down and step % across == 0 and left % across == 0 and top % down == 0:
        return reduced(cut, step // across)
    y, x = max(0, top // down - 1), max(0, left // across - 1)  # one more about it, which its outer pixels need
    cut = plane[y : -(-bottom // down) + 1, x : -(-right // across) + 1]
    size = (cut.shape[1] * across, cut.shape[0] * down)
    fine = np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
    fine = fine[top - y * down :, left - x * across :][: bottom - top, : right - left]
    return reduced(fine, step)


def reduced(image: Bytes, step: int) -> Bytes:
    """An image (h, w[, 3]) with each pixel the mean of ``step`` x ``step``; itself when that is 1."""
    while step % 2 == 0 and step > 1:  # halving is the fastest resize of OpenCV
        image = _shrunk(image, 2)
        step //= 2
    return image if step == 1 else _shrunk(image, step)


def _shrunk(image: Bytes, step: int) -> Bytes:
    size = (image.shape[1] // step, image.shape[0] // step)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
