"""What is hidden: forces, events, sensors, cameras and clocks, written from the physics and not from the library.

A hidden effect says which names of the library call it rightly. Forms that the library does not have (``own_form``)
are right when the kind of physics is named: a Stribeck curve is friction, a power of 1.5 is drag.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from validation.independent.camera import Camera
from validation.independent.motions import GRAVITY, Array, Force, Motion, Values, integrate

LINES = ("pendulum", "linear-oscillator", "incline", "free-fall")  # one coordinate, second order
MOVES = (*LINES, "projectile")
UNDAMPED = ("incline", "free-fall", "projectile")
PULLED_BACK = ("pendulum", "linear-oscillator")
FIRST_ORDER = ("torricelli", "exponential-decay")
EVERY = (*MOVES, *FIRST_ORDER)

Shape = Mapping[str, float]
# (motion, values, t_s, size, shape) -> what is observed (n, d)
Show = Callable[[Motion, Values, Array, float, Shape], Array]


@dataclass(frozen=True, slots=True)
class HiddenEffect:
    """An effect that may be hidden in a motion.

    ``show`` makes the observed values; ``shape`` draws the numbers beside the size; ``right`` are the library's names
    for it; ``kind`` is physics, camera or clock, ``fault`` the value of a camera that it changes; ``brakes`` effects
    have sizes above zero only; ``size`` is the library's parameter that has the same definition, where one has.
    """

    name: str
    kind: str
    right: frozenset[str]
    motions: tuple[str, ...]
    show: Show
    shape: Callable[[Motion, Array, np.random.Generator], dict[str, float]]
    brakes: bool = False
    own_form: bool = False
    size: str = ""
    fault: str = ""


def _nothing(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    return {}


def _moment(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    share = rng.uniform(0.15, 0.6)
    return {"when": float(t_s[0] + share * (t_s[-1] - t_s[0]))}


# Forces -------------------------------------------------------------------------------------------------------------


def _speed(velocity: Array) -> float:
    return max(float(np.linalg.norm(velocity)), 1e-12)


def _sign(velocity: Array) -> Array:
    return np.tanh(velocity / 1e-3) if velocity.size == 1 else velocity / max(_speed(velocity), 1e-3)


def linear_drag(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-b v."""
    return -size * v


def power_drag(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-c |v|^(p - 1) v."""
    return -size * _speed(v) ** (shape["power"] - 1.0) * v


def dry_friction(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-c sign v."""
    return -size * _sign(v)


def stribeck(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-c (1 + a exp(-(v / v_s)^2)) sign v: friction that is larger at low speed (Armstrong 1994, Automatica 30)."""
    return -size * (1.0 + shape["excess"] * np.exp(-((_speed(v) / shape["speed"]) ** 2))) * _sign(v)


def smooth_friction(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-c tanh(v / v_s), of any width."""
    return -size * np.tanh(v / shape["speed"])


def constant(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """A constant."""
    return np.full_like(x, size)


def cubic(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-k x^3."""
    return -size * x**3


def sinusoid(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """A sine of any frequency and phase."""
    return np.full_like(x, size * np.sin(shape["rate"] * (t - shape["start"]) + shape["phase"]))


def growing_force(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """The undisturbed acceleration changes in proportion to the time since the start."""
    return size * (t - shape["start"]) * base


def growing_length(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """A cord L (1 + e t): theta'' + 2 (L'/L) theta' + g / L(t) sin theta = 0 (Wright et al. 1989, Am. J. Phys. 57)."""
    stretched = 1.0 + size * (t - shape["start"])
    pull = GRAVITY / shape["length"] * np.sin(x)
    return pull - pull / stretched - 2.0 * size / stretched * v


def held_back(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """A hand takes a share of the force until it lets go."""
    return -size * base if t < shape["when"] else np.zeros_like(base)


def rough_part(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """More dry friction beyond a position."""
    return -size * _sign(v) if x[0] > shape["beyond"] else np.zeros_like(v)


def leaking(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-l h."""
    return -size * x


def over_the_rim(t: float, x: Array, v: Array, base: Array, size: float, shape: Shape) -> Array:
    """-w (h - rim)^1.5, a weir (Francis): not the library's power."""
    return -size * np.maximum(x - shape["rim"], 0.0) ** 1.5


def forced(term: Callable[..., Array], motion: Motion, values: Values, t_s: Array, size: float, shape: Shape) -> Array:
    """Observed values under a force."""
    force: Force = partial(_term_with, term, size, {**shape, **values})
    return integrate(motion, values, t_s, force)[:, : motion.size]


def _term_with(
    term: Callable[..., Array], size: float, shape: Shape, t: float, x: Array, v: Array, base: Array
) -> Array:
    return term(t, x, v, base, size, shape)


def struck(motion: Motion, values: Values, t_s: Array, size: float, shape: Shape) -> Array:
    """A jump of the velocity at one moment."""
    kick = {shape["when"]: np.full(motion.size, size)}
    return integrate(motion, values, t_s, kicks=kick)[:, : motion.size]


# Sensor and clock ---------------------------------------------------------------------------------------------------


def offset(motion: Motion, values: Values, t_s: Array, size: float, shape: Shape) -> Array:
    """A wrong zero."""
    return integrate(motion, values, t_s)[:, : motion.size] + size


def drifting(motion: Motion, values: Values, t_s: Array, size: float, shape: Shape) -> Array:
    """A zero that moves evenly."""
    return integrate(motion, values, t_s)[:, : motion.size] + size * (t_s - t_s[0])[:, None]


def frames_lost(motion: Motion, values: Values, t_s: Array, size: float, shape: Shape) -> Array:
    """Time goes on by ``size`` between two frames, and the times of the table do not say so."""
    late = t_s + np.where(t_s >= shape["when"], size, 0.0)
    return integrate(motion, values, late)[:, : motion.size]


# Camera -------------------------------------------------------------------------------------------------------------


def filmed(change: str, motion: Motion, values: Values, t_s: Array, size: float, shape: Shape) -> Array:
    """What the naive geometry reads from a camera that is not ideal in one way."""
    undisturbed = integrate(motion, values, t_s)[:, : motion.size]
    return filmed_by(camera_before(motion, values, undisturbed).with_(**{change: size}), motion, values, t_s)


def filmed_by(camera: Camera, motion: Motion, values: Values, t_s: Array) -> Array:
    """What the naive geometry reads (n, d) from a camera."""
    margin = 0.05 * float(t_s[-1] - t_s[0])
    dense = np.linspace(t_s[0], t_s[-1] + margin, 4 * t_s.size)
    course = CubicSpline(dense, integrate(motion, values, dense)[:, : motion.size])
    pixels = camera.film(lambda t: in_plane(motion, values, course(t)), t_s)
    return _read_back(motion, values, camera, pixels)


def camera_before(motion: Motion, values: Values, observed: Array) -> Camera:
    """The ideal camera that films an undisturbed motion (n, d)."""
    return Camera.facing(in_plane(motion, values, observed))


def in_plane(motion: Motion, values: Values, observed: Array) -> Array:
    """Positions (n, 2) m, x right and z up, of what is observed."""
    if motion.model == "pendulum":
        angle, length = observed[:, 0], values["length"]
        return np.column_stack([length * np.sin(angle), -length * np.cos(angle)])
    if motion.size == 2:
        return observed
    along = observed[:, 0]
    if motion.model == "free-fall":
        return np.column_stack([np.zeros_like(along), along])
    return np.column_stack([along, np.zeros_like(along)])


def _read_back(motion: Motion, values: Values, camera: Camera, pixels: Array) -> Array:
    """What is observed, by the naive geometry; a pendulum's pivot is where the camera shows it."""
    positions = camera.naive(pixels)
    if motion.model == "pendulum":
        pivot = camera.naive(camera.project(np.zeros((1, 2))))[0]
        return np.arctan2(positions[:, 0] - pivot[0], pivot[1] - positions[:, 1])[:, None]
    if motion.size == 2:
        return positions
    return positions[:, [1]] if motion.model == "free-fall" else positions[:, [0]]


# Shapes -------------------------------------------------------------------------------------------------------------


def _started(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    return {"start": float(t_s[0])}


def _powers(low: float, high: float) -> Callable[..., dict[str, float]]:
    return lambda motion, t_s, rng: {"power": float(rng.uniform(low, high))}


def _speeds(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    return {"speed": float(np.exp(rng.uniform(np.log(0.03), np.log(0.5)))), "excess": float(rng.uniform(0.3, 1.0))}


def _frequencies(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    span = float(t_s[-1] - t_s[0])
    slowest, fastest = 2 * np.pi * 1.3 / span, 2 * np.pi * min(0.12 * motion.rate_hz, 30.0 / span)
    rate = float(np.exp(rng.uniform(np.log(slowest), np.log(max(fastest, 2 * slowest)))))
    return {"rate": rate, "phase": float(rng.uniform(0, 2 * np.pi)), "start": float(t_s[0])}


def _early(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    return {"when": float(t_s[0] + rng.uniform(0.03, 0.2) * (t_s[-1] - t_s[0]))}


def _beyond(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    return {"beyond": float(rng.uniform(0.6, 1.6))}


def _rims(motion: Motion, t_s: Array, rng: np.random.Generator) -> dict[str, float]:
    return {"rim": float(rng.uniform(0.1, 0.2))}


def _names(text: str) -> frozenset[str]:
    return frozenset(text.split())


def _force(name: str, right: str, motions: tuple[str, ...], term: Callable[..., Array], **more: object) -> HiddenEffect:
    shape = more.pop("shape", _nothing)
    return HiddenEffect(name, "physics", _names(right), motions, partial(forced, term), shape, **more)  # type: ignore[arg-type]


FRICTION = "coulomb-friction velocity-weakening-friction"
HIDDEN: tuple[HiddenEffect, ...] = (
    _force("linear drag", "linear-drag", UNDAMPED, linear_drag, brakes=True, size="linear_drag"),
    _force(
        "quadratic drag",
        "quadratic-drag",
        MOVES,
        power_drag,
        brakes=True,
        shape=_powers(2.0, 2.0),
        size="quadratic_drag",
    ),
    _force("dry friction", "coulomb-friction", PULLED_BACK, dry_friction, brakes=True, size="coulomb_friction"),
    _force("constant force", "constant-force", PULLED_BACK, constant, size="constant_force"),
    _force("cubic stiffness", "cubic-stiffness", PULLED_BACK, cubic, size="cubic_stiffness"),
    _force("periodic force", "periodic-forcing", LINES, sinusoid, shape=_frequencies),
    _force(
        "drift of the force",
        "parameter-drift",
        (*LINES, *FIRST_ORDER),
        growing_force,
        shape=_started,
        size="parameter_drift",
    ),
    _force("late release", "late-release", PULLED_BACK, held_back, shape=_early, size="late_release"),
    _force(
        "rough part", "friction-change", ("incline",), rough_part, brakes=True, shape=_beyond, size="friction_change"
    ),
    _force("leak", "leak", ("torricelli",), leaking, brakes=True, size="leak"),
    HiddenEffect("impact", "physics", _names("impact"), LINES, struck, _moment, size="impact"),
    HiddenEffect(
        "zero offset",
        "camera",
        _names("zero-offset"),
        (*PULLED_BACK, *FIRST_ORDER),
        offset,
        _nothing,
        size="zero_offset",
    ),
    HiddenEffect(
        "camera drift",
        "camera",
        _names("camera-drift zero-drift"),
        (*PULLED_BACK, *FIRST_ORDER),
        drifting,
        _nothing,
        size="camera_drift",
    ),
    HiddenEffect(
        "lost frames", "clock", _names("dropped-frame"), EVERY, frames_lost, _moment, brakes=True, size="dropped_frame"
    ),
    HiddenEffect(
        "camera tilt",
        "camera",
        _names("camera-tilt"),
        ("pendulum", "linear-oscillator", "incline"),
        partial(filmed, "tilt_rad"),
        _nothing,
        fault="tilt_rad",
    ),
    HiddenEffect(
        "radial distortion",
        "camera",
        _names("radial-distortion"),
        MOVES,
        partial(filmed, "distortion"),
        _nothing,
        fault="distortion",
    ),
    HiddenEffect(
        "rolling shutter",
        "camera",
        _names("rolling-shutter"),
        MOVES,
        partial(filmed, "line_s"),
        _nothing,
        fault="line_s",
    ),
    HiddenEffect(
        "unequal scales",
        "camera",
        _names("anisotropic-scale"),
        ("pendulum", "projectile"),
        lambda motion, values, t_s, size, shape: filmed("aspect", motion, values, t_s, 1.0 + size, shape),
        _nothing,
        fault="aspect",
    ),
    # forms that are not the library's
    _force(
        "drag of another power",
        "quadratic-drag linear-drag",
        MOVES,
        power_drag,
        brakes=True,
        own_form=True,
        shape=_powers(1.4, 1.8),
    ),
    _force("Stribeck friction", FRICTION, PULLED_BACK, stribeck, brakes=True, own_form=True, shape=_speeds),
    _force("rounded friction", FRICTION, PULLED_BACK, smooth_friction, brakes=True, own_form=True, shape=_speeds),
    _force("drift of the length", "parameter-drift", ("pendulum",), growing_length, own_form=True, shape=_started),
    _force("weir", "overflow", ("torricelli",), over_the_rim, brakes=True, own_form=True, shape=_rims),
)
