"""A track without positions, of a clip that no tracker follows or of a body that a person adds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Track
from iris_sysid.video.reader import Video


def empty_track(t_s: Array, frame: NDArray[np.int64], body: str) -> Track:
    """A body that was found in no frame; times (n,) s and numbers of the frames (n,), dimensionless."""
    n = len(t_s)
    nothing = np.full((n, 2), np.nan)
    return Track(
        t_s=t_s,
        xy_px=nothing,
        sigma_px=nothing,
        valid=np.zeros(n, dtype=np.bool_),
        frame=np.asarray(frame, dtype=np.int64),
        body=body,
        edited=np.zeros(n, dtype=np.bool_),
    )


def unfollowed(video: Video) -> Track | None:
    """A body that was found in no frame of a clip, for a person to place; None where only decoding tells the times."""
    times = np.array(video.frame_times)
    if not times.size:
        return None
    later = np.concatenate([[True], np.diff(np.maximum.accumulate(times)) > 0])
    return empty_track(times[later], np.flatnonzero(later), "1")
