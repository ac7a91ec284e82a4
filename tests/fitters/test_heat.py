"""A temperature is read by a gauge, and no vessel drains: radiation is proposed; SciPy makes the record."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.image_effects import sensor_of
from fitters.sindy.proposals import proposals
from iris_sysid import EFFECTS, Quantity, Trajectory, fit, model_from_equation

HEATED = model_from_equation("T' = -k*(T-Ta) + b*u", units={"T": "K"})
FILMED, ELSEWHERE = ("m", "px", "rad"), ("K", "V", "1", "m/s", "rad/s", "A", "Pa")


def heated() -> Trajectory:
    """A plate under a held power of up to 100 W, which loses heat to the air and by radiation."""
    rng, t_s = np.random.default_rng(0), np.arange(800) * 10.0
    power, reading = np.repeat(rng.uniform(0.0, 100.0, 20), 40), [293.0]
    for given in power[::40]:
        cooling = lambda t, y, u=given: 0.004 * u - 8e-4 * (y - 293.0) - 1e-12 * (y**4 - 293.0**4)  # noqa: E731
        reading += solve_ivp(cooling, (0, 400), reading[-1:], t_eval=np.arange(41) * 10.0, rtol=1e-10).y[0][1:].tolist()
    seen = (np.array(reading[:-1]) + 0.2 * rng.standard_normal(t_s.size))[:, None]
    return Trajectory(
        t_s, (Quantity("T", "K"),), seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool),
        input_quantities=(Quantity("u", "W"),), inputs=power[:, None], hold="zero-order",
    )  # fmt: skip


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
