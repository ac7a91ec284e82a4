"""A ball let go under a camera that looks straight down: its apparent radius is r = r0 f / h."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.synthetic.camera import FOCAL_PER_WIDTH, CameraView
from iris_sysid.synthetic.effects import FORCES, extra_acceleration
from iris_sysid.synthetic.motion import SceneMotion, bouncing, integrate
from iris_sysid.synthetic.props import hand, tape
from iris_sysid.synthetic.scene import Curve, Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.shapes import Colour, Layer, Path, Shading, disc, soft
from iris_sysid.types import Array, Parameter

BALL: Colour = (60.0, 120.0, 190.0)
WOOD: Colour = (158.0, 136.0, 112.0)
ASIDE = (0.012, -0.008)  # m from the camera's axis
EFFECTS = ("linear-drag", "quadratic-drag", "constant-force", "release-velocity", "zero-offset", "parameter-drift")

PARAMETERS = (
    Parameter("gravity", "m/s^2", "g", 0.01, 1000.0, 9.80665),
    Parameter("ball_radius", "m", "r_0", 1e-4, 1.0, 0.07),
    Parameter("h0", "m", "h_0", 0.01, 100.0, 0.75),
    Parameter("floor_distance", "m", "H", 0.02, 1000.0, 2.2),
    Parameter("restitution", "1", "e", 0.0, 1.0, 0.6),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)


def stage(setup: Setup) -> Stage:
    """Hold the ball at h0 under the camera and let it go; the plane of the image is the one at h0."""
    start, radius = setup["h0"], setup["ball_radius"]
    if setup["floor_distance"] <= start + radius:
        raise DataError(f"floor_distance must exceed h0 + ball_radius = {start + radius:g} m")
    motion = _motion(setup)
    height = motion.state(0)

    def shrunk(t_s: Array) -> Array:
        """Size in the image relative to that at h0."""
        return np.asarray(start / (setup["floor_distance"] - height(t_s)))

    def centre(t_s: Array) -> Array:
        return shrunk(t_s)[:, np.newaxis] * np.array(ASIDE)

    def apparent(t_s: Array) -> Array:
        return radius * shrunk(t_s)

    half = start / FOCAL_PER_WIDTH / 2
    view = CameraView(-half, half, -half * 9 / 16, half * 9 / 16, distance_m=start)
    observed = {"h_m": lambda t_s: setup["floor_distance"] - height(t_s), "speed_m_s": lambda t_s: -motion(t_s)[:, 1]}
    marks = tape([(-0.28, 0.14), (0.3, 0.15), (-0.3, -0.16), (0.27, -0.15)], 0.02, 0.02) if setup.look.marks else []
    return Stage(
        view=view,
        wall=Wall(WOOD),
        props=tuple(marks),
        layers=_layers(setup, centre, apparent, shrunk),
        bodies=(SceneBody("1", centre, apparent, observed),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
    )


def _motion(setup: Setup) -> SceneMotion:
    """Height of the ball's centre above the floor, and its rate."""
    effects, gravity, release = setup.effects, setup["gravity"], setup["release_time"]
    added, drift = extra_acceleration(effects), effects.get("parameter-drift", 0.0)

    def fall(t: float, state: Array) -> float:
        return float(-gravity * (1 + drift * (t - release)) + added(t, state[0], state[1]))

    start = setup["floor_distance"] - setup["h0"] - effects.get("zero-offset", 0.0)
    phase = bouncing(fall, setup["ball_radius"], setup["restitution"], gravity)
    stop = max(setup.duration_s, release) + 1.0
    return integrate(phase, np.array([start, -effects.get("release-velocity", 0.0)]), release, stop)


def _layers(setup: Setup, centre: Path, apparent: Curve, shrunk: Curve) -> tuple[Layer, ...]:
    ball = disc(centre, apparent)
    layers = list[Layer]()
    if setup.look.shadow:
        dark = soft(disc(centre, lambda t_s: 1.25 * apparent(t_s)), centre, 0.2)
        layers.append(Layer(dark, (0.0, 0.0, 0.0), setup.look.shadow, blur_step_px=8.0))
    behind, before = hand(setup, ASIDE, setup["ball_radius"], math.pi)
    shading = Shading(centre, setup["ball_radius"], along=(-0.05, 0.08), limb=0.25, size=shrunk)
    return (*layers, *behind, Layer(ball, BALL, shading=shading), *before)


SCENE = Scene(
    name="falling-ball",
    summary="a ball let go under a camera that looks down: its apparent radius",
    folder="Falling_ball",
    duration_s=8.0,
    parameters=PARAMETERS,
    settings={"big": {"ball_radius": 0.11}, "mid": {"ball_radius": 0.07}, "small": {"ball_radius": 0.04}},
    stage=stage,
    effects={name: FORCES[name] for name in EFFECTS},
    scatter={"h0": 0.005, "release_time": 0.05},
    published={"gravity": ("g", 1.0, "m/s^2"), "ball_radius": ("ball_radius", 1.0, "m")},
)
