"""Sub-pixel centroid of one body, weighted by the coverage of each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Array
from trackers._detection.coverage import coverage
from trackers._detection.coverage_kernels import Planes
from trackers._frames.arrays import Bytes, Image
from trackers._uncertainty.error_correlation import outline_lobes

HALF = 0.5  # of a pixel at the border: a body that covers more is cut by it


@dataclass(frozen=True, slots=True)
class Centre:
    """Centre of a body in its window (px), area (px), contrast and intensity (grey levels), with standard errors.

    ``cut`` says that the body reaches the border of the window; ``lobes`` are amplitudes of the outline's lobes, px.
    """

    x: float
    y: float
    sigma_x: float
    sigma_y: float
    area: float
    sigma_area: float
    contrast: float
    intensity: float
    sigma_intensity: float
    cut: bool
    lobes: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Window:
    """Pixels round a body: grey levels (channels, h, w) of frame, background and noise.

    ``mask`` (h, w) is 1 where the body is, right to about two pixels; ``other`` (h, w) is 1 where
    something else is. ``inflation`` is the variance of sums of noise over that of white noise.
    """

    image: Image
    background: Image
    noise: Image
    mask: Bytes
    other: Bytes
    inflation: float = 1.0

    @property
    def planes(self) -> Planes:
        """Frame, background and noise (channels, h, w)."""
        return self.image, self.background, self.noise


def coverage_centre(window: Window, *, refined: bool = True) -> Centre:
    """Centre of the body in a window, weighted by how much of each pixel it covers.

    A pixel that the body covers by the share a shows I = a F + (1 - a) B. Let i = (I - B)/noise and
    f = (F - B)/noise, vectors over the channels, with F continued outwards from the inside of the
    body, and s the strength |i| continued likewise. In a band about the outline

        a = i.f / |f|^2           where the body is all brighter or all darker, |f| near s,
        a = |i| / s               where it is both, as a steel ball is, |f| well below s,
        var a = (1 + (1 - m)^2) / s^2,

    mixed as m to 1 - m in between. a is 1 inside of the band and 0 outside, so that texture,
    highlights and noise away from the outline do not count. Then, with A = sum(a),

        x = sum(a x) / A,   var x = sum((x_i - x)^2 v_i) / A^2,

    over the pixels i of the band, where v = inflation * q * var a + e^2 a^2 d. Here q >= 1 is how much
    noisier than the still background the pixels just outside of the band are: compression keeps the
    noise of the moving body. e^2 is the variance of a just inside of the band beyond its noise, that is how
    badly F is known on a textured body, and d the distance in px over which such an error persists.

    Parameters
    ----------
    window
        The pixels round the body.
    refined
        Whether outline and background are estimated again from the first result; if not, the centre is a good guess.
    """
    share, variance = coverage(window.planes, window.mask, window.other, window.inflation, refined)
    return _moments(window, share.astype(np.float64), variance.astype(np.float64))


def _moments(window: Window, share: Array, variance: Array) -> Centre:
    """Centre and standard error from coverage and its variance."""
    area = max(float(share.sum()), 1e-9)
    (x, sigma_x), (y, sigma_y) = (_middle(share.sum(axis=axis), variance.sum(axis=axis), area) for axis in (0, 1))
    body = window.mask > 0
    seen, noise = window.image[0][body], float(window.noise[0][body].mean(dtype=np.float64))
    return Centre(
        x=x,
        y=y,
        sigma_x=sigma_x,
        sigma_y=sigma_y,
        area=area,
        sigma_area=float(np.sqrt(variance.sum())),
        contrast=float(np.abs(window.image - window.background).max(axis=0)[body].mean(dtype=np.float64)),
        intensity=float(seen.mean(dtype=np.float64)),
        sigma_intensity=noise * float(np.sqrt(window.inflation / seen.size)),
        cut=max(float(side.max()) for side in (share[0], share[-1], share[:, 0], share[:, -1])) > HALF,
        lobes=outline_lobes(share, x, y, area),
    )


def _middle(share: Array, variance: Array, area: float) -> tuple[float, float]:
    """Mean place (px) and its standard error, from the sums of coverage and of its variance across each place (n,)."""
    places = np.arange(share.size)
    middle = float(share @ places) / area
    return middle, float(np.sqrt(variance @ (places - middle) ** 2)) / area
