"""Forces with a free exponent: what a refit measures the exponent of a missing force with.

They are no effects of the library, whose exponents follow from physics.
"""

from __future__ import annotations

from dataclasses import replace

from fitters.effect_sensitivity import Motion
from fitters.latent_force.form import usual
from iris_sysid.types import Effect, ForceKind, OdeModel, Parameter

POWER = "missing_force_power"
SIZE = "missing_force"
ROUNDED = 1e-3  # of the usual speed or position: below it the force is rounded, so that its derivative is finite


def _against_velocity(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """Force -c (|v| / v_1)^p along the velocity."""
    size, power, usual = params
    return -size * velocity / usual * ((speed / usual) ** 2 + ROUNDED**2) ** (0.5 * (power - 1.0))


def _odd_in_position(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """Force c sign(x) (|x| / x_1)^p."""
    size, power, usual = params
    return size * position / usual * ((position / usual) ** 2 + ROUNDED**2) ** (0.5 * (power - 1.0))


def _even_in_position(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """Force c (|x| / x_1)^p."""
    size, power, usual = params
    return size * ((position / usual) ** 2 + ROUNDED**2) ** (0.5 * power)


def _any_model(model: OdeModel) -> bool:
    return True


FORCES = {
    "against-velocity": (_against_velocity, r"-c\,|\dot x|^p\,\mathrm{sign}\,\dot x"),
    "odd-in-position": (_odd_in_position, r"c\,|x|^p\,\mathrm{sign}\,x"),
    "even-in-position": (_even_in_position, r"c\,|x|^p"),
}


def open_effect(kind: ForceKind, motion: Motion) -> Effect | None:
    """The force of a kind with a free exponent; None for kinds without an exponent.

    Parameters
    ----------
    kind
        Of the force.
    motion
        Its usual speed, or position, is the unit in which the power is taken.
    """
    if kind not in FORCES:
        return None
    acceleration, equation = FORCES[kind]
    size = Parameter(SIZE, "{x}/s^2" if motion.model.second_order else "{x}/s", "c", default=0.0)
    exponent = Parameter(POWER, "1", "p", lower=0.0, upper=8.0, default=1.0)
    scale = Parameter("missing_force_unit", "1", "x_1", default=usual(motion, kind), constant=True)
    return Effect(
        name="missing-force",
        summary="a force with a free exponent",
        equation=equation,
        source="",
        parameters=(size, exponent, replace(scale, source="root mean square along the motion")),
        applies=_any_model,
        acceleration=acceleration,
    )
