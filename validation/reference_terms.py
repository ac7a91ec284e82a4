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
class Term:
    """One candidate: the ``kinds`` of component that it stands for, and the library's ``effects``.

    ``force(t, x, v, own, c, scales)`` is an acceleration (d, b) at the time ``t``, s: ``x`` and ``v`` (d, b), ``own``
    (d, b) the base model's force, ``c`` the coefficients (b,). ``reading(r, rate, t, scales)`` gives the functions
    (size, n, d, b) that the coefficients multiply, of what is read (n, d, b), its rate, and the time (n, 1, 1).
    """

    name: str
    kinds: frozenset[str]
    effects: frozenset[str]
    size: int = 1
    force: Callable[..., Array] | None = None
    reading: Callable[..., Array] | None = None

    @property
    def names(self) -> list[str]:
        """The names of its coefficients."""
        return [f"{self.name}/{k}" for k in range(self.size)]


def periodic(t, x, v, own, c, s):
    """A force at one frequency, near the one where it was looked for."""
    phase = s.line * (1 + c[2]) * (t - s.middle)
    return s.force * (c[0] * np.cos(phase) + c[1] * np.sin(phase))


def spill(t, x, v, own, c, s):
    """What flows over the rim of the upper tank, full at 10 V."""
    over = c[0] * np.maximum(own[0], 0) / (1 + np.exp(-(x[0] - 10.0) / 0.1))
    return np.array([-over, np.zeros_like(over)])


def waves(s: Scales) -> int:
    """How many half waves a wander has: below 0.7 of the motion's own frequency."""
    return int(np.clip(0.7 * s.omega / np.pi * s.time, 1, WAVES)) if s.omega > 0 else 2


def wander(r, rate, t, s):
    """Slow cosines of the time."""
    turns = np.arange(WAVES)[:, None, None, None] + 1
    slow = turns <= waves(s)
    return s.reading * slow * np.cos(np.pi * turns * (s.along(t) + 0.5)) * np.ones_like(r)


def off(r: Array) -> Array:
    """What is read, from its mean."""
    return r - r.mean(axis=0)


def far(r: Array) -> Array:
    """The squared distance (n, 1, b) from the mean place."""
    return np.sum(off(r) ** 2, axis=1, keepdims=True)


def length(v: Array) -> Array:
    """The speed (1, b)."""
    return np.sqrt(np.sum(v**2, axis=0, keepdims=True))


def term(name: str, kinds: str, effects: str = "", size: int = 1, force=None, reading=None) -> Term:
    """A candidate; kinds and effects with blanks between."""
    return Term(name, frozenset(kinds.split()), frozenset(effects.split()), size, force, reading)


SPEED, PLACE, READING = "force-of-velocity", "force-of-position", "reading-of-position"
WANDER, LATE = "zero-wander", "reading-of-velocity"
SLOW = "zero-drift camera-drift"
ZERO = "zero-offset constant-force"
FRICTION = "coulomb-friction velocity-weakening-friction"
LENS, TILT = "radial-distortion gain-change", "camera-tilt anisotropic-scale"

FORCES = (
    term("linear-drag", SPEED, "linear-drag", 1, lambda t, x, v, own, c, s: -c[0] * s.force * v / s.v),
    term("quadratic-drag", SPEED, "quadratic-drag", 1, lambda t, x, v, own, c, s: -c[0] * s.force * length(v) * v / s.v**2),
    term("cubic-drag", SPEED, "quadratic-drag", 1, lambda t, x, v, own, c, s: -c[0] * s.force * (v / s.v) ** 3),
    # Below half a per cent of the usual speed its sign is rounded, so that the integration stays smooth.
    term("dry-friction", SPEED, FRICTION, 1, lambda t, x, v, own, c, s: -c[0] * s.force * v / np.sqrt(v**2 + (0.005 * s.v) ** 2)),
    term("constant-force", f"{PLACE} {WANDER} force-of-time", ZERO, 1, lambda t, x, v, own, c, s: c[0] * s.force),
    term("square-force", PLACE, "", 1, lambda t, x, v, own, c, s: c[0] * s.force * (x / s.x) ** 2),
    term("cubic-force", PLACE, "cubic-stiffness", 1, lambda t, x, v, own, c, s: c[0] * s.force * (x / s.x) ** 3),
    term("place-gain", PLACE, "", 1, lambda t, x, v, own, c, s: c[0] * own * x / s.x),
    term("place-gain-2", PLACE, "", 2, lambda t, x, v, own, c, s: own * (c[0] + c[1] * x / s.x) * x / s.x),
    term("overflow", PLACE, "overflow", 1, spill),
    term("leak", PLACE, "leak constant-force", 1, lambda t, x, v, own, c, s: -c[0] * s.force),
    term("force-drift", "own-force-drift", "parameter-drift", 1, lambda t, x, v, own, c, s: c[0] * own * s.along(t)),
    term("ramp-force", f"force-of-time {WANDER}", "parameter-drift", 1, lambda t, x, v, own, c, s: c[0] * s.force * s.along(t)),
    term("drag-drift", f"{SPEED} force-of-time own-force-drift", "friction-change parameter-drift", 1, lambda t, x, v, own, c, s: c[0] * s.force * v / s.v * s.along(t)),
    term("periodic-force", "periodic-force", "periodic-forcing", 3, periodic),
)  # fmt: skip
READINGS = (
    ("zero-offset", f"{WANDER} {READING} {PLACE}", ZERO, lambda r, rate, t, s: s.reading + 0 * r),
    ("zero-line", WANDER, SLOW, lambda r, rate, t, s: s.reading * s.along(t) + 0 * r),
    ("even-reading", READING, TILT, lambda r, rate, t, s: r**2 / s.reading),
    ("odd-reading", READING, LENS, lambda r, rate, t, s: r**3 / s.reading**2),
    ("pivot-aside", READING, f"{TILT} zero-offset", lambda r, rate, t, s: np.cos(r) - 1),
    ("pivot-along", READING, LENS, lambda r, rate, t, s: np.sin(r)),
    ("tilt", READING, TILT, lambda r, rate, t, s: off(r) * off(r)[:, -1:] / s.reading),
    ("lens", READING, LENS, lambda r, rate, t, s: off(r) * far(r) / s.reading**2),
    ("shutter", LATE, "rolling-shutter", lambda r, rate, t, s: r * rate / s.rate),
    ("speed-reading", LATE, "", lambda r, rate, t, s: s.reading * (rate / s.rate) ** 2),
    ("clock-drift", "clock own-force-drift", "time-scale", lambda r, rate, t, s: s.reading / s.rate * rate * s.along(t) ** 2),
    ("clock-step", "clock", "dropped-frame", lambda r, rate, t, s: s.reading / s.rate * rate * (s.along(t) > s.step)),
)  # fmt: skip


def _single(function):
    return lambda r, rate, t, s: function(r, rate, t, s)[None]


TERMS: dict[str, Term] = {
    each.name: each
    for each in (
        *FORCES,
        *(term(name, kinds, effects, reading=_single(function)) for name, kinds, effects, function in READINGS),
        term("zero-wander", WANDER, SLOW, WAVES, reading=wander),
    )
}
