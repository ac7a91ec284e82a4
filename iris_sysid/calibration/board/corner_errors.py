"""Covariance of the errors of a board's corners in one image, by restricted maximum likelihood of the residual.

The error of a corner's coordinate depends on where in its pixel the corner lies: the pixel's grid, the camera's curve
and the encoder's blocks all repeat. Corners of one column of a board that stands upright lie at the same place in their
pixels and share their error. On a board that is turned a little, that place changes slowly, so neighbours share it. The
mean over many corners is then not as exact as their scatter suggests.
"""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array

SHARES = np.linspace(0, 0.9, 7)  # of the variance, that corners at one place in their pixels have in common
LENGTHS_PX = (0.02, 0.1, 0.3)  # over which that part changes
LENGTHS_SQUARES = (2.0, 4.0, 8.0)  # over which a part that neighbours have in common changes
HARMONICS = np.arange(1, 41)  # at the shortest length the last has 3 e-6 of the first one's power
LOCKED, LOCKED_PX = 2.0, 0.3  # times a corner's own error, and over which length, an encoder shifts it by its place
EXACT_PX2 = 1e-24  # px^2, corners without an error


def relative_errors(stderr_px: Array) -> Array:
    """Errors of corners (n,) relative to the usual one, at least 1: an encoder's filter blurs some of them.

    ``stderr_px`` (n,) px; where it is unknown (NaN), the error is the usual one.
    """
    usual = usual_error(stderr_px)
    return np.fmax(stderr_px / usual, 1.0) if usual > 0 else np.ones(len(stderr_px))


def usual_error(stderr_px: Array) -> float:
    """Median of the corners' standard errors (n,), px, in px; 0 where none is known."""
    known = stderr_px[np.isfinite(stderr_px)]
    return float(np.median(known)) if known.size else 0.0


def covariance_of_fit(slopes: Array, residual: Array, corners_px: Array, encoded_px: float | None = None) -> Array:
    """Covariance of parameters fitted by least squares to a board's corners, whose errors are common in part.

    The errors have the covariance ``s^2 ((1 - share) I + share K)``. ``K`` is either a Gaussian of the distance between
    places in the pixel, periodic and less its mean, between equal coordinates; or ``exp(-d^2 / 2 length^2)`` of the
    distance on the board, where an encoder shifts neighbours alike. The covariance is averaged over both, shares and
    lengths, each weighted by the restricted likelihood of the residual (Patterson and Thompson 1971), and taken to the
    parameters by the sandwich ``(J'J)^-1 J' C J (J'J)^-1``.

    Where the place in the pixel changes by less than a pixel across the board, its error looks like another scale and
    is in no residual. In a frame of a clip a part of twice the corners' own error is added for it: a stronger
    compression raises both.

    Parameters
    ----------
    slopes
        J, (2 n, p): derivatives of the coordinates, px per unit of each parameter, x and y of a corner in turn. Those
        of a corner with a larger error are divided by its relative error, as its residual.
    residual
        (n, 2), px.
    corners_px
        (n, 2), px.
    encoded_px
        Usual standard error, px, of a corner by the grey levels around it, in a frame that an encoder compressed. None
        for an image, where neighbours share only the place in the pixel.

    Returns
    -------
    Array
        (p, p), in products of the parameters' units.
    """
    size = np.linalg.norm(slopes, axis=0)
    basis, triangle = np.linalg.qr(slopes / size, mode="complete")
    fitted, rest = basis[:, : size.size], basis[:, size.size :]
    to_params = np.linalg.inv(triangle[: size.size]) / size[:, np.newaxis]
    seen = rest.T @ residual.ravel()
    scores, covariances = [], []
    for common in _common_errors(corners_px, encoded_px is not None):
        # the eigenvalues of the common part serve every share
        within, ways = np.linalg.eigh(rest.T @ common @ rest)
        squares = np.square(ways.T @ seen)
        for share in SHARES:
            variances = 1 - share + share * np.maximum(within, 0)
            scale = max(float(np.mean(squares / variances)), EXACT_PX2)
            scores.append(-0.5 * (np.sum(np.log(variances)) + seen.size * np.log(scale)))
            covariances.append(scale * ((1 - share) * np.eye(size.size) + share * fitted.T @ common @ fitted))
    weights = np.exp(np.array(scores) - max(scores))
    covariance = np.tensordot(weights / weights.sum(), np.array(covariances), axes=1)
    if encoded_px is not None:
        locked = _of_each_axis(_periodic(corners_px[:, np.newaxis] - corners_px, LOCKED_PX))
        covariance += (LOCKED * encoded_px) ** 2 * fitted.T @ locked @ fitted
    return np.asarray(to_params @ covariance @ to_params.T)


def _common_errors(corners_px: Array, encoded: bool) -> list[Array]:
    """Correlation (2 n, 2 n) of the part of the errors that corners share, by its kind and length."""
    apart = corners_px[:, np.newaxis] - corners_px
    at_one_place = [_of_each_axis(_periodic(apart, length)) for length in LENGTHS_PX]
    if not encoded:
        return at_one_place
    squared = np.sum(np.square(apart), axis=2)
    square_px2 = float(np.median(np.min(squared + np.diag(np.full(len(squared), np.inf)), axis=1)))
    spread = [np.exp(-squared / (2 * length**2 * square_px2)) for length in LENGTHS_SQUARES]
    return at_one_place + [_of_each_axis(np.repeat(part[..., np.newaxis], 2, axis=2)) for part in spread]


def _periodic(apart_px: Array, length: float) -> Array:
    """Correlation of an error with the period of a pixel and the mean zero over it, at these distances, px.

    A Gaussian of that ``length``, px, summed over the periods, by its Fourier series: no such sum is negative definite.
    """
    power = np.exp(-2 * np.square(np.pi * HARMONICS * length))
    waves = [
        weight * np.cos(2 * np.pi * n * apart_px) for n, weight in zip(HARMONICS, power / power.sum(), strict=True)
    ]
    return np.asarray(np.sum(waves, axis=0))


def _of_each_axis(correlation: Array) -> Array:
    """That (n, n, 2) of each coordinate as one matrix (2 n, 2 n); errors of x and y have nothing in common."""
    count = len(correlation)
    common = np.zeros((count, 2, count, 2))
    for axis in (0, 1):
        common[:, axis, :, axis] = correlation[..., axis]
    return common.reshape(2 * count, -1)
