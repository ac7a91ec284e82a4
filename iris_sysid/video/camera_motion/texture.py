"""Points of the image that can be found again: corners spread over it, followed by the method of Lucas and Kanade."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Mask

Bytes = NDArray[np.uint8]

WIDE = 31  # px: shades that vary over more are light, not texture
GAIN_TO = 100.0  # grey levels that the strongest texture is brought to
MAX_GAIN = 8.0  # of texture: beyond it, it is noise
STRONGEST = 99.5  # percentile of the texture
PATCH = 21  # px, side of the patch that is found again
LEVELS = 3  # halvings of the image: a patch is found that moved by up to about 80 px
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 30, 1e-3)
MIN_QUALITY = 1e-3  # of the strongest corner
TILES = 4  # a side, each with its own corners
TILED = range(TILES**2)
LOOK_AT = 10  # times as many candidates as are wanted, for points that lie apart
BORDER = PATCH // 2 + 2  # px at the edge of the image without corners


@dataclass(frozen=True, slots=True)
class Texture:
    """What makes the image in which points are followed: reduced ``step`` times, shades taken out, amplified."""

    step: int
    gain: float

    def image(self, luma: Bytes) -> Bytes:
        """The texture (h, w) of a frame's luma, grey levels about 128; a pixel is the mean of step x step px."""
        return _bytes(_without_shades(luma, self.step) * np.float32(self.gain))


def texture_of(luma: Bytes, widest: int) -> Texture:
    """The texture of a clip with frames like this luma (h, w), grey levels, searched at most ``widest`` px wide."""
    step = -(-luma.shape[1] // widest)
    strongest = float(np.percentile(np.abs(_without_shades(luma, step)), STRONGEST))
    return Texture(step, min(MAX_GAIN, GAIN_TO / max(strongest, 1.0)))


def _without_shades(luma: Bytes, step: int) -> NDArray[np.float32]:
    height, width = (size - size % step for size in luma.shape)
    small = luma[:height, :width].astype(np.float32) if step == 1 else _reduced(luma[:height, :width], step)
    smooth = cv2.GaussianBlur(small, (5, 5), 0.8)
    return np.asarray(smooth - cv2.blur(small, (WIDE, WIDE)), dtype=np.float32)


def _reduced(luma: Bytes, step: int) -> NDArray[np.float32]:
    size = (luma.shape[1] // step, luma.shape[0] // step)
    # bytes are averaged much faster than floats; the first halvings keep their fractions
    return np.asarray(cv2.resize(luma.astype(np.float32), size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _bytes(image: NDArray[np.float32]) -> Bytes:
    return np.asarray(cv2.convertScaleAbs(np.maximum(image + np.float32(128), 0)), dtype=np.uint8)


def corners(image: Bytes, count: int) -> Array:
    """About ``count`` corners (n, 2) of an image (h, w), px, strongest first; each a random part of a pixel off.

    Every tile of the image gives its strongest ones, so that a body with a strong pattern does not take them all.
    Interpolation shifts what is found by some hundredths of a pixel, in a way that depends on the part of a pixel:
    random parts make these errors independent.
    """
    height, width = image.shape
    strength = cv2.cornerMinEigenVal(image, 7)
    peaks = (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > MIN_QUALITY * strength.max())
    peaks[:BORDER] = peaks[height - BORDER :] = False
    peaks[:, :BORDER] = peaks[:, width - BORDER :] = False
    rows, columns = np.nonzero(peaks)
    order = np.argsort(-strength[rows, columns], kind="stable")
    rows, columns = rows[order], columns[order]
    tiles = (rows * TILES // height) * TILES + columns * TILES // width
    spacing, most = max(5.0, np.sqrt(width * height / count) / 2), -(-count // TILES**2)
    chosen = np.sort(np.concatenate([_apart(np.flatnonzero(tiles == k), columns, rows, spacing, most) for k in TILED]))
    points = np.column_stack([columns, rows])[chosen].astype(np.float64)
    return np.asarray(points + np.random.default_rng(len(points)).uniform(-0.5, 0.5, points.shape))


def _apart(
    numbers: NDArray[np.intp], columns: NDArray[np.intp], rows: NDArray[np.intp], spacing: float, most: int
) -> NDArray[np.intp]:
    """The first ``most`` points that are at least ``spacing`` px apart."""
    kept: list[int] = []
    for number in numbers[: LOOK_AT * most]:
        near = [abs(columns[k] - columns[number]) < spacing and abs(rows[k] - rows[number]) < spacing for k in kept]
        if len(kept) < most and not any(near):
            kept.append(int(number))
    return np.array(kept, dtype=np.intp)


def found_again(
    before: Bytes, after: Bytes, points: Array, expected: Array | None = None, levels: int = LEVELS
) -> Array:
    """Where points of one image lie in another, (n, 2) px; NaN where they are not found.

    Parameters
    ----------
    before, after
        Images (h, w), grey levels.
    points
        In the first one (n, 2), px.
    expected
        Where to look first (n, 2), px; where they were by default.
    levels
        Halvings of the image; 0 looks no farther than about half a patch.
    """
    if not len(points):
        return points.copy()
    start = np.array(points, dtype=np.float32, order="C").reshape(-1, 1, 2)
    guess = np.array(points if expected is None else expected, dtype=np.float32, order="C").reshape(-1, 1, 2)
    flags = cv2.OPTFLOW_USE_INITIAL_FLOW
    found, state, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, guess, winSize=(PATCH, PATCH), maxLevel=levels, criteria=CRITERIA, flags=flags
    )
    places = found.reshape(-1, 2).astype(np.float64)
    places[state.ravel() == 0] = np.nan
    return places


def shift_of(before: Bytes, after: Bytes) -> Array:
    """The shift (2,) px of most of one image (h, w) to another, by the phase of their spectra, to a pixel or two."""
    small = [cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA) for image in (before, after)]
    window = cv2.createHanningWindow(small[0].shape[::-1], cv2.CV_32F)
    (across, down), _ = cv2.phaseCorrelate(small[0].astype(np.float32), small[1].astype(np.float32), window)
    return 2 * np.array([across, down])


def inside(points: Array, shape: tuple[int, ...]) -> Mask:
    """Which points (n, 2) px lie so far inside an image (h, w) that their whole patch does; NaN does not."""
    height, width = shape[:2]
    with np.errstate(invalid="ignore"):
        return np.asarray(((points >= BORDER) & (points <= np.array([width, height]) - 1 - BORDER)).all(axis=1))
