"""A temperature is read by a gauge, and no vessel drains: radiation is proposed; SciPy makes the record."""

import numpy as np
import pytest

from fitters.image_effects import sensor_of
from fitters.sindy.proposals import proposals
from iris_sysid import EFFECTS, Quantity, Trajectory, fit, model_from_equation
from tests._held_inputs import held_record, states_under

HEATED = model_from_equation("T' = -k*(T-Ta) + b*u", units={"T": "K"})
FILMED, ELSEWHERE = ("m", "px", "rad"), ("K", "V", "1", "m/s", "rad/s", "A", "Pa")


def heated() -> Trajectory:
    """A plate under a held power of up to 100 W, which loses heat to the air and by radiation."""
    rng = np.random.default_rng(0)
    power = np.repeat(rng.uniform(0.0, 100.0, 20), 40)
    cooling = lambda y, u: 0.004 * u - 8e-4 * (y - 293.0) - 1e-12 * (y**4 - 293.0**4)  # noqa: E731
    reading = states_under(cooling, [293.0], power, 40, 10.0, rtol=1e-10)[:, 0]
    seen = reading + 0.2 * rng.standard_normal(power.size)
    return held_record(Quantity("T", "K"), seen, Quantity("u", "W"), power, 10.0)


def test_residual_of_newton_s_cooling_suggests_the_fourth_power():
    record = heated()
    assert [term.term for term in proposals([record], [fit(record, HEATED)])] == ["T^4"]


@pytest.mark.parametrize("name", ["leak", "overflow", "camera-tilt"])
def test_temperature_neither_drains_nor_has_a_place_in_an_image(name):
    assert not EFFECTS[name].applies(HEATED)


@pytest.mark.parametrize("unit", [*FILMED, *ELSEWHERE])
def test_lengths_and_angles_alone_have_a_place_in_an_image(unit):
    model = model_from_equation("y' = -k*y", units={"y": unit})
    seen = np.exp(-np.arange(20) / 10)[:, None]
    record = Trajectory(
        np.arange(20) / 10,
        (Quantity("y", unit),),
        seen,
        np.full_like(seen, np.nan),
        np.ones(20, bool),
        sensor="unknown",
    )
    assert sensor_of(record, model) == ("unknown" if unit in FILMED else "gauge")
