"""A pandas DataFrame becomes a trajectory by the rules of tables: never a silent unit."""

import numpy as np
import pandas as pd
import pytest

from iris_sysid import DataError, Segment, Trajectory, from_frame, to_frame

T_S = np.arange(12) * 0.04
THETA = 0.35 * np.cos(4.4 * T_S)
WHEN = pd.Timestamp("2026-01-01") + pd.to_timedelta(T_S, unit="s")


def frame(attrs=None, index=None, **columns):
    made = pd.DataFrame(columns)
    made = made if index is None else made.set_index(index)
    made.attrs.update(attrs or {})
    return made


SAME = {
    "own names": (frame(t_s=T_S, theta_rad=THETA), None),
    "own names, degrees": (frame(t_s=T_S, theta_deg=np.degrees(THETA)), None),
    "units in brackets": (frame(**{"time [s]": T_S, "angle [deg]": np.degrees(THETA)}), None),
    "milliseconds": (frame(t_ms=1000 * T_S, theta_rad=THETA), None),
    "units in attrs": (frame(t=T_S, theta=np.degrees(THETA), attrs={"units": {"t": "s", "theta": "deg"}}), None),
    "stated": (frame(when=T_S, left=np.degrees(THETA)), {"t[s]": "when", "theta[deg]": "left"}),
    "index": (frame(index="t_s", t_s=T_S, theta_rad=THETA), None),
    "time spans": (frame(time=pd.to_timedelta(T_S, unit="s"), theta_rad=THETA), None),
    "dates": (frame(time=WHEN, theta_rad=THETA), None),
    "text": (frame(t_s=[str(t) for t in T_S], theta_rad=THETA.astype(object)), None),
    "two levels": (pd.DataFrame({("run", "time (s)"): T_S, ("run", "theta (rad)"): THETA}), None),
    "notes beside": (frame(time_s=T_S, theta_rad=THETA, note=["fine"] * 12), None),
}


@pytest.mark.parametrize("name", SAME)
def test_same_swing_however_the_columns_are_named(name):
    table, columns = SAME[name]
    trajectory = Trajectory.from_frame(table, columns)
    assert [(quantity.name, quantity.unit) for quantity in trajectory.quantities] == [("theta", "rad")]
    np.testing.assert_allclose(trajectory.t_s, T_S, atol=1e-9)
    np.testing.assert_allclose(trajectory.position[:, 0], THETA, rtol=1e-12)


def test_gaps_errors_inputs_and_sensor():
    theta = np.where(np.arange(12) == 3, np.nan, THETA)
    table = frame(t_s=T_S, theta_rad=theta, sigma_theta_deg=np.full(12, 0.1), u_V=T_S, attrs={"sensor": "encoder"})
    trajectory = from_frame(table)
    assert np.flatnonzero(~trajectory.valid).tolist() == [3]
    np.testing.assert_allclose(trajectory.sigma, np.radians(0.1))
    assert trajectory.input_quantities[0].name == "u"
    assert trajectory.sensor == "encoder"


def test_errors_take_the_unit_of_their_quantity_from_attrs():
    table = frame(t=T_S, theta=THETA, sigma_theta=np.full(12, 0.01), attrs={"units": {"theta": "rad"}})
    np.testing.assert_allclose(from_frame(table).sigma, 0.01)


def test_there_and_back():
    made = Trajectory.from_frame(SAME["own names"][0]).with_(segments=(Segment("motion", 2, 9),), valid=T_S < 0.4)
    again = from_frame(to_frame(made))
    np.testing.assert_array_equal(again.position, made.position)
    np.testing.assert_array_equal(again.valid, made.valid)
    assert again.segments == made.segments


def test_what_was_read_is_said():
    said = from_frame(SAME["units in attrs"][0]).origin
    assert said["read_as"] == ["t = column 't [s]' in s", "theta = column 'theta [deg]' in deg"]
    assert said["converted"] == {"theta_deg": "rad"}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (frame(t_s=T_S, theta=THETA), "column 'theta' is not <name>_<unit>"),
        (frame(t=T_S, theta=THETA), "no column states a position, an angle or a level with its unit"),
        (frame(t_s=T_S[::-1], theta_rad=THETA), "data frame line 1, column t_s: .* is not later than"),
        (frame(t_s=T_S, theta_rad=["x"] * 12), "data frame line 0, column theta_rad: 'x' is not a number"),
        (frame(t_s=T_S, theta_rad=THETA, sigma_theta_rad=-THETA), "is below zero"),
        (frame(t_s=T_S, theta_rad=THETA, attrs={"sensor": "eye"}), r"attrs\['sensor'\] is 'eye'; it may be camera"),
        (pd.DataFrame(np.column_stack([T_S, T_S, THETA]), columns=["t_s", "x_m", "x_m"]), "two columns of the same"),
        (pd.DataFrame(), "is empty"),
        ({"t_s": T_S}, "a pandas DataFrame is wanted, not dict"),
    ],
)
def test_refusals(table, message):
    with pytest.raises(DataError, match=message):
        from_frame(table)
