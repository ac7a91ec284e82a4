"""A fitted gravity that is not that of the Earth: it has absorbed an effect, or the scale or the clock is wrong."""

from __future__ import annotations

import math

from iris_sysid.types import Doubt, Estimate

EARTH = 9.76, 9.84  # m/s^2: from a mountain at the equator to the poles
FAR = 3.0  # standard errors
REMEDY = (
    "diagnose it for drag, check the scale (--scale) and the frame rate (--fps); "
    "if it is not 9.81 there, give it: --set gravity=VALUE"
)
UPWARDS = 'count it upwards, e.g. --columns "t=t_s,z[-1 m]=y_m", or fit the model incline to a distance'


def earth_gravity_doubt(gravity: Estimate, allowance: float = 0.0) -> Doubt | None:
    """A doubt where gravity, fitted in metres, is more than three errors outside the range on Earth, None otherwise.

    ``allowance`` is the standard error for an effect that the equation lacks, m/s^2: it is part of the error of the
    estimate, but this is how such an effect shows.
    """
    if gravity.unit != "m/s^2" or not math.isfinite(gravity.stderr):
        return None
    stderr = math.sqrt(max(gravity.stderr**2 - allowance**2, 0.0))
    off = max(EARTH[0] - gravity.value, gravity.value - EARTH[1], 0.0)
    if not off > FAR * stderr:
        return None
    if gravity.value < 0.0:
        return Doubt("scale", f"gravity is {gravity.value:.4g} m/s^2: the height is counted downwards", UPWARDS)
    finding = f"gravity is {gravity.value:.4g} m/s^2, where the Earth has {EARTH[0]} to {EARTH[1]}: "
    finding += "drag or another force that the equation lacks, the scale or the clock"
    return Doubt("scale", finding, REMEDY)
