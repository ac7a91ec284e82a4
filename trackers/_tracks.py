"""From the sightings of a body to its Track."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Track
from trackers._choose import held_frames
from trackers._link import Path
from trackers._memory import memory
from trackers._scatter import with_scatter
from trackers._sighting import Glimpse, Sighting


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
    return Track(
        t_s=t_s,
        xy_px=table[:, 0:2],
        sigma_px=np.column_stack([with_scatter(t_s, table[:, axis], table[:, axis + 2]) for axis in (0, 1)]),
        valid=np.isfinite(table[:, 0]),
        frame=np.array([glimpse.frame for glimpse in glimpses]),
        body=body,
        radius_px=np.sqrt(table[:, 4] / np.pi),
        sigma_radius_px=table[:, 5] / np.sqrt(4 * np.pi * table[:, 4]),
        intensity=table[:, 6],
        sigma_intensity=table[:, 7],
        area_px=table[:, 4],
        hand=hand,
        origin={**origin, **_memory_of(path)},
    )


def _memory_of(path: Path) -> dict[str, object]:
    """How long the errors of the place last, as ``error_memory``, where the outline says so."""
    seen = [one for one in path.sightings if one.centre.bends and not one.hand]
    if not seen:
        return {}
    places = np.array([(one.x, one.y) for one in seen])
    bends, radius = np.array([one.centre.bends for one in seen]), np.array([one.radius for one in seen])
    found = memory(np.array([one.frame for one in seen]), places, bends, radius)
    return {"error_memory": found} if found else {}


def _row(one: Sighting) -> tuple[float, ...]:
    """Position and its errors, area and its error, intensity and its error."""
    centre = one.centre
    errors = (centre.sigma_x, centre.sigma_y)
    return (one.x, one.y, *errors, centre.area, centre.sigma_area, centre.intensity, centre.sigma_intensity)
