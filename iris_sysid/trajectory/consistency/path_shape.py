"""What a path looks like: whether the body swings to and fro, falls, flies or slides, and which phenomenon that is."""

from __future__ import annotations

from typing import Literal

import numpy as np

from iris_sysid.types import Array, Doubt, Phenomenon, Trajectory

PathShape = Literal["swings", "falls", "flies", "slides", "unknown"]
# by shape: what the body does, in words, and the phenomenon that it is
WORDS: dict[PathShape, tuple[str, str]] = {
    "swings": ("swings to and fro", "pendulum"),
    "falls": ("falls straight down", "dropping-ball"),
    "flies": ("flies on a parabola", "projectile"),
    "slides": ("moves faster and faster along a straight line", "sliding-cone"),
}
SHAPES_OF: dict[str, tuple[PathShape, ...]] = {"oscillation": ("swings",), "flight": ("falls", "flies")}
TURNS = 3  # reversals of a swing; a bounce off a wall has one
SWING = 0.25  # of the range: a reversal is a way back of at least that
SIDEWAYS = 0.3  # range of x over that of z: a ball that bounces upright is not a pendulum
PARABOLA = 0.02  # rms residual over the motion's standard deviation
STRAIGHT = 0.02  # scatter across a line over the scatter along it
UPRIGHT = 0.15  # range of x over that of z of a fall
MIN_SAMPLES = 8


def shape_of(body: Trajectory) -> PathShape:
    """The shape of a path of x and z (n, 2), m or px, segmented, from the samples that no hand holds.

    A swing turns back three times at least along x. A parabola over time is judged in the motion only, before the first
    contact.
    """
    free = body.valid & ~(body.mask("hand") if body.segments else np.zeros(body.n, dtype=np.bool_))
    across, up = np.ptp(body.position[free, :2], axis=0) if free.sum() >= MIN_SAMPLES else (0.0, 0.0)
    if across > SIDEWAYS * up and reversals(body.position[free, 0]) >= TURNS:
        return "swings"
    used = body.valid & body.mask("motion")
    if used.sum() < MIN_SAMPLES:
        return "unknown"
    return _single_run(body.t_s[used], body.position[used, :2])


def _single_run(t_s: Array, position: Array) -> PathShape:
    """The shape of a motion without a return: times (n,) s, x and z (n, 2)."""
    polynomials = np.polyfit(t_s - t_s[0], position, 2)
    residual = position - np.vander(t_s - t_s[0], 3) @ polynomials
    size = np.sqrt(np.mean((position - position.mean(axis=0)) ** 2))
    if size == 0 or np.sqrt(np.mean(residual**2)) > PARABOLA * size:
        return "unknown"
    across, up = np.ptp(position, axis=0)
    changes = np.abs(polynomials[0]) * np.ptp(t_s) ** 2  # of the way, by the acceleration
    if changes[1] < 2 * PARABOLA * size or polynomials[0, 1] > 0:
        return "unknown"
    if across < UPRIGHT * up:
        return "falls"
    along, scatter = np.linalg.svd(position - position.mean(axis=0), compute_uv=False)
    if scatter < STRAIGHT * along:
        return "slides"
    return "flies" if changes[0] < 0.2 * changes[1] else "unknown"


def reversals(values: Array) -> int:
    """How often values (n,), in any unit, turn back by more than a quarter of their range."""
    return len(turning_values(values))


def turning_values(values: Array) -> list[float]:
    """The extremes from which values (n,) turn back by more than a quarter of their range, in their unit."""
    least = SWING * np.ptp(values) if values.size else 0.0
    if not least > 0:
        return []
    found, way, extreme = [], 0.0, values[0]
    for value in values:
        if way == 0.0:
            way = np.sign(value - extreme) if abs(value - extreme) > least else 0.0
            extreme = value if way else extreme
        elif way * (value - extreme) > 0:
            extreme = value
        elif abs(value - extreme) > least:
            found.append(float(extreme))
            way, extreme = -way, value
    return found


def phenomenon_doubt(body: Trajectory, phenomenon: Phenomenon) -> Doubt | None:
    """A doubt where the path is clearly that of another phenomenon, which it names; None otherwise."""
    expected = SHAPES_OF.get(phenomenon.motion, ())
    if not expected or phenomenon.measures != "position" or phenomenon.bodies > 1:
        return None
    shape = shape_of(body)
    if shape in (*expected, "unknown"):
        return None
    does, name = WORDS[shape]
    return Doubt("phenomenon", f"the body {does}: this is no {phenomenon.name}", f"try --phenomenon {name}")
