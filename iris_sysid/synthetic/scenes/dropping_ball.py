"""A ball let go at a height, seen from the side: z'' = -g, then bounces."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import FORCES, extra_acceleration
from iris_sysid.synthetic.motion import SceneMotion, bouncing, integrate
from iris_sysid.synthetic.props import BEIGE, floor, hand, tape
from iris_sysid.synthetic.scene import Curve, Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.scenes._hanging import ball, constant, seams
from iris_sysid.synthetic.shapes import Colour, Layer, Path
from iris_sysid.types import Array, Parameter

BALL: Colour = (222.0, 112.0, 38.0)
SEAM: Colour = (150.0, 70.0, 30.0)
ASIDE_M = -0.15  # where it falls, from the middle of the image
EFFECTS = ("linear-drag", "quadratic-drag", "constant-force", "release-velocity", "zero-offset", "parameter-drift")

PARAMETERS = (
    Parameter("height", "m", "h_0", 0.01, 100.0, 1.0),
    Parameter("gravity", "m/s^2", "g", 0.01, 1000.0, 9.80665),
    Parameter("damping", "1/s", r"\beta", 0.0, 100.0, 0.0),
    Parameter("restitution", "1", "e", 0.0, 1.0, 0.72),
    Parameter("ball_radius", "m", "r", 1e-4, 1.0, 0.0335),
    Parameter("distance", "m", "d", 0.1, 100.0, 1.94),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)


def stage(setup: Setup) -> Stage:
    """Hold the ball so that it has its height to fall until it touches the floor, and let it go."""
    radius, height = setup["ball_radius"], setup["height"]
    motion = _motion(setup)
    z = motion.state(0)

    def centre(t_s: Array) -> Array:
        return np.stack([np.full(t_s.size, ASIDE_M), z(t_s)], axis=-1)

    tall = max(height, 1.5) + 2 * radius  # one camera position for all heights of the benchmark
    view = CameraView(-0.6 * tall, 0.6 * tall, -0.12, tall + 0.1, distance_m=setup["distance"])
    return Stage(
        view=view,
        wall=Wall(BEIGE),
        props=_props(setup, view),
        layers=_layers(setup, centre),
        bodies=(SceneBody("1", centre, radius, {"height_m": z, "velocity_m_s": motion.state(1)}),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
    )


def _motion(setup: Setup) -> SceneMotion:
    effects, gravity, release = setup.effects, setup["gravity"], setup["release_time"]
    added, drift = extra_acceleration(effects), effects.get("parameter-drift", 0.0)

    def fall(t: float, state: Array) -> float:
        base = -gravity - setup["damping"] * state[1]
        return float(base * (1 + drift * (t - release)) + added(t, state[0], state[1]))

    lowest = setup["ball_radius"]
    start = lowest + setup["height"] + effects.get("zero-offset", 0.0)
    phase = bouncing(fall, lowest, setup["restitution"], gravity)
    stop = max(setup.duration_s, release) + 1.0
    return integrate(phase, np.array([start, effects.get("release-velocity", 0.0)]), release, stop)


def _props(setup: Setup, view: CameraView) -> tuple[Layer, ...]:
    marks = [(0.32, 0.5 * k) for k in range(1, 4)] if setup.look.marks else []
    return (*floor(0.0, 3 * view.left, 3 * view.right, -1.0), *tape(marks, 0.05, 0.012))


def _layers(setup: Setup, centre: Path) -> tuple[Layer, ...]:
    radius = setup["ball_radius"]
    behind, before = hand(setup, centre(np.array([-1.0]))[0], radius, math.pi)
    still: Curve = constant(0.3)
    markings = seams(centre, radius, still, SEAM) if setup.look.shading else []
    return (*behind, *ball(centre, radius, BALL, setup), *markings, *before)


SCENE = Scene(
    name="dropping-ball",
    summary="a ball let go at a height, seen from the side",
    folder="Dropping_ball",
    duration_s=5.0,
    parameters=PARAMETERS,
    settings={"drop_50": {"height": 0.5}, "drop_100": {"height": 1.0}, "drop_150": {"height": 1.5}},
    stage=stage,
    effects={name: FORCES[name] for name in EFFECTS},
    scatter={"height": 0.002, "release_time": 0.05},
    published={
        "gravity": ("g", 1.0, "m/s^2"),
        "height": ("drop_height", 1.0, "m"),
        "distance": ("camera_to_object", 1.0, "m"),
    },
)
