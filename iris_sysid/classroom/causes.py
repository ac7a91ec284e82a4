"""Why a group stands out, in plain words, by what its own motion shows and how that differs from the other groups.

A motion carries three rulers itself: its times (the period of a swing, the time of a fall), its lengths (the radius
of the arc, the height of the fall, the body's diameter), and its vertical. A wrong clock changes the first alone, a
wrong scale the second alone, a tilted camera the third; a pendulum that is really longer changes the first two as
gravity demands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from iris_sysid.classroom.evidence import (
    ACCELERATION,
    AMPLITUDE,
    ARC,
    CAPTURE,
    DIAMETER,
    FALL_TIME,
    HEIGHT,
    PERIOD,
    STEP,
    TILT,
)
from iris_sysid.io.schemas import EstimateEntry, GroupDocument, number
from iris_sysid.trajectory.consistency.gravity_scale import NEAR_RATE, RATES_HZ, STANDARD_GRAVITY
from iris_sysid.types import DoubtKind, explained_percent, times_text

CauseKind = Literal[
    "failed", "degrees", "clock", "scale", "tilt", "wrong-body", "constant", "doubtful-track", "another-length",
    "clock-or-scale", "incomplete", "imprecise",
]  # fmt: skip

MIN_GROUPS = 3  # groups that show a quantity, for a group to be compared with them
FACTOR = math.log(1.08)  # of time or length, from which it is named even where the value is not off
SIGNIFICANT = 4.0  # standard errors
AGREES = 0.03  # natural logarithm, beside three standard errors, within which two factors are the same
FRAME_NUMBERS = 1e-6  # s, by which steps of one second may differ from that
PLAIN_RATIO = 1.5  # of two frame rates: at a larger ratio a period alone shows the wrong one
TILTED, TILT_FLOOR = math.radians(3.0), math.radians(0.3)
SPREAD_FLOOR = 0.003  # natural logarithm: pupils hang no two pendulums alike
DEGREES = (35.0, 90.0)  # ratio of amplitudes, 57.3 give or take how far people pull a pendulum out
CALLED = 0.002  # of a frame rate that is called by the next whole number
SIZE = math.log(1.6)  # of two bodies' diameters
UNEXPLAINED, TIMES_OTHERS = 0.01, 20.0  # fraction of the motion's variance, and over that of the other groups
ABOVE_NOISE = 1.5  # of a residual over the noise
RESIDUAL = 5.0  # times that of the other groups
UNIT_FACTORS = {10: "mm for cm", 100: "cm for m", 1000: "mm for m", 2.54: "cm for inches", 3.2808: "feet for m"}
TRACK_DOUBTS: tuple[DoubtKind, ...] = ("another-body", "shadow", "missed", "jumps", "ambiguous", "off-marks")


@dataclass(frozen=True, slots=True)
class Cause:
    """A fault that the evidence shows, and the evidence in a clause."""

    kind: CauseKind
    fault: str
    evidence: str

    @property
    def text(self) -> str:
        """Both in one line."""
        return f"{self.fault}: {self.evidence}" if self.evidence else self.fault


@dataclass(frozen=True, slots=True)
class Offset:
    """How far a group is from the others: by ``value`` (a logarithm, or an angle in rad), known to ``stderr``."""

    value: float
    stderr: float

    @property
    def factor(self) -> float:
        """The ratio whose logarithm is the value."""
        return math.exp(self.value)

    def significant(self, least: float) -> bool:
        """Whether it is larger than ``least`` and than four standard errors."""
        return abs(self.value) > max(least, SIGNIFICANT * self.stderr)

    def agrees(self, other: float, stderr: float = 0.0) -> bool:
        """Whether it is the same as another one with its standard error."""
        return abs(self.value - other) <= AGREES + 3 * math.hypot(self.stderr, stderr)


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """One group beside all groups of its class; ``outlying``: its value stands out, so that smaller faults count."""

    group: GroupDocument
    every: Sequence[GroupDocument]
    outlying: bool

    @property
    def least(self) -> float:
        """The smallest factor, as a logarithm, that is named."""
        return 0.0 if self.outlying else FACTOR

    def ratio(self, name: str) -> Offset | None:
        """Evidence of this group, by ``name``, over the median of the others; None where it is not known."""
        own = self.group.evidence.get(name)
        if own is None or not number(own.value) > 0 or own.unit == "px":
            return None
        others = [
            math.log(number(entry.value))
            for entry in self._of_others(name)
            if entry.unit == own.unit and number(entry.value) > 0
        ]
        if len(others) < MIN_GROUPS:
            return None
        return _offset(math.log(number(own.value)), number(own.stderr) / number(own.value), others, SPREAD_FLOOR)

    def difference(self, name: str) -> Offset | None:
        """Evidence of this group, by ``name``, minus the median of the others; None where it is not known."""
        own = self.group.evidence.get(name)
        others = [number(entry.value) for entry in self._of_others(name)]
        if own is None or own.value is None or len(others) < MIN_GROUPS:
            return None
        return _offset(own.value, number(own.stderr), others, TILT_FLOOR)

    def stated(self, name: str) -> float | None:
        """A constant that was stated for this group; None where it was not."""
        entry = self.group.parameters.get(name)
        return entry.value if entry is not None and entry.measurement_type == "direct" else None

    def _of_others(self, name: str) -> list[EstimateEntry]:
        return [other.evidence[name] for other in self.every if other is not self.group and name in other.evidence]


def _offset(own: float, stderr: float, others: Sequence[float], floor: float) -> Offset:
    middle = float(np.median(others))
    spread = 1.4826 * float(np.median(np.abs(np.array(others) - middle)))
    return Offset(own - middle, math.hypot(stderr, spread, floor))


def causes_of(group: GroupDocument, every: Sequence[GroupDocument], outlying: bool) -> tuple[Cause, ...]:
    """The faults that evidence shows in one group, beside ``every`` group of the class; empty where none is shown.

    ``outlying`` says whether its value stands out: then faults are named that do not count where the value agrees, such
    as a track that is doubtful.
    """
    if not group.usable:
        return _named(group) or (Cause("failed", "no value", group.message),)
    compared = Comparison(group, every, outlying)
    if outlying and (unexplained := _little_explained(compared)):
        return (*_named(group), *unexplained)  # without a period there is no clock to judge
    found = [cause for look in LOOKS for cause in look(compared)]
    if outlying and not found:
        found = [cause for look in WEAKER for cause in look(compared)]
    return tuple(found)


# --------------------------------------------------------------------------- faults that are named wherever they are


def _named(group: GroupDocument) -> tuple[Cause, ...]:
    """What the verdict on the group alone says already: another motion, degrees."""
    reasons = [] if group.verdict is None else group.verdict.reasons
    kinds: dict[DoubtKind, tuple[CauseKind, str]] = {
        "phenomenon": ("wrong-body", "wrong body, or another experiment"),
        "degrees": ("degrees", "angles in degrees read as radians"),
    }
    return tuple(Cause(*kinds[reason.kind], reason.finding) for reason in reasons if reason.kind in kinds)


def _by_verdict(compared: Comparison) -> tuple[Cause, ...]:
    return _named(compared.group)


def _degrees(compared: Comparison) -> tuple[Cause, ...]:
    swing = compared.ratio(AMPLITUDE)
    if swing is None or _named(compared.group) or not DEGREES[0] < max(swing.factor, 1 / swing.factor) < DEGREES[1]:
        return ()
    large = swing.factor > 1
    fault = "angles in degrees read as radians" if large else "angles in radians read as degrees"
    size = max(swing.factor, 1 / swing.factor)
    return (
        Cause("degrees", fault, f"it swings {size:.0f} times {'farther' if large else 'less far'} than the others"),
    )


def _by_file(compared: Comparison) -> tuple[Cause, ...]:
    """The file itself says that it was recorded at another rate than the one it is played at."""
    true, step = compared.group.evidence.get(CAPTURE), compared.group.evidence.get(STEP)
    if true is None or step is None or not number(step.value) > 0:
        return ()
    played = 1 / number(step.value)
    late = Offset(math.log(number(true.value) / played), NEAR_RATE)
    if abs(late.value) < NEAR_RATE:
        return ()
    return (Cause("clock", _rates(played, late), f"the file says that it was recorded at {true.value:g} fps"),)


def _swing(compared: Comparison) -> tuple[Cause, ...]:
    if _by_file(compared):
        return ()
    period, arc = _against_the_length(compared) or (compared.ratio(PERIOD), compared.ratio(ARC))
    if period is None or (arc is None and not period.significant(math.log(PLAIN_RATIO) / 2)):
        return ()
    late = period.significant(compared.least / 2)
    if not late:
        return () if arc is None or not arc.significant(compared.least) else (_scale(arc, "its period agrees"),)
    if arc is None:
        return _plain_clock(compared, period)
    if arc.agrees(2 * period.value, 2 * period.stderr):
        return ()  # a longer pendulum
    beside = "its arc is as large as theirs" if not arc.significant(compared.least) else "its arc does not fit that"
    causes = [_clock(compared, period, beside)]
    if arc.significant(max(compared.least, FACTOR)):
        causes.append(_scale(arc, "its period does not measure that"))
    return tuple(causes)


def _against_the_length(compared: Comparison) -> tuple[Offset | None, Offset | None] | None:
    """Period and arc against the length that the group states; None where it states none."""
    length = compared.stated("length")
    if length is None or not length > 0:
        return None
    demanded = {PERIOD: 2 * math.pi * math.sqrt(length / STANDARD_GRAVITY), ARC: length}

    def off(name: str) -> Offset | None:
        own = compared.group.evidence.get(name)
        if own is None or not number(own.value) > 0 or own.unit == "px":
            return None
        stderr = math.hypot(number(own.stderr) / number(own.value), SPREAD_FLOOR)
        return Offset(math.log(number(own.value) / demanded[name]), stderr)

    return off(PERIOD), off(ARC)


def _plain_clock(compared: Comparison, period: Offset) -> tuple[Cause, ...]:
    """A clock that is wrong by the ratio of two usual frame rates, where nothing else shows it."""
    if max(period.factor, 1 / period.factor) < PLAIN_RATIO or _true_rate(_played(compared), period) is None:
        return ()
    return (_clock(compared, period, "by the ratio of two usual frame rates"),)


def _flight(compared: Comparison) -> tuple[Cause, ...]:
    fall = compared.ratio(ACCELERATION)
    if fall is None or not fall.significant(compared.least) or _by_file(compared):
        return ()
    size, height, duration = compared.ratio(DIAMETER), compared.ratio(HEIGHT), compared.ratio(FALL_TIME)
    clock = Offset(-fall.value / 2, fall.stderr / 2)
    hints = []
    if size is not None:
        hints = [("scale", size.agrees(fall.value, fall.stderr)), ("clock", size.agrees(0.0))]
        beside = "the body itself is"
    elif height is not None and duration is not None:
        longer = duration.agrees(clock.value, clock.stderr) and height.agrees(0.0)
        larger = height.agrees(fall.value, fall.stderr) and duration.agrees(0.0)
        hints, beside = [("scale", larger), ("clock", longer)], "the height of its fall is"
    sure = [kind for kind, agrees in hints if agrees]
    if sure == ["scale"]:
        return (_scale(fall, f"{beside} too {'large' if fall.value > 0 else 'small'} by the same factor"),)
    if sure == ["clock"]:
        return (_clock(compared, clock, f"{beside} as large as theirs"),)
    if max(clock.factor, 1 / clock.factor) < PLAIN_RATIO:
        return ()
    either = f"it falls with {fall.factor:.2g} times the acceleration of the others"
    return (Cause("clock-or-scale", "wrong clock or wrong scale", either),)


def _tilt(compared: Comparison) -> tuple[Cause, ...]:
    turned = compared.difference(TILT)
    if turned is None or not turned.significant(TILTED):
        return ()
    seen = ARC in compared.group.evidence or ACCELERATION in compared.group.evidence
    fault = "camera tilted" if seen else "camera tilted, or angles counted from another zero"
    shown = "it rests" if compared.group.evidence.keys() & {ARC, PERIOD} else "it falls"
    return (Cause("tilt", fault, f"{shown} {math.degrees(abs(turned.value)):.1f}° off the vertical of the others"),)


def _constant(compared: Comparison) -> tuple[Cause, ...]:
    """A constant that this group states, and all others alike state or take otherwise."""
    causes = []
    for name, own in compared.group.parameters.items():
        if own.measurement_type != "direct" or own.value is None or name in compared.group.free:
            continue
        others = [
            other.parameters[name].value
            for other in compared.every
            if other is not compared.group and name in other.parameters and name not in other.free
        ]
        known = np.array([value for value in others if value is not None])
        if len(known) < MIN_GROUPS or np.ptp(known) > 1e-2 * abs(np.median(known)):
            continue
        usual = float(np.median(known))
        if compared.outlying and abs(own.value - usual) > 2e-2 * abs(usual):
            said = f"it was fitted with {own.value:.4g} {own.unit}, the others with {usual:.4g} {own.unit}"
            causes.append(Cause("constant", f"another {name.replace('_', ' ')} than the others", said))
    return tuple(causes)


# --------------------------------------------------------------------------- named where nothing else explains a value


def _little_explained(compared: Comparison) -> tuple[Cause, ...]:
    own, others = _explained(compared.group), [_explained(other) for other in compared.every]
    usual = float(np.nanmedian(others)) if np.isfinite(others).any() else math.nan
    if not (1 - own > max(UNEXPLAINED, TIMES_OTHERS * (1 - usual)) and _residual(compared.group) > ABOVE_NOISE):
        return ()
    said = f"the equation explains {100 * max(own, 0.0):.0f} % of its motion, {explained_percent(usual)} of the others'"
    return (Cause("wrong-body", "wrong body, or a doubtful track", said),)


def _another_body(compared: Comparison) -> tuple[Cause, ...]:
    size = compared.ratio(DIAMETER)
    if size is None or not size.significant(SIZE):
        return ()
    word = "larger" if size.value > 0 else "smaller"
    said = f"what was followed is {max(size.factor, 1 / size.factor):.1f} times {word} than the others' body"
    return (Cause("wrong-body", "wrong body", said),)


def _doubtful_track(compared: Comparison) -> tuple[Cause, ...]:
    doubts = [doubt.finding for doubt in compared.group.track_doubts if doubt.kind in TRACK_DOUBTS]
    doubts += [doubt.finding for doubt in compared.group.track_doubts if doubt.kind not in TRACK_DOUBTS]
    return (Cause("doubtful-track", "doubtful track", doubts[0]),) if doubts else ()


def _another_length(compared: Comparison) -> tuple[Cause, ...]:
    period, arc = compared.ratio(PERIOD), compared.ratio(ARC)
    if period is None or arc is None or not (period.significant(0.0) and arc.significant(0.0)):
        return ()
    if not arc.agrees(2 * period.value, 2 * period.stderr):
        return ()
    word = "longer" if period.value > 0 else "shorter"
    factor = max(period.factor**2, period.factor**-2)
    return (Cause("another-length", f"its pendulum is really {word}", f"arc and period both say {factor:.3g} times"),)


def _incomplete(compared: Comparison) -> tuple[Cause, ...]:
    own, others = _residual(compared.group), [_residual(other) for other in compared.every]
    usual = float(np.nanmedian(others)) if np.isfinite(others).any() else math.nan
    if not own > RESIDUAL * max(usual, 1.0):
        return ()
    said = f"the residual is {times_text(own)} the noise, {times_text(usual)} in the others"
    return (Cause("incomplete", "something acts on its motion that the equation lacks", said),)


def _explained(group: GroupDocument) -> float:
    equation = None if group.verdict is None else group.verdict.equation
    return math.nan if equation is None else number(equation.explained)


def _residual(group: GroupDocument) -> float:
    equation = None if group.verdict is None else group.verdict.equation
    return math.nan if equation is None else number(equation.residual_over_noise)


Look = Callable[[Comparison], tuple[Cause, ...]]
LOOKS: tuple[Look, ...] = (_by_verdict, _degrees, _by_file, _swing, _flight, _tilt, _constant)
WEAKER: tuple[Look, ...] = (_another_body, _doubtful_track, _another_length, _incomplete)


# --------------------------------------------------------------------------- words


def _scale(length: Offset, beside: str) -> Cause:
    size = max(length.factor, 1 / length.factor)
    unit = next((f" ({words}?)" for ratio, words in UNIT_FACTORS.items() if abs(size / ratio - 1) < AGREES), "")
    said = f"all its lengths are {size:.3g} times too {'large' if length.value > 0 else 'small'}{unit}; {beside}"
    return Cause("scale", "wrong scale", said)


def _clock(compared: Comparison, late: Offset, beside: str) -> Cause:
    size = max(late.factor, 1 / late.factor)
    said = f"all its times are {size:.3g} times too {'long' if late.value > 0 else 'short'}; {beside}"
    if _true_rate(_played(compared), late) is None and size < PLAIN_RATIO:
        return Cause("clock", "wrong clock, or another gravity", said)
    return Cause("clock", _rates(_played(compared), late), said)


def _played(compared: Comparison) -> float:
    """Samples a second, as the file has them."""
    return 1 / number(compared.group.evidence[STEP].value)


def _rates(played: float, late: Offset) -> str:
    """A file that is played at one rate, and whose times are late by a factor, in words."""
    if abs(played - 1.0) < FRAME_NUMBERS:
        return "numbers of frames read as seconds"
    true_hz = _true_rate(played, late)
    if true_hz is None:
        return "wrong clock"
    return f"a {_rate_text(_usual(played) or played)} fps file of a {_rate_text(true_hz)} fps recording"


def _rate_text(rate_hz: float) -> str:
    """A frame rate as people call it: 29.97 is 30."""
    whole = round(rate_hz)
    return str(whole) if whole and abs(rate_hz / whole - 1) < CALLED else f"{rate_hz:.4g}"


def _true_rate(played: float, late: Offset) -> float | None:
    """The usual frame rate of the recording whose times are late by a factor; None where none fits."""
    true_hz = _usual(played * late.factor)
    file_hz = _usual(played) or played
    return true_hz if true_hz is not None and late.agrees(math.log(true_hz / file_hz)) else None


def _usual(rate_hz: float) -> float | None:
    """The frame rate of a camera that is near; None where none is."""
    nearest = min(RATES_HZ, key=lambda rate: abs(math.log(rate / rate_hz)))
    return float(nearest) if abs(math.log(nearest / rate_hz)) < NEAR_RATE else None
