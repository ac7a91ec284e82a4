"""Region whose pixels share one time series up to a factor, by principal component analysis."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from trackers._frames.arrays import Bytes, Flags, Image

SHARES = (0.5, 0.3, 0.15)  # of the greatest change: a pixel that changes less is left out
CLIPPED = (2, 250)  # grey levels up to, or from, which a pixel may be cut off
MIN_PIXELS = 9
SMOOTHING = 1.0  # px: the seed is not a single noisy pixel
ROUNDS = 3
MIN_CHANGE = 4.0  # times the noise of a pixel


@dataclass(frozen=True, eq=False, slots=True)
class Region:
    """Pixels (h, w) that covary, and the share of the change that they explain.

    ``explained_share`` is the share of the variance, beyond the noise, that the common time series explains, in these
    pixels or in the whole image, whichever is less; ``clipped`` the share of what changes that is cut off in some
    sample.
    """

    mask: Flags
    explained_share: float
    clipped: float


def noise_of(stack: Bytes) -> float:
    """Noise of a pixel, grey levels, from the change of most pixels between successive samples (k, h, w)."""
    steps = np.diff(stack.astype(np.float32), axis=0).std(axis=0) / np.sqrt(2)
    return max(float(np.median(steps)), float(1 / np.sqrt(12)))


def region_that_changes(stack: Bytes, free: Flags, clipped: tuple[float, float] = CLIPPED) -> Region | None:
    """The connected region of samples (k, h, w) that changes most, of the pixels that are ``free``; None if none does.

    The time series is the first principal component in time of the region's pixels, the change of a pixel its
    projection on it. Pixels up to the first, or from the second, of the levels ``clipped`` may be cut off at black or
    white: they are left out as long as others remain.
    """
    series = stack.astype(np.float32)
    deviation = series - series.mean(axis=0)
    cut_off = np.asarray(np.any((stack <= clipped[0]) | (stack >= clipped[1]), axis=0))
    noise = noise_of(stack)
    series, mask = _principal_series(deviation, free), free
    for _ in range(ROUNDS):
        own = np.tensordot(series, deviation, axes=1)
        change = cv2.GaussianBlur(own, (0, 0), SMOOTHING)
        strength = np.where(free, np.abs(change), 0.0)
        top = np.unravel_index(int(np.argmax(strength)), strength.shape)
        if strength[top] < MIN_CHANGE * noise:
            return None
        mask = _connected((strength > SHARES[0] * strength[top]) & (np.sign(change) == np.sign(change[top])), top)
        series = _principal_series(deviation, mask)
    clipped_share = float(cut_off[mask].mean())
    for share in SHARES:
        wide = _connected((strength > share * strength[top]) & (np.sign(change) == np.sign(change[top])), top)
        uncut = wide & ~cut_off & (np.abs(own) > share * strength[top])  # not a neighbour that the smoothing reaches
        if np.count_nonzero(uncut) >= MIN_PIXELS:
            mask, clipped_share = uncut, float(cut_off[wide].mean())
            break
    if np.count_nonzero(mask) < MIN_PIXELS:
        return None
    anywhere = free & (deviation.std(axis=0) > MIN_CHANGE / 2 * noise)
    explained_share = min(
        _explained_share(deviation, series, mask, noise),
        _explained_share(deviation, series, anywhere, noise),
    )
    return Region(mask, explained_share, clipped_share)


def _principal_series(deviation: Image, mask: Flags) -> Image:
    """First principal component in time (k,) of some pixels, of length one."""
    values = deviation[:, mask]
    _, vectors = np.linalg.eigh(values @ values.T)
    return np.asarray(vectors[:, -1], dtype=np.float32)


def _connected(mask: Flags, seed: tuple[np.intp, ...]) -> Flags:
    """The part of a mask that is connected to a pixel, its holes filled."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    return np.asarray(labels == labels[seed])


def _explained_share(deviation: Image, series: Image, mask: Flags, noise: float) -> float:
    """Share of the variance of some pixels, beyond the noise, that the common time series explains."""
    values = deviation[:, mask]
    whole = float((values**2).sum()) - noise**2 * values.size
    common = float(((series @ values) ** 2).sum())
    return common / whole if whole > 0 else 1.0
