"""Recordings of bodies that coast: an electric car, a drum and a wheel, and a rocket after its burn.

Written from the README of ``../shared/data/world2`` before any of them was diagnosed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from iris_sysid import MODELS, OdeModel, Parameter, Quantity, Trajectory
from iris_sysid.types import Array
from validation.world_tables import DRAG, LOCAL_GRAVITY, QUADRATIC, WORLD2, ZERO, Recording, only, series

SPEED = Quantity("v", "m/s")
KM_H, FOOT_M = 1 / 3.6, 0.3048
UNEVEN_ROLLING = DRAG | ZERO | {"velocity-weakening-friction", "friction-change", "parameter-drift"}
FROM_ZERO = {"s_0": 0.0}  # the speed does not tell where a body is
APOGEE_S, BEFORE_S = 17.40, 0.5  # README: the highest row of the rocket; what is left out after the burn and before it


def rolling_rhs(t: float, state: tuple[float, float], params: tuple[float]) -> tuple[float, float]:
    """A constant resistance: v' = -a."""
    return state[1], -params[0]


def rolling_guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A line through all samples."""
    valid = trajectory.valid
    slope, start = np.polyfit(trajectory.t_s[valid] - trajectory.t_s[0], trajectory.position[valid, 0], 1)
    return {"rolling": -float(slope), "s_0": 0.0, "v_0": float(start)}


def speed(t_s: Array, states: Array, params: Array) -> Array:
    """What is read is the speed (n, 1), m/s, of the states (n, 2) at ``t_s`` (n,) s."""
    return states[:, 1:2]


COAST = OdeModel(
    name="coast-down",
    summary="a body that coasts against a constant resistance, and whose speed is measured",
    equation=r"\dot v = -a",
    source="Coulomb (1785)",
    states=(Quantity("s", "m"), SPEED),
    parameters=(Parameter("rolling", "m/s^2", "a", lower=-100.0, upper=100.0, default=0.1),),
    observed=(SPEED,),
    rhs=rolling_rhs,
    guess=rolling_guess,
    observe=speed,
)


def car_clip(name: str) -> Trajectory:
    """Speed over time; the rows without numbers at its end are left out."""
    table = np.genfromtxt(WORLD2 / "tab-ecar-coastdown" / name, delimiter=",")
    t_s, km_h = table[np.isfinite(table).all(axis=1)].T
    return series(t_s, km_h * KM_H, SPEED)


def falling_part(t_s: Array, values: Array) -> slice:
    """The samples after the last one above 97 % of the largest value, until the first below 10 %.

    The largest is that of the upper 2 %, as a counter shows too much now and then.
    """
    most = float(np.percentile(values, 98))
    start = int(np.flatnonzero(values > 0.97 * most)[-1]) + 1
    below = np.flatnonzero(values[start:] < 0.1 * most)
    return slice(start, start + int(below[0]) if below.size else values.size)


def drum_clip(name: str, column: int) -> Trajectory:
    """Speed of the surface, once a revolution; counts and the stated circumference make the file's rate km/h."""
    table = np.genfromtxt(WORLD2 / "tab-drum-coastdown" / f"Grandprix - {name} psi.csv", delimiter=",")
    fresh = np.concatenate([[True], np.diff(table[:, column]) != 0])
    t_s, rate = table[fresh, 0] / 1e6, table[fresh, column] * KM_H
    part = falling_part(t_s, rate)
    return series(t_s[part], rate[part], SPEED)


def rocket_clip() -> Trajectory:
    """Height from half a second after the burn until half a second before the top."""
    path = WORLD2 / "tab-rocket-ndrt" / "ndrt_2020_flight_data.csv"
    table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(0, 1, 3, 4))
    push = table[(table[:, 0] < APOGEE_S) & np.isfinite(table[:, :2]).all(axis=1)]
    burn = int(np.argmax(push[:, 1]))
    end_s = push[burn + int(np.argmax(push[burn:, 1] < 0)), 0]
    t_s, feet = table[np.isfinite(table[:, 2:]).all(axis=1), 2:].T
    coasts = (t_s > end_s + BEFORE_S) & (t_s < APOGEE_S - BEFORE_S)
    return series(t_s[coasts], feet[coasts] * FOOT_M, Quantity("z", "m"))


def car(number: int) -> Recording:
    """A row of the electric car."""
    return Recording(
        f"coast-ecar-{number}",
        "world2/README: rolling resistance, known air drag (0.52 per km by the stated constants), slope",
        "air drag, not in the model",
        COAST,
        only(partial(car_clip, f"rolling{number}.csv")),
        "unknown",
        DRAG,
        UNEVEN_ROLLING,
        fixed=FROM_ZERO,
    )


def drum(body: str, contact: str, pressure: int, column: int) -> Recording:
    """A row of the wheel on the drum."""
    return Recording(
        f"coast-{body}-{contact}-{pressure}",
        "world2/README: tyre rolling resistance where in contact, bearing and air drag",
        "drag, not in the model",
        COAST,
        only(partial(drum_clip, f"{contact.capitalize()} - Left - {pressure}", column)),
        "gauge",
        DRAG,
        UNEVEN_ROLLING,
        fixed=FROM_ZERO,
    )


COASTS = [
    car(1),
    car(2),
    *(drum("drum", contact, psi, 1) for contact in ("contact", "separate") for psi in (110, 120, 140)),
    *(drum("wheel", "separate", psi, 3) for psi in (110, 120, 140)),
    Recording(
        "coast-rocket",
        "world2/README: burn, coasting with quadratic drag, parachute",
        "quadratic drag",
        MODELS["free-fall"],
        only(rocket_clip),
        "gauge",
        QUADRATIC,
        DRAG,
        fixed=LOCAL_GRAVITY,
    ),
]
