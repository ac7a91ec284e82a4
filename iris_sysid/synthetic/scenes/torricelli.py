"""A vessel that drains through a hole in its side: h' = -k sqrt(h)."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import FORCES
from iris_sysid.synthetic.motion import Phase, SceneEvent, SceneMotion, integrate, resting
from iris_sysid.synthetic.props import BEIGE, BLACK
from iris_sysid.synthetic.scene import Curve, Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.shapes import Colour, Layer, Outline, box, static
from iris_sysid.types import Array, Parameter

LIQUID: Colour = (40.0, 92.0, 168.0)
GLASS: Colour = (226.0, 232.0, 232.0)
TABLE: Colour = (120.0, 96.0, 76.0)
RIM_M, GLASS_M = 0.03, 0.004
JET_M = 0.006
OVERFLOW_AT = 0.8  # of the initial level

PARAMETERS = (
    Parameter("outflow", "m^0.5/s", "k", 0.0, 10.0, 0.0128),
    Parameter("h_0", "m", "h_0", 0.005, 10.0, 0.2),
    Parameter("width", "m", "w", 0.01, 10.0, 0.12),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.5),
)


def stage(setup: Setup) -> Stage:
    """Fill the vessel to h0 above the hole, and open the hole."""
    motion = _motion(setup)
    level, width, full = motion.state(0), setup["width"], setup["h_0"]

    def surface(t_s: Array) -> Array:
        return np.stack([np.zeros(t_s.size), level(t_s)], axis=-1)

    top = full + 0.06
    view = CameraView(-0.75 * top - width / 2, 0.95 * top + width / 2, -RIM_M - 0.03, top)
    jet = Layer(_jet(setup, level), LIQUID, stop_s=motion.starts[-1], start_s=setup["release_time"])
    return Stage(
        view=view,
        wall=Wall(BEIGE),
        props=_props(setup, top),
        layers=(Layer(_liquid(level, width), LIQUID), jet),
        bodies=(SceneBody("1", surface, width / 2, {"h_m": level}),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
    )


def _motion(setup: Setup) -> SceneMotion:
    effects, release, full = setup.effects, setup["release_time"], setup["h_0"]
    drift, leak = effects.get("parameter-drift", 0.0), effects.get("leak", 0.0)
    overflow, offset = effects.get("overflow", 0.0), effects.get("zero-offset", 0.0)

    def rate(t: float, state: Array) -> Array:
        head = max(float(state[0]) - offset, 0.0)
        base = -setup["outflow"] * math.sqrt(head) * (1 + drift * (t - release))
        return np.array([base - leak * head - overflow * max(float(state[0]) - OVERFLOW_AT * full, 0.0)])

    lowest = max(offset, 0.0) + 1e-6  # the square root has no derivative at 0
    empty = SceneEvent("empty", lambda t, state: float(state[0]) - lowest, -1.0, lambda t, state: (state, resting(1)))
    stop = max(setup.duration_s, release) + 1.0
    return integrate(Phase("motion", rate, (empty,)), np.array([full]), release, stop)


def _liquid(level: Curve, width: float) -> Outline:
    """From the bottom, below the hole, up to the level."""

    def outline(t_s: Array, scale: float) -> Array:
        del scale
        top, half = level(t_s), np.full(t_s.size, width / 2)
        bottom = np.full(t_s.size, -RIM_M)
        corners = [(-half, bottom), (half, bottom), (half, top), (-half, top)]
        return np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1)

    return outline


def _jet(setup: Setup, level: Curve) -> Outline:
    """The parabola of the jet, z = -x^2 / (4 h), as thick as its hole."""
    fall = np.linspace(0, 1, 24) ** 2 * (RIM_M + 0.05)

    def outline(t_s: Array, scale: float) -> Array:
        del scale
        reach = 2 * np.sqrt(np.maximum(level(t_s), 1e-9))[:, np.newaxis] * np.sqrt(fall)
        x = setup["width"] / 2 + GLASS_M + reach
        above = np.stack([x, np.broadcast_to(JET_M / 2 - fall, x.shape)], axis=-1)
        return np.concatenate([above, (above - np.array([0.0, JET_M]))[:, ::-1]], axis=1)

    return outline


def _props(setup: Setup, top: float) -> tuple[Layer, ...]:
    width, wall = setup["width"], GLASS_M
    height = top - 0.02 + RIM_M
    sides = [box(side * (width / 2 + wall / 2), height / 2 - RIM_M, wall, height) for side in (-1, 1)]
    table = Layer(static(box(0.0, -RIM_M - 0.25, 20.0, 0.5)), TABLE)
    marks = [box(-width / 2 - 0.012, h, 0.012, 0.0015) for h in np.arange(0.0, top - 0.03, 0.02)]
    ticks = [Layer(static(mark), BLACK) for mark in marks] if setup.look.marks else []
    return (table, *(Layer(static(side), GLASS) for side in sides), *ticks)


SCENE = Scene(
    name="torricelli",
    summary="a vessel that drains through a hole",
    folder="torricelli",
    duration_s=20.0,
    parameters=PARAMETERS,
    settings={
        "small": {"outflow": 0.009553717},
        "medium": {"outflow": 0.012826432},
        "large": {"outflow": 0.016202066},
    },
    stage=stage,
    effects={
        **{name: FORCES[name] for name in ("zero-offset", "parameter-drift")},
        "leak": "h' loses c h; c in 1/s",
        "overflow": f"h' loses c (h - {OVERFLOW_AT} h_0) while that is positive; c in 1/s",
    },
    scatter={"h_0": 0.001, "release_time": 0.05},
    published={"outflow": ("k", 1.0, "m^0.5/s")},
)
