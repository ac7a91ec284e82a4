"""A ball on a cord that may hang slack: it flies until the cord jerks taut, and swings until the cord slackens."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY
from fitters.models._reading import PLANE, PLANE_STATES
from fitters.starting_values import samples, start_of
from iris_sysid.types import Event, ModelExample, OdeModel, Parameter, Trajectory

TAUT = 1.0  # mode; 0 is slack
SLACK_BELOW = 0.97  # of the length from the pivot: nearer, the cord is surely slack
SETTLING_S = 1e-4  # of fall make a rebound along the cord so slow that it stays taut

Four = tuple[float, float, float, float]


def rhs(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> Four:
    """Give free flight while the cord is slack, and its tension towards the pivot while it is taut; z upwards."""
    x, z, vx, vz, mode = state
    length, _, pivot_x, pivot_z, damping, gravity = params
    if mode == TAUT:
        across, up = x - pivot_x, z - pivot_z
        pull = (vx * vx + vz * vz - gravity * up) / (length * length)
        return vx, vz, -damping * vx - pull * across, -damping * vz - gravity - pull * up
    return vx, vz, -damping * vx, -damping * vz - gravity


def slackness(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Length of the cord less the distance from the pivot, m."""
    return 1.0 if state[4] == TAUT else params[0] - np.hypot(state[0] - params[2], state[1] - params[3])


def jerk(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """The cord takes the speed along it, or throws some of it back."""
    x, z, vx, vz, _ = state
    length, restitution, pivot_x, pivot_z, _, gravity = params
    across, up = (x - pivot_x) / length, (z - pivot_z) / length
    outward = vx * across + vz * up
    if outward < 0.0:  # it starts farther away than the cord is long, and comes nearer
        return x, z, vx, vz, 0.0
    after = -restitution * outward if restitution * outward > SETTLING_S * gravity else 0.0
    vx, vz = vx + (after - outward) * across, vz + (after - outward) * up
    pulled = vx * vx + vz * vz - gravity * length * up > 0.0
    return x, z, vx, vz, TAUT if after == 0.0 and pulled else 0.0


def tension(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Tension per mass times length, m^2/s^2."""
    if state[4] != TAUT:
        return 1.0
    return state[2] ** 2 + state[3] ** 2 - params[5] * (state[1] - params[3])


def slacken(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    """Let go without a jump."""
    return state[0], state[1], state[2], state[3], 0.0


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the length from the farthest samples, the pivot from the circle through the lower half of the motion."""
    t_s, x = samples(trajectory, "x")
    _, z = samples(trajectory, "z")
    low = z <= np.median(z)
    design = np.column_stack([x[low], z[low], np.ones(int(low.sum()))])
    (a, b, c), *_ = np.linalg.lstsq(design, -(x[low] ** 2 + z[low] ** 2), rcond=None)  # x^2 + z^2 + a x + b z + c = 0
    length = float(np.sqrt(max(a * a / 4 + b * b / 4 - c, 1e-6)))
    slack = np.hypot(x + a / 2, z + b / 2) < SLACK_BELOW * length
    flight = slice(0, max(int(np.argmin(slack)) if not slack.all() else t_s.size, 6))
    across, along = (start_of(t_s[flight], column[flight], np.inf, degree=2) for column in (x, z))
    return {
        "length": length,
        "pivot_x": -a / 2,
        "pivot_z": -b / 2,
        "x_0": float(across[0]),
        "z_0": float(along[0]),
        "vx_0": float(across[1]),
        "vz_0": float(along[1]),
    }


MODEL = OdeModel(
    name="slack-cord",
    summary="a ball on a cord, in free flight while the cord is slack, swinging while it is taut",
    equation=(
        r"\ddot{\mathbf{r}} = \mathbf{g} - \zeta\,\dot{\mathbf{r}} - T\,\mathbf{r},\quad T \geq 0,"
        r"\; |\mathbf{r}| \leq L,\; T\,(L - |\mathbf{r}|) = 0,"
        r"\quad \dot r^+ = -e\,\dot r^- \text{ where } |\mathbf{r}| = L"
    ),
    source="Moreau (1988), Unilateral contact and dry friction, section 2, for the inextensible cord",
    states=PLANE_STATES,
    parameters=(
        Parameter("length", "m", "L", lower=1e-3, upper=1e5),
        Parameter(
            "restitution", "1", "e", lower=0.0, upper=1.5, default=0.0, constant=True,
            source="a cord that does not spring back unless it is freed",
        ),
        Parameter("pivot_x", "m", "x_p", role="pivot"),
        Parameter("pivot_z", "m", "z_p", role="pivot"),
        Parameter("damping", "1/s", r"\zeta", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        GRAVITY,
    ),
    observed=PLANE,
    rhs=rhs,
    guess=guess,
    events=(Event("taut", slackness, jerk), Event("slack", tension, slacken)),
    typical="restitution: 0 of a cord that gives, up to 0.5 of a stiff one",
    example=ModelExample(
        {
            "length": 0.5, "pivot_x": 0.1, "pivot_z": 0.7, "damping": 0.1, "x_0": 0.52, "z_0": 0.72,
            "vx_0": -0.1, "vz_0": 0.0,
        },
        samples=400,
        rate_hz=80.0,
    ),
)  # fmt: skip
