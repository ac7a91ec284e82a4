"""The parts of a residual in words: what each is, and what it stands for in an experiment."""

from __future__ import annotations

from collections.abc import Mapping

from iris_sysid.types._components import ComponentKind, ComponentSide

# predicates of "81 % of the residual ..."
KINDS_IN_WORDS: Mapping[ComponentKind, str] = {
    "force-of-velocity": "depends on the velocity like drag or friction",
    "force-of-position": "is a force that depends on the position",
    "force-of-time": "is a force that changes slowly with time",
    "own-force-drift": "is a slow change of the equation's own force",
    "pulse": "is a pulse",
    "periodic-force": "is a periodic force",
    "zero-wander": "is a slow wander of the zero",
    "reading-of-position": "is an error of the reading that depends on the position",
    "reading-of-velocity": "is an error of the reading that depends on the velocity",
    "clock": "comes from the clock",
    "input": "is an error of the measured input",
}
MEANINGS: Mapping[ComponentKind, str] = {
    "force-of-velocity": "",
    "force-of-position": "a stiffness, the direction of gravity, or the geometry",
    "force-of-time": "wind, or a supply that drifts",
    "own-force-drift": "a parameter changes with time",
    "pulse": "an impact, a push or a late release",
    "periodic-force": "something drives the motion",
    "zero-wander": "the support, the camera or the sensor moves",
    "reading-of-position": "the picture's geometry, the scale or the pivot",
    "reading-of-velocity": "a lag, the exposure or the rolling shutter",
    "clock": "lost frames or a wrong rate",
    "input": "its gain, its lag or its noise",
}
KIND_NAMES: Mapping[ComponentKind, str] = {
    "force-of-velocity": "force by velocity",
    "force-of-position": "force by position",
    "force-of-time": "slow force in time",
    "own-force-drift": "change of the equation's own force",
    "pulse": "pulse",
    "periodic-force": "periodic force",
    "zero-wander": "wander of the zero",
    "reading-of-position": "error of the reading by position",
    "reading-of-velocity": "error of the reading by velocity",
    "clock": "error of the clock",
    "input": "error of the measured input",
}
SIDE_NAMES: Mapping[ComponentSide, str] = {
    "force": "the forces",
    "reading": "the reading",
    "clock": "the clock",
    "input": "the measured input",
}
