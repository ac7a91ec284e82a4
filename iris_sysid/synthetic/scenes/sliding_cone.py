"""A plastic cup that slides down a board, off its end, and topples: x'' = g (sin alpha - mu cos alpha)."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.effects import FORCES, dry_friction, extra_acceleration
from iris_sysid.synthetic.motion import Phase, SceneEvent, SceneMotion, integrate, moving, resting
from iris_sysid.synthetic.props import BEIGE, BLACK, METAL, floor, hand
from iris_sysid.synthetic.scene import Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.scenes._cup import cup, standing_height
from iris_sysid.synthetic.shapes import Colour, Layer, box, static
from iris_sysid.types import Array, Parameter

BOARD: Colour = (214.0, 210.0, 198.0)
UNDER: Colour = (58.0, 54.0, 50.0)
BOARD_THICKNESS_M = 0.012
FLOOR_FRICTION = 0.6
TOPPLING_S = 0.35
EFFECTS = (
    *("linear-drag", "quadratic-drag", "coulomb-friction", "velocity-weakening-friction"),
    *("constant-force", "parameter-drift", "release-velocity", "periodic-forcing"),
)

PARAMETERS = (
    Parameter("angle", "rad", r"\alpha", 0.01, 1.56, math.radians(60)),
    Parameter("friction", "1", r"\mu", 0.0, 10.0, 0.3),
    Parameter("board_length", "m", "l", 0.05, 10.0, 0.84),
    Parameter("gravity", "m/s^2", "g", 0.01, 1000.0, 9.80665),
    Parameter("cup_height", "m", "", 0.005, 1.0, 0.11),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.8),
)


def stage(setup: Setup) -> Stage:
    """Lay the board from the floor up to the right, put the cup at its top, and let it go."""
    motion, angle, length = _motion(setup), setup["angle"], setup["board_length"]
    height, stand = setup["cup_height"], standing_height(setup["cup_height"])
    run, rise = length * math.cos(angle), length * math.sin(angle)
    down = np.array([-math.cos(angle), -math.sin(angle)])
    above = stand * np.array([-math.sin(angle), math.cos(angle)])
    top = np.array([run, rise])

    def centre(t_s: Array) -> Array:
        state = motion(t_s)
        on_board = top + above + state[:, :1] * down
        foot = np.maximum(state[:, 2:3], 0.0)  # 0 on the board, 1 when it lies on the floor
        lying = np.stack([on_board[:, 0] - state[:, 4], np.full(t_s.size, 0.43 * height)], axis=-1)
        return on_board + foot * (lying - on_board)

    def turned(t_s: Array) -> Array:
        return angle + motion(t_s)[:, 2] * (math.pi / 2 - angle + 0.08)

    far = max(length, 0.84)  # one camera position for all of the benchmark's boards
    view = CameraView(-0.62, 0.72 * far + 0.32, -0.1, far + 0.2)
    observed = {"s_m": motion.state(0), "speed_m_s": motion.state(1), "angle_rad": turned}
    x, z = centre(np.array([-1.0]))[0]
    behind, before = hand(setup, (x, z + 0.1 * height), 0.42 * height, math.pi + 0.9)
    cup_layers = cup(centre, turned, height, shaded=setup.look.shading)
    return Stage(
        view=view,
        wall=Wall(BEIGE),
        props=_props(setup, view, run, rise),
        layers=(*behind, *cup_layers, *before),
        bodies=(SceneBody("1", centre, 0.43 * height, observed),),
        stated=stated(setup, PARAMETERS),
        phase=motion.phase,
        happened=motion.happened,
    )


def _motion(setup: Setup) -> SceneMotion:
    """States s down the board, s', how far it has toppled (0 to 1), its rate, and how far it slid on the floor."""
    effects, angle, gravity = setup.effects, setup["angle"], setup["gravity"]
    added, rub, release = extra_acceleration(effects), dry_friction(effects), setup["release_time"]
    drift = effects.get("parameter-drift", 0.0)
    way = setup["board_length"] - 0.45 * setup["cup_height"] - START_M

    def pull(t: float, state: Array) -> float:
        base = gravity * math.sin(angle) * (1 + drift * (t - release))
        return base + added(t, state[0], state[1])

    def hold(t: float, state: Array) -> float:
        return setup["friction"] * gravity * math.cos(angle) * (1 + drift * (t - release)) + rub(t, state)

    def on_floor(t: float, state: Array) -> tuple[Array, Phase]:
        return state, _toppling(t, float(state[1]))

    end = SceneEvent("end of the board", lambda t, state: state[0] - way, 1.0, on_floor)
    start = np.array([0.0, effects.get("release-velocity", 0.0), 0.0, 0.0, 0.0])
    first = moving(pull, hold, release, start, others=lambda t, state: np.zeros(3), events=(end,))
    return integrate(first, start, release, max(setup.duration_s, release) + 1.0)


START_M = 0.12  # from the board's upper end to where the cup is let go, along the board


def _toppling(start_s: float, speed: float) -> Phase:
    """The cup leaves the board, falls over within a third of a second, and slides to rest."""
    braking = FLOOR_FRICTION * 9.80665
    stop = max(TOPPLING_S, speed / braking)

    def rate(t: float, state: Array) -> Array:
        since = t - start_s
        slide = max(speed - braking * since, 0.0)
        falling = math.sin(math.pi * since / TOPPLING_S) * math.pi / (2 * TOPPLING_S) if since < TOPPLING_S else 0.0
        return np.array([0.0, -state[1] / 0.05, falling, 0.0, slide])

    def over(t: float, state: Array) -> tuple[Array, Phase]:
        del t
        return state, resting(5)

    return Phase("contact", rate, (SceneEvent("rest", lambda t, state: t - start_s - stop, 1.0, over),), 0.02)


def _props(setup: Setup, view: CameraView, run: float, rise: float) -> tuple[Layer, ...]:
    half = BOARD_THICKNESS_M / 2
    angle, length = setup["angle"], setup["board_length"]
    middle = (run / 2 + half * math.sin(angle), rise / 2 - half * math.cos(angle))
    board = Layer(static(box(*middle, length, BOARD_THICKNESS_M, angle)), BOARD)
    shade = Layer(static(np.array([(0.02, 0.0), (run, 0.0), (run, rise - 0.03)])), UNDER, opacity=0.35)
    leg = Layer(static(box(run + 0.05, rise / 2 + 0.2, 0.05, rise + 0.4)), BLACK)
    post = Layer(static(box(run + 0.2, rise / 2 + 0.2, 0.02, rise + 0.4)), METAL)
    furniture = (leg, post) if setup.look.marks else ()
    return (*floor(0.0, 4 * view.left, 4 * view.right, -1.0), shade, *furniture, board)


SCENE = Scene(
    name="sliding-cone",
    summary="a plastic cup that slides down a board",
    folder="Sliding_cone",
    duration_s=5.0,
    parameters=PARAMETERS,
    settings={
        "cone_45": {"angle": math.radians(45), "board_length": 0.77},
        "cone_60": {"angle": math.radians(60), "board_length": 0.84},
        "cone_80": {"angle": math.radians(80), "board_length": 0.80},
    },
    stage=stage,
    effects={name: FORCES[name] for name in EFFECTS},
    scatter={"friction": 0.01, "release_time": 0.05},
    published={
        "angle": ("angle", 180 / math.pi, "deg"),
        "friction": ("friction", 1.0, "1"),
        "board_length": ("hypotenuse", 1.0, "m"),
    },
)
