"""Autocorrelation of position errors, measured from the errors of the outline's shape, which each frame shows.

A compressed frame consists of motion-compensated blocks of the frame before it; the encoder corrects the residual only
where it is large. So the outline is wrong by parts of a pixel, outwards in one direction and inwards in another, for
some frames. The part of these errors that shifts the outline as a whole is the position error; no single frame shows
it. The part that lobes a disc into three or five lobes does not move its centre, is measured in each frame, and lasts
as long.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, ErrorAutocorrelation, Mask
from trackers._frames.arrays import MAD_TO_SD, Image

LOBES = (3, 5)  # odd as a shift is: a shape with a centre of symmetry, a disc or its streak, has none
INNER, OUTER = 0.5, 1.8  # of the radius, between which the outline lies
MAX_LOBE = 0.15  # of the radius: a shape with larger lobes is not a disc, and its outline changes as it turns
MIN_SPEED = 0.5  # px a frame: the encoder copies a resting body from frame to frame, and its errors never change
STRETCH = (10, 32)  # frames of the shortest and longest stretch of the track that is analysed by itself
OUTLIER = 3.0  # robust standard deviations: another object, e.g. the floor, disturbs the outline
MIN_SAMPLES = 40  # samples of each lobe; fewer do not determine the autocorrelation
MAX_STRETCHES = 20  # they determine a partial autocorrelation to 0.04
DEGREE = 2  # of the polynomial trend in time of each stretch: the shading changes with the position
MIN_SCATTERED = 12  # samples of each lobe that determine its standard deviation to a fifth
ROUND = 0.02  # of the radius: a body whose typical lobe is larger is not a disc
TURNING = 0.85  # autocorrelation from frame to frame: what changes so slowly is a shape that turns
GRID = (np.linspace(0.0, 0.9, 19), np.linspace(-0.2, 0.5, 15))  # partial autocorrelations at lags of 1 and 2 frames


def outline_lobes(share: Array, x: float, y: float, area: float) -> tuple[float, ...]:
    """Amplitudes, px, of the outline's lobes of order three and five: (cosine, sine) of each, by Fourier analysis.

    With delta(phi) the outline's distance from a circle of radius r, the amplitude is that of its Fourier series,
    1/pi times the integral of delta cos(m phi), here sum((a - d) cos(m phi)) / (pi r) over the pixels near the outline,
    where d is the coverage by the disc. An edge in which the coverage falls linearly over the width w holds
    sum(a (1 - a)) = 2 pi r w / 6. The pixels alone give a sharp disc lobes of a few hundredths of a pixel; those of a
    disc with an edge as wide are taken off.

    Parameters
    ----------
    share
        Coverage (h, w) of each pixel by the body, 0 to 1.
    x, y, area
        Its centre, px from the centre of pixel (0, 0) of ``share``, and its area, px^2.
    """
    radius = float(np.sqrt(area / np.pi))
    down, across = np.arange(share.shape[0]) - y, np.arange(share.shape[1]) - x
    squared = np.add.outer(down**2, across**2)
    near = (squared > (INNER * radius) ** 2) & (squared < (OUTER * radius) ** 2)
    seen = share[near]
    covered = np.clip(seen, 0, 1)
    width = max(1.0, 6 * float((covered * (1 - covered)).sum()) / (2 * np.pi * radius))
    off = seen - np.clip((radius - np.sqrt(squared[near])) / width + 0.5, 0, 1)
    return lobe_amplitudes(off, np.add.outer(1j * down, across)[near], radius)


def lobe_amplitudes(share: Array | Image, offset: NDArray[np.complex128], radius: float) -> tuple[float, ...]:
    """The same from pixels near the outline of a disc.

    Parameters
    ----------
    share
        Coverage (n,) of each pixel by the body, or by how much it exceeds that of the disc.
    offset
        Position (n,) of each pixel from the centre as x + iy, px.
    radius
        Of the disc, px.
    """
    weight, direction = share / (np.pi * radius), offset * (1 / np.maximum(np.abs(offset), 1e-9))
    power, amplitudes = direction, []
    for lobe in range(2, max(LOBES) + 1):  # complex powers take four times as long
        power = power * direction
        if lobe in LOBES:
            amplitudes.append(complex(weight @ power))
    return tuple(part for amplitude in amplitudes for part in (amplitude.real, amplitude.imag))


def outline_autocorrelation(frame: Array, xy_px: Array, lobes: Array, radius_px: Array) -> ErrorAutocorrelation | None:
    """Partial autocorrelations of a disc's outline errors at lags of 1 and 2 frames, with standard errors.

    Mean and standard deviation of the posterior of an autoregression of order 2, by the restricted likelihood
    (Patterson and Thompson 1971) of all stretches in which the body moves, each with parabolic trends and variances
    of its own. None where the body is seen in too few frames, or is not a disc.

    Parameters
    ----------
    frame
        Numbers (n,) of the frames in which the body is seen, ascending.
    xy_px
        Its positions (n, 2), x right and y down, px.
    lobes
        Amplitudes (n, 4) by :func:`outline_lobes`, px.
    radius_px
        Radius (n,) of the disc of the same area, px.
    """
    stretches = _stretches_of_disc(frame, xy_px, lobes, radius_px)[:MAX_STRETCHES]
    if sum(len(stretch) for stretch in stretches) < MIN_SAMPLES:
        return None
    stacks = _stacked(stretches)
    minus_twice = np.array([[_minus_restricted(stacks, first, second) for second in GRID[1]] for first in GRID[0]])
    weight = np.exp(-0.5 * (minus_twice - minus_twice.min()))
    weight /= weight.sum()
    marginals = zip(GRID, (weight.sum(axis=1), weight.sum(axis=0)), strict=True)
    partial, stderr = zip(*(_moments(values, marginal) for values, marginal in marginals), strict=True)
    return ErrorAutocorrelation(partial, stderr)


def outline_scatter(frame: Array, xy_px: Array, lobes: Array, radius_px: Array) -> float | None:
    """Standard deviation, px, of the errors of the outline's lobes while the body moves.

    The error of the position is that of the lobe of order one, which no image shows; the next odd one, of order three,
    is about as large in what a video coder makes of a disc. No path is assumed: a shift of the whole body does not
    show. Shading that changes slowly with the position is followed by parabolas in time. The lobes of a body that is
    not a disc change as it turns: the smaller of the orders three and five counts. None where the body is seen in too
    few frames, has large lobes, or turns fast.

    Parameters
    ----------
    frame, xy_px, lobes, radius_px
        As for :func:`outline_autocorrelation`.
    """
    stretches = _stretches_of_disc(frame, xy_px, lobes, radius_px)
    if sum(map(len, stretches)) < MIN_SCATTERED:
        return None
    shape = float(np.median(np.abs(np.concatenate(stretches)))) / float(np.median(radius_px))
    orders = slice(0, 2), slice(2, 4)
    scatters = [_scatter_of([stretch[:, order] for stretch in stretches]) for order in orders]
    known = [scatter for scatter in scatters if scatter is not None]
    if shape < ROUND:
        return scatters[0]
    return min(known, default=None)


def _scatter_of(stretches: Sequence[Array]) -> float | None:
    """Standard deviation of lobes (n, 2) of one order about parabolas in time; None where they change slowly."""
    residuals = [_without_trend(stretch) for stretch in stretches]
    squares = sum(float((residual**2).sum()) for residual in residuals)
    products = sum(float((residual[1:] * residual[:-1]).sum()) for residual in residuals)
    count = sum(len(residual) - DEGREE - 1 for residual in residuals)
    return None if products > TURNING * squares else float(np.sqrt(squares / (2 * count)))


def _without_trend(lobes: Array) -> Array:
    """Lobes (n, k) of one stretch without their parabolas in time."""
    powers = np.vander(np.linspace(-1, 1, len(lobes)), DEGREE + 1)
    return np.asarray(lobes - powers @ np.linalg.lstsq(powers, lobes, rcond=None)[0])


def _stretches_of_disc(frame: Array, xy_px: Array, lobes: Array, radius_px: Array) -> list[Array]:
    """Lobes (n, 4) of a disc in each stretch in which it moves, without outliers; none where it is not a disc."""
    useful = is_moving(frame, xy_px, radius_px)
    if not useful.any() or np.median(np.abs(lobes[useful])) > MAX_LOBE * np.median(radius_px[useful]):
        return []
    useful[useful] = _without_outliers(lobes[useful])
    moving = lobes[useful]
    return [moving[stretch] for stretch in _stretches(frame[useful])]


def _moments(values: Array, weight: Array) -> tuple[float, float]:
    """Mean and standard deviation of values with weights that sum to one; the latter at least a step of the grid."""
    mean = float(values @ weight)
    return mean, max(float(np.sqrt((values - mean) ** 2 @ weight)), float(values[1] - values[0]))


def is_moving(frame: Array, xy_px: Array, radius_px: Array) -> Mask:
    """Where (n,) the outline has moved since the frame before, or moves until the next one.

    ``frame`` (n,) are numbers of frames, ``xy_px`` (n, 2) and ``radius_px`` (n,) the disc's positions and radii, px.
    """
    step = np.hypot(*np.diff(xy_px, axis=0).T) + np.abs(np.diff(radius_px))
    moves = (np.diff(frame) == 1) & (step > MIN_SPEED)
    return np.asarray(np.append(moves, False) | np.append(False, moves))


def _without_outliers(lobes: Array) -> Mask:
    """Where (n,) no lobe amplitude (n, 4) is an outlier."""
    off = np.abs(lobes - np.median(lobes, axis=0))
    return np.asarray((off < OUTLIER * MAD_TO_SD * np.median(off, axis=0)).all(axis=1))


def _stretches(frame: Array) -> list[slice]:
    """Stretches of consecutive frames, none too long or too short."""
    ends = np.concatenate([[0], np.flatnonzero(np.diff(frame) != 1) + 1, [len(frame)]])
    cuts = [
        (first, min(first + STRETCH[1], stop))
        for start, stop in itertools.pairwise(ends.tolist())
        for first in range(start, stop, STRETCH[1])
    ]
    return [slice(start, stop) for start, stop in cuts if stop - start >= STRETCH[0]]


def _stacked(stretches: Sequence[Array]) -> list[Array]:
    """Stretches (n, 4) of equal length stacked, with the powers of time of their trend in front: (k, n, 7)."""
    lengths = sorted({len(stretch) for stretch in stretches})
    of_length = {n: [stretch for stretch in stretches if len(stretch) == n] for n in lengths}
    powers = {n: np.vander(np.linspace(-1, 1, n), DEGREE + 1) for n in of_length}
    return [np.stack([np.column_stack([powers[n], stretch]) for stretch in same]) for n, same in of_length.items()]


def _minus_restricted(stacks: Sequence[Array], first: float, second: float) -> float:
    """Minus twice the log restricted likelihood of those partial autocorrelations, the variances profiled out."""
    value = 0.0
    for columns in stacks:
        count, n, _ = columns.shape
        white = _whitened(columns, first, second)
        directions, triangle = np.linalg.qr(white[..., : DEGREE + 1])
        lobes = white[..., DEGREE + 1 :]
        residual = lobes - directions @ (directions.transpose(0, 2, 1) @ lobes)
        squares = (residual**2).sum(axis=1).reshape(count, len(LOBES), 2).sum(axis=-1)
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        # of the first two samples, whose variance is that of the process
        logs = -count * (2 * np.log(1 - second**2) + np.log(1 - first**2)) + 2 * np.log(sizes).sum()
        value += 2 * float(len(LOBES) * logs + (n - DEGREE - 1) * np.log(squares).sum())
    return value


def _whitened(columns: Array, first: float, second: float) -> Array:
    """Prediction errors (k, n, c) of columns, over their standard deviation in units of the innovation's."""
    filtered = columns.copy()
    filtered[:, 0] *= np.sqrt((1 - first**2) * (1 - second**2))
    filtered[:, 1] = (columns[:, 1] - first * columns[:, 0]) * np.sqrt(1 - second**2)
    filtered[:, 2:] -= first * (1 - second) * columns[:, 1:-1] + second * columns[:, :-2]
    return filtered
