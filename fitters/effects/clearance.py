"""Play: within a gap about the middle nothing pulls back, and beyond it the pull begins at zero."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._domain import has_rest_force, is_pulled_back
from iris_sysid.types import Array, Effect, EffectExample, Parameter

SHARES = (0.03, 0.06, 0.12, 0.25, 0.5)  # of the motion's reach, tried as half of the gap
STEPS = 2.0 ** -np.arange(6)  # powers of two by which a gap is moved, down to 2 %
CORNER = 8  # sharpness of the edge of the gap, smooth for the integrator


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float]
) -> float:
    """Minus a share of the base acceleration: all of it within the gap, and what the gap takes off beyond it."""
    share, gap = params
    return -share * base / (1.0 + (position / gap) ** CORNER) ** (1.0 / CORNER)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Halves of the gap. ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit."""
    reach = float(np.nanquantile(np.abs(observed), 0.98))
    return [(share * reach,) for share in SHARES]


def nearby(t_s: Array, shape: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Wider and narrower gaps: beyond a gap only its product with the share counts. ``t_s`` (n,), s, is not used."""
    return [(float(shape[0] * factor),) for factor in 2.0 ** np.concatenate([-STEPS, STEPS])]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether something is taken away, and not added. ``t_s`` (n,), s, is not used."""
    return params[0] > 0


EFFECT = Effect(
    name="clearance",
    summary="play: nothing pulls back within a gap; s = 1 is a gap without any force",
    equation=r"-s\,\ddot x_0\,\min(1, x_c / |x|)",
    source="dead zone; Nordin and Gutman (2002), Automatica 38, 1633, section 2",
    parameters=(
        Parameter("clearance", "1", "s", lower=-1.0, upper=1.5, default=0.0),
        Parameter(
            "clearance_gap",
            "{x}",
            "x_c",
            lower=1e-12,
            default=0.1,
            constant=True,
            source="half of the gap that fits best",
            role="location",
        ),
    ),
    component="force-of-position",
    applies=is_pulled_back,
    plausibility=0.1,
    acceleration=acceleration,
    acts_at_rest=has_rest_force,
    alike="cubic-stiffness; odd-reading",
    trials=trials,
    nearby=nearby,
    sensible=sensible,
    typical="free play: 1; a stiffer stop on a softer spring: less. Gaps of bearings: 0.01 to 0.5 mm",
    example=EffectExample("linear-oscillator", size=0.05),
)
