"""Positions of a body that the edge of its own frame cuts, from the part of it that is visible."""

from __future__ import annotations

import cv2
import numpy as np

from iris_sysid.types import Array, Mask, Track, mapped, runs

LIKE_THE_BODY = 0.35  # of its radius: how far the visible part's may differ from that of a disc cut so
STEPS = 200  # of the distance from the edge, in which the visible part of a disc is worked out


def seen_part(inside: Array) -> tuple[Array, Array]:
    """Of discs of radius 1 with their centres ``inside`` (n,) >= 0 of an edge: the area over pi, and the shift inwards.

    The visible part has the area ``pi - acos(h) + h sqrt(1 - h^2)``, and its centroid lies
    ``2 (1 - h^2)^(3/2) / (3 area)`` farther from the edge than the centre of the disc.
    """
    h = np.clip(inside, 0.0, 1.0)
    area = np.pi - np.arccos(h) + h * np.sqrt(1 - h**2)
    return area / np.pi, 2 * (1 - h**2) ** 1.5 / (3 * area)


def is_whole(xy_px: Array, track: Track, to_frame: Array, size: tuple[int, int]) -> Mask:
    """Where (n,) the body, or its centre where no radius is known, lies within its frame.

    Parameters
    ----------
    xy_px
        Positions (n, 2) in the reference frame.
    track
        Has the radii, px, and where the body was found.
    to_frame
        (n, 2, 3) affine maps from the reference to each frame.
    size
        Width and height of the frames, px.
    """
    radius = np.zeros(len(xy_px)) if track.radius_px is None else np.nan_to_num(track.radius_px)
    with np.errstate(invalid="ignore"):
        from_edges = _from_edges(mapped(to_frame, xy_px), size) >= radius[:, np.newaxis]
    return np.asarray(from_edges.all(axis=1) | ~track.valid)


def completed(
    xy_px: Array, track: Track, to_frame: Array, size: tuple[int, int], whole: Mask
) -> tuple[Array, Array, Mask]:
    """Positions (n, 2) px of the whole body, what their errors grow by (n,) px, and where (n,) it is known.

    Where one side of the frame cuts less than half of a disc, as large as where it is whole, the distance of the
    visible part's centroid from the edge says where its centre is; how far the visible area is from that of a disc cut
    so, as the radius of a disc of that area, is the standard error. A radius that is the body's own is of a position
    that is so already. Alone, without a frame next to it in which the body is whole, it may be anything.

    Parameters
    ----------
    xy_px, track, to_frame, size
        As for :func:`is_whole`.
    whole
        What that gave (n,).
    """
    places, error_px, known = xy_px.copy(), np.zeros(len(xy_px)), whole.copy()
    free = ~whole if track.hand is None else ~whole & ~track.hand
    if track.radius_px is None or not (whole & track.valid).any():
        return places, error_px, known
    radius = float(np.nanmedian(track.radius_px[whole & track.valid]))
    h = np.linspace(0.0, 1.0, STEPS)
    share, shift = seen_part(h)
    for row in np.flatnonzero(free):
        here = mapped(to_frame[row], xy_px[row : row + 1])[0]
        away = _from_edges(here, size)
        side = int(np.argmin(away))
        of_centre = np.interp(away[side] / radius, h + shift, h)
        unlike = abs(track.radius_px[row] - radius * np.sqrt(np.interp(of_centre, h, share)))
        as_whole = abs(track.radius_px[row] - radius)
        error_px[row] = min(unlike, as_whole)
        corner, beyond = np.count_nonzero(away < radius) > 1, away[side] < shift[0] * radius
        known[row] = not corner and not beyond and error_px[row] < LIKE_THE_BODY * radius
        if known[row] and unlike < as_whole:
            here[side % 2] += np.sign(side - 1.5) * (away[side] - of_centre * radius)
            places[row] = mapped(cv2.invertAffineTransform(to_frame[row]), here[np.newaxis])[0]
    for start, stop in runs(known & track.valid):
        known[start:stop] &= whole[start:stop].any()
    return places, error_px, known


def _from_edges(here: Array, size: tuple[int, int]) -> Array:
    """Distances (..., 4) px of places (..., 2) of a frame of that size from its left, top, right and lower edge."""
    return np.concatenate([here + 0.5, np.array(size) - 0.5 - here], axis=-1)
