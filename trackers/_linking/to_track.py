"""From the sightings of a body to its Track."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Track
from trackers._detection.detection import Glimpse, Sighting
from trackers._linking.frame_to_frame import Path
from trackers._linking.select_bodies import held_frames
from trackers._uncertainty.error_correlation import memory, moving
from trackers._uncertainty.excess_scatter import Steadiness, with_scatter


def track_of(path: Path, glimpses: Sequence[Glimpse], body: str, origin: dict[str, object]) -> Track:
    """The Track of one path over all frames; gaps are NaN.

    Parameters
    ----------
    path
        The sightings of the body.
    glimpses
        All frames of the clip, in order.
    body
        Name of the body.
    origin
        Where the track came from.
    """
    place = {glimpse.frame: k for k, glimpse in enumerate(glimpses)}
    table = np.full((len(glimpses), 8), np.nan)
    table[[place[one.frame] for one in path.sightings]] = [_row(one) for one in path.sightings]
    hand = np.zeros(len(glimpses), dtype=np.bool_)
    hand[list(held_frames(path, glimpses))] = True
    t_s = np.array([glimpse.t_s for glimpse in glimpses])
    radius = np.sqrt(table[:, 4] / np.pi)
    free = [one for one in path.sightings if one.centre.bends and not one.hand]
    rows = np.array([place[one.frame] for one in free], dtype=np.int64)
    lasting, known = errors_last(rows, table[:, :2], radius, np.array([one.centre.bends for one in free]))
    return Track(
        t_s=t_s,
        xy_px=table[:, 0:2],
        sigma_px=np.column_stack([with_scatter(t_s, table[:, axis], table[:, axis + 2], known) for axis in (0, 1)]),
        valid=np.isfinite(table[:, 0]),
        frame=np.array([glimpse.frame for glimpse in glimpses]),
        body=body,
        radius_px=radius,
        sigma_radius_px=table[:, 5] / np.sqrt(4 * np.pi * table[:, 4]),
        intensity=table[:, 6],
        sigma_intensity=table[:, 7],
        area_px=table[:, 4],
        hand=hand,
        origin={**origin, **lasting},
    )


def errors_last(
    rows: NDArray[np.int64], xy_px: Array, radius_px: Array, bends: Array, less: float = 0.0
) -> tuple[dict[str, object], Steadiness]:
    """How long the errors of the place last, as ``error_memory`` where the outline says so, and what follows from it.

    Parameters
    ----------
    rows
        Of the samples (k,) whose outline tells, ascending.
    xy_px, radius_px
        Places (n, 2) and radii (n,) of all samples, px; NaN in gaps.
    bends
        Amplitudes (k, 4) of the outline's lobes in those rows, px.
    less
        By how much the partial autocorrelation of the place's errors at one frame is below that of the lobes.
    """
    seen, number = np.isfinite(radius_px), np.arange(radius_px.size, dtype=np.float64)
    moves = np.zeros(radius_px.size, dtype=np.bool_)
    moves[seen] = moving(number[seen], xy_px[seen], radius_px[seen])
    found = memory(number[rows], xy_px[rows], bends, radius_px[rows]) if rows.size else []
    found = [(max(value - less, 0.0), stderr) for value, stderr in found[:1]] + found[1:]
    return ({"error_memory": found} if found else {}), Steadiness(moves, tuple(value for value, _ in found))


def _row(one: Sighting) -> tuple[float, ...]:
    """Position and its errors, area and its error, intensity and its error."""
    centre = one.centre
    errors = (centre.sigma_x, centre.sigma_y)
    return (one.x, one.y, *errors, centre.area, centre.sigma_area, centre.intensity, centre.sigma_intensity)
