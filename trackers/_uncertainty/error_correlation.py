"""How long the errors of a body's place last: told by those of its outline's shape, which are seen.

A compressed frame is made of blocks of the frame before it, moved, with what is left over corrected only where it is
large. So the outline is off by parts of a pixel, here outwards and there inwards, and stays so for some frames. Its
errors as a whole move the place; no frame shows that. Those that bend a disc into three or five lobes move nothing,
are seen in each frame, and last as long.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Array, Mask
from trackers._background.median import MAD_TO_SD, Image

LOBES = (3, 5)  # odd as a shift is: what is symmetric about its centre, a disc or its streak, has none of its own
MOST_BENT = 0.15  # of the radius: what has larger lobes is no disc, and its own shape changes as it turns
INNER, OUTER = 0.5, 1.8  # of the radius, between which the outline lies
SLOWEST = 0.5  # px a frame: what rests is copied from frame to frame, and its errors last for ever
PIECE = (10, 32)  # frames of a piece of the course that is looked at by itself, least and most
OUTLIER = 3.0  # robust standard deviations: something is before the outline or behind it, e.g. the floor
FEWEST = 40  # samples of each lobe without which nothing can be said
MOST_PIECES = 20  # that are looked at: they tell a partial autocorrelation to 0.04
DEGREE = 2  # of the polynomial in time that a piece may follow of its own: the shading changes with the place
GRID = (np.linspace(0.0, 0.9, 19), np.linspace(-0.2, 0.5, 15))  # partial autocorrelations at one and two frames


def lobes(share: Image, x: float, y: float, area: float) -> tuple[float, ...]:
    """Amplitudes, px, of the outline's bends into three and five lobes, as cosine and sine each.

    With delta(phi) the outline's distance from a circle of radius r, the amplitude is that of its Fourier series,
    1/pi times the integral of delta cos(m phi), here sum(a cos(m phi)) / (pi r) over the pixels near the outline.

    Parameters
    ----------
    share
        How much (h, w) of each pixel the body covers.
    x, y, area
        Its centre in these pixels, and its area.
    """
    radius = float(np.sqrt(area / np.pi))
    across, down = np.arange(share.shape[1]) - x, np.arange(share.shape[0])[:, np.newaxis] - y
    squared = across**2 + down**2
    near = (squared > (INNER * radius) ** 2) & (squared < (OUTER * radius) ** 2) & (share != 0)
    return lobes_of(share[near], (across + 1j * down)[near], radius)


def lobes_of(share: Array | Image, place: Array, radius: float) -> tuple[float, ...]:
    """The same from pixels near the outline of a disc.

    Parameters
    ----------
    share
        How much (n,) of each pixel the body covers, or how much more than the disc does.
    place
        Of each pixel (n,), x + iy from the centre, px.
    radius
        Of the disc, px.
    """
    weight, direction = share / (np.pi * radius), place / np.maximum(np.abs(place), 1e-9)
    sums = [complex(weight @ direction**lobe) for lobe in LOBES]
    return tuple(part for one in sums for part in (one.real, one.imag))


def memory(frame: Array, xy_px: Array, bends: Array, radius_px: Array) -> list[tuple[float, float]]:
    """Partial autocorrelations at one and two frames of a disc's outline, each with its standard error.

    Mean and standard deviation of the posterior of an autoregression of order 2, by the restricted likelihood
    (Patterson and Thompson 1971) of all pieces in which the body moves, each about parabolas of its own and with
    variances of its own. Empty where too little of the outline is seen, or it is not that of a disc.

    Parameters
    ----------
    frame
        Numbers (n,) of the frames in which the body is seen, ascending.
    xy_px
        Its places (n, 2), px.
    bends
        Amplitudes (n, 4) of :func:`lobes`, px.
    radius_px
        Radius (n,) of the disc of the same area, px.
    """
    useful = moving(frame, xy_px, radius_px)
    if not useful.any() or np.median(np.abs(bends[useful])) > MOST_BENT * np.median(radius_px[useful]):
        return []
    useful[useful] = _clear(bends[useful])
    pieces = [bends[useful][piece] for piece in _pieces(frame[useful])][:MOST_PIECES]
    if sum(len(piece) for piece in pieces) < FEWEST:
        return []
    stacks = _stacked(pieces)
    minus_twice = np.array([[_minus_restricted(stacks, first, second) for second in GRID[1]] for first in GRID[0]])
    weight = np.exp(-0.5 * (minus_twice - minus_twice.min()))
    weight /= weight.sum()
    shares = zip(GRID, (weight.sum(axis=1), weight.sum(axis=0)), strict=True)
    return [_moments(values, share) for values, share in shares]


def _moments(values: Array, weight: Array) -> tuple[float, float]:
    """Mean and standard deviation of values with weights that sum to one; the latter at least a step of the grid."""
    mean = float(values @ weight)
    return mean, max(float(np.sqrt((values - mean) ** 2 @ weight)), float(values[1] - values[0]))


def moving(frame: Array, xy_px: Array, radius_px: Array) -> Mask:
    """Where (n,) the outline has moved since the frame before, or moves until the next one.

    ``frame`` (n,) are numbers of frames, ``xy_px`` (n, 2) and ``radius_px`` (n,) the disc's places and radii, px.
    """
    step = np.hypot(*np.diff(xy_px, axis=0).T) + np.abs(np.diff(radius_px))
    moves = (np.diff(frame) == 1) & (step > SLOWEST)
    return np.asarray(np.append(moves, False) | np.append(False, moves))


def _clear(bends: Array) -> Mask:
    """Where (n,) no lobe is wild."""
    off = np.abs(bends - np.median(bends, axis=0))
    return np.asarray((off < OUTLIER * MAD_TO_SD * np.median(off, axis=0)).all(axis=1))


def _pieces(frame: Array) -> list[slice]:
    """Stretches of frames without gaps, none too long or too short."""
    ends = np.concatenate([[0], np.flatnonzero(np.diff(frame) != 1) + 1, [len(frame)]])
    cuts = [
        (first, min(first + PIECE[1], stop))
        for start, stop in itertools.pairwise(ends.tolist())
        for first in range(start, stop, PIECE[1])
    ]
    return [slice(start, stop) for start, stop in cuts if stop - start >= PIECE[0]]


def _stacked(pieces: Sequence[Array]) -> list[Array]:
    """Pieces of the same length together (k, n, 4), each with the powers of time that it may follow: (k, n, 7)."""
    of_length = {n: [piece for piece in pieces if len(piece) == n] for n in sorted({len(piece) for piece in pieces})}
    powers = {n: np.vander(np.linspace(-1, 1, n), DEGREE + 1) for n in of_length}
    return [np.stack([np.column_stack([powers[n], one]) for one in same]) for n, same in of_length.items()]


def _minus_restricted(stacks: Sequence[Array], first: float, second: float) -> float:
    """Minus twice the log restricted likelihood of those partial autocorrelations, the variances profiled out."""
    value = 0.0
    for columns in stacks:
        count, n, _ = columns.shape
        white = _whitened(columns, first, second)
        directions, triangle = np.linalg.qr(white[..., : DEGREE + 1])
        seen = white[..., DEGREE + 1 :]
        left = seen - directions @ (directions.transpose(0, 2, 1) @ seen)
        squares = (left**2).sum(axis=1).reshape(count, len(LOBES), 2).sum(axis=-1)
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
