"""A ball launched at a pyramid of 15 cups (5-4-3-2-1): impacts, or the benchmark's continuous coupling.

With ``contact`` 0 the sixteen bodies follow z_i'' + zeta z_i' + kappa sum_j (z_i - z_j) = 0, z being the horizontal
displacement from where each stood.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import interp1d

from iris_sysid.errors import DataError
from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.motion import Phase, integrate
from iris_sysid.synthetic.props import BEIGE, floor, hand
from iris_sysid.synthetic.scene import Curve, Scene, SceneBody, Setup, Stage, Wall, stated
from iris_sysid.synthetic.scenes._collisions import STEP_S, Material, pile_of, run
from iris_sysid.synthetic.scenes._cup import cup
from iris_sysid.synthetic.scenes._hanging import ball
from iris_sysid.synthetic.shapes import Colour, Path
from iris_sysid.types import Array, Parameter

BALL: Colour = (40.0, 60.0, 150.0)
ROWS = (5, 4, 3, 2, 1)
CUPS = sum(ROWS)
BALL_OVER_CUP_MASS = 12.0
CUP_FRICTION = 0.3
ROW_RISE = math.sqrt(3) / 2  # of circles that lie in the gaps of the row below

PARAMETERS = (
    Parameter("launch_speed", "m/s", "v_0", 0.0, 100.0, 3.5),
    Parameter("damping", "1/s", r"\zeta", 0.0, 100.0, 0.4),
    Parameter("coupling", "1/s^2", r"\kappa", 0.0, 1e4, 0.0),
    Parameter("restitution", "1", "e", 0.0, 1.0, 0.45),
    Parameter("contact", "1", "", 0.0, 1.0, 1.0),
    Parameter("ball_distance", "m", "d", 0.05, 100.0, 2.0),
    Parameter("distance", "m", "", 0.1, 100.0, 2.2),
    Parameter("ball_radius", "m", "r", 1e-3, 1.0, 0.075),
    Parameter("cup_radius", "m", "", 1e-3, 1.0, 0.05),
    Parameter("gravity", "m/s^2", "g", 0.01, 1000.0, 9.80665),
    Parameter("release_time", "s", "t_r", 0.0, 1e4, 0.4),
)


def stage(setup: Setup) -> Stage:
    """Pile up the cups and send the ball rolling along the floor."""
    start = _start(setup)
    paths, angles, happened = _collided(setup, start) if setup["contact"] else _coupled(setup, start)
    release, radius, cup_radius = setup["release_time"], setup["ball_radius"], setup["cup_radius"]
    view = CameraView(-setup["ball_distance"] - 0.35, 1.2, -0.12, 1.7, distance_m=setup["distance"])
    layers = ball(paths[0], radius, BALL, setup)
    for path, angle in zip(paths[1:], angles[1:], strict=True):
        layers += cup(path, angle, 1.95 * cup_radius, shaded=setup.look.shading)
    behind, before = hand(setup, start[0], 0.75 * radius, 0.35)
    return Stage(
        view=view,
        wall=Wall(BEIGE),
        props=tuple(floor(0.0, 3 * view.left, 3 * view.right, -1.0)),
        layers=(*behind, *layers, *before),
        bodies=tuple(
            SceneBody(str(k + 1), path, radius if k == 0 else cup_radius, _observed(path, angles[k], start[k]))
            for k, path in enumerate(paths)
        ),
        stated=stated(setup, PARAMETERS),
        phase=lambda t_s: ["hand" if t < release else "motion" for t in t_s],
        happened=happened,
    )


def _observed(path: Path, angle: Curve, home: Array) -> dict[str, Curve]:
    return {"displacement_m": lambda t_s: path(t_s)[:, 0] - home[0], "angle_rad": angle}


def _start(setup: Setup) -> Array:
    """Centres (16, 2) at first: the ball, then the cups row by row from the floor up, each from the left."""
    cup_radius = setup["cup_radius"]
    if setup["ball_distance"] < setup["ball_radius"] + cup_radius:
        raise DataError("ball_distance must exceed ball_radius + cup_radius: the ball starts inside the pyramid")
    places = [(-setup["ball_distance"] - (ROWS[0] - 1) * cup_radius, setup["ball_radius"])]
    for row, count in enumerate(ROWS):
        height = cup_radius * (1 + 2 * ROW_RISE * row)
        places += [((2 * k - (count - 1)) * cup_radius, height) for k in range(count)]
    return np.array(places)


Moves = tuple[list[Path], list[Curve], tuple[tuple[float, str], ...]]


def _collided(setup: Setup, start: Array) -> Moves:
    """Paths and angles of bodies that strike each other."""
    release, cup_radius = setup["release_time"], setup["cup_radius"]
    masses = np.array([BALL_OVER_CUP_MASS, *[1.0] * CUPS])
    pile = pile_of(start, np.array([setup["ball_radius"], *[cup_radius] * CUPS]), masses)
    # the launch differs a little in each trial, as from a hand
    pile.velocity[0, 0] = setup["launch_speed"] * (1 + 0.02 * setup.rng.standard_normal())
    pile.spin[0] = -pile.velocity[0, 0] / setup["ball_radius"]
    pile.awake[0] = True
    steps = math.ceil((max(setup.duration_s - release, 0.0) + 0.1) / STEP_S)
    material = Material(setup["restitution"], CUP_FRICTION, setup["damping"], setup["gravity"])
    positions, angles = run(pile, material, steps)
    clock: Array = release + STEP_S * np.arange(steps + 1, dtype=np.float64)
    struck = sorted((int(step), body) for body, step in enumerate(pile.woken_at) if step >= 0)
    happened = tuple((float(clock[step]), f"impact on {body + 1}") for step, body in struck)
    paths = [_held(clock, positions[:, k]) for k in range(CUPS + 1)]
    return paths, [_held(clock, angles[:, k]) for k in range(CUPS + 1)], happened


def _held(clock: Array, values: Array) -> Callable[[Array], Array]:
    """Linear between the steps, held before and after."""
    between = interp1d(
        clock, values, axis=0, assume_sorted=True, bounds_error=False, fill_value=(values[0], values[-1])
    )
    return lambda t_s: np.asarray(between(t_s), dtype=np.float64)


def _coupled(setup: Setup, start: Array) -> Moves:
    """Paths of bodies under the benchmark's continuous coupling; nothing turns."""
    release, count = setup["release_time"], CUPS + 1

    def rate(t: float, state: Array) -> Array:
        del t
        z, speed = state[:count], state[count:]
        pull = setup["coupling"] * (count * z - z.sum())
        return np.concatenate([speed, -setup["damping"] * speed - pull])

    first = np.zeros(2 * count)
    first[count] = setup["launch_speed"]
    motion = integrate(Phase("motion", rate), first, release, max(setup.duration_s, release) + 1.0)

    def path(k: int) -> Path:
        def moved(t_s: Array) -> Array:
            z = motion(t_s)[:, k]
            return start[k] + np.stack([z, np.zeros_like(z)], axis=-1)

        return moved

    return [path(k) for k in range(count)], [lambda t_s: np.zeros(t_s.size)] * count, ()


SCENE = Scene(
    name="hitting-cones",
    summary="a ball launched at a pyramid of 15 cups",
    folder="Hitting_cones",
    duration_s=5.0,
    parameters=PARAMETERS,
    settings={"slow": {"launch_speed": 2.0}, "mid": {"launch_speed": 3.5}, "fast": {"launch_speed": 5.0}},
    stage=stage,
    scatter={"release_time": 0.05},
    published={"ball_distance": ("ball_to_cones", 1.0, "m"), "distance": ("camera_to_object", 1.0, "m")},
)
