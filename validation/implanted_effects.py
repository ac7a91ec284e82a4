"""Effects of known size that are added to real recordings: the laws and the forces of their own, and SciPy.

A recording is a fitted motion and a real residual. Added is a simulation with the effect minus one without it, so that
noise, wander and misfit stay real. Nothing of the search takes part but the fit of the base model, which gives the
motion and shows how much of an effect its own parameters imitate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from iris_sysid import FitOptions, FitResult, Segment, Trajectory, fit
from validation.implanted_scores import Hidden
from validation.world_recordings import BOTTOM_M2, HOLE_M, HOLE_RADIUS_M, TANK_M, TOP_M2, Recording

Array = NDArray[np.float64]
Values = Mapping[str, float]
Law = Callable[[float, float, Values], float]  # (position, velocity, values) -> acceleration, or rate
Force = Callable[[float, float, float, float], float]  # (t since the start, position, velocity, base) -> added to it
Term = Callable[[float, float, float, float, float, Values], float]  # the same, then size and shape

SMALL = 1e-3  # of the model's own force, or of the motion's spread: where the search of a size starts
MAX_SHARE = 0.5  # of them: an effect beyond is no small correction
IMITATED = 1e-3  # share of a change that is left by the refitted parameters, below which nothing can show it
CLOSE, ACCEPTED = 0.02, 0.3  # relative errors of the trace: the search ends, and its best result may be used
ROUNDS = 14  # of refits
STEP = 4.0  # largest factor from one size to the next: a strong drag ends the motion, and leaves less
MOMENT = 0.4  # share of the clip at which frames are lost
MAX_LOST = 0.1  # of the samples
TURNOVER = 1e-3  # of the largest speed, over which dry friction changes its sign
OFF_OWN_RATE = 1.618  # rate of the forcing over the motion's own: near neither it nor a harmonic
CYCLES = 2.7  # of the forcing in a clip that does not swing
SLOW = 6  # half cycles of the fastest part of a wander in the clip, or
REPEATS = 3  # reversals from which a motion has swings
SLOWER = 0.5  # of the half cycles of the motion: what is as fast as a swing is no slow wander


class NotShownError(ArithmeticError):
    """An effect that a recording cannot show at the wanted size; the text says why."""


# Laws ---------------------------------------------------------------------------------------------------------------


def _tank(level: float, rate: float, values: Values) -> float:
    """A(h) h' = -C a sqrt(2 g h), with sides that widen evenly from the bottom to the top."""
    above = max(level, 0.0)
    share = (above + HOLE_M) / TANK_M
    side = (1 - share) * math.sqrt(BOTTOM_M2) + share * math.sqrt(TOP_M2)
    return -values["discharge"] * math.pi * HOLE_RADIUS_M**2 * math.sqrt(2 * 9.81 * above) / side**2


def _spring(x: float, v: float, values: Values) -> float:
    return -values["stiffness"] * x - values["damping"] * v


LAWS: Mapping[str, Law] = {
    "pendulum": lambda x, v, values: -values["gravity"] / values["length"] * math.sin(x) - values["damping"] * v,
    "linear-oscillator": _spring,
    "torsion-wheel": _spring,
    "free-fall": lambda x, v, values: -values["gravity"],
    "incline": lambda x, v, values: values["acceleration"],
    "coasting-ball": lambda x, v, values: -values["damping"] * v,
    "tapered-tank": _tank,
}
FIRST_ORDER = frozenset({"tapered-tank"})
PULLED_BACK = frozenset({"pendulum", "linear-oscillator", "torsion-wheel"})
MOVES = frozenset(LAWS) - FIRST_ORDER


def _seen(model: str, x: Array, v: Array, values: Values) -> Array:
    """What is read off (n,) of positions and velocities (n,)."""
    if model == "pendulum":
        return x + values["vertical"] - values["pivot_across"] * np.cos(x) - values["pivot_along"] * np.sin(x)
    if model == "torsion-wheel":
        return v
    return x * values.get("magnification", 1.0)


def states(model: str, values: Values, start: tuple[float, ...], t_s: Array, force: Force | None = None) -> Array:
    """Positions and velocities (2, n) at times (n,) s since the start, by Dormand and Prince's method of order 8.

    Parameters
    ----------
    model
        Name of the governing equation.
    values
        Its parameters by name.
    start
        State at the time 0: position, and velocity unless the law is of first order.
    t_s
        Increasing, s.
    force
        Added to the acceleration, or to the rate of a law of first order.
    """
    law, first_order = LAWS[model], model in FIRST_ORDER

    def highest(t: float, x: float, v: float) -> float:
        base = law(x, v, values)
        return base if force is None else base + force(t, x, base if first_order else v, base)

    def rates(t: float, state: Array) -> tuple[float, ...]:
        if first_order:
            return (highest(t, float(state[0]), 0.0),)
        return float(state[1]), highest(t, float(state[0]), float(state[1]))

    span, fine = (0.0, float(t_s[-1])), 1e-11 * max(map(abs, start))  # the first samples may be outliers
    solved = solve_ivp(rates, span, start, "DOP853", t_s, rtol=1e-10, atol=fine, max_step=span[1] / 50)
    if not solved.success or solved.y.shape[1] < t_s.size:
        raise NotShownError(f"the motion diverges: {solved.message}")
    x = solved.y[0]
    return np.array([x, [highest(*each, 0.0) for each in zip(t_s, x, strict=True)] if first_order else solved.y[1]])


@dataclass(frozen=True, eq=False, slots=True)
class Base:
    """A recording's clip with the fit of its base model."""

    recording: Recording
    clip: Trajectory
    fit: FitResult

    @property
    def model(self) -> str:
        """Name of the governing equation."""
        return self.recording.model.name

    @property
    def values(self) -> Values:
        """All values of the fit."""
        return {name: estimate.value for name, estimate in self.fit.estimates.items()}

    @property
    def inside(self) -> NDArray[np.intp]:
        """Numbers (m,) of the samples from the first to the last that the fit uses."""
        used = np.flatnonzero(self.fit.used)
        return np.arange(used[0], used[-1] + 1)

    @property
    def rms(self) -> float:
        """Root mean square of the recording's own residual."""
        return rms(self.fit.residual[self.fit.used])

    def motion(self, t_s: Array, force: Force | None = None) -> Array:
        """Positions and velocities (2, m) of the fitted motion at times (m,) s since its start."""
        start = tuple(self.values[name] for name in self.recording.model.initial_names)
        return states(self.model, self.values, start, t_s, force)

    def times(self) -> Array:
        """Times (m,) of the samples inside, s since the start of the fit."""
        return self.clip.t_s[self.inside] - self.fit.t0_s


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def based(recording: Recording, clip: Trajectory, start: Values | None = None) -> Base:
    """The clip with the fit of its base model; with ``start`` the fit goes downhill from there."""
    options = FitOptions() if start is None else FitOptions(local=True, discrepancy=False)
    known = {"fixed": recording.fixed, "free": recording.free}
    result = fit(clip, recording.model, **known, start=start or {}, options=options)
    if not result.usable:
        raise NotShownError(f"the base model cannot be fitted ({result.status}): {result.message}")
    return Base(recording, clip, result)


# Effects ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class Changed:
    """A clip with an effect in it; ``kept`` (n,) numbers its samples in the clip before, ``size`` is the true one."""

    clip: Trajectory
    kept: NDArray[np.intp]
    size: float


@dataclass(frozen=True, eq=False, slots=True)
class Implant(Hidden):
    """An effect to add to a table.

    ``models`` can show it; ``unit(base)`` is a size of SMALL times the model's force or the motion, and
    ``add(base, size)`` the clip with the effect. A ``whole`` size is a number of frames.
    """

    models: frozenset[str]
    unit: Callable[[Base], float]
    add: Callable[[Base, float], Changed]
    whole: bool = False


def _read_as(base: Base, change: Array, size: float) -> Changed:
    """The clip with a change (m,) of what is read off inside."""
    position = base.clip.position.copy()
    position[base.inside, 0] += change
    moved = base.clip.with_(position=position, systematic=base.clip.systematic, smoothed=None)
    return Changed(moved, np.arange(base.clip.n), size)


def forced(term: Term, shape: Callable[[Base], Values], base: Base, size: float) -> Changed:
    """The clip with a force: the simulation with it minus the one without."""
    t_s, form = base.times(), shape(base)
    alone = _seen(base.model, *base.motion(t_s), base.values)
    acted = base.motion(t_s, lambda t, x, v, own: term(t, x, v, own, size, form))
    return _read_as(base, _seen(base.model, *acted, base.values) - alone, size)


def _small_force(term: Term, shape: Callable[[Base], Values], base: Base) -> float:
    """A size at which the force is a thousandth of the model's own."""
    t_s, form, law = base.times(), shape(base), LAWS[base.model]
    x, v = base.motion(t_s)
    own = np.array([law(*state, base.values) for state in zip(x, v, strict=True)])
    along = np.array([term(*row, 1.0, form) for row in zip(t_s, x, v, own, strict=True)])
    return SMALL * rms(own) / rms(along)


def _small_reading(base: Base) -> float:
    return SMALL * float(np.std(base.fit.predicted[base.inside]))


def _no_shape(base: Base) -> Values:
    return {}


def _turnover(base: Base) -> Values:
    return {"turnover": TURNOVER * float(np.max(np.abs(base.motion(base.times())[1])))}


def _begun(base: Base) -> Values:
    return {"late": base.fit.t0_s - float(base.clip.t_s[0])}


def _rate(base: Base) -> Values:
    """A rate of the forcing, 1/s, away from the motion's own."""
    values, span = base.values, float(np.ptp(base.times()))
    squared = values["gravity"] / values["length"] if base.model == "pendulum" else values.get("stiffness", 0.0)
    return {"rate": OFF_OWN_RATE * math.sqrt(squared) if squared > 0 else 2 * math.pi * CYCLES / span}


def quadratic_drag(t: float, x: float, v: float, base: float, size: float, shape: Values) -> float:
    """-c |v| v."""
    return -size * abs(v) * v


def dry_friction(t: float, x: float, v: float, base: float, size: float, shape: Values) -> float:
    """-c sign v, which turns over a small speed."""
    return -size * math.tanh(v / shape["turnover"])


def cubic_stiffness(t: float, x: float, v: float, base: float, size: float, shape: Values) -> float:
    """-k x^3."""
    return -size * x**3


def growing_force(t: float, x: float, v: float, base: float, size: float, shape: Values) -> float:
    """The model's own force grows evenly with the time since the clip's first sample."""
    return size * (t + shape["late"]) * base


def sinusoid(t: float, x: float, v: float, base: float, size: float, shape: Values) -> float:
    """A sine of the time."""
    return size * math.sin(shape["rate"] * t + 1.0)


def shifted(base: Base, size: float) -> Changed:
    """The clip read from another zero."""
    return _read_as(base, np.full(base.inside.size, size), size)


def wandering(base: Base, size: float) -> Changed:
    """The clip read from a zero that wanders: half cosines of the clip, rms ``size``, the same in every run.

    It is slower than the motion, where that turns.
    """
    share = base.times() / float(np.ptp(base.times()))
    turns = int(np.sum(np.diff(np.sign(base.motion(base.times())[1])) != 0))
    waves = min(SLOW, int(SLOWER * turns)) if turns >= REPEATS else SLOW
    weights = np.random.default_rng(7).standard_normal(waves)
    course = sum(weight * np.cos(np.pi * (k + 1) * share) for k, weight in enumerate(weights))
    return _read_as(base, size * course / rms(course), size)


def frames_lost(base: Base, size: float) -> Changed:
    """The clip without a number of frames, and the gap closed; the true size is the time lost, s."""
    clip, lost = base.clip, round(size)
    first = int(base.inside[round(MOMENT * base.inside.size)])
    kept = np.delete(np.arange(clip.n), np.arange(first, first + lost))
    gap_s = float(clip.t_s[first + lost] - clip.t_s[first])
    t_s = clip.t_s[kept] - np.where(kept > first, gap_s, 0.0)
    parts = [(part, *map(int, np.searchsorted(kept, [part.start, part.stop]))) for part in clip.segments]
    cut = clip.with_(
        t_s=t_s,
        position=clip.position[kept],
        sigma=clip.sigma[kept],
        valid=clip.valid[kept],
        segments=tuple(Segment(part.label, start, stop, part.reason) for part, start, stop in parts if stop > start),
        systematic={source: patterns[:, kept] for source, patterns in clip.systematic.items()},
        smoothed=None,
    )
    return Changed(cut, kept, gap_s)


def _force(
    name: str, kinds: str, models: frozenset[str], term: Term, parameter: str, shape: Callable[[Base], Values]
) -> Implant:
    unit, add = partial(_small_force, term, shape), partial(forced, term, shape)
    return Implant(name, frozenset({name}), frozenset(kinds.split()), parameter, models, unit, add)


ZEROS, DRIFTS = frozenset({"zero-offset", "constant-force"}), frozenset({"camera-drift", "zero-drift"})
EVERY = frozenset(LAWS)
IMPLANTS: tuple[Implant, ...] = (
    _force("quadratic-drag", "force-of-velocity", MOVES, quadratic_drag, "quadratic_drag", _no_shape),
    _force("coulomb-friction", "force-of-velocity", MOVES - {"free-fall"}, dry_friction, "coulomb_friction", _turnover),
    _force("cubic-stiffness", "force-of-position", PULLED_BACK, cubic_stiffness, "cubic_stiffness", _no_shape),
    _force("parameter-drift", "own-force-drift force-of-time", EVERY, growing_force, "parameter_drift", _begun),
    _force("periodic-forcing", "periodic-force", MOVES, sinusoid, "periodic_forcing", _rate),
    Implant(
        "dropped-frame", frozenset({"dropped-frame"}), frozenset({"clock"}), "dropped_frame", EVERY,
        lambda base: 1.0, frames_lost, whole=True,
    ),
    Implant(
        "zero-offset", ZEROS, frozenset({"zero", "constant", "zero-wander", "reading-of-position"}), "zero_offset",
        EVERY, _small_reading, shifted,
    ),
    Implant("zero-wander", DRIFTS | {"zero-wander"}, frozenset({"zero-wander"}), "", EVERY, _small_reading, wandering),
)  # fmt: skip


# Sizes --------------------------------------------------------------------------------------------------------------


def trace(base: Base, changed: Changed) -> float:
    """Root mean square of what a change leaves in the residual once the base model is fitted again."""
    start = {name: base.values[name] for name in base.fit.free}
    try:
        again = based(base.recording, changed.clip, start).fit
    except NotShownError:  # too far downhill
        again = based(base.recording, changed.clip).fit
    both = base.fit.used[changed.kept] & again.used
    return rms(again.residual[both] - base.fit.residual[changed.kept][both])


def sized(implant: Implant, base: Base, multiple: float) -> tuple[Changed, float]:
    """The clip with an effect whose trace is a multiple of the recording's own residual, and the multiple reached.

    Raises
    ------
    NotShownError
        When the fitted values imitate the effect, or it would have to be as large as the motion.
    """
    return (_whole_number if implant.whole else _any_number)(implant, base, multiple)


def _whole_number(implant: Implant, base: Base, multiple: float) -> tuple[Changed, float]:
    """The number of frames, at least one, whose trace is nearest; one after the other grows about evenly."""
    one = implant.add(base, 1.0)
    frames = max(1, round(multiple * base.rms / trace(base, one)))
    if frames > MAX_LOST * base.inside.size:
        raise NotShownError(f"{frames} frames of {base.inside.size} would have to be lost")
    changed = implant.add(base, frames)
    reached = trace(base, changed) / base.rms
    if reached < (1.0 - ACCEPTED) * multiple:
        raise NotShownError(f"{frames} frames leave {reached:.2g} times")
    return changed, reached


def _any_number(implant: Implant, base: Base, multiple: float) -> tuple[Changed, float]:
    """A size by steps upwards until the trace is large enough, then by a power law between the nearest two."""
    size, most = implant.unit(base), MAX_SHARE / SMALL * implant.unit(base)
    tried: list[tuple[float, float, Changed]] = []  # size, multiple reached, clip
    while len(tried) < ROUNDS and size < most:
        changed = implant.add(base, size)
        tried.append((size, _reached(base, changed), changed))
        if abs(tried[-1][1] / multiple - 1) < CLOSE:
            break
        size = _next_size([each[:2] for each in tried], multiple)
    _, reached, changed = min(tried, key=lambda each: abs(each[1] / multiple - 1))
    if abs(reached / multiple - 1) > ACCEPTED:
        raise NotShownError(f"no size below {MAX_SHARE:g} of the model's force or motion leaves {multiple:g} times")
    return changed, reached


def _next_size(tried: Sequence[tuple[float, float]], multiple: float) -> float:
    """The next size after some (size, multiple reached): on the line between the two about it, in logarithms."""
    above = min((each for each in tried if each[1] > multiple), default=None)
    if above is None:
        size, reached = max(tried)
        return size * float(np.clip(multiple / reached, 1.0, STEP))
    below = max((each for each in tried if each[1] <= multiple and each[0] < above[0]), default=None)
    if below is None:
        return above[0] * float(np.clip(multiple / above[1], 1 / STEP, 1.0))
    power = math.log(above[0] / below[0]) / math.log(above[1] / below[1])
    return below[0] * (multiple / below[1]) ** power


def _reached(base: Base, changed: Changed) -> float:
    left = trace(base, changed)
    if left < IMITATED * rms((changed.clip.position - base.clip.position)[base.inside]):
        raise NotShownError("the fitted values imitate it")
    return max(left / base.rms, 1e-9)
