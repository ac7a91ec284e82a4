"""Additional position error where a body shows another area than before and after: something covers or joins it."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Mask
from trackers._frames.arrays import MAD_TO_SD
from trackers._uncertainty.running_median import running_median

NEIGHBOURS = 31  # frames over which the median area is taken: the body's own area is steady over them
USUAL = 4.0  # robust standard deviations: noise and compression change the area by less
# frames, over which a streak grows by less, and share of the area that something else adds: on the one synthetic drop
# that showed it (1280x720, seed 7301, drop_50), 0.25 left too many such frames in, 0.2 and 0.15 did not; of six others
# (1280x720 seed 8102, 640x360 seeds 8170, 8220, 8270) 0.2 and 0.25 mark the same seven frames, off by 0.55 and 0.7 px
MEDIAN_FRAMES, MAX_EXCESS = 15, 0.2
# of the frames: where the area is off by MAX_EXCESS in more of them, in either direction, the body has no steady area;
# 5 % of that drop, 14 and 23 % of two real clips (throw-green-PV4, incline-marble-1) that lost a right frame
MAX_SHARE = 0.1
MIN_CHANGE = 0.12  # of the area: the streak of a moving body varies by less


def shifted_by_area(area: Array, radius: Array) -> Array:
    """Additional standard error (n,) of positions along each axis, px, by the area that is missing or too much.

    A part of the area that lies at the outline, on an unknown side, shifts the centroid by about the radius times its
    share of the area. The usual area is the median of the neighbours; what noise explains does not count.

    Parameters
    ----------
    area, radius
        Area (n,), px^2, and radius (n,) of the disc of that area, px; NaN in gaps.
    """
    added = np.zeros_like(area)
    seen = np.flatnonzero(np.isfinite(area) & (area > 0))
    if seen.size < MEDIAN_FRAMES:
        return added
    usual = running_median(area[seen], NEIGHBOURS)
    share = np.abs(area[seen] - usual) / area[seen]
    noise = max(MIN_CHANGE, USUAL * MAD_TO_SD * float(np.median(share)))
    added[seen] = np.where(share > noise, share * radius[seen], 0.0)
    return added


def area_outliers(area: Array) -> Mask:
    """Frames (n,) whose detection holds more than the body, e.g. its shadow: the area is too large.

    ``area`` (n,) px^2, NaN in gaps. A body with a shadow of nearly its own contrast is detected together with it in
    some frames, which shifts the centroid by half the radius and more. None where the area is often too large or too
    small: parts of the outline come and go there, and one frame with more of it is as right as the others.
    """
    joined = np.zeros(area.size, dtype=np.bool_)
    seen = np.flatnonzero(np.isfinite(area) & (area > 0))
    if seen.size < MEDIAN_FRAMES:
        return joined
    share = 1 - running_median(area[seen], MEDIAN_FRAMES) / area[seen]
    if np.count_nonzero(np.abs(share) > MAX_EXCESS) <= MAX_SHARE * seen.size:
        joined[seen] = share > MAX_EXCESS
    return joined
