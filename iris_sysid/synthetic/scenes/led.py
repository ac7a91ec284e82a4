"""A lamp that fades after it is switched off: I' = -gamma I."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import FORCES
from iris_sysid.synthetic.motion import Phase, SceneMotion, integrate
from iris_sysid.synthetic.scene import Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.shapes import Colour, Layer, disc, soft, static, still
from iris_sysid.types import Array, Parameter

UNLIT: Colour = (40.0, 40.0, 42.0)
LIT: Colour = (236.0, 232.0, 216.0)
BOARD: Colour = (30.0, 74.0, 52.0)
TRACK: Colour = (70.0, 120.0, 84.0)
GLOW = 0.35  # brightness of the halo over that of the lamp
EFFECTS = ("constant-force", "zero-offset", "parameter-drift")
PLACE = (0.004, -0.002)

PARAMETERS = (
    Parameter("decay_rate", "1/s", r"\gamma", 0.0, 1000.0, 0.92),
    Parameter("i_0", "1", "I_0", 0.01, 1.0, 1.0),
    Parameter("lamp_radius", "m", "r", 1e-4, 0.02, 0.006),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)


def stage(setup: Setup) -> Stage:
    """Let the lamp shine, then fade; 1 is its full brightness."""
    radius, position = setup["lamp_radius"], still(*PLACE)
    motion = _motion(setup)
    light = motion.state(0)
    view = CameraView(-0.064, 0.064, -0.036, 0.036)
    lamp = disc(position, radius)
    halo = Layer(soft(disc(position, 2.0 * radius), position, 0.75, steps=40), LIT, opacity=GLOW)
    return Stage(
        view=view,
        wall=Wall((38.0, 38.0, 40.0)),
        props=(*_board(setup), Layer(lamp, UNLIT)),
        layers=(*([halo] if setup.look.shading else []), Layer(lamp, LIT)),
        bodies=(SceneBody("1", position, radius, {"intensity_1": light}),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
        light=light,
    )


def _motion(setup: Setup) -> SceneMotion:
    effects, release = setup.effects, setup["release_time"]
    drift, constant = effects.get("parameter-drift", 0.0), effects.get("constant-force", 0.0)
    offset = effects.get("zero-offset", 0.0)

    def rate(t: float, state: Array) -> Array:
        level = float(state[0]) - offset
        return np.array([-setup["decay_rate"] * level * (1 + drift * (t - release)) + constant])

    stop = max(setup.duration_s, release) + 1.0
    return integrate(Phase("motion", rate), np.array([setup["i_0"]]), release, stop)


def _board(setup: Setup) -> list[Layer]:
    def corners(x: float, z: float, width: float, height: float) -> Array:
        return np.array([(x, z), (x + width, z), (x + width, z + height), (x, z + height)])

    board = Layer(static(corners(-0.045, -0.026, 0.09, 0.052)), BOARD)
    if not setup.look.marks:
        return [board]
    tracks = [static(corners(-0.04, z, 0.05 + 0.02 * math.sin(90 * z), 0.0012)) for z in (-0.02, -0.012, 0.012, 0.019)]
    return [board, *(Layer(track, TRACK) for track in tracks)]


SCENE = Scene(
    name="led",
    summary="a lamp that fades after it is switched off",
    folder="led",
    duration_s=8.0,
    parameters=PARAMETERS,
    settings={
        # from full brightness to a hundredth in 2, 5 and 10 s
        f"led_{seconds}s": {"decay_rate": math.log(100) / seconds}
        for seconds in (2, 5, 10)
    },
    stage=stage,
    effects={name: FORCES[name] for name in EFFECTS},
    scatter={"release_time": 0.05},
    published={"decay_rate": ("decay", 1.0, "1/s")},
)
