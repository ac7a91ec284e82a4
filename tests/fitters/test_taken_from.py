"""Columns of a record that a model takes under its own names: an input of another name, y for the height."""

import numpy as np
import pytest
from typer.testing import CliRunner

from iris_sysid import MODELS, Quantity, Trajectory, model_from_equation, read_trajectory
from iris_sysid.cli import app
from iris_sysid.cli._own_equation import model_for

N = 40


def record(*quantities, inputs=()):
    values = np.arange(N)[:, None] * np.arange(1.0, len(quantities) + 1)
    given = None if not inputs else np.arange(N)[:, None] * np.full(len(inputs), -1.0)
    everywhere = np.ones(N, bool)
    return Trajectory(
        np.arange(N) / 10, quantities, values, np.full_like(values, np.nan), everywhere, tuple(inputs), given
    )


def test_the_only_quantity_in_the_unit_of_the_input_drives_the_model():
    taken, said = MODELS["driven-oscillator"].taken_from(record(Quantity("x", "m"), Quantity("force", "N")))
    assert said == "u = force for the model driven-oscillator; z of the model driven-oscillator = x"
    assert [each.name for each in (*taken.quantities, *taken.input_quantities)] == ["z", "u"]
    np.testing.assert_array_equal(taken.inputs[:, 0], 2.0 * np.arange(N))
    np.testing.assert_array_equal(taken.position[:, 0], np.arange(N))


def test_the_only_input_drives_the_model_whatever_its_name():
    clip = record(Quantity("z", "m"), inputs=[Quantity("u1", "N")])
    taken, said = MODELS["driven-oscillator"].taken_from(clip)
    assert said == "u = u1 for the model driven-oscillator"
    assert taken.input_quantities[0].name == "u"


@pytest.mark.parametrize(
    ("quantities", "inputs"),
    [
        ((Quantity("z", "m"), Quantity("pull", "N"), Quantity("push", "N")), ()),  # which of them drives is not known
        ((Quantity("z", "m"), Quantity("voltage", "V")), ()),  # of another unit
        ((Quantity("z", "m"),), (Quantity("u1", "N"), Quantity("u2", "N"))),
    ],
)
def test_an_input_is_not_guessed(quantities, inputs):
    taken, _ = MODELS["driven-oscillator"].taken_from(record(*quantities, inputs=inputs))
    assert "u" not in [each.name for each in taken.input_quantities]


def test_y_in_metres_is_the_height_of_a_projectile():
    taken, said = MODELS["projectile"].taken_from(record(Quantity("x", "m"), Quantity("y", "m")))
    assert said == "z = y, upwards for the model projectile"
    assert [each.name for each in taken.quantities] == ["x", "z"]


def test_y_in_an_image_points_down_and_is_not_taken():
    pixels = record(Quantity("x", "px"), Quantity("y", "px"))
    assert [each.name for each in MODELS["projectile"].taken_from(pixels)[0].quantities] == ["x", "y"]


def test_speeds_are_read_with_a_slash(tmp_path):
    (tmp_path / "motor.csv").write_text("t_s,u_V,w_rad/s,a_m/s^2\n0,1,2,3\n1,1,2,3\n")
    read = read_trajectory(tmp_path / "motor.csv")
    assert [(each.name, each.unit) for each in read.quantities] == [("w", "rad/s"), ("a", "m/s^2")]


def test_a_missing_input_is_named_with_the_columns_there_are(tmp_path):
    (tmp_path / "push.csv").write_text("t_ms,F (kN),x_mm\n0,1,2\n10,1,3\n20,2,4\n")
    arguments = ["fit", str(tmp_path / "push.csv"), "--model", "driven-oscillator", "-o", str(tmp_path / "fit.json")]
    ended = CliRunner().invoke(app, arguments)
    said = str(ended.exception)
    assert "model driven-oscillator is driven by u, but the table has z" in said
    assert "columns={'t': 't_ms', 'z[mm]': 'x_mm', 'u[N]': 'F (kN)'}" in said


@pytest.mark.parametrize(("header", "name"), [("force_N", "force"), ("Motor voltage_V", "motor_voltage")])
def test_units_of_one_letter_after_what_they_measure_are_read(tmp_path, header, name):
    (tmp_path / "push.csv").write_text(f"t_ms,{header},x_mm,ball_A\n0,1,2,1\n10,1,3,1\n20,2,4,1\n")
    names = [each.name for each in read_trajectory(tmp_path / "push.csv").quantities]
    assert name in names
    assert "ball" not in names


def test_speeds_of_other_programs_are_not_taken_for_times(tmp_path):
    (tmp_path / "car.csv").write_text("Time (s),speed_m/s,z [m]\n0,3,1\n1,3,2\n")
    read = read_trajectory(tmp_path / "car.csv", {"t": "Time (s)", "v": "speed_m/s", "z": "z [m]"})
    assert [(each.name, each.unit) for each in read.quantities] == [("v", "m/s"), ("z", "m")]


def test_the_only_other_column_drives_an_equation_in_text():
    clip = record(Quantity("v", "m/s"), Quantity("throttle", ""))
    model = model_for("v' = (k*u - b*v)/m", (), ("m=1000",), clip)
    assert model.taken_from(clip)[1] == "u = throttle for the model own-equation"
    torque = record(Quantity("v", "m/s"), Quantity("torque", "N m"))
    assert model_for("v' = (k*u - b*v)/m", (), (), torque).inputs[0].unit == "N m"


def test_models_of_speeds_are_told_from_levels():
    speeds = model_from_equation("w' = (k*u - b*w)/J", units={"w": "rad/s", "u": "V"})
    assert speeds.of_speeds
    assert MODELS["dc-motor"].of_speeds
    assert not any(MODELS[name].of_speeds for name in ("pumped-tank", "rc-circuit", "pendulum"))
