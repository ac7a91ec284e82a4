"""A scene: one phenomenon, from its parameters to everything that moves in the image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from iris_sysid.registry import Registry
from iris_sysid.synthetic.camera import CameraView
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.shapes import Colour, Layer, Path
from iris_sysid.types import Array, Estimate, Parameter

Curve = Callable[[Array], Array]  # times (n,) s -> values (n,)


@dataclass(frozen=True, slots=True)
class Setup:
    """Request for a scene: parameters and hidden effects by name, length, look, and the random generator."""

    parameters: Mapping[str, float]
    effects: Mapping[str, float]
    duration_s: float
    look: Look
    rng: np.random.Generator

    def __getitem__(self, name: str) -> float:
        return self.parameters[name]


@dataclass(frozen=True, eq=False, slots=True)
class SceneBody:
    """One body: where its centre truly is, its radius (m, in the plane of motion), and what else is true of it.

    ``observed`` holds further columns of the truth table by name, e.g. ``theta_rad``. ``present`` (n,) tells when
    nothing hides it; None means always.
    """

    name: str
    centre: Path
    radius_m: float | Curve
    observed: Mapping[str, Curve] = field(default_factory=dict)

    def radius(self, t_s: Array) -> Array:
        """Radius (n,) m at times (n,)."""
        return self.radius_m(t_s) if callable(self.radius_m) else np.full(t_s.size, self.radius_m)


@dataclass(frozen=True, slots=True)
class Wall:
    """What is behind: colour, and whether the board's lamps are reflected in it."""

    colour: Colour = (122.0, 121.0, 123.0)
    glossy: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """A scene made ready: the picture, its resting and moving layers, and the truth.

    ``props`` are painted once, ``layers`` in every frame, both in order. ``stated`` are the parameters a user would
    be told, ``hidden`` those that hidden effects make different in the equation of motion. ``phase`` names what
    happens at each time: ``hand``, ``motion``, ``contact`` or ``rest``; ``happened`` lists events as (time, name).
    Where ``light`` is given, the layers stand still and shine by this fraction of their paint: their light is
    added to that of the rest, and the sum is coded by the camera's curve.
    """

    view: CameraView
    wall: Wall
    props: tuple[Layer, ...]
    layers: tuple[Layer, ...]
    bodies: tuple[SceneBody, ...]
    stated: Mapping[str, Estimate]
    phase: Callable[[Array], list[str]]
    happened: tuple[tuple[float, str], ...] = ()
    hidden: Mapping[str, Estimate] = field(default_factory=dict)
    light: Curve | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """One phenomenon of the benchmark, to be rendered. One file in ``synthetic/scenes`` holds one.

    ``folder`` is the benchmark's name of the class; ``settings`` its settings, each with the parameters it changes;
    ``effects`` the names it can hide (those of the camera come on top). ``scatter`` is the standard deviation of
    parameters from trial to trial; ``published`` gives the benchmark's name, factor and unit of parameters that its
    ``parameters.json`` holds.
    """

    name: str
    summary: str
    folder: str
    duration_s: float
    parameters: tuple[Parameter, ...]
    settings: Mapping[str, Mapping[str, float]]
    stage: Callable[[Setup], Stage]
    effects: Mapping[str, str] = field(default_factory=dict)
    scatter: Mapping[str, float] = field(default_factory=dict)
    published: Mapping[str, tuple[str, float, str]] = field(default_factory=dict)


def stated(setup: Setup, parameters: tuple[Parameter, ...]) -> dict[str, Estimate]:
    """The parameters of a setup with their units, exact."""
    return {parameter.name: exactly(setup[parameter.name], parameter.unit) for parameter in parameters}


def exactly(value: float, unit: str) -> Estimate:
    """A number that is known exactly because it was put in."""
    return Estimate(float(value), 0.0, unit, "direct", "rendered")


SCENES: Registry[Scene] = Registry("scene", "iris_sysid.synthetic.scenes", Scene)  # type: ignore[type-var]
