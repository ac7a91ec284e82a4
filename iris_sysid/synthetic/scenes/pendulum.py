"""A ball on a cord, held, let go, swinging: theta'' + zeta theta' + (g/L) sin theta = 0."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import FORCES, dry_friction, effect_within, extra_acceleration
from iris_sysid.synthetic.motion import Phase, SceneEvent, SceneMotion, integrate, moving
from iris_sysid.synthetic.props import clamp, tape
from iris_sysid.synthetic.scene import Scene, SceneBody, Setup, Stage, Wall, exactly, stated
from iris_sysid.synthetic.scenes._hanging import ball, cord, hanging, holding_hand, seams
from iris_sysid.synthetic.shapes import Colour, Layer, Path
from iris_sysid.types import Array, Parameter

BALL: Colour = (176.0, 204.0, 32.0)
SEAM: Colour = (96.0, 116.0, 24.0)
CORD_WIDTH_M = 0.0028
CORD_GAP_M = 0.010  # the cord is doubled: a loop through the clamp
PIVOT = (0.0, 0.0)

PARAMETERS = (
    Parameter("length", "m", "L", 0.01, 100.0, 0.5),
    Parameter("damping", "1/s", r"\zeta", 0.0, 100.0, 0.06),
    Parameter("gravity", "m/s^2", "g", 0.01, 1000.0, 9.80665),
    Parameter("theta_0", "rad", r"\theta_0", -math.pi, math.pi, -math.pi / 4),
    Parameter("ball_radius", "m", "r", 1e-4, 1.0, 0.0335),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)


def stage(setup: Setup) -> Stage:
    """Put up the clamp, the ball and the hand, and let the ball go."""
    radius, bob = setup["ball_radius"], effect_within(setup.effects, "finite-bob", 0.0, 10.0)
    reach = setup["length"] + bob  # pivot to the ball's centre
    dynamic = reach + 0.4 * bob**2 / reach  # a solid ball's own inertia
    motion = _motion(setup, reach, dynamic)
    centre = hanging(motion.state(0), motion.state(2), PIVOT)
    side = reach + radius + 0.06
    view = CameraView(-side, side, 0.01 - side, 0.057 if abs(setup["theta_0"]) < 1.7 else side)
    return Stage(
        view=view,
        wall=Wall(glossy=True),
        props=_props(setup, view),
        layers=_layers(setup, motion, centre, reach),
        bodies=(SceneBody("1", centre, radius, {"theta_rad": motion.state(0), "omega_rad_s": motion.state(1)}),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
        hidden={"length": exactly(dynamic, "m"), "centre_distance": exactly(reach, "m")},
    )


def _motion(setup: Setup, reach: float, dynamic: float) -> SceneMotion:
    """States theta, omega, distance from the pivot and its rate (which change only while the cord is slack)."""
    effects, gravity, release = setup.effects, setup["gravity"], setup["release_time"]
    added, drift = extra_acceleration(effects), effects.get("parameter-drift", 0.0)
    offset, hold = effects.get("zero-offset", 0.0), dry_friction(effects)

    def taut(t: float, state: Array) -> float:
        theta, omega = state[0] - offset, state[1]
        base = -setup["damping"] * omega - gravity / dynamic * math.sin(theta)
        return base * (1 + drift * (t - release)) + added(t, theta, omega)

    def straight(t: float, state: Array) -> tuple[Array, Phase]:
        state = np.array([state[0], state[1], reach, 0.0])  # the jerk takes the speed along the cord
        return state, moving(taut, hold, t, state, others=_no_change)

    slack = effect_within(effects, "slack-tether", 0.0, 0.9 * reach)
    start = np.array([setup["theta_0"], effects.get("release-velocity", 0.0), reach - slack, 0.0])
    first = Phase("motion", _falling(gravity, offset), (SceneEvent("taut", lambda t, y: y[2] - reach, 1.0, straight),))
    if not slack:
        first = moving(taut, hold, release, start, others=_no_change)
    return integrate(first, start, release, max(setup.duration_s, release) + 1.0)


def _no_change(t: float, state: Array) -> Array:
    del t, state
    return np.zeros(2)


def _falling(gravity: float, offset: float) -> Callable[[float, Array], Array]:
    """Free fall in polar coordinates about the pivot, while the cord is slack."""

    def rate(t: float, state: Array) -> Array:
        del t
        theta, omega, distance, speed = state
        down, across = gravity * math.cos(theta - offset), gravity * math.sin(theta - offset)
        return np.array([omega, (-across - 2 * speed * omega) / distance, speed, distance * omega**2 + down])

    return rate


def _props(setup: Setup, view: CameraView) -> tuple[Layer, ...]:
    marks = tape([(-0.36, -0.40), (-0.20, -0.53), (0.36, -0.40), (0.22, -0.52)]) if setup.look.marks else []
    stand = clamp(0.0, 0.0, view.top + 0.05) if setup.look.clamp else []
    return (*marks, *stand)


def _layers(setup: Setup, motion: SceneMotion, centre: Path, reach: float) -> tuple[Layer, ...]:
    radius = setup["ball_radius"]
    behind, before = holding_hand(centre, PIVOT, radius, setup)
    gaps = (-CORD_GAP_M / 2, CORD_GAP_M / 2) if setup.look.cord else ()
    cords = [cord(centre, PIVOT, reach, CORD_WIDTH_M, gap) for gap in gaps]
    markings = seams(centre, radius, motion.state(0), SEAM) if setup.look.shading else []
    return (*behind, *cords, *ball(centre, radius, BALL, setup), *markings, *before)


SCENE = Scene(
    name="pendulum",
    summary="a ball on a cord, released at an angle",
    folder="Pendulum",
    duration_s=150.0,
    parameters=PARAMETERS,
    settings={
        "pendulum_20": {"theta_0": -math.radians(20)},
        "pendulum_45": {"theta_0": -math.radians(45)},
        "pendulum_90": {"theta_0": -math.radians(90)},
    },
    stage=stage,
    effects={
        **FORCES,
        "finite-bob": "the bob's centre hangs its radius c below the cord's end, a solid ball; m",
        "slack-tether": "the bob is held c nearer to the pivot than the cord allows; m",
    },
    scatter={"theta_0": 0.004, "damping": 0.002, "release_time": 0.05},
    published={
        "length": ("rope_length", 1.0, "m"),
        "damping": ("damping", 1.0, "1/s"),
        "theta_0": ("release_angle", 180 / math.pi, "deg"),
    },
)
