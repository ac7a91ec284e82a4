"""Covariance of the errors of a board's corners in one image, by restricted maximum likelihood of the residual.

The error of a corner's coordinate depends on where in its pixel the corner lies: the pixel's grid, the camera's curve
and the encoder's blocks all repeat. Corners of one column of a board that stands upright lie at the same place in their
pixels and share their error, so the mean over many corners is not as exact as their scatter suggests.
"""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array

SHARES = np.linspace(0, 0.9, 7)  # of the variance, that corners at one place in their pixels have in common
LENGTHS_PX = (0.02, 0.1, 0.3)  # over which that part changes
OVER_A_PIXEL = (np.arange(200) + 0.5) / 200 - 0.5  # px
EXACT_PX2 = 1e-24  # px^2, corners without an error


def covariance_of_fit(slopes: Array, residual: Array, corners_px: Array) -> Array:
    """Covariance of parameters fitted by least squares to a board's corners, whose errors are common in part.

    The errors have the covariance ``s^2 ((1 - share) I + share K)``: ``K = exp(-d^2 / 2 length^2)``, less its mean,
    between equal coordinates, d px apart within their pixels. It is averaged over shares and lengths, each weighted by
    the restricted likelihood of the residual (Patterson and Thompson 1971), and taken to the parameters by the sandwich
    ``(J'J)^-1 J' C J (J'J)^-1``.

    Parameters
    ----------
    slopes
        J, (2 n, p): derivatives of the coordinates, px per unit of each parameter, x and y of a corner in turn.
    residual
        (n, 2), px.
    corners_px
        (n, 2), px.

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
    for common in _common_errors(corners_px):
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
    return np.asarray(to_params @ covariance @ to_params.T)


def _common_errors(corners_px: Array) -> list[Array]:
    """Correlation (2 n, 2 n) of the part of the errors that corners at one place in their pixels share, by length."""
    apart = corners_px[:, np.newaxis] - corners_px
    apart -= np.round(apart)
    found = []
    for length in LENGTHS_PX:
        # an error that varies with the place in the pixel has the mean zero over it
        mean = float(np.mean(np.exp(-np.square(OVER_A_PIXEL / length) / 2)))
        common = np.zeros((len(corners_px), 2, len(corners_px), 2))
        for axis in (0, 1):
            common[:, axis, :, axis] = (np.exp(-np.square(apart[..., axis] / length) / 2) - mean) / (1 - mean)
        found.append(common.reshape(2 * len(corners_px), -1))
    return found
