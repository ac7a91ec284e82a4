"""Candidate terms of :mod:`validation.reference_fits`, written out by hand in NumPy.

Coefficients are without a unit: each term is a coefficient times the usual size of the force or of the reading. Arrays
end with an axis of columns (b,): many values of the parameters are integrated at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
WAVES = 8  # cosines of a wander, at most


@dataclass(frozen=True)
class Scales:
    """Usual sizes: position, speed, force, what is read and its rate, duration and middle of the time, s.

    ``omega`` is the motion's own angular frequency (0 where it does not swing), ``line`` that of a periodic force,
    rad/s, and ``step`` where the clock may jump, from -0.5 to 0.5 of the time.
    """

    x: float
    v: float
    force: float
    reading: float
    rate: float
    time: float
    middle: float
    omega: float
    line: float = 1.0
    step: float = 0.0

    def along(self, t: Array) -> Array:
        """The time from -0.5 to 0.5."""
        return (t - self.middle) / self.time


@dataclass(frozen=True)
class Now:
    """A moment: the time ``t``, s, position and speed (d, b), the base model's force (d, b), and the usual sizes."""

    t: float
    x: Array
    v: Array
    own: Array
    s: Scales


@dataclass(frozen=True)
class Term:
    """One candidate: the ``kinds`` of component that it stands for, and the library's ``effects``.

    ``force(now, c)`` is an acceleration (d, b), with the coefficients ``c``, each (b,). ``reading(r, rate, t, scales)``
    gives the functions (size, n, d, b) that the coefficients multiply, of what is read (n, d, b), its rate, and the
    time (n, 1, 1). Coefficients outside ``limits`` are not physics.
    """

    name: str
    kinds: frozenset[str]
    effects: frozenset[str]
    limits: tuple[float, float]
    size: int = 1
    force: Callable[..., Array] | None = None
    reading: Callable[..., Array] | None = None

    @property
    def names(self) -> list[str]:
        """The names of its coefficients."""
        return [f"{self.name}/{k}" for k in range(self.size)]

    @property
    def price(self) -> int:
        """For how many terms it counts: one that can imitate a part of anything counts twice."""
        return 2 if self.name in SOAKS else 1


def periodic(now: Now, c):
    """A force at one frequency, near the one where it was looked for."""
    phase = now.s.line * (1 + c[2]) * (now.t - now.s.middle)
    return now.s.force * (c[0] * np.cos(phase) + c[1] * np.sin(phase))


def spill(now: Now, c):
    """What flows over the rim of the upper tank, full at 10 V."""
    over = c[0] * np.maximum(now.own[0], 0) / (1 + np.exp(-(now.x[0] - 10.0) / 0.1))
    return np.array([-over, np.zeros_like(over)])


def dry(now: Now, c):
    """Dry friction; below half a per cent of the usual speed its sign is rounded, so that steps stay small."""
    return -c[0] * now.s.force * now.v / np.sqrt(now.v**2 + (0.005 * now.s.v) ** 2)


def waves(s: Scales) -> int:
    """How many half waves a wander has: below 0.7 of the motion's own frequency."""
    return int(np.clip(0.7 * s.omega / np.pi * s.time, 1, WAVES)) if s.omega > 0 else 2


def wander(r, rate, t, s):
    """A constant, a line and slow cosines of the time."""
    turns = np.arange(WAVES)[:, None, None, None] + 1
    slow = turns <= waves(s)
    course = [np.ones_like(t)[None], s.along(t)[None], slow * np.cos(np.pi * turns * (s.along(t) + 0.5))]
    return s.reading * np.concatenate(course) * np.ones_like(r)


def off(r: Array) -> Array:
    """What is read, from its mean."""
    return r - r.mean(axis=0)


def far(r: Array) -> Array:
    """The squared distance (n, 1, b) from the mean place."""
    return np.sum(off(r) ** 2, axis=1, keepdims=True)


def length(v: Array) -> Array:
    """The speed (1, b)."""
    return np.sqrt(np.sum(v**2, axis=0, keepdims=True))


def weakening(now: Now, c):
    """Friction that falls with the speed, to a third at the usual one."""
    return dry(now, c) / (1 + 2 * length(now.v) / now.s.v)


SPEED, PLACE, READING = "force-of-velocity", "force-of-position", "reading-of-position"
WANDER, LATE, DRIFT, TIME = "zero-wander", "reading-of-velocity", "own-force-drift", "force-of-time"
SLOW = "zero-wander zero-drift camera-drift"
ZERO = "zero-offset constant-force"
UNEVEN = "friction-change"
STRETCHED = f"{ZERO} gain-change buoyancy time-scale"
SLOWER = "linear-drag drag-crisis"  # drag that grows with less than the square of the speed
FRICTION = "coulomb-friction velocity-weakening-friction"
LENS, TILT = "radial-distortion gain-change odd-reading", "camera-tilt anisotropic-scale even-reading"
LOSS, SMALL, ANY = (0.0, np.inf), (-0.3, 0.3), (-np.inf, np.inf)

FORCES = (
    ("linear-drag", SPEED, SLOWER, LOSS, lambda n, c: -c[0] * n.s.force * n.v / n.s.v),
    ("quadratic-drag", SPEED, "quadratic-drag", LOSS, lambda n, c: -c[0] * n.s.force * length(n.v) * n.v / n.s.v**2),
    ("cubic-drag", SPEED, "quadratic-drag", LOSS, lambda n, c: -c[0] * n.s.force * (n.v / n.s.v) ** 3),
    ("dry-friction", SPEED, FRICTION, LOSS, dry),
    ("weakening-friction", SPEED, FRICTION, LOSS, weakening),
    ("constant-force", f"{PLACE} {WANDER} {TIME}", ZERO, ANY, lambda n, c: c[0] * n.s.force),
    ("scale", f"{PLACE} {READING} {TIME}", STRETCHED, (-0.1, 0.1), lambda n, c: c[0] * n.own),
    ("square-force", PLACE, "slack-tether", ANY, lambda n, c: c[0] * n.s.force * (n.x / n.s.x) ** 2),
    ("cubic-force", PLACE, "cubic-stiffness clearance", ANY, lambda n, c: c[0] * n.s.force * (n.x / n.s.x) ** 3),
    ("place-gain", PLACE, UNEVEN, ANY, lambda n, c: c[0] * n.own * n.x / n.s.x),
    ("leak", PLACE, "leak constant-force", LOSS, lambda n, c: -c[0] * n.s.force),
    ("overflow", PLACE, "overflow", LOSS, spill),
    ("force-drift", DRIFT, "parameter-drift", SMALL, lambda n, c: c[0] * n.own * n.s.along(n.t)),
    ("ramp-force", f"{TIME} {WANDER}", "parameter-drift", ANY, lambda n, c: c[0] * n.s.force * n.s.along(n.t)),
    (
        "drag-drift", f"{SPEED} {TIME} {DRIFT}", "friction-change parameter-drift", ANY,
        lambda n, c: c[0] * n.s.force * n.v / n.s.v * n.s.along(n.t),
    ),
)  # fmt: skip
READINGS = (
    ("zero-offset", f"{WANDER} {READING} {PLACE}", ZERO, ANY, lambda r, rate, t, s: s.reading + 0 * r),
    ("zero-line", WANDER, SLOW, ANY, lambda r, rate, t, s: s.reading * s.along(t) + 0 * r),
    ("even-reading", READING, TILT, SMALL, lambda r, rate, t, s: r**2 / s.reading),
    ("odd-reading", READING, LENS, SMALL, lambda r, rate, t, s: r**3 / s.reading**2),
    ("pivot-aside", READING, f"{TILT} zero-offset wrong-pivot", SMALL, lambda r, rate, t, s: np.cos(r) - 1),
    ("pivot-along", READING, f"{LENS} wrong-pivot", SMALL, lambda r, rate, t, s: np.sin(r)),
    ("tilt", READING, TILT, SMALL, lambda r, rate, t, s: off(r) * off(r)[:, -1:] / s.reading),
    ("lens", READING, LENS, SMALL, lambda r, rate, t, s: off(r) * far(r) / s.reading**2),
    ("shutter", LATE, "rolling-shutter", SMALL, lambda r, rate, t, s: r * rate / s.rate),
    ("clock-drift", f"clock {DRIFT}", "time-scale", ANY, lambda r, rate, t, s: s.time * rate * s.along(t) ** 2),
    ("clock-step", "clock", "dropped-frame", ANY, lambda r, rate, t, s: s.time * rate * (s.along(t) > s.step)),
)


def _single(function):
    return lambda r, rate, t, s: function(r, rate, t, s)[None]


def _several(name, kinds, effects, size, **more) -> Term:
    return Term(name, frozenset(kinds.split()), frozenset(effects.split()), ANY, size, **more)


def _one(name, kinds, effects, limits, **more) -> Term:
    return Term(name, frozenset(kinds.split()), frozenset(effects.split()), limits, **more)


TERMS: dict[str, Term] = {
    each.name: each
    for each in (
        *(_one(*row, force=function) for *row, function in FORCES),
        *(_one(*row, reading=_single(function)) for *row, function in READINGS),
        _several("periodic-force", "periodic-force", "periodic-forcing", 3, force=periodic),
        _several("zero-wander", WANDER, SLOW, WAVES + 2, reading=wander),
    )
}
SOAKS = ("force-drift", "drag-drift", "ramp-force", "periodic-force", "zero-wander", "clock-drift", "clock-step")
CLOCK_LIMITS = {"clock-drift": 0.01, "clock-step": 0.02}  # of the whole time
TUNED = 0.15  # how far the frequency of a force may lie from where it was looked for
SWINGS = (
    "quadratic-drag cubic-drag dry-friction weakening-friction constant-force square-force cubic-force force-drift "
    "drag-drift periodic-force zero-offset zero-line zero-wander clock-drift clock-step"
)


def physical(term: Term, coefficients: list[float]) -> bool:
    """Whether all coefficients are of a size that a rig or a camera can have."""
    most = CLOCK_LIMITS.get(term.name, np.inf)
    least, largest = max(term.limits[0], -most), min(term.limits[1], most)
    near = term.name != "periodic-force" or abs(coefficients[2]) < TUNED
    return near and all(least <= value <= largest for value in coefficients)
