"""A patch followed by normalised cross-correlation: the content of the given region in the first frame.

The patch is found again where the correlation with it peaks, in the whole image at first and later near where it
was. The peak is refined to a fraction of a pixel by maximising the enhanced correlation coefficient [1]_, which does
not depend on brightness and contrast. The patch is never updated, so that it cannot drift.

.. [1] G. D. Evangelidis and E. Z. Psarakis, Parametric image alignment using enhanced correlation coefficient
   maximization, IEEE Transactions on Pattern Analysis and Machine Intelligence 30 (2008) 1858-1865.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import Array, FrameSource, Track, Tracker, TrackerExample, TrackOptions, with_progress
from trackers._detection.detect_frames import REPORT_EVERY
from trackers._frames.arrays import Bytes, Image
from trackers._frames.working_image import view_of

MIN_PATCH = 6  # px a side
MIN_CORRELATION = 0.6  # below it the place shows another object, or the patch is half hidden
MIN_CONTRAST = 2.0  # grey levels, standard deviation: less is noise
REACH = 1.5  # of the patch's larger side: how far from where it is predicted it is sought
MARGIN = 2  # px round the peak in which it is refined
ROUNDS = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-4  # px at which the refinement has settled
NOWHERE = (np.nan,) * 5


@dataclass(frozen=True, eq=False, slots=True)
class Patch:
    """The patch (h, w), its gradient's covariance (2, 2) summed over its pixels, and the size of the image."""

    image: Image
    information: Array

    def seen_in(self, luma: Bytes, near: tuple[float, float] | None) -> tuple[float, ...]:
        """Corner x, y, their standard errors, and the correlation; NaN where the patch is not seen.

        ``near`` is where its corner is expected, px; None to look everywhere.
        """
        left, top, part = self._part(luma, near)
        scores = cv2.matchTemplate(part, self.image, cv2.TM_CCOEFF_NORMED)
        _, best, _, (x, y) = cv2.minMaxLoc(scores)
        if not MIN_CORRELATION <= best <= 1.0 + 1e-6:
            return NOWHERE
        height, width = self.image.shape
        x0, y0 = max(0, x - MARGIN), max(0, y - MARGIN)
        window = np.ascontiguousarray(part[y0 : y + height + MARGIN, x0 : x + width + MARGIN])
        warp = np.array([[1, 0, x - x0], [0, 1, y - y0]], dtype=np.float32)
        try:
            best, warp = cv2.findTransformECC(self.image, window, warp, cv2.MOTION_TRANSLATION, ROUNDS, None, 1)
        except cv2.error:  # it does not converge
            return NOWHERE
        shift = np.array([warp[0, 2], warp[1, 2]], dtype=np.float64)
        if np.abs(shift - (x - x0, y - y0)).max() > MARGIN:
            return NOWHERE
        corner = shift + np.array([left + x0, top + y0])
        return (*corner, *self._sigma(window, shift), float(best))

    def _part(self, luma: Bytes, near: tuple[float, float] | None) -> tuple[int, int, Image]:
        """The part of the image in which to look, and its corner."""
        height, width = self.image.shape
        left, top, right, bottom = 0, 0, luma.shape[1], luma.shape[0]
        if near is not None:
            reach = int(REACH * max(height, width))
            x, y = (round(coordinate) for coordinate in near)
            left, top = (
                min(max(0, low), high) for low, high in ((x - reach, right - width), (y - reach, bottom - height))
            )
            right, bottom = min(right, max(x, left) + width + reach), min(bottom, max(y, top) + height + reach)
        return left, top, luma[top:bottom, left:right].astype(np.float32)

    def _sigma(self, window: Image, shift: Array) -> Array:
        """Standard errors (2,) of a position, px.

        With the patch T, its gain a and offset b fitted to the image, and the residual r,
        cov = var(r) / a^2 (sum grad T grad T')^-1: the Cramer-Rao bound, with the noise as it is seen.
        """
        height, width = self.image.shape
        matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], dtype=np.float32)
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpAffine(window, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        gain, offset = np.polyfit(self.image.ravel(), seen.ravel(), 1)
        residual = float(np.var(seen - gain * self.image - offset, ddof=4))
        return np.sqrt(np.diag(np.linalg.inv(self.information)) * max(residual, 1 / 12) / max(gain**2, 1e-6))


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the content of ``options.roi`` in the first frame.

    Parameters
    ----------
    video
        The clip; its camera may move.
    options
        ``roi`` is the patch in the first frame, x, y, width, height in px; ``progress`` is called every ten frames.

    Returns
    -------
    list of Track
        One: the middle of the patch in every frame. A frame in which it is not seen again is a gap.

    Raises
    ------
    TrackingError
        When no region is given, or its content has no structure to match.
    DataError
        When the region does not lie in the image, is smaller than 6 px a side, or several bodies are requested.
    """
    view = view_of(video, options)
    if options.bodies != 1 or options.colour is not None:
        raise DataError("template follows one patch, by its brightness: leave out --bodies and --colour")
    if options.roi is None:
        raise TrackingError(
            "this tracker follows a patch: give the region in which the body lies in the first frame, --roi x,y,w,h"
        )
    if min(view.width, view.height) < MIN_PATCH:
        raise DataError(f"the patch is {view.width} x {view.height} px; it must be {MIN_PATCH} px a side or more")
    patch: Patch | None = None
    rows: list[tuple[float, ...]] = []
    times: list[tuple[int, float]] = []
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        patch = patch or _patch(view.part(frame, (0, 0, view.width, view.height)))
        times.append((frame.index, frame.t_s))
        rows.append(patch.seen_in(frame.luma, _expected(rows)))
    return [_track_of(np.array(rows), times, options)]


def _patch(luma: Bytes) -> Patch:
    """The patch in the first frame; TrackingError where it has too little structure to be found again."""
    image = luma.astype(np.float32)
    if float(image.std()) < MIN_CONTRAST:
        raise TrackingError("there is nothing in the region but one grey level; give a region in which the body lies")
    slopes = np.stack([np.gradient(image.astype(np.float64), axis=axis).ravel() for axis in (1, 0)])
    information = slopes @ slopes.T
    if np.linalg.cond(information) > 1e6:
        raise TrackingError("the region looks the same all along a line; include a corner or an end of it")
    return Patch(image, information)


def _expected(rows: list[tuple[float, ...]]) -> tuple[float, float] | None:
    """Where the patch's corner will be if its velocity stays; None where it was not seen just before."""
    if not rows or np.isnan(rows[-1][0]):
        return None
    x, y = rows[-1][:2]
    if len(rows) < 2 or np.isnan(rows[-2][0]):
        return x, y
    return 2 * x - rows[-2][0], 2 * y - rows[-2][1]


def _track_of(corners: Array, times: list[tuple[int, float]], options: TrackOptions) -> Track:
    """The Track of the patch's middle from its corners (n, 5)."""
    assert options.roi is not None
    _, _, width, height = options.roi
    return Track(
        t_s=np.array([t_s for _, t_s in times]),
        xy_px=corners[:, :2] + np.array([(width - 1) / 2, (height - 1) / 2]),
        sigma_px=corners[:, 2:4],
        valid=np.isfinite(corners[:, 0]),
        frame=np.array([index for index, _ in times]),
        origin={"tracker": TRACKER.name, "roi": options.roi, "least_correlation": MIN_CORRELATION},
    )


TRACKER = Tracker(
    name="template",
    summary="a patch as it looks in the first frame, by normalised cross-correlation; give it with --roi",
    track=track,
    example=TrackerExample(options=TrackOptions(roi=(112, 35, 27, 27))),
)
