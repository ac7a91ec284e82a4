"""Whether the camera changed its exposure while a lamp faded: the light of the still background, and what it corrects.

A gain multiplies lamp and background alike. Room light that flickers adds to both. Light of the lamp on the background
rises and falls with the lamp itself. The first two make the lamp's brightness rough in step with the background; the
hypothesis that leaves it smoothest is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from iris_sysid.types import Array, Frame
from trackers._frames.arrays import Flags
from trackers._frames.working_image import WorkingView
from trackers._regions.lamp_brightness import luma_of
from trackers._regions.linear_light import LinearLight, PixelIndices

Change = Literal["none", "gain", "room light", "lamp light", "unclear"]

AWAY = 0.04  # of the image's width: distance from a lamp at which the background begins
MIN_CODE, MAX_CODE = 0.12, 0.92  # codes of background pixels that count
MIN_PIXELS, MAX_PIXELS = 100, 4000
MIN_CHANGE = 0.004  # of the background's light: less is the noise of compression
MAX_ROUGHNESS_RATIO = 0.7  # times the roughness: a correction that leaves less is taken
SLOW_CHANGE = 0.02  # of the background's light: a larger smooth change makes the lamp's decay doubtful
TRUSTED = 0.1  # of a correction is its standard error
OPPOSES = 0.6  # correlation: at a stronger one the background opposes the lamp
MIN_SIGMAS = 6.0  # standard errors of the background's light: a smaller change is noise


@dataclass(frozen=True, eq=False, slots=True)
class BackgroundLight:
    """Pixels of the still background, the curve of their light, and the standard error of their mean over it."""

    pixels: PixelIndices
    curve: LinearLight
    noise: float = 0.0

    def light(self, frame: Frame) -> float:
        """Mean light of the pixels."""
        return float(self.each(frame).mean())

    def each(self, frame: Frame) -> Array:
        """Light (m,) of each pixel, by luma."""
        luma = frame.luma[self.pixels.rows, self.pixels.columns].astype(np.float32)
        code = (luma - np.float32(frame.coding.black)) / np.float32(frame.coding.span)
        return self.curve.of((code, code, code))[0]


@dataclass(frozen=True, eq=False, slots=True)
class Exposure:
    """What changed, by how much of the background's light, the corrected brightness (n,), and its errors (r, n)."""

    change: Change
    size: float
    light: Array
    patterns: Array


def background_of(
    view: WorkingView, samples: Sequence[Frame], lamps: Flags, curve: LinearLight
) -> BackgroundLight | None:
    """The still background's pixels that the lamps (a mask at the size of the search) light least; None if too dark."""
    stack = np.stack([view.small(luma_of(view, frame)) for frame in samples]).astype(np.float32)
    coding = samples[0].coding
    low, high = (coding.black + share * coding.span for share in (MIN_CODE, MAX_CODE))
    reach = 2 * int(AWAY * stack.shape[2]) + 1
    near = cv2.dilate(lamps.astype(np.uint8), np.ones((reach, reach), np.uint8)) > 0
    usable = np.all((stack > low) & (stack < high), axis=0) & ~near
    if np.count_nonzero(usable) < MIN_PIXELS:
        return None
    smooth = np.stack([cv2.GaussianBlur(image, (0, 0), 2.0) for image in stack])
    relative = np.ptp(smooth, axis=0) / smooth.mean(axis=0)
    usable &= relative <= np.median(relative[usable])
    rows, columns = np.nonzero(usable)
    stride = -(-rows.size // MAX_PIXELS)
    middle = view.step // 2
    pixels = PixelIndices(
        rows[::stride] * view.step + middle + view.top, columns[::stride] * view.step + middle + view.left
    )
    background = BackgroundLight(pixels, curve)
    light = np.stack([background.each(frame) for frame in samples])
    residual = light - light.mean(axis=0) - (light.mean(axis=1, keepdims=True) - light.mean())
    return replace(background, noise=float(residual.std() / np.sqrt(rows[::stride].size) / light.mean()))


def exposure_of(light: Array, background: Array, noise: float) -> Exposure:
    """What changed the brightness (n,) of a lamp and of the background (n,), and the lamp's without it.

    ``noise`` is the standard error of the background's brightness over itself.
    """
    nothing = np.zeros((0, light.size))
    seen = background / np.median(background)
    ratio = _without_lamp(seen, light)
    size, least = _range(ratio), max(MIN_CHANGE, MIN_SIGMAS * noise)
    if size < least:
        return Exposure("none" if _range(seen) < least else "lamp light", size, light, nothing)
    room = float(_bends(light) @ _bends(ratio) / (_bends(ratio) @ _bends(ratio)))
    tried: dict[Change, Array] = {"gain": light / ratio, "room light": light - max(room, 0.0) * (ratio - 1)}
    best = min(tried, key=lambda change: _roughness(tried[change]))
    if _roughness(tried[best]) < MAX_ROUGHNESS_RATIO * _roughness(light):
        return _corrected(best, size, light, tried[best])
    if size < SLOW_CHANGE:
        return Exposure("none", size, light, nothing)
    # too smooth for roughness to show the cause: a camera that adapts opposes the lamp
    if float(np.corrcoef(light, ratio)[0, 1]) < -OPPOSES:
        return _corrected("gain", size, light, light / ratio)
    return Exposure("unclear", size, light, nothing)


def _without_lamp(ratio: Array, light: Array) -> Array:
    """The background's light (n,) less what of it rises and falls with the lamp (n,), never less than nothing."""
    from_mean = light - light.mean()
    lit = max(0.0, float(from_mean @ ratio / (from_mean @ from_mean)))
    rest = ratio - lit * from_mean
    return np.asarray(rest / np.median(rest))


def _range(values: Array) -> float:
    return float(np.ptp(np.percentile(values, (2, 98))))


def _corrected(change: Change, size: float, light: Array, corrected: Array) -> Exposure:
    return Exposure(change, size, corrected, TRUSTED * (corrected - light)[np.newaxis])


def _bends(values: Array) -> Array:
    return np.diff(values, 2)


def _roughness(values: Array) -> float:
    """Root mean square of the second differences."""
    return float(np.sqrt(np.mean(_bends(values) ** 2)))
