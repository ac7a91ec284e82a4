"""From the samples of some pixels to linear light: matrix and range undone, then the curve, channel by channel.

Light is a sum over channels, and each channel has its own code: luma alone gives the light of greys only. So a red
lamp is undone in red, and counts as cut off when its red is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Frame, Matrix, PixelCoding, Transfer
from trackers._frames.arrays import Bytes, Flags, Image

# Shares (red, blue) of luma, by matrix: ITU-R BT.601, BT.709, BT.2020
LUMA_SHARES: Mapping[Matrix, tuple[float, float]] = MappingProxyType(
    {"bt601": (0.299, 0.114), "bt709": (0.2126, 0.0722), "bt2020": (0.2627, 0.0593)}
)
WEIGHTS = (0.2126, 0.7152, 0.0722)  # of red, green and blue in light; any would do, since light adds up in each
LOWEST, HIGHEST, STEPS = -0.1, 1.2, 4095  # codes in the table of a curve; its steps are a twelfth of a grey level
WHITE, BLACK = 0.985, 0.004  # codes from, or up to, which a pixel may be cut off: noise of a grey level or two


@dataclass(frozen=True, eq=False, slots=True)
class LinearLight:
    """A curve as tables of light and of its slope, light a grey level, by code from ``LOWEST`` to ``HIGHEST``."""

    light: NDArray[np.float32]
    slope: NDArray[np.float32]

    def of(self, codes: tuple[Image, Image, Image]) -> tuple[Array, float]:
        """Light (m,) of the codes of red, green and blue (m,) each, and its mean slope, light a grey level."""
        scale = np.float32(STEPS / (HIGHEST - LOWEST))
        total, slope = np.zeros(codes[0].size, dtype=np.float32), 0.0
        for weight, code in zip(WEIGHTS, codes, strict=True):
            index = np.clip((code - np.float32(LOWEST)) * scale + np.float32(0.5), 0, STEPS).astype(np.intp)
            total += np.float32(weight) * self.light[index]
            slope += weight * float(self.slope[index].mean())
        return total.astype(np.float64), slope


def linear_light(transfer: Transfer, span: float) -> LinearLight:
    """The tables of a curve for samples that are ``span`` grey levels from black to white."""
    code = np.linspace(LOWEST, HIGHEST, STEPS + 1)
    light = np.where(code < 0, -transfer.light(-code), transfer.light(np.abs(code)))  # noise about black has mean 0
    return LinearLight(light.astype(np.float32), (np.gradient(light, code) / span).astype(np.float32))


@dataclass(frozen=True, eq=False, slots=True)
class PixelIndices:
    """Some pixels of a frame by rows and columns (m,), px."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]

    def codes(self, frame: Frame) -> tuple[Image, Image, Image]:
        """Red, green and blue (m,) each, 0 at black and 1 at white, beyond where the file goes beyond."""
        planes = frame.chroma()
        if planes is None:
            bgr = frame.bgr()[self.rows, self.columns].astype(np.float32) / np.float32(255.0)
            return bgr[:, 2], bgr[:, 1], bgr[:, 0]
        coding = frame.coding
        luma = (self._of(frame.luma, frame.luma) - np.float32(coding.black)) / np.float32(coding.span)
        blue, red = (self._difference(plane, frame.luma, coding) for plane in planes)
        red_share, blue_share = LUMA_SHARES[coding.matrix]
        red = luma + np.float32(2 * (1 - red_share)) * red
        blue = luma + np.float32(2 * (1 - blue_share)) * blue
        green = (luma - np.float32(red_share) * red - np.float32(blue_share) * blue) / np.float32(
            1 - red_share - blue_share
        )
        return red, green, blue

    def _of(self, plane: Bytes, luma: Bytes) -> Image:
        """Samples (m,) of a plane that may be smaller than that of luma."""
        down, across = (-(-luma.shape[k] // plane.shape[k]) for k in (0, 1))
        return plane[self.rows // down, self.columns // across].astype(np.float32)

    def _difference(self, plane: Bytes, luma: Bytes, coding: PixelCoding) -> Image:
        """Colour difference (m,), -0.5 to 0.5."""
        middle = 128.0 - (1.0 - 2.0**-coding.lost_bits) / 2.0
        return (self._of(plane, luma) - np.float32(middle)) / np.float32(224.0 if coding.limited else 255.0)


def pixels_of(mask: Flags, left: int, top: int) -> PixelIndices:
    """The pixels of a mask (h, w) whose corner is ``left`` and ``top`` px from the frame's."""
    rows, columns = np.nonzero(mask)
    return PixelIndices(rows + top, columns + left)


def cut_off(codes: tuple[Image, Image, Image]) -> Flags:
    """Which pixels (m,) may be cut off at white in a channel, or at black in all."""
    return np.asarray((np.maximum.reduce(codes) >= WHITE) | (np.maximum.reduce(codes) <= BLACK))
