"""Mean linear light of a region that changes as a whole, with a standard error from its pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Frame
from trackers._frames.arrays import MAD_TO_SD, QUANTISATION_SD, Bytes, Flags
from trackers._frames.working_image import WorkingView
from trackers._regions.covarying_region import MIN_PIXELS, Region
from trackers._regions.linear_light import LinearLight, PixelIndices, cut_off, pixels_of
from trackers._uncertainty.pixel_correlation import noise_correlation, variance_of_sum

MAX_TERMS = 3  # level, slope and bend of each pixel against the mean of the region
MAX_PIXELS = 20_000  # by which the noise of a frame is measured
OUTLIER = 4.0  # standard deviations
PRIOR_PIXELS = 30  # as many of the noise in all samples count beside those of a frame: small regions have few
MIN_UNCUT = 0.05  # of a region must never be cut off at white, to be measured by those pixels alone
MAX_CUT = 0.02  # of the pixels may be cut off in a frame that is measured
MIN_SAMPLES = 3


def luma_of(view: WorkingView, frame: Frame) -> Bytes:
    """The luma of the region of interest of a frame."""
    return frame.luma[view.top : view.top + view.height, view.left : view.left + view.width]


@dataclass(frozen=True, slots=True)
class Reading:
    """A region in one frame: mean light and its standard error, light a grey level, share cut off at white."""

    light: float
    sigma: float
    slope: float
    cut: float


@dataclass(frozen=True, eq=False, slots=True)
class Lamp:
    """The pixels of a region at full size, and how their light follows its mean.

    ``curves`` (terms, m) are the coefficients of every ``stride``-th pixel in powers of the mean, scaled by
    ``range_`` (lowest, highest) to 0 to 1. ``share`` is the variance of the mean over that of a pixel, ``learned``
    that of a residual over that of a pixel, ``noise`` the typical noise of a pixel, grey levels. ``centre`` and
    ``sigma_centre`` (2,) are the middle of the change, px; ``clipped`` the share of the region that is cut off at
    white in some sample.
    """

    pixels: PixelIndices
    curve: LinearLight
    range_: tuple[float, float]
    curves: Array
    stride: int
    share: float
    learned: float
    noise: float
    centre: Array
    sigma_centre: Array
    clipped: float

    def reading(self, frame: Frame) -> Reading:
        """Mean light of the region in a frame, and its standard error by how its pixels scatter."""
        codes = self.pixels.codes(frame)
        values, slope = self.curve.of(codes)
        mean = float(values.mean())
        expected = _powers(np.array([mean]), self.range_, len(self.curves))[0] @ self.curves
        residual = (values[:: self.stride] - expected) / (slope * np.sqrt(self.learned))
        scatter = max(MAD_TO_SD * float(np.median(np.abs(residual))), self.noise)
        inside = residual[np.abs(residual) <= OUTLIER * scatter]
        variance = ((inside**2).sum() + PRIOR_PIXELS * self.noise**2) / (inside.size + PRIOR_PIXELS)
        return Reading(mean, slope * float(np.sqrt(self.share * variance)), slope, float(cut_off(codes).mean()))


def lamp_of(region: Region, view: WorkingView, samples: Sequence[Frame], curve: LinearLight) -> Lamp:
    """Learn from sampled frames how the pixels of a region, found at reduced size, follow its mean light."""
    mask = _enlarged(region.mask, view)
    rows, columns = (_extent(np.any(mask, axis=axis)) for axis in (1, 0))
    mask, corner = mask[rows, columns], np.array([columns.start + view.left, rows.start + view.top])
    cut = np.stack([cut_off(pixels_of(mask, *corner).codes(frame)) for frame in samples])
    clipped = max(region.clipped, float(cut.any(axis=0).mean()))
    mask, cut = _without_cut(mask, cut)
    pixels = pixels_of(mask, *corner)
    light = [curve.of(pixels.codes(frame)) for frame in _uncut(samples, cut)]
    values, slopes = np.stack([values for values, _ in light]), np.array([slope for _, slope in light])[:, np.newaxis]
    mean = values.mean(axis=1)
    range_ = (float(mean.min()), float(mean.max()))
    terms = _powers(mean, range_, min(MAX_TERMS, len(values) - 1))
    curves = np.asarray(np.linalg.lstsq(terms, values, rcond=None)[0], dtype=np.float64)
    residual = values - terms @ curves
    freedom = len(values) - terms.shape[1]
    variance = (residual**2).sum(axis=0) / freedom
    stride = max(1, values.shape[1] // MAX_PIXELS)
    centre, sigma_centre = _middle(mask, curves[1], variance / ((terms[:, 1] - terms[:, 1].mean()) ** 2).sum())
    grey = residual / slopes
    return Lamp(
        pixels=pixels,
        curve=curve,
        range_=range_,
        curves=curves[:, ::stride],
        stride=stride,
        share=variance_of_sum(mask / mask.sum(), noise_correlation(_images(grey, mask))),
        learned=1 + terms.shape[1] / len(values),
        noise=max(float(np.sqrt((grey**2).sum() / (freedom * grey.shape[1]))), QUANTISATION_SD),
        centre=centre + corner,
        sigma_centre=sigma_centre,
        clipped=clipped,
    )


def _without_cut(mask: Flags, cut: Flags) -> tuple[Flags, Flags]:
    """The mask (h, w) of the pixels that are cut off in no sample, and their flags (k, m); all where too few remain."""
    whole = ~cut.any(axis=0)
    if np.count_nonzero(whole) < max(MIN_PIXELS, MIN_UNCUT * whole.size):
        return mask, cut
    kept = np.zeros_like(mask)
    kept[mask] = whole
    return kept, cut[:, whole]


def _uncut(samples: Sequence[Frame], cut: Flags) -> list[Frame]:
    """The sampled frames in which few of the pixels are cut off (k, m)."""
    chosen = [frame for frame, flags in zip(samples, cut, strict=True) if flags.mean() <= MAX_CUT]
    if len(chosen) < MIN_SAMPLES:
        raise TrackingError(
            f"the region is cut off at white in all but {len(chosen)} of {len(samples)} sampled frames: nothing tells "
            "how bright it was; film it with a shorter exposure, or use the dimmer part of the clip (--start)"
        )
    return chosen


def _powers(mean: Array, range_: tuple[float, float], count: int) -> Array:
    """Powers 0 to count - 1 of means scaled by their range (n, count)."""
    return np.vander((mean - range_[0]) / max(range_[1] - range_[0], 1e-9), count, increasing=True)


def _enlarged(mask: Flags, view: WorkingView) -> Flags:
    """A mask found at reduced size, at full size."""
    rows = np.arange(view.height) * mask.shape[0] // view.height
    columns = np.arange(view.width) * mask.shape[1] // view.width
    return mask[rows[:, np.newaxis], columns]


def _extent(flags: ArrayLike) -> slice:
    """From the first to the last that is set."""
    indices = np.flatnonzero(flags)
    return slice(int(indices[0]), int(indices[-1]) + 1)


def _middle(mask: Flags, strength: Array, variance: Array) -> tuple[Array, Array]:
    """Centre of a change of some strength (m,) in the pixels of a mask, and its standard error; px in the mask."""
    rows, columns = np.nonzero(mask)
    position = np.column_stack([columns, rows]).astype(np.float64)
    whole = strength.sum()
    centre = (strength[:, np.newaxis] * position).sum(axis=0) / whole
    spread = ((position - centre) ** 2 * variance[:, np.newaxis]).sum(axis=0)
    return centre, np.sqrt(spread) / abs(whole)


def _images(residual: Array, mask: Flags) -> list[tuple[Array, Array]]:
    """Residuals (k, m) of the pixels of a mask as images over their standard deviation, and which are known."""
    known = mask.astype(np.float64)
    images = []
    for values in residual / max(float(residual.std()), 1e-9):
        image = np.zeros(mask.shape)
        image[mask] = values
        images.append((image, known))
    return images
