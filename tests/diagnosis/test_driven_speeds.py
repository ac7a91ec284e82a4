"""Driven records whose measured quantity is a speed or a filtered reading, integrated by SciPy from step to step."""

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.validation_record import validate_model
from iris_sysid import MODELS, Quantity, diagnose, model_from_equation
from tests._held_inputs import held_record, states_under

STEP_S, SAMPLES, EACH = 0.01, 600, 50
MOTOR = model_from_equation("w' = (K*u - b*w)/0.002", units={"w": "rad/s", "u": "V"})
CONSTANT, VISCOUS, DRY, INERTIA = 0.05, 0.01, 0.04, 0.002


def record(rates, start, reading, quantity, noise, seed=5):
    """Samples of a quantity under a voltage that keeps its value for 50 samples; ``rates(state, voltage)``."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(-6, 6, SAMPLES // EACH), EACH)
    precise = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-11, "max_step": 1e-3}
    states = states_under(rates, start, voltage, EACH, STEP_S, **precise)
    seen = np.array([reading(state) for state in states]) + noise * rng.standard_normal(SAMPLES)
    return held_record(quantity, seen, Quantity("u", "V"), voltage, STEP_S)


def rubbing(state, voltage):
    return [(CONSTANT * voltage - VISCOUS * state[0] - DRY * np.tanh(state[0] / 0.02)) / INERTIA]


@pytest.mark.slow
def test_dry_friction_of_a_motor_is_named_from_its_speed():
    found = diagnose(record(rubbing, [0.0], lambda state: state[0], Quantity("w", "rad/s"), 0.05), MOTOR)
    assert [effect.name for effect in found.added] == ["coulomb-friction"]
    size = found.sizes["coulomb_friction"]
    assert size.unit == "rad/s^2"
    assert abs(size.value - DRY / INERTIA) < 4 * size.stderr < 0.8
    for name, value in (("K", CONSTANT / INERTIA), ("b", VISCOUS / INERTIA)):
        low, high = found.final.estimates[name].interval
        assert low < value * 0.002 < high
    assert found.components.parts[0].kind == "force-of-velocity"


@pytest.mark.slow
def test_a_slow_sensor_is_named_and_not_a_delay_of_the_input():
    """A lag of a fifth of the time constant: short windows take it for an input that comes late."""
    lagging = lambda state, voltage: [(voltage - state[0]) / 0.4, (state[0] - state[1]) / 0.08]  # noqa: E731
    clip = record(lagging, [0.0, 0.0], lambda state: state[1], Quantity("y", "V"), 0.005)
    found = diagnose(clip, MODELS["rc-circuit"])
    assert [effect.name for effect in found.added] == ["sensor-lag"]
    assert found.sizes["sensor_lag"].value == pytest.approx(0.08, abs=4 * found.sizes["sensor_lag"].stderr)
    assert found.final.estimates["time_constant"].value == pytest.approx(0.4, rel=0.01)


def test_a_record_that_begins_in_motion_is_validated_with_sharp_friction_and_an_offset_of_the_sensor():
    """From rest the sharp friction would hold the motor fast, and no initial state from there leads to the data."""
    offset, noise = 0.5, 0.05
    clip = record(rubbing, [11.0], lambda state: state[0] + offset, Quantity("w", "rad/s"), noise)
    model = with_effects(MOTOR, ["coulomb-friction", "zero-offset"])
    values = {"K": CONSTANT, "b": VISCOUS, "coulomb_friction": DRY / INERTIA, "zero_offset": offset}
    found = validate_model(model, values | {"coulomb_turnover": 1e-7}, clip)
    assert found.rms[0] < 2 * noise
