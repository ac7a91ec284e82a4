"""A decay is that of any quantity: a voltage, a temperature above that of the room, the counts of a counter."""

import numpy as np
import pytest

from fitters.ode import fit
from fitters.selection.select import select_model
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.registry import MODELS
from iris_sysid.types import Quantity, Trajectory

RATE, ROOM, ABOVE = 0.004, 294.6, 60.0


def seen(t_s, values, noise, quantity) -> Trajectory:
    read = (values + noise * np.random.default_rng(0).standard_normal(t_s.size))[:, None]
    return Trajectory(t_s, (quantity,), read, np.full_like(read, np.nan), np.ones(t_s.size, dtype=bool))


def cooling() -> Trajectory:
    t_s = np.arange(0.0, 900.0, 5.0)
    return seen(t_s, ROOM + ABOVE * np.exp(-RATE * t_s), 0.1, Quantity("T", "K"))


def test_decay_has_the_unit_of_what_is_measured():
    found = fit(cooling(), "exponential-decay")
    assert found.status == "ok"
    assert {name: found.estimates[name].unit for name in found.free} == {
        "decay_rate": "1/s",
        "background": "K",
        "intensity_0": "K",
    }
    for name, truth in {"decay_rate": RATE, "background": ROOM, "intensity_0": ABOVE}.items():
        assert abs(found.estimates[name].value - truth) < 4 * found.estimates[name].stderr
    assert any("intensity of the model exponential-decay = T" in note for note in found.notes)


def test_auto_takes_a_temperature_for_a_decay():
    assert select_model(cooling()).nearest.model == "exponential-decay"


def test_diagnosis_of_a_decay_is_in_its_unit():
    found = diagnose(cooling(), "exponential-decay")
    assert found.unit == "K"
    assert not found.added


def test_model_in_its_own_unit_is_left_as_it_is():
    brightness = cooling().with_(quantities=(Quantity("intensity", "1"),))
    for name in ("exponential-decay", "pendulum"):
        assert MODELS[name].in_unit_of(brightness) is MODELS[name]


@pytest.mark.parametrize("header", ["t_s,counts", "Time (s),Counts"])
def test_counts_have_no_unit(tmp_path, header):
    table = tmp_path / "geiger.csv"
    table.write_text(header + "\n" + "\n".join(f"{k},{900 - k}" for k in range(20)))
    (counts,) = read_trajectory(table).quantities
    assert counts.name == "counts"
    assert counts.unit in ("", "1")


def test_oscillator_holds_of_a_voltage():
    t_s = np.arange(500) / 50
    clip = seen(t_s, 1.2 + 5.0 * np.exp(-0.1 * t_s) * np.cos(3.0 * t_s), 0.05, Quantity("U", "V"))
    assert select_model(clip).nearest.model == "linear-oscillator"
    found = fit(clip, "linear-oscillator")
    assert {name: found.estimates[name].unit for name in ("stiffness", "rest", "z_0", "vz_0")} == {
        "stiffness": "1/s^2",
        "rest": "V",
        "z_0": "V",
        "vz_0": "V/s",
    }
    assert abs(found.estimates["rest"].value - 1.2) < 4 * found.estimates["rest"].stderr


def test_only_equations_without_a_scale_hold_in_any_unit():
    assert {name for name, model in MODELS.items() if model.of_any_unit} == {"exponential-decay", "linear-oscillator"}
