"""A cup on a turning wooden arm, seen from above: phi'' + beta phi' + alpha phi = 0."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import FORCES, dry_friction, extra_acceleration
from iris_sysid.synthetic.motion import SceneMotion, integrate, moving
from iris_sysid.synthetic.props import BLACK, METAL, hand
from iris_sysid.synthetic.scene import Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.scenes._cup import DARK_RED, RED
from iris_sysid.synthetic.scenes._hanging import ball, hanging
from iris_sysid.synthetic.shapes import Colour, Layer, box, disc, rigid, static, still
from iris_sysid.types import Array, Parameter

WOOD: Colour = (176.0, 138.0, 92.0)
GRAIN: Colour = (142.0, 106.0, 68.0)
TABLE: Colour = (172.0, 172.0, 168.0)

PARAMETERS = (
    Parameter("stiffness", "1/s^2", r"\alpha", 0.0, 1e4, 0.1),
    Parameter("damping", "1/s", r"\beta", 0.0, 1e3, 0.05),
    Parameter("phi_0", "rad", r"\varphi_0", -1e3, 1e3, 2 * math.pi),
    Parameter("arm_length", "m", "", 0.02, 5.0, 0.24),
    Parameter("cup_radius", "m", "r", 0.002, 1.0, 0.045),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)


def stage(setup: Setup) -> Stage:
    """Turn the arm, hold the cup, and let it go; phi is the arm's angle from straight down, anticlockwise."""
    motion, arm, radius = _motion(setup), setup["arm_length"], setup["cup_radius"]
    phi = motion.state(0)
    centre = hanging(phi, lambda t_s: np.full(t_s.size, arm))
    hub = still(0.0, 0.0)
    reach = arm + radius + 0.1
    plank = box(0.0, -0.32 * arm, 0.07, 1.75 * arm)
    layers = [Layer(rigid(plank, hub, phi), WOOD)]
    if setup.look.shading:
        layers += [Layer(rigid(box(x, -0.3 * arm, 0.003, 1.6 * arm), hub, phi), GRAIN, 0.6) for x in (-0.02, 0.012)]
    layers += [Layer(disc(hub, 0.02), METAL), Layer(disc(hub, 0.007), BLACK)]
    layers += ball(centre, radius, RED, setup)
    if setup.look.shading:
        layers.append(Layer(disc(centre, 0.58 * radius), DARK_RED, 0.8))
    x, z = centre(np.array([-1.0]))[0]
    behind, before = hand(setup, (x, z), radius, math.atan2(-z, -x))
    return Stage(
        view=CameraView(-reach, reach, -reach, reach),
        wall=Wall(TABLE),
        props=_props(setup, reach),
        layers=(*behind, *layers, *before),
        bodies=(SceneBody("1", centre, radius, {"phi_rad": phi, "omega_rad_s": motion.state(1)}),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
    )


def _motion(setup: Setup) -> SceneMotion:
    effects, release = setup.effects, setup["release_time"]
    added, hold = extra_acceleration(effects), dry_friction(effects)
    drift, offset = effects.get("parameter-drift", 0.0), effects.get("zero-offset", 0.0)

    def pull(t: float, state: Array) -> float:
        phi, omega = state[0] - offset, state[1]
        base = -setup["stiffness"] * phi - setup["damping"] * omega
        return float(base * (1 + drift * (t - release)) + added(t, phi, omega))

    start = np.array([setup["phi_0"], effects.get("release-velocity", 0.0)])
    return integrate(moving(pull, hold, release, start), start, release, max(setup.duration_s, release) + 1.0)


def _props(setup: Setup, reach: float) -> tuple[Layer, ...]:
    if not setup.look.marks:
        return ()
    angles = np.arange(0, 360, 30)
    far = 0.93 * reach
    ticks: list[Array] = []
    for degrees in angles:
        turn = math.radians(degrees)
        ticks.append(box(far * math.sin(turn), -far * math.cos(turn), 0.004, 0.025, turn))
    return tuple(Layer(static(tick), BLACK) for tick in ticks)


SCENE = Scene(
    name="rotating-cone",
    summary="a cup on a turning wooden arm, seen from above",
    folder="Rotation",
    duration_s=8.0,
    parameters=PARAMETERS,
    settings={
        "slow": {"phi_0": math.pi, "damping": 0.03},
        "mid": {"phi_0": 2 * math.pi, "damping": 0.05},
        "fast": {"phi_0": 4 * math.pi, "damping": 0.08},
    },
    stage=stage,
    effects=FORCES,
    scatter={"phi_0": 0.03, "damping": 0.001, "release_time": 0.05},
    published={"stiffness": ("angular_stiffness", 1.0, "1/s^2"), "damping": ("angular_damping", 1.0, "1/s")},
)
