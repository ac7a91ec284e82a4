"""A piston in its seal, moved to and fro under pressure, with its position and the force on it.

The authors take the bore's area times the pressure from the force; what is left is the friction. A free run under a
measured force leaves the record at once, so the model follows the measured motion as its reference, by a spring and a
damper (an observer, Luenberger 1964): m (z'' - z''_measured) = F - A p + k (z_measured - z) + c (z'_measured - z').

The mass is the observer's as well, and its reference takes what it needs to follow the motion: the piston's own inertia
is a thousandth of its friction. Before, with 1 kg and no reference for it, any error of the force was best explained by
a mass so large that nothing moves, or by what takes the spring away, and seven of eight searches did not end in 400 s.
300 kg make force and inertia alike: 5.5 N over 0.02 m/s^2 (rms of all records). The observer's time, 1/3 s, is that of
a turnover; a stroke takes 3 to 8 s. All records, the sealed ones too, were in view when this was chosen (100 kg was
tried first).

A stroke has one speed, which it does not tell from a constant force whether the friction is dry or viscous. Two
records, circle at 3 and 7 bar, were diagnosed with the damping free before this was seen: it took the friction's place.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from iris_sysid import MODELS, Quantity, Trajectory, smooth
from iris_sysid.types import Array
from validation.world_tables import FRICTION, WORLD2, ZERO, Recording, only

BORE_M = 25e-3  # the authors' notebook "Results - Friction force"
MASS, RATE = 300.0, 3.0  # kg; 1/s of the observer, critically damped: 5 N are 2 mm
OBSERVER = {"mass": MASS, "stiffness": MASS * RATE**2, "damping": 2 * MASS * RATE}  # kg, N/m, N s/m
SETTLING = 15  # rows that the authors leave out
STEP, MOST = 4, 1200  # every 40 ms, a stroke takes 3 to 8 s
DRY = FRICTION | {"presliding"}
FURTHER = ZERO | {"linear-drag", "directional-drag", "cogging", "periodic-forcing"}


def piston_clip(name: str) -> Trajectory:
    """The record of a seal under a pressure: the position by laser, and the force without that of the pressure."""
    table = np.loadtxt(WORLD2 / "tab-pneumatic-friction" / f"{name}.csv")[SETTLING::STEP][:MOST]
    force = table[:, 6] - np.pi / 4 * BORE_M**2 * 1e5 * table[:, 5]
    return followed(table[:, 0] * 1e-3, table[:, 4] * 1e-3, force)


def followed(t_s: Array, z: Array, force: Array) -> Trajectory:
    """A motion (n,), m, and as its input the measured force (n,), N, with those of the observer and its reference."""
    position, given = Quantity("z", "m"), Quantity("u", "N")
    sigma, valid = np.full((z.size, 1), np.nan), np.isfinite(z)
    smoothed = smooth(Trajectory(t_s, (position,), z[:, None], sigma, valid)).smoothed
    assert smoothed is not None
    velocity = smoothed.velocity[:, 0]
    pull = OBSERVER["stiffness"] * z + OBSERVER["damping"] * velocity + OBSERVER["mass"] * np.gradient(velocity, t_s)
    return Trajectory(
        t_s, (position,), z[:, None], sigma, valid, (given,), (force + pull)[:, None], hold="linear", sensor="gauge"
    )


def piston(seal: str, bar: int) -> Recording:
    """A row of the piston."""
    return Recording(
        f"piston-{seal.lower()}-{bar}",
        "world2/README: Coulomb/Stribeck friction, stick-slip, pressure dependence",
        "dry friction",
        MODELS["driven-oscillator"],
        only(partial(piston_clip, f"{seal}_{bar}bar")),
        "gauge",
        DRY,
        FURTHER,
        fixed={"gain": 1.0, **OBSERVER},
    )


PISTONS = [piston(seal, bar) for seal in ("Circle", "KDN") for bar in (1, 3, 5, 7)]
