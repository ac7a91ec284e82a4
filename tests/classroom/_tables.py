"""A class of tables of x and z, five of them with a fault."""

import numpy as np

from tests._motions import on_arc, pendulum_angle

RATES_HZ = (30, 60, 120)
FAULTS = {"group3": "scale", "group5": "wrong-body", "group7": "tilt", "group10": "constant", "group12": "clock"}
SECONDS = 4.0


def write_class(folder, count=12, seed=0, faults=FAULTS):
    """Tables ``group1.csv`` to that of ``count``, half a metre of cord give or take 2 mm, and ``groups.csv``."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(1, count + 1):
        name = f"group{k}"
        t_s, position = _recorded(faults.get(name), rng)
        write_table(folder / f"{name}.csv", t_s, position + 5e-4 * rng.standard_normal(position.shape))
    stated = [f"{name},gravity=1.62" for name, fault in faults.items() if fault == "constant"]
    if stated:
        (folder / "groups.csv").write_text("\n".join(["group,set", *stated]) + "\n")


def write_table(path, t_s, position):
    rows = [f"{t:.6f},{x:.6f},{z:.6f}" for t, (x, z) in zip(t_s, position, strict=True)]
    path.write_text("\n".join(["t_s,x_m,z_m", *rows]) + "\n")


def _recorded(fault, rng):
    """Times (n,) s and positions (n, 2) m of one group."""
    length, rate = 0.5 + 0.002 * rng.standard_normal(), rng.choice(RATES_HZ)
    rate = 240 if fault == "clock" else rate
    t_s = np.arange(0, SECONDS, 1 / rate)
    theta = pendulum_angle(t_s, rng.uniform(0.15, 0.35), length, rng.uniform(0.02, 0.06))
    theta = theta + np.radians(8.0 if fault == "tilt" else 0.7 * rng.standard_normal())
    if fault == "wrong-body":  # a hand that follows the swing as hands do
        theta = 0.15 * np.sin(3.3 * t_s) + 0.05 * np.cumsum(rng.standard_normal(t_s.size)) / np.sqrt(rate)
    scale = 1.5 if fault == "scale" else 1 + 0.01 * rng.standard_normal()
    return t_s * (8 if fault == "clock" else 1), on_arc(theta, length * scale)
