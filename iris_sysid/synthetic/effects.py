"""Effects that can be hidden in a clip: names, units, and the terms they add to an acceleration."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from difflib import get_close_matches

from iris_sysid.errors import DataError, UnknownNameError
from iris_sysid.types import Array

FORCING_HZ = 0.7  # frequency of periodic-forcing
WEAKENING_SPEED = 0.3  # rad/s or m/s over which velocity-weakening-friction falls to 1/e

# name -> meaning of its number. q is the scene's coordinate, e.g. theta in rad or z in m.
FORCES: Mapping[str, str] = {
    "linear-drag": "q'' loses c q'; c in 1/s",
    "quadratic-drag": "q'' loses c |q'| q'; c in 1/rad or 1/m",
    "coulomb-friction": "q'' loses c sign(q'), and sticks; c in rad/s^2 or m/s^2",
    "velocity-weakening-friction": f"q'' loses c exp(-|q'| / {WEAKENING_SPEED}) sign(q'), and sticks",
    "constant-force": "q'' gains c; in rad/s^2 or m/s^2",
    "cubic-stiffness": "q'' loses c q^3",
    "periodic-forcing": f"q'' gains c sin(2 pi {FORCING_HZ} t)",
    "parameter-drift": "q'' without the other effects is multiplied by 1 + c t from the release on; c in 1/s",
    "release-velocity": "q' at the release; rad/s or m/s",
    "zero-offset": "the coordinate's zero is shifted by c; rad or m",
}
CAMERA: Mapping[str, str] = {
    "camera-tilt": "camera turned about its vertical axis; rad",
    "radial-distortion": "k1 of the lens",
    "anisotropic-scale": "horizontal scale is 1 + c times the vertical one",
    "camera-drift": "picture moves to the right; px/s at 1280 px width",
    "rolling-shutter": "time from the first row to the last; s",
    "time-scale": "the file's times are 1 + c times the true ones",
    "dropped-frame": "the frame of that number was left out and the times closed up",
}


def check_effects(effects: Mapping[str, float], accepted: Mapping[str, str], scene: str) -> dict[str, float]:
    """Copy the effects after checking that the scene has them and that their sizes are finite numbers.

    ``accepted`` are the scene's own effects, beside those of the camera. UnknownNameError lists the names, DataError
    says when a size is not a finite number.
    """
    known = [*accepted, *CAMERA]
    for name, size in effects.items():
        if name not in known:
            close = get_close_matches(str(name), known, n=1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            raise UnknownNameError(f"{scene} has no effect {name!r}; {hint}there are: {', '.join(known)}")
        if not isinstance(size, int | float) or not math.isfinite(size):
            raise DataError(f"the size of effect {name!r} must be a finite number, not {size!r}")
    return {name: float(size) for name, size in effects.items()}


def extra_acceleration(effects: Mapping[str, float]) -> Callable[[float, float, float], float]:
    """The smooth terms that the effects add to q'', as a function of (t, q, q')."""
    linear = effects.get("linear-drag", 0.0)
    quadratic = effects.get("quadratic-drag", 0.0)
    constant = effects.get("constant-force", 0.0)
    cubic = effects.get("cubic-stiffness", 0.0)
    forcing = effects.get("periodic-forcing", 0.0)

    def added(t: float, q: float, rate: float) -> float:
        drag = -(linear + quadratic * abs(rate)) * rate
        return drag + constant - cubic * q**3 + forcing * math.sin(2 * math.pi * FORCING_HZ * t)

    return added


def dry_friction(effects: Mapping[str, float]) -> Callable[[float, Array], float]:
    """Size of the dry friction that the effects add, as a function of (t, state), the speed being state 1.

    In m/s^2 or rad/s^2, as the state's second derivative.
    """
    constant, weakening = effects.get("coulomb-friction", 0.0), effects.get("velocity-weakening-friction", 0.0)
    if min(constant, weakening) < 0:
        raise DataError("coulomb-friction and velocity-weakening-friction must not be negative: friction only brakes")

    def size(t: float, state: Array) -> float:
        del t
        return constant + weakening * math.exp(-abs(float(state[1])) / WEAKENING_SPEED)

    return size


def effect_within(effects: Mapping[str, float], name: str, low: float, high: float) -> float:
    """The size of an effect, 0 when it is absent; DataError when it does not lie from low to high.

    Parameters
    ----------
    effects
        Sizes by name.
    name
        Name of the effect.
    low, high
        Bounds, included.
    """
    size = effects.get(name, 0.0)
    if not low <= size <= high:
        raise DataError(f"the size of effect {name!r} must lie between {low:g} and {high:g} here, not {size:g}")
    return size
