"""A piston in its seal, moved to and fro under pressure, with its position and the force on it.

The authors take the bore's area times the pressure from the force; what is left is the friction. A free run under a
measured force leaves the record at once, so the piston is an observer's (Luenberger 1964), whose gains are a spring and
a damper from the measured motion to the model's: m z'' = F - A p + k (z_measured - z) + c (z'_measured - z'). A stroke
has one speed, which it does not tell from a constant force whether the friction is dry or viscous. Two records, circle
at 3 and 7 bar, were diagnosed with the damping free before this was seen: it took the friction's place.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from iris_sysid import MODELS, Quantity, Trajectory
from validation.world_tables import FRICTION, WORLD2, ZERO, Recording, only

BORE_M = 25e-3  # the authors' notebook "Results - Friction force"
OBSERVER = {"mass": 1.0, "stiffness": 1e3, "damping": 63.0}  # kg, N/m, N s/m: critical damping, 5 N are 5 mm
SETTLING = 15  # rows that the authors leave out
STEP, MOST = 4, 1200  # every 40 ms, a stroke takes 3 to 8 s
DRY = FRICTION | {"presliding"}
FURTHER = ZERO | {"linear-drag", "directional-drag", "cogging", "periodic-forcing"}


def piston_clip(name: str) -> Trajectory:
    """Position (m) by laser, and the net force with the observer's (N)."""
    table = np.loadtxt(WORLD2 / "tab-pneumatic-friction" / f"{name}.csv")[SETTLING::STEP][:MOST]
    t_s, z = table[:, 0] * 1e-3, table[:, 4] * 1e-3
    friction = table[:, 6] - np.pi / 4 * BORE_M**2 * 1e5 * table[:, 5]
    given = friction + OBSERVER["stiffness"] * z + OBSERVER["damping"] * np.gradient(z, t_s)
    position, force = Quantity("z", "m"), Quantity("u", "N")
    sigma, valid = np.full((z.size, 1), np.nan), np.isfinite(z)
    return Trajectory(t_s, (position,), z[:, None], sigma, valid, (force,), given[:, None], hold="linear")


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
