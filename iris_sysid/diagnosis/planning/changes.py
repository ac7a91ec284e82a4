"""Changes of a set-up that a person with a camera can make for one more clip, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from iris_sysid.types import Effect, OdeModel

RELEASES_DEG = (-60.0, -20.0, 10.0, 20.0, 45.0, 75.0)  # from rest; a cord goes slack beyond 90 degrees
RECTIFIED = ("camera-tilt", "radial-distortion", "anisotropic-scale")  # what a board in the plane of motion removes
CLAMPED = ("camera-drift",)  # what a tripod removes
PLUMBED = ("zero-offset",)  # what angles from a plumb line do not have
ALIKE_RELEASE = 0.15  # relative difference of two releases below which one is a repeat of the other
FLIGHTS = (["z", "vz"], ["x", "z", "vx", "vz"])  # states of what falls, and of what is thrown
LEVELS = (0.6, 1.5)  # of a first level, or of an amplitude
DRIVES = (0.5, 2.0)  # of the inputs
# mass and radius over today's
BALLS = (("a ball of the same size, 4 times as heavy", 4.0, 1.0), ("a ball half as wide, of the same kind", 0.125, 0.5))


@dataclass(frozen=True, slots=True)
class SetUpChange:
    """One more clip, made with one thing changed; what is not named stays as it is today.

    ``longer`` and ``faster`` are factors on the length of the clip and on its frame rate, ``start`` the new initial
    values by name in the model's units, ``body`` factors on the body's ``mass``, ``radius``, cord ``length`` or the
    stiffness of its ``spring``, ``steeper`` a factor on the acceleration of an incline, ``driven`` one on the inputs.
    Effects in ``without`` cannot act in the new clip. ``clips`` is how many such clips are made.
    """

    name: str
    text: str
    longer: float = 1.0
    faster: float = 1.0
    start: Mapping[str, float] = field(default_factory=dict)
    body: Mapping[str, float] = field(default_factory=dict)
    steeper: float = 1.0
    driven: float = 1.0
    without: tuple[str, ...] = ()
    clips: int = 1

    def joined(self, other: SetUpChange) -> SetUpChange | None:
        """Both changes at once; None where they exclude one another."""
        clash = (self.start and other.start) or (self.body and other.body) or self.name == other.name
        clash = clash or self.driven != 1.0 != other.driven
        if clash or self.longer != 1.0 != other.longer or "repeat" in (self.name, other.name):
            return None
        return replace(
            self,
            name=f"{self.name} + {other.name}",
            text=f"{self.text}, and {other.text}",
            longer=self.longer * other.longer,
            faster=self.faster * other.faster,
            start={**self.start, **other.start},
            body={**self.body, **other.body},
            steeper=self.steeper * other.steeper,
            driven=self.driven * other.driven,
            without=(*self.without, *other.without),
            clips=max(self.clips, other.clips),
        )


REPEAT = SetUpChange("repeat", "the same once more")


def changes_for(model: OdeModel, start: Mapping[str, float], effects: Sequence[Effect]) -> list[SetUpChange]:
    """The changes that make sense for a model and for the effects in question, a repeat of the same set-up first.

    Parameters
    ----------
    model
        The governing equation.
    start
        Today's initial values by name, in the model's units.
    effects
        The alternatives: one of them acts.
    """
    found = [REPEAT, replace(REPEAT, name="repeat-3", text="the same three times more", clips=3)]
    found += [SetUpChange("fast", "four times the frame or sample rate", faster=4.0)]
    found += _motions(model, start)
    found += _bodies(model, effects)
    names = {effect.name for effect in effects}
    if names & set(RECTIFIED):
        found.append(SetUpChange("board", "a board in the plane of motion as calibration", without=RECTIFIED))
    if names & set(CLAMPED):
        found.append(SetUpChange("tripod", "the camera clamped to something fixed", without=CLAMPED))
    if names & set(PLUMBED) and model.observed[0].unit == "rad" and model.with_role("gravity"):
        found.append(SetUpChange("plumb-line", "a plumb line in the picture, and angles from it", without=PLUMBED))
    if model.inputs:
        found += [SetUpChange(f"drive-{each:g}", f"drive it {each:g} times as hard", driven=each) for each in DRIVES]
    return found


def _motions(model: OdeModel, start: Mapping[str, float]) -> list[SetUpChange]:
    """Other starts, and longer clips where the motion stays in the picture."""
    longer = SetUpChange("long", "a record three times as long", longer=3.0)
    first, hangs = model.states[0], bool(model.with_role("gravity"))
    if not model.second_order:
        return [longer, *(_level(model, start, factor) for factor in LEVELS)]
    if len(model.states) == 2 and first.unit == "rad" and hangs:
        return [longer, *_releases(model, start)]
    if first.name == "s" or ([state.name for state in model.states] in FLIGHTS and hangs):
        return _throws(model, start)
    return [longer, *(_level(model, start, factor) for factor in (*LEVELS, -1.0))]


def _level(model: OdeModel, start: Mapping[str, float], factor: float) -> SetUpChange:
    text = "start from the other side" if factor < 0 else f"start from {factor:g} times as far from rest"
    moved = {name: factor * start[name] for name in model.initial_names}
    return SetUpChange(f"start-{factor:g}", text, start=moved)


def _releases(model: OdeModel, start: Mapping[str, float]) -> list[SetUpChange]:
    """Releases from rest at angles that are not today's."""
    angle, rate = model.initial_names
    new = [np.radians(degrees) for degrees in RELEASES_DEG]
    apart = [value for value in new if abs(value - start[angle]) > ALIKE_RELEASE * abs(value)]
    return [
        SetUpChange(
            f"release{np.degrees(value):.0f}",
            f"release at {np.degrees(value):.0f} degrees, from rest",
            start={angle: value, rate: 0.0},
        )
        for value in apart
    ]


def _throws(model: OdeModel, start: Mapping[str, float]) -> list[SetUpChange]:
    """Falls, throws and slides: from rest, and at other speeds; longer ones need more way."""
    half = len(model.states) // 2
    speeds = model.initial_names[half:]
    size = max(float(np.hypot.reduce([start[name] for name in speeds])), 0.5)
    longer = SetUpChange("long", "one and a half times as long a flight, from higher or further up", longer=1.5)
    if half == 1:
        pushes = [(speeds[0], 0.0, "from rest"), (speeds[0], 2.0 * size, f"pushed off at {2 * size:.2g} m/s")]
        pushes += [(speeds[0], 2.0, "thrown upwards at 2 m/s")] if model.with_role("gravity") and size < 2 else []
        return [longer, *(SetUpChange(f"start {text}", text, start={name: v}) for name, v, text in pushes)]
    aimed = []
    for degrees in (30.0, 50.0, 75.0):
        velocity = size * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        thrown = dict(zip(speeds, velocity.tolist(), strict=True))
        aimed.append(SetUpChange(f"throw{degrees:.0f}", f"a throw at {degrees:.0f} degrees", start=thrown))
    faster = {name: 1.5 * start[name] for name in speeds}
    return [longer, *aimed, SetUpChange("throw-hard", "a throw 1.5 times as fast", start=faster, longer=1.3)]


def _bodies(model: OdeModel, effects: Sequence[Effect]) -> list[SetUpChange]:
    """Another ball, cord or spring, where it is known how the size of an effect goes with it."""
    scaling = [set(effect.scaling) for effect in effects]
    found = []
    if any({"mass", "radius"} <= known for known in scaling):
        found += [
            SetUpChange(f"ball-{mass:g}", text, body={"mass": mass, "radius": radius}) for text, mass, radius in BALLS
        ]
    if any("length" in known for known in scaling) and any(each.name == "length" for each in model.parameters):
        found.append(SetUpChange("cord", "a cord twice as long", body={"length": 2.0}))
    if any("spring" in known for known in scaling) and any(each.name == "stiffness" for each in model.parameters):
        found.append(SetUpChange("spring", "springs twice as stiff between the same ends", body={"spring": 2.0}))
    if any(each.name == "acceleration" for each in model.parameters):
        found.append(SetUpChange("steeper", "a steeper board: twice the acceleration", steeper=2.0))
    return found
