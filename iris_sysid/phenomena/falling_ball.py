"""A ball that falls away from a camera that looks down on it: its apparent radius until the first bounce.

Radius and time alone leave a common factor of gravity, distance and r0 f open: r = r0 f / h with h'' = g stays the same
when all three are multiplied by it. One of them must be known. Gravity is taken as known unless h0, the distance from
the camera at which the ball is let go, is stated: then gravity follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from iris_sysid.phenomena._motion import in_motion, only_measured, stated, stated_length
from iris_sysid.types import BenchmarkClass, Estimate, FitResult, Phenomenon, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the apparent radius r in px.

    Parameters
    ----------
    world
        One trajectory of r in px, segmented.
    settings
        ``h0``, the distance from the camera at which the ball is let go, in m, is passed on.

    Returns
    -------
    Trajectory
        ``r``; the motion is the fall from the release to the first contact.

    Raises
    ------
    DataError
        When the motion has fewer than five samples, or h0 is no length in m.
    """
    body = only_measured(world, "falling-ball", "r")
    in_motion(body, 5)
    stated_length(settings, ("h0",), "m")
    return body.with_(geometry={**body.geometry, **stated(settings, "h0")}, smoothed=None)


def refine(fit: FitResult, trajectory: Trajectory) -> Mapping[str, Estimate]:
    """Gravity from the stated h0: the fit's h0 is in proportion to the gravity that it assumed."""
    known, gravity = trajectory.geometry.get("h0"), fit.estimates["gravity"]
    if known is None or not fit.usable or gravity.measurement_type not in ("assumed", "derived"):
        return {}
    found = fit.estimates["h0"]
    value = gravity.value * known.value / found.value
    share = math.hypot(known.stderr / known.value, found.stderr / found.value)
    return {"gravity": Estimate(value, value * share, "m/s^2", "derived", f"the fall, from h0 = {known.value:g} m")}


PHENOMENON = Phenomenon(
    name="falling-ball",
    summary="a ball falls away from a camera above it; its apparent radius until the first bounce",
    tracker="disc",
    model="apparent-radius",
    observe=observe,
    motion="flight",
    refine=refine,
    settings=("h0",),
    measures="radius",
    classes=(
        BenchmarkClass("Falling_ball", ("small", "mid", "big"), 10, {"gravity": "g", "h0": "h0"}),
        BenchmarkClass("free_fall", ("mousepad", "table", "tennis"), 5, {"gravity": "g", "h0": "h0"}),
    ),
)
