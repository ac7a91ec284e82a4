"""Tables as people make them: rounded times, a column of groups, one header of ours beside one of theirs, hints."""

import pickle

import numpy as np
import pytest

from iris_sysid import read_trajectory
from iris_sysid.errors import DataError
from iris_sysid.io.grouped_table import groups_of_table, read_group
from iris_sysid.io.table_headers import parse_columns

STEP_S = 1 / 240
T_S = STEP_S * np.arange(480)


def written(tmp_path, header, *columns, form="%.6f"):
    path = tmp_path / "table.csv"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt=form)
    return path


@pytest.mark.parametrize("header", ["t_s,theta_rad", "time (s),angle (rad)"])
@pytest.mark.parametrize("decimals", [2, 3])
def test_times_that_a_spreadsheet_rounded_are_even_steps_again(tmp_path, header, decimals):
    trajectory = read_trajectory(written(tmp_path, header, np.round(T_S, decimals), np.sin(T_S)))
    np.testing.assert_allclose(trajectory.t_s, T_S, atol=2e-4)
    np.testing.assert_allclose(np.diff(trajectory.t_s), STEP_S, rtol=1e-3)
    assert f"times are rounded to {10.0**-decimals:g} s" in trajectory.origin["read_as"][-1]


@pytest.mark.parametrize(
    "times",
    [
        T_S[:200],  # not rounded
        0.02 * np.arange(100),  # even as they are
        np.round(np.cumsum(np.tile([0.01, 0.05], 50)), 3),  # uneven by more than rounding does
        np.round(0.0167 * np.arange(12), 2),  # too few to tell
    ],
)
def test_other_times_are_read_as_they_are(tmp_path, times):
    trajectory = read_trajectory(written(tmp_path, "t_s,x_m", times, np.sin(times), form="%.9f"))
    np.testing.assert_allclose(trajectory.t_s, times, atol=1e-9)
    assert not trajectory.origin.get("read_as")


def test_runs_below_each_other_are_refused_still(tmp_path):
    times = np.tile(0.01 * np.arange(50), 2)
    with pytest.raises(DataError, match="several runs below each other"):
        read_trajectory(written(tmp_path, "t_s,x_m", times, times))


@pytest.mark.parametrize("title", ["id", "Group", "team"])
def test_table_of_many_groups_is_no_one_trajectory(tmp_path, title):
    path = written(tmp_path, f"{title},t_s,x_m", np.repeat(np.arange(5), 40), 0.01 * np.arange(200), np.arange(200.0))
    with pytest.raises(DataError, match=rf"the rows of 5 groups \(0.000000, .*by its column '{title}': compare them"):
        read_trajectory(path)
    with pytest.raises(DataError, match="the rows of 5 groups"):
        read_trajectory(path, {"t": "t_s", "x[m]": "x_m"})
    found, names = groups_of_table(path)
    assert (found, len(names)) == (title, 5)
    assert read_group(path, found, names[3]).position[:, 0].tolist() == list(range(120, 160))


def test_a_number_of_each_row_is_no_group(tmp_path):
    path = written(tmp_path, "id,time (s),x (m)", np.arange(100), 0.01 * np.arange(100), np.arange(100.0))
    assert read_trajectory(path).n == 100


def test_unit_in_brackets_stands_beside_t_s(tmp_path):
    trajectory = read_trajectory(written(tmp_path, "t_s,u [V],y [V]", T_S, np.ones_like(T_S), np.exp(-T_S)))
    assert [quantity.column for quantity in trajectory.quantities] == ["y_V"]
    assert [quantity.column for quantity in trajectory.input_quantities] == ["u_V"]


def test_a_current_is_read_beside_a_speed_in_another_unit(tmp_path):
    trajectory = read_trajectory(written(tmp_path, "t_s,u_V,omega_rpm,i_A", T_S, T_S, 30 * T_S, T_S))
    assert [quantity.column for quantity in trajectory.quantities] == ["i_A", "omega_rad_s"]
    assert trajectory.position[-1, 1] == pytest.approx(np.pi * T_S[-1])


def test_of_several_runs_side_by_side_the_first_is_read_and_the_others_are_said(tmp_path):
    header = "Run 1: Time (s),Run 1: Position (m),Run 2: Time (s),Run 2: Position (m)"
    trajectory = read_trajectory(written(tmp_path, header, T_S, T_S, T_S, 2 * T_S))
    np.testing.assert_allclose(trajectory.position[:, 0], T_S, atol=1e-6)
    assert trajectory.origin["read_as"][-1] == "left out: 'Run 2: Time (s)', 'Run 2: Position (m)'"


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("Time,Position", {"t": "Time", "x[m]": "Position"}),
        ("Moment,Angle", {"t": "Moment", "theta[rad]": "Angle"}),
    ],
)
def test_hint_names_the_tables_own_columns_and_the_hint_works(tmp_path, header, columns):
    path = written(tmp_path, header, *[T_S] * (1 + header.count(",")))
    with pytest.raises(DataError) as refused:
        read_trajectory(path)
    assert refused.value.columns == columns
    assert f"columns={columns}" in str(refused.value)
    assert "--columns" not in str(refused.value)
    assert pickle.loads(pickle.dumps(refused.value)).columns == columns  # from another process
    assert read_trajectory(path, columns).n == T_S.size


def test_command_says_the_option_where_python_says_the_argument(cli, tmp_path):
    path = written(tmp_path, "Moment,Angle", T_S, T_S)
    outcome = cli("fit", path, "--model", "pendulum", "-o", tmp_path / "fit.json")
    (option,) = outcome.err.split('--columns "')[1].split('"')[:1]
    assert parse_columns(option) == {"t": "Moment", "theta[rad]": "Angle"}
    assert "columns={" not in outcome.err


@pytest.mark.parametrize("header", ["t_s,y [V]", "t_s,foo", "t_s,temp_K", "Time (s),Temperature (K)"])
def test_hint_for_a_model_names_the_tables_own_columns_and_works(cli, tmp_path, header):
    swing = 0.3 * np.cos(5 * T_S)
    path = written(tmp_path, header, T_S, swing)
    command = ("fit", path, "--model", "pendulum", "-o", tmp_path / "fit.json")
    (option,) = cli(*command).err.split('--columns "')[1].split('"')[:1]
    title = header.split(",")[1]
    assert parse_columns(option)["t"] == header.split(",")[0]
    assert title in parse_columns(option).values()
    assert cli(*command, "--columns", f"t={header.split(',')[0]},theta[rad]={title}").status == 0


def test_class_says_how_to_name_the_columns_of_a_table(cli, tmp_path):
    folder = tmp_path / "class"
    folder.mkdir()
    for name in ("a", "b"):
        written(folder, "Moment,Angle", T_S, 0.3 * np.cos(5 * T_S)).rename(folder / f"{name}.csv")
    command = ("class", folder, "--phenomenon", "pendulum", "-o", tmp_path / "out")
    said = cli(*command).err
    assert "columns={" not in said
    (option,) = said.split('columns "')[1].split('"')[:1]
    assert cli(*command, "--columns", option).status == 0
