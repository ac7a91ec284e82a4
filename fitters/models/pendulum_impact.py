"""Two pendulums that strike one another, as solid balls do: impacts with restitution, and lasting contact."""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numba.extending import register_jitable

from fitters.models._gravity import GRAVITY, STANDARD_GRAVITY
from fitters.models._impacts import between_contacts, pieces_regression
from fitters.models._pendulum import PAIR_STATES
from fitters.models._reading import shifted
from fitters.starting_values import samples, start_of
from iris_sysid.types import Event, ModelExample, OdeModel, Parameter, Quantity, Trajectory

SETTLING_S = 1e-4  # of fall make a rebound too slow to part them: they stay together until they are pulled apart

Four = tuple[float, float, float, float]


@register_jitable
def meeting(state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """Gap between the balls (m), its slopes by the angles, and the way from ball 1 to ball 2, as a unit vector.

    The gap is negative where they overlap, and stays so where they would have passed through one another.
    """
    length_1, length_2, contact, apart = params[0], params[1], params[6], params[7]
    sin_1, cos_1, sin_2, cos_2 = np.sin(state[0]), np.cos(state[0]), np.sin(state[1]), np.cos(state[1])
    across = length_1 * apart + length_2 * sin_2 - length_1 * sin_1
    up = length_1 * cos_1 - length_2 * cos_2
    distance = np.sqrt(across * across + up * up)
    middle = (state[0] + state[1]) / 2
    side = across * np.cos(middle) + up * np.sin(middle)
    away = distance if side >= 0 else -distance
    n_x, n_z = across / away, up / away
    slope_1, slope_2 = -length_1 * (cos_1 * n_x + sin_1 * n_z), length_2 * (cos_2 * n_x + sin_2 * n_z)
    return away - length_1 * contact, slope_1, slope_2, n_x, n_z


@register_jitable
def swinging(state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float]:
    """Give the angular accelerations of the two without contact."""
    length_1, length_2, damping_1, damping_2, gravity = params[0], params[1], params[2], params[3], params[8]
    return (
        -damping_1 * state[2] - gravity / length_1 * np.sin(state[0]),
        -damping_2 * state[3] - gravity / length_2 * np.sin(state[1]),
    )


@register_jitable
def pressed(state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float]:
    """Force that keeps the gap closed, per mass of ball 1, and the angular accelerations by a unit of it."""
    length_1, length_2, mass = params[0], params[1], params[5]
    gap, slope_1, slope_2, n_x, n_z = meeting(state, params)
    free_1, free_2 = swinging(state, params)
    sin_1, cos_1, sin_2, cos_2 = np.sin(state[0]), np.cos(state[0]), np.sin(state[1]), np.cos(state[1])
    v_x = length_2 * cos_2 * state[3] - length_1 * cos_1 * state[2]
    v_z = length_2 * sin_2 * state[3] - length_1 * sin_1 * state[2]
    bend_1 = length_1 * (n_x * sin_1 - n_z * cos_1) * state[2] ** 2
    bend_2 = length_2 * (n_z * cos_2 - n_x * sin_2) * state[3] ** 2
    turning = (v_x * n_z - v_z * n_x) ** 2 / (gap + length_1 * params[6])
    push_1, push_2 = slope_1 / length_1**2, slope_2 / (mass * length_2**2)
    closing = slope_1 * free_1 + slope_2 * free_2 + bend_1 + bend_2 + turning
    return -closing / (slope_1 * push_1 + slope_2 * push_2), push_1, push_2


def rhs(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> Four:
    """Give theta_i'' = -damping_i theta_i' - (gravity / length_i) sin theta_i, with the force of a lasting contact."""
    first, second = swinging(state, params)
    if state[4] == 1.0:
        force, push_1, push_2 = pressed(state, params)
        return state[2], state[3], first + force * push_1, second + force * push_2
    return state[2], state[3], first, second


def gap(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Distance between the surfaces, m."""
    return 1.0 if state[4] == 1.0 else meeting(state, params)[0]


def bounce(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """Newton's restitution along the line of centres; too slow a rebound leaves the balls together."""
    _, slope_1, slope_2, _, _ = meeting(state, params)
    push_1, push_2 = slope_1 / params[0] ** 2, slope_2 / (params[5] * params[1] ** 2)
    opening = slope_1 * state[2] + slope_2 * state[3]
    if opening >= 0.0:  # they overlap at the start and move apart
        return state[0], state[1], state[2], state[3], 0.0
    impulse = -opening / (slope_1 * push_1 + slope_2 * push_2)
    if -params[4] * opening >= SETTLING_S * params[8]:
        impulse *= 1.0 + params[4]
    omega_1, omega_2 = state[2] + impulse * push_1, state[3] + impulse * push_2
    settled = (state[0], state[1], omega_1, omega_2, 1.0)
    if -params[4] * opening >= SETTLING_S * params[8] or pressed(settled, params)[0] <= 0.0:
        return state[0], state[1], omega_1, omega_2, 0.0
    return settled


def hold(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Force between balls that lie against one another, per mass of ball 1."""
    return pressed(state, params)[0] if state[4] == 1.0 else 1.0


def part(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """Let go without a jump."""
    return state[0], state[1], state[2], state[3], 0.0


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take each pendulum between the contacts alone; the contacts are where the angles come nearest."""
    t_s, theta_1 = samples(trajectory, "theta1")
    _, theta_2 = samples(trajectory, "theta2")
    nearest, stretches = between_contacts(theta_2 - theta_1)
    values: dict[str, float] = {}
    for body, own in (("1", theta_1), ("2", theta_2)):
        pieces = [(t_s[stretch], own[stretch], -np.sin(own[stretch])[:, None]) for stretch in stretches]
        (stiffness, friction), half_width_s = pieces_regression(pieces)
        if not stiffness > 0:  # e.g. barely moving: take the clip for a quarter of a period
            stiffness, friction = (np.pi / 2 / (t_s[-1] - t_s[0])) ** 2, 0.0
        start = start_of(*pieces[0][:2], min(half_width_s, 0.5 / np.sqrt(stiffness)), degree=2)
        values[f"length_{body}"] = STANDARD_GRAVITY / float(stiffness)
        values[f"damping_{body}"] = float(np.clip(-friction, 0.0, 1.0))
        values[f"theta{body}_0"], values[f"omega{body}_0"] = float(start[0]), float(start[1])
    peaks = np.array([np.max((theta_2 - theta_1)[stretch]) for stretch in stretches]) - nearest
    ratios = peaks[2:] / peaks[1:-1] if peaks.size > 2 else np.array([0.8])
    apart = trajectory.geometry.get("pivot_ratio")
    ratio = values["length_2"] / values["length_1"]
    across = ratio * np.sin(theta_2) - np.sin(theta_1) + (apart.value if apart is not None else 0.0)
    contact = np.min(np.hypot(across, ratio * np.cos(theta_2) - np.cos(theta_1)))
    return {
        **values,
        "restitution": float(np.clip(np.median(ratios), 0.1, 0.95)),
        "contact_ratio": float(np.clip(contact, 1e-4, 1.5)),
    }


def distance(values: Mapping[str, float]) -> Mapping[str, float]:
    """Distance of the balls' centres when they touch: the sum of their radii."""
    return {"contact_distance": values["contact_ratio"] * values["length_1"]}


def _vertical(body: int) -> Parameter:
    return Parameter(
        f"vertical_{body}", "rad", rf"\theta_{{v,{body}}}", lower=-0.7, upper=0.7, default=0.0, constant=True,
        source="angle at rest: 0 where angles are measured from the true vertical", role="vertical",
    )  # fmt: skip


MODEL = OdeModel(
    name="pendulum-impact",
    summary="two pendulums whose balls strike one another, and may stay together for a while",
    equation=(
        r"\ddot\theta_i + \zeta_i\,\dot\theta_i + \frac{g}{L_i}\,\sin\theta_i = 0,\quad"
        r"\dot d^+ = -e\,\dot d^- \text{ where } d = 0"
    ),
    source="Newton (1687), Principia, scholium to the laws, on colliding pendulums; contact as in Moreau (1988)",
    states=PAIR_STATES,
    parameters=(
        Parameter("length_1", "m", "L_1", lower=1e-3, upper=200.0),
        Parameter("length_2", "m", "L_2", lower=1e-3, upper=200.0),
        Parameter("damping_1", "1/s", r"\zeta_1", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        Parameter("damping_2", "1/s", r"\zeta_2", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        Parameter("restitution", "1", "e", lower=0.0, upper=1.5, default=0.8),
        Parameter("mass_ratio", "1", "m_2/m_1", lower=1e-3, upper=1e3, default=1.0),
        Parameter("contact_ratio", "1", "(r_1 + r_2)/L_1", lower=0.0, upper=2.0, default=0.1),
        Parameter(
            "pivot_ratio", "1", "p/L_1", lower=-2.0, upper=2.0, default=0.0, constant=True,
            source="distance of the pivots over the first length: 0 where both hang from one point",
        ),
        GRAVITY,
        _vertical(1),
        _vertical(2),
    ),
    observed=PAIR_STATES[:2],
    rhs=rhs,
    guess=guess,
    observe=partial(shifted, 2, 9),
    derived=(Quantity("contact_distance", "m", "r_1 + r_2"),),
    derive=distance,
    events=(Event("impact", gap, bounce), Event("parting", hold, part)),
    typical="restitution: steel on steel 0.9 to 0.95, wood on wood about 0.5",
    example=ModelExample(
        {
            "length_1": 0.5, "length_2": 0.45, "damping_1": 0.1, "damping_2": 0.15, "restitution": 0.8,
            "mass_ratio": 0.7, "contact_ratio": 0.12, "theta1_0": -1.0, "theta2_0": 0.6, "omega1_0": 0.1,
            "omega2_0": 0.2,
        },
        samples=400,
        rate_hz=80.0,
    ),
)  # fmt: skip
