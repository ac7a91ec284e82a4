"""The force changes with time, at a steady rate or one that settles: a cord that stretches, a battery runs down."""

from __future__ import annotations

from fitters.effects._domain import any_model, has_rest_force
from fitters.effects._times import start_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter

MIN_SPAN = 1e-9  # s
MIN_SETTLING, MAX_SETTLING = -0.5, 10.0  # the rate at the end of a record is 4 to 1/121 of that at its start


def acceleration(
    t: float,
    position: float,
    velocity: float,
    speed: float,
    base: float,
    params: tuple[float, float, float, float, float],
) -> float:
    """The base acceleration less a damping, times rate * (t - start) / (1 + settling * (t - start) / span)."""
    rate, start, settling, damping, span = params
    since = t - start
    return (base - damping * velocity) * rate * since / (1.0 + settling * since / span)


def whole_record(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """A steady rate from the first of the times (n,) s to the last; ``observed`` (n, d) is not used."""
    return [(float(t_s[0]), 0.0, 0.0, max(float(t_s[-1] - t_s[0]), MIN_SPAN))]


EFFECT = Effect(
    name="parameter-drift",
    summary="forces that change slowly with time",
    equation=r"(\ddot x_0 - \gamma \dot x)\,\epsilon\,(t - t_0) / (1 + \kappa\,(t - t_0) / T)",
    source="Padé approximant [1/1] of a slow change: exact where a parameter is divided by 1 + e t, near for a decay",
    parameters=(
        Parameter("parameter_drift", "1/s", r"\epsilon", default=0.0),
        start_parameter("drift_start"),
        Parameter(
            "drift_settling",
            "1",
            r"\kappa",
            MIN_SETTLING,
            MAX_SETTLING,
            default=0.0,
            constant=True,
            source="a steady rate",
            role="form",
        ),
        Parameter(
            "drift_damping",
            "1/s",
            r"\gamma",
            default=0.0,
            constant=True,
            source="no damping drifts beside what pulls back",
            role="form",
        ),
        Parameter(
            "drift_span",
            "s",
            "T",
            lower=MIN_SPAN,
            default=1.0,
            constant=True,
            source="the record's length",
            role="shape",
        ),
    ),
    component="own-force-drift",
    absorbs=True,
    applies=any_model,
    plausibility=0.3,
    acceleration=acceleration,
    acts_at_rest=has_rest_force,
    trials=whole_record,
    alike="time-scale errors that grow; frequency that depends on amplitude, in a damped swing",
    recurrence="anew",
    typical="a steel spring that warms by 10 K in a minute: -0.00004 1/s",
    example=EffectExample("pendulum", size=0.05),
)
