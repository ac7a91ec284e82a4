"""A ball that falls and is thrown back by a floor, again and again, until it lies still."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from fitters.models._gravity import GRAVITY, MAGNIFICATION
from fitters.models._impacts import bounces
from fitters.models._reading import magnified
from fitters.starting_values import samples
from iris_sysid.types import Event, ModelExample, OdeModel, Parameter, Quantity, Trajectory

SETTLING_S = 1e-4  # of fall make a rebound so slow that the ball stays on the floor: it would rise by 50 nm


def rhs(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float]:
    """Give z'' = -gravity - damping z' in the air, z upwards, and nothing on the floor."""
    _, vz, on_floor = state
    _, _, damping, gravity, _ = params
    if on_floor == 1.0:
        return 0.0, 0.0
    return vz, -gravity - damping * vz


def height(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Height of the centre above where it is when the ball touches the floor."""
    return 1.0 if state[2] == 1.0 else state[0] - params[1]


def bounce(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float]:
    """Newton's restitution; too slow a rebound leaves the ball on the floor."""
    up = -params[0] * state[1]
    if state[1] > 0.0:  # it starts below the floor and rises
        return state[0], state[1], 0.0
    if up < SETTLING_S * params[3]:
        return state[0], 0.0, 1.0
    return state[0], up, 0.0


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the floor where the height is least, and the restitution from the heights of successive flights."""
    return bounces(*samples(trajectory, "z"))[0]


MODEL = OdeModel(
    name="bouncing-ball",
    summary="a ball that falls on a floor and bounces, each time more slowly, until it lies still",
    equation=r"\ddot z = -g - \beta\,\dot z,\quad \dot z^+ = -e\,\dot z^- \text{ where } z = z_f",
    source="Newton (1687), Principia, scholium to the laws; Halliday, Resnick and Walker, Fundamentals, section 9-8",
    states=(Quantity("z", "m", "z"), Quantity("vz", "m/s", "v_z")),
    parameters=(
        Parameter("restitution", "1", "e", lower=0.0, upper=1.5, default=0.8),
        Parameter("floor", "m", "z_f", default=0.0),
        Parameter(
            "damping", "1/s", r"\beta", lower=-10.0, upper=100.0, default=0.0, constant=True,
            source="no drag unless it is freed", role="damping",
        ),
        GRAVITY,
        MAGNIFICATION,
    ),
    observed=(Quantity("z", "m", "z"),),
    rhs=rhs,
    guess=guess,
    observe=partial(magnified, 1, 4),
    events=(Event("impact", height, bounce),),
    typical="restitution by the rules of the sport: table-tennis ball 0.89 to 0.92, tennis ball 0.73 to 0.76",
    example=ModelExample({"restitution": 0.8, "floor": 0.03, "z_0": 1.0, "vz_0": -0.2}, samples=400, rate_hz=100.0),
)  # fmt: skip
