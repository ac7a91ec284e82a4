"""Bodies on a line that strike one another: the first is launched, the others stand until they are hit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.starting_values import samples, start_of
from iris_sysid.types import Event, ModelExample, OdeModel, Parameter, Quantity, Trajectory

SETTLING = 1e-4  # of their speeds; a slower rebound is not one: the two go on together for this moment

Seven = tuple[float, float, float, float, float, float, float]


def rhs(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, ...]:
    """Give z_i'' = -damping_i z_i'; the first body has its own damping, as a ball that rolls among cups."""
    damping, rest = params[0], params[1]
    return state[3], state[4], state[5], -damping * state[3], -rest * state[4], -rest * state[5]


def first_gap(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Way from the first body to the second, beyond that at contact."""
    return state[1] - state[0] - params[4]


def second_gap(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Way from the second body to the third, beyond that at contact."""
    return state[2] - state[1] - params[5]


def first_impact(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> Seven:
    """Newton's restitution between the first and the second body."""
    z_1, z_2, z_3, v_1, v_2, v_3, _ = state
    restitution, light = params[2], params[3]
    closing = v_1 - v_2
    parts = restitution * closing > SETTLING * (abs(v_1) + abs(v_2))
    impulse = (1.0 + (restitution if parts else 0.0)) * closing / (1.0 + 1.0 / light)
    return z_1, z_2, z_3, v_1 - impulse, v_2 + impulse / light, v_3, 0.0


def second_impact(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> Seven:
    """Newton's restitution between the second and the third body, of equal masses."""
    z_1, z_2, z_3, v_1, v_2, v_3, _ = state
    restitution = params[2]
    closing = v_2 - v_3
    parts = restitution * closing > SETTLING * (abs(v_2) + abs(v_3))
    impulse = (1.0 + (restitution if parts else 0.0)) * closing / 2.0
    return z_1, z_2, z_3, v_1, v_2 - impulse, v_3 + impulse, 0.0


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the contacts where the bodies come nearest, and the damping from the straightness before and after."""
    columns = [samples(trajectory, f"z{k}") for k in (1, 2, 3)]
    t_s, (first, second, third) = columns[0][0], (values for _, values in columns)
    values = {
        "contact_12": float(np.min(second - first)),
        "contact_23": float(np.min(third - second)),
        "damping_1": 0.1,
        "damping": 0.1,
    }
    hit = max(int(np.argmin(second - first)), 6)
    for k, own in enumerate((first, second, third), start=1):
        start = start_of(t_s[:hit], own[:hit], np.inf, degree=1)
        values[f"z{k}_0"], values[f"v{k}_0"] = float(start[0]), float(start[1])
    return values


MODEL = OdeModel(
    name="impact-chain",
    summary="three bodies on a line, the first of another mass, that strike one another",
    equation=r"\ddot z_i + \zeta_i\,\dot z_i = 0,\quad \Delta\dot z^+ = -e\,\Delta\dot z^- \text{ where two touch}",
    source="Newton (1687), Principia, scholium to the laws; the impacts beside contact-chain's continuous coupling",
    states=(
        *(Quantity(f"z{k}", "m", f"z_{{{k}}}") for k in (1, 2, 3)),
        *(Quantity(f"v{k}", "m/s", f"v_{{{k}}}") for k in (1, 2, 3)),
    ),
    parameters=(
        Parameter("damping_1", "1/s", r"\zeta_1", lower=-1e2, upper=1e4, default=0.0, role="damping"),
        Parameter("damping", "1/s", r"\zeta", lower=-1e2, upper=1e4, default=0.0, role="damping"),
        Parameter("restitution", "1", "e", lower=0.0, upper=1.5, default=0.6),
        Parameter("mass_ratio", "1", "m_2/m_1", lower=1e-4, upper=1e4, default=0.3),
        Parameter("contact_12", "m", "d_{12}", default=0.0),
        Parameter("contact_23", "m", "d_{23}", default=0.0),
    ),
    observed=tuple(Quantity(f"z{k}", "m", f"z_{{{k}}}") for k in (1, 2, 3)),
    rhs=rhs,
    guess=guess,
    events=(Event("impact of 1 on 2", first_gap, first_impact), Event("impact of 2 on 3", second_gap, second_impact)),
    typical="restitution: steel on steel 0.9 to 0.95, wood on wood about 0.5, clay 0",
    example=ModelExample(
        {
            "damping_1": 0.4,
            "damping": 0.9,
            "restitution": 0.6,
            "mass_ratio": 0.3,
            "contact_12": 0.12,
            "contact_23": 0.1,
            "z1_0": -0.6,
            "z2_0": 0.0,
            "z3_0": 0.25,
            "v1_0": 1.5,
            "v2_0": 0.0,
            "v3_0": 0.02,
        },
        samples=300,
        rate_hz=150.0,
    ),
)
