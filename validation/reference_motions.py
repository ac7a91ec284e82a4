"""Equations of motion of :mod:`validation.reference_fits`, written out by hand, and their integration in NumPy.

Arrays end with an axis of columns (b,): many values of the parameters are integrated at once, by the classical
Runge-Kutta method with fixed steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from validation.reference_terms import SWINGS, TERMS, Array, Now, Scales

GRAVITY = 9.81
STEP_RAD, MIN_STEPS = 0.25, 100  # largest step, in radians of the motion's own angle; steps of a short clip


@dataclass(frozen=True)
class Clip:
    """Samples of one clip: ``t`` (n,) s, ``values`` (n, d), NaN where missing, and ``u`` (n,) a measured input."""

    t: Array
    values: Array
    u: Array


@dataclass(frozen=True)
class Motion:
    """A base model: its own force, what is read of it, its parameters with starting values, and candidate terms.

    ``own(x, v, u, p)`` is the force (d, b), an acceleration, but where ``order`` is one the rate of x. ``damped``: a
    force ``-damping v`` belongs to the model. What is read is the speed (``reads`` "v"), or the position. The terms
    ``first`` are there while starting values are looked for, where the base model alone is too far off. ``measured``
    has the standard errors of the geometry of a picture, ``across`` and ``along``: where the pivot was taken to be.
    """

    own: Callable[[Array, Array, Array, Mapping[str, Array]], Array]
    start: Mapping[str, tuple[float, ...]]
    terms: tuple[str, ...]
    order: int = 2
    degrees: int = 1
    damped: bool = False
    reads: str = "x"
    swings: bool = False
    first: tuple[str, ...] = ()
    measured: Mapping[str, float] = field(default_factory=dict)

    @property
    def driven(self) -> bool:
        """Whether a measured torque drives it."""
        return "gain" in self.start

    @property
    def states(self) -> int:
        """How many values a state has."""
        return self.order * self.degrees


def motion(own, start: Mapping[str, tuple[float, ...]], terms: str, **more) -> Motion:
    """A base model, the names of its terms with blanks between."""
    return Motion(own, start, tuple(terms.split()), **more)


def sides(level: Array) -> Array:
    """The area, m^2, of the tapered tank at a level above its hole."""
    bottom, top, height, hole = 102.98e-4, 128.95e-4, 0.2859, 0.025
    return (np.sqrt(bottom) + (np.sqrt(top) - np.sqrt(bottom)) * (level + hole) / height) ** 2


def tank(x, v, u, p):
    """Torricelli through a hole of 1/8 inch."""
    level = np.maximum(x, 0.0)
    return -p["discharge"] * np.pi * (0.0254 / 16) ** 2 * np.sqrt(2 * GRAVITY * level) / sides(level)


def two_tanks(x, v, u, p):
    """A pump into the upper tank, which drains into the lower one."""
    falling = p["upper"] * np.sqrt(np.maximum(x[0], 0.0))
    return np.array([p["pump"] * u - falling, falling - p["lower"] * np.sqrt(np.maximum(x[1], 0.0))])


def thrown(x, v, u, p):
    """A projectile."""
    return np.array([0 * x[0], -p["gravity"] + 0 * x[1]])


TO_AND_FRO = {"damped": True, "swings": True}
FALLS = "linear-drag quadratic-drag scale even-reading odd-reading clock-drift"
MOTIONS: dict[str, Motion] = {
    "pendulum": motion(
        lambda x, v, u, p: -p["pull"] * np.sin(x), {"pull": (), "damping": (0.0,)},
        f"{SWINGS} pivot-aside pivot-along shutter", **TO_AND_FRO,
    ),
    "linear-oscillator": motion(
        lambda x, v, u, p: -p["pull"] * x, {"pull": (), "damping": (0.0,)},
        f"{SWINGS} even-reading odd-reading shutter", first=("cubic-force",), **TO_AND_FRO,
    ),
    "torsion-wheel": motion(
        lambda x, v, u, p: -p["pull"] * x, {"pull": (), "damping": (0.0,)},
        f"{SWINGS} even-reading odd-reading", reads="v", **TO_AND_FRO,
    ),
    "driven-arm": motion(
        lambda x, v, u, p: p["gain"] * u - p["pull"] * np.sin(x),
        {"gain": (4.0, 16.0), "pull": (8.0, 16.0, 40.0), "damping": (0.75,)},
        "quadratic-drag dry-friction weakening-friction constant-force force-drift drag-drift ramp-force zero-offset "
        "zero-line clock-drift", damped=True
    ),
    "free-fall": motion(lambda x, v, u, p: -GRAVITY + 0 * x, {}, FALLS),
    "incline": motion(
        lambda x, v, u, p: p["slope"] + 0 * x, {"slope": (1.0,)},
        "linear-drag quadratic-drag force-drift place-gain zero-wander even-reading odd-reading clock-drift clock-step",
    ),
    "projectile": motion(
        thrown, {"gravity": (GRAVITY,)},
        "linear-drag quadratic-drag zero-wander tilt lens clock-drift clock-step", degrees=2,
    ),
    "coast-down": motion(
        lambda x, v, u, p: -p["rolling"] + 0 * x, {"rolling": (0.1,)},
        "linear-drag quadratic-drag cubic-drag force-drift drag-drift place-gain periodic-force zero-offset zero-line "
        "even-reading clock-drift", reads="v",
    ),
    "tapered-tank": motion(
        tank, {"discharge": (0.6,)},
        "leak place-gain square-force force-drift zero-offset zero-line zero-wander even-reading odd-reading", order=1,
    ),
    "two-tanks": motion(
        two_tanks, {"upper": (0.05,), "lower": (0.05,), "pump": (0.05,)},
        "overflow leak force-drift place-gain zero-offset zero-line even-reading odd-reading", order=1, degrees=2,
    ),
}  # fmt: skip


def derivative(base: Motion, forces: Sequence[str], scales: Scales, p: Mapping[str, Array], t: float, y: Array, u):
    """The rate (s, b) of the state (s, b): the base model with the candidate forces."""
    x = y[: base.degrees]
    v = y[base.degrees :] if base.order == 2 else x
    own = base.own(x, v, u, p)
    force = own - p["damping"] * v if base.damped else own
    now = Now(t, x, v, own, scales)
    for name in forces:
        each = TERMS[name]
        force = force + each.force(now, [p[label] for label in each.names])
    return force if base.order == 1 else np.concatenate([v, force])


def course(base: Motion, clip: Clip, forces: Sequence[str], scales: Scales, p: Mapping[str, Array], start: Array):
    """The states (n, s, b) at the samples of a clip, from ``start`` (s, b); an input is interpolated linearly."""
    states, y = [start], start
    for k in range(clip.t.size - 1):
        step_s = clip.t[k + 1] - clip.t[k]
        count = steps(step_s, clip, scales)
        h = step_s / count
        for j in range(count):
            a, b, c = (clip.u[k] + (clip.u[k + 1] - clip.u[k]) * (j + part) / count for part in (0, 0.5, 1))
            y = stepped(
                lambda t, y, u: derivative(base, forces, scales, p, t, y, u), clip.t[k] + j * h, y, h, (a, b, c)
            )
        states.append(y)
    return np.array(states)


def stepped(rate, t: float, y: Array, h: float, u: tuple[float, float, float]) -> Array:
    """One step of the classical Runge-Kutta method."""
    k1 = rate(t, y, u[0])
    k2 = rate(t + h / 2, y + h / 2 * k1, u[1])
    k3 = rate(t + h / 2, y + h / 2 * k2, u[1])
    k4 = rate(t + h, y + h * k3, u[2])
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def steps(step_s: float, clip: Clip, scales: Scales) -> int:
    """How many steps of the method lie between two samples."""
    swing = scales.omega * step_s / STEP_RAD
    short = step_s / (clip.t[-1] - clip.t[0]) * MIN_STEPS
    return max(1, int(np.ceil(min(max(swing, short), 50))))


def shown(base: Motion, clip: Clip, states: Array, readings: Sequence[str], scales: Scales, p: Mapping[str, Array]):
    """What is read (n, d, b) of the states, and by coefficient the functions (n, d, b) that it multiplies."""
    first = base.degrees if base.reads == "v" else base.states - clip.values.shape[1] if base.order == 1 else 0
    plain = states[:, first : first + clip.values.shape[1]]
    rate = np.gradient(plain, clip.t, axis=0)
    functions, total = {}, plain + p.get("vertical", 0.0)
    if "across" in p:
        total = total - p["across"] * np.cos(plain) - p["along"] * np.sin(plain)
    for name in readings:
        each = TERMS[name]
        values = each.reading(plain, rate, clip.t[:, None, None], scales)
        for label, value in zip(each.names, values, strict=True):
            functions[label] = value
            total = total + p[label] * value
    return total, functions
