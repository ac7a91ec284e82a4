"""Tables: what is written reads back exactly, what is typed by hand reads, what is wrong is named to the cell."""

import math
import tracemalloc
from dataclasses import fields

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.csv_cells import read_sheet
from iris_sysid.io.csv_columns import SUFFIXES, column_of, parse_column
from iris_sysid.io.csv_write import (
    estimates_frame,
    read_track,
    read_trajectory,
    to_frame,
    write_track,
    write_trajectory,
)
from iris_sysid.io.files import sha256_of
from iris_sysid.types import Estimate, Quantity, Segment, Smoothed, Track, Trajectory, symbol_of, unit_suffix
from iris_sysid.types._arrays import MAX_VALUE
from iris_sysid.units import rate_of
from tests._project import recording
from tests.io.test_json_documents import fit_result

THETA = Quantity("theta", "rad", r"\theta")


def track(n=4, body="1", **changes):
    rng = np.random.default_rng(n)
    gap = np.arange(n) == 1
    values = {
        "t_s": np.arange(n) / 59.94,
        "xy_px": np.where(gap[:, None], np.nan, rng.normal(300, 100, (n, 2))),
        "sigma_px": rng.uniform(0.01, 0.1, (n, 2)),
        "valid": ~gap,
        "frame": np.arange(n) + 7,
        "body": body,
        "origin": {"source": "clip.mp4", "options": {"fps": None, "roi": [1, 2, 3, 4]}},
    }
    return Track(**(values | changes))


def full_track(n=4, body="1"):
    rng = np.random.default_rng(9)
    parts = {name: rng.normal(10, 1, n) for name in ("radius_px", "angle_rad", "intensity", "area_px")}
    return track(n, body, **parts, hand=np.arange(n) < 2)


def trajectory(n=5, d=1, **changes):
    rng = np.random.default_rng(n + d)
    gap = np.arange(n) == 2
    values = {
        "t_s": np.cumsum(rng.uniform(0.01, 0.02, n)),
        "quantities": (THETA,)
        if d == 1
        else tuple(Quantity(f"theta{k}", "rad", f"\\theta_{k}") for k in range(1, d + 1)),
        "position": np.where(gap[:, None], np.nan, rng.normal(size=(n, d))),
        "sigma": rng.uniform(0.001, 0.002, (n, d)),
        "valid": ~gap,
        "segments": (Segment("hand", 0, 1, "touched"), Segment("motion", 1, 3), Segment("motion", 3, 5, "again")),
        "geometry": {"pivot_x": Estimate(0.1, 0.02, "m", "derived", "arc", (0.05, 0.2))},
        "origin": {"source": "clip.mp4", "first_frame": 7},
    }
    return Trajectory(**(values | changes))


def smoothed(n=5, d=1, *, correlated=True):
    rng = np.random.default_rng(3)
    root = rng.normal(size=(n, 2 * d, 2 * d))
    covariance = root @ root.transpose(0, 2, 1)
    if not correlated:
        covariance = covariance * np.eye(2 * d)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    covariance[:, range(2 * d), range(2 * d)] = np.square(sigma)  # what a table of standard errors can hold exactly
    return Smoothed(
        position=rng.normal(size=(n, d)),
        velocity=rng.normal(size=(n, d)),
        covariance=covariance,
        psd=rng.uniform(size=d),
        nis=rng.uniform(size=d),
    )


def assert_same(track, other):
    """Every field equal, arrays to the bit, NaN at the same positions."""
    assert type(track) is type(other)
    for field in fields(track):
        have, want = getattr(track, field.name), getattr(other, field.name)
        if isinstance(want, np.ndarray):
            np.testing.assert_array_equal(have, want, err_msg=field.name, strict=True)
        elif isinstance(want, Smoothed):
            assert_same(have, want)
        else:
            assert have == want, field.name


def table(folder, text, name="table.csv"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# --------------------------------------------------------------------------- tracks


@pytest.mark.parametrize("make", [track, full_track])
def test_track_written_and_read_is_the_same(tmp_path, make):
    (back,) = read_track(write_track([make()], tmp_path / "track.csv"))
    assert_same(back, make())


def test_track_columns_are_those_of_the_design(tmp_path):
    path = write_track(full_track(), tmp_path / "track.csv")
    header = path.read_text().splitlines()[0]
    assert header == ("frame,t_s,body,x_px,y_px,sigma_x_px,sigma_y_px,radius_px,angle_rad,intensity,valid,area_px,hand")


def test_tracks_of_several_bodies_keep_their_names_origins_and_optional_columns(tmp_path):
    tracks = [full_track(body="ball, red"), track(body='the "2"', origin={"source": "b.mp4"}), track(6, body="ü\n3")]
    back = read_track(write_track(tracks, tmp_path / "track.csv"))
    for read, other in zip(back, tracks, strict=True):
        assert_same(read, other)


def test_track_rows_are_in_the_order_of_time(tmp_path):
    frame = pd.read_csv(write_track([track(body="a"), track(body="b")], tmp_path / "track.csv"))
    assert frame["body"].tolist() == ["a", "b"] * 4
    assert frame["valid"].tolist() == [1, 1, 0, 0, 1, 1, 1, 1]


def test_track_never_seen_reads_back_as_all_gaps(tmp_path):
    lost = track(xy_px=np.full((4, 2), np.nan), valid=[False] * 4)
    (back,) = read_track(write_track(lost, tmp_path / "track.csv"))
    assert_same(back, lost)


def test_track_position_marked_as_wrong_keeps_its_position(tmp_path):
    doubted = track(xy_px=np.ones((4, 2)), valid=[True, False, True, True])
    (back,) = read_track(write_track(doubted, tmp_path / "track.csv"))
    assert_same(back, doubted)


def test_track_typed_by_hand_reads_with_its_defaults(tmp_path):
    (back,) = read_track(table(tmp_path, "t_s,x_px,y_px\n0,1,2\n0.1,,\n0.2,3,4\n"))
    np.testing.assert_array_equal(back.valid, [True, False, True])
    np.testing.assert_array_equal(back.frame, [0, 1, 2])
    assert np.isnan(back.sigma_px).all()
    assert (back.body, back.radius_px, back.hand) == ("1", None, None)
    assert back.origin["sha256"] == sha256_of(tmp_path / "table.csv")


def test_track_of_two_bodies_without_frames_shares_the_count(tmp_path):
    first, second = read_track(table(tmp_path, "t_s,x_px,y_px,body\n0,1,2,a\n0,1,2,b\n0.1,1,2,b\n0.2,1,2,a\n"))
    assert (first.frame.tolist(), second.frame.tolist()) == ([0, 2], [0, 1])


def test_table_of_tracks_is_written_as_pandas_would(tmp_path):
    tracks = [full_track(5, "=A1"), track(4, 'b,"c"', xy_px=np.array([[1e-7, 1e20], [0, -0.0], [1 / 3, 5], [1e16, 2]]))]
    frame = to_frame(tracks)
    flags = {name: frame[name].astype("Int8") for name in ("valid", "hand")}
    expected = frame.assign(**flags, body=frame["body"].replace("=A1", "'=A1")).to_csv(index=False)
    write_track(tracks, tmp_path / "track.csv")
    assert (tmp_path / "track.csv").read_bytes().decode() == expected.replace("\r\n", "\n")


@pytest.mark.parametrize(
    ("tracks", "message"),
    [([], "there is no track"), ([track(body="a"), track(body="a")], "two tracks are of the same body: 'a', 'a'")],
)
def test_write_track_of_what_is_no_table_is_refused(tmp_path, tracks, message):
    with pytest.raises(DataError, match=message):
        write_track(tracks, tmp_path / "track.csv")
    assert list(tmp_path.iterdir()) == []


BAD_TRACKS = [
    ("t_s,x_px\n0,1\n", r"has no column y_px; it has t_s, x_px; a track has t_s in s, and x_px and y_px"),
    ("t_s,theta_rad\n0,1\n", "has no column x_px"),
    ("t_s,x_px,y_px,speed\n0,1,2,3\n", "a track has no column 'speed'; it may have frame, t_s"),
    ("t_s,x_px,y_px,body\n0,1,2,\n", "line 2, column body: '' is blank; give the name of the body"),
    ("t_s,x_px,y_px,frame\n0,1,2,1.5\n", r"line 2, column frame: '1\.5' is not a whole number"),
    ("t_s,x_px,y_px,frame\n0,1,2,1e300\n", "column frame: '1e300' is not a whole number"),
    ("t_s,x_px,y_px,valid\n0,1,2,maybe\n", "column valid: 'maybe' is neither 1 nor 0"),
    ("t_s,x_px,y_px,valid\n0,1,,1\n", "line 2, column y_px: '' is blank although valid is 1; set valid to 0"),
    ("t_s,x_px,y_px,sigma_x_px\n0,1,2,-1\n", "column sigma_x_px: '-1' is below zero"),
    ("t_s,x_px,y_px,radius_px\n0,1,2,-1\n", "column radius_px: '-1' is below zero"),
    ("t_s,x_px,y_px,body\n0,1,2,a\n0,1,2,b\n0,1,2,a\n", r"line 4, column t_s: '0' is not later than 0\.0 in line 2"),
    ("t_s,x_px,y_px\n0,1,2\n,1,2\n", "line 3, column t_s: '' is blank or not a number; every row needs one"),
]


@pytest.mark.parametrize(("text", "message"), BAD_TRACKS)
def test_read_track_bad_table_is_one_data_error_that_names_the_place(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        read_track(table(tmp_path, text))


# --------------------------------------------------------------------------- trajectories


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"d": 2},
        {"segments": (), "geometry": {}, "origin": {}},
        {"sigma": np.full((5, 1), np.nan)},
        {"smoothed": smoothed()},
        {"smoothed": smoothed(correlated=False)},
        {"d": 2, "smoothed": smoothed(d=2)},
        {"quantities": (Quantity("I", "1", "I"),), "smoothed": smoothed()},
        {"quantities": (Quantity("x", "m/s"),), "smoothed": smoothed()},
        {"position": np.arange(5.0)[:, None], "valid": [True, False, True, True, True]},
        {"input_quantities": (Quantity("u", "V", "U"),), "inputs": np.arange(5.0)[:, None]},
        {"input_quantities": (Quantity("u1", "V"), Quantity("u2", "m^3/s")), "inputs": np.full((5, 2), np.nan)},
        {"segments": (Segment("motion", 0, 5), Segment("contact", 2, 3, "a wall"))},
    ],
)
def test_trajectory_written_and_read_is_the_same(tmp_path, changes):
    original = trajectory(**changes)
    path = write_trajectory(original, tmp_path / "trajectory.csv")
    back = read_trajectory(path)
    assert_same(back, original)
    again = write_trajectory(back, tmp_path / "again.csv")
    assert again.read_bytes() == path.read_bytes()


def test_trajectory_columns_follow_the_grammar(tmp_path):
    original = trajectory(smoothed=smoothed(), input_quantities=(Quantity("u", "V"),), inputs=np.ones((5, 1)))
    assert list(to_frame(original).columns) == [
        "t_s",
        "theta_rad",
        "sigma_theta_rad",
        "u_V",
        "smooth_theta_rad",
        "d_theta_rad_s",
        "sigma_smooth_theta_rad",
        "sigma_d_theta_rad_s",
        "cov_smooth_theta_rad_d_theta_rad_s",
        "segment",
    ]


finite = st.floats(-MAX_VALUE, MAX_VALUE)


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.float64, (4, 2), elements=finite))
def test_trajectory_floats_read_back_to_the_bit(tmp_path_factory, position):
    original = trajectory(4, 2, position=position, valid=[True] * 4, segments=())
    path = tmp_path_factory.mktemp("t") / "trajectory.csv"
    assert_same(read_trajectory(write_trajectory(original, path)), original)


def test_trajectory_without_the_file_beside_it_keeps_the_numbers(tmp_path):
    path = write_trajectory(trajectory(smoothed=smoothed()), tmp_path / "trajectory.csv")
    (tmp_path / "trajectory.csv.origin.json").unlink()
    back = read_trajectory(path)
    np.testing.assert_array_equal(back.position, trajectory().position)
    assert back.quantities == (THETA,)
    assert back.segments == (Segment("hand", 0, 1), Segment("motion", 1, 5))
    assert np.isnan(back.smoothed.psd).all()
    assert dict(back.geometry) == {}


def test_trajectory_edited_by_hand_keeps_its_geometry_and_says_so(tmp_path):
    path = write_trajectory(trajectory(), tmp_path / "trajectory.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]))
    back = read_trajectory(path)
    assert back.n == 4
    assert back.origin["edited"] is True
    assert back.geometry["pivot_x"].stderr == 0.02
    assert back.segments == (Segment("hand", 0, 1), Segment("motion", 1, 4))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"document": "origin"', '"document": "fit"', "document: .*not the file that is wanted.*; delete that file"),
        ('"value": 0.1', '"value": "x"', r"geometry\.pivot_x\.value: .*not 'x'"),
        ('"start": 0', '"start": -1', r"segments\.0\.start: "),
        ('"label": "hand"', '"label": "foot"', r"segments\.0\.label: .*'foot'"),
        ('"psd": [', '"psd": [1.0,', "is of another table: smoothing of 1 quantities is wanted; delete it"),
        ('"origin": {', '"origin": {"read_as": 5, ', "read_as is 5: give a list of sentences"),
        ('"origin": {', '"origin": {"clipped_readings": [3], ', "clipped_readings is .3.: give a list of sentences"),
        ("{", "", "Invalid JSON"),
    ],
)
def test_trajectory_with_a_wrong_file_beside_it_is_a_data_error(tmp_path, old, new, message):
    path = write_trajectory(trajectory(smoothed=smoothed()), tmp_path / "trajectory.csv")
    beside = tmp_path / "trajectory.csv.origin.json"
    text = beside.read_text()
    assert old in text
    beside.write_text(text.replace(old, new, 1))
    with pytest.raises(DataError, match=message):
        read_trajectory(path)


def test_trajectory_refuses_to_replace_and_then_replaces_both_files(tmp_path):
    path = write_trajectory(trajectory(), tmp_path / "trajectory.csv")
    with pytest.raises(OutputError, match=r"trajectory\.csv exists already.*--force"):
        write_trajectory(trajectory(7), path)
    assert read_trajectory(path).n == 5
    assert read_trajectory(write_trajectory(trajectory(7), path, overwrite=True)).n == 7
    assert "edited" not in read_trajectory(path).origin


def test_trajectory_whose_side_car_cannot_be_written_writes_nothing(tmp_path):
    (tmp_path / "trajectory.csv.origin.json").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        write_trajectory(trajectory(), tmp_path / "trajectory.csv")
    assert not (tmp_path / "trajectory.csv").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"quantities": (Quantity("d_x", "m"),)}, "cannot hold the quantity 'd_x'"),
        ({"quantities": (Quantity("sigma_x", "m"),)}, "cannot hold the quantity 'sigma_x'"),
        ({"quantities": (Quantity("cov_x", "m"),)}, "cannot hold the quantity 'cov_x'"),
        ({"quantities": (Quantity("x_m", "s"),)}, "cannot hold the quantity 'x_m'"),
        ({"quantities": (Quantity("t", "s"),)}, "cannot hold the quantity 't'"),
        ({"quantities": (Quantity("x", "furlong"),)}, "'x_furlong' is not <name>_<unit>"),
        ({"quantities": (Quantity("u", "m"),)}, "cannot hold the quantity 'u': that is the name of an input"),
        ({"input_quantities": (Quantity("pump", "V"),)}, "cannot hold the input 'pump': an input is named u, u1"),
        ({"d": 2, "quantities": (Quantity("x", "m"), Quantity("x", "rad"))}, "two quantities of the same name: x, x"),
        ({"geometry": {"pivot": Estimate(1.0, 0.1, "m", "guessed")}}, "pivot: measurement_type: "),
        ({"origin": {"camera": object()}}, "as JSON"),
    ],
)
def test_write_trajectory_that_could_not_be_read_back_is_refused(tmp_path, changes, message):
    with pytest.raises(DataError, match=message):
        write_trajectory(trajectory(**changes), tmp_path / "trajectory.csv")
    assert list(tmp_path.iterdir()) == []


# --------------------------------------------------------------------------- typed by hand


@pytest.mark.parametrize(
    "text",
    [
        "t_s,theta_rad\n0,0.5\n0.1,\n0.2,-1.5\n",
        "t_s,theta_rad\r\n0,0.5\r\n0.1,\r\n0.2,-1.5",
        "\ufefft_s,theta_rad\n0,0.5\n0.1,nan\n0.2,-1.5\n",
        "\n t_s , theta_rad \n\n0, 0.5\n0.1,NaN\n\n0.2,-1.5\n,\n",
        '"t_s","theta_rad",\n"0","0.5",\n"0.1","",\n"0.2","-1.5",\n',
        "t_s;theta_rad\n0;0,5\n0,1;\n0,2;-1,5\n",
        "t_s\ttheta_rad\n0\t.5\n1e-1\tNA\n0.2\t-15e-1\n",
        "theta_rad,t_s,valid\n0.5,0,1\n7,0.1,0\n-1.5,0.2,\n",
        "t_s,theta_rad\n0,0.5\n0.1,\n0.2,-1.5\n".encode("utf-16"),
    ],
)
def test_trajectory_typed_by_hand_reads(tmp_path, text):
    back = read_trajectory(table(tmp_path, text))
    np.testing.assert_array_equal(back.t_s, [0, 0.1, 0.2])
    np.testing.assert_array_equal(back.valid, [True, False, True])
    np.testing.assert_array_equal(back.position[back.valid, 0], [0.5, -1.5])
    assert back.quantities == (THETA,)
    assert np.isnan(back.sigma).all()


def test_trajectory_in_other_units_is_converted_and_says_so(tmp_path):
    text = "t_s,theta1_deg,theta2_rad,z_cm,sigma_z_mm,u_mV\n0,180,1,50,2,1500\n1,0,1,50,2,1500\n"
    back = read_trajectory(table(tmp_path, text))
    assert [quantity.column for quantity in back.quantities] == ["theta1_rad", "theta2_rad", "z_m"]
    np.testing.assert_allclose(back.position[0], [math.pi, 1.0, 0.5], rtol=1e-15)
    np.testing.assert_allclose(back.sigma[0], [np.nan, np.nan, 0.002], rtol=1e-15)
    np.testing.assert_allclose(back.inputs[:, 0], 1.5, rtol=1e-15)
    assert back.origin["converted"] == {"theta1_deg": "rad", "z_cm": "m", "sigma_z_mm": "m", "u_mV": "V"}


def test_trajectory_symbols_are_guessed_from_the_names(tmp_path):
    back = read_trajectory(table(tmp_path, "t_s,theta1_rad,h_m\n0,1,1\n1,1,1\n"))
    assert [quantity.symbol for quantity in back.quantities] == [r"\theta_{1}", "h"]


def test_trajectory_smoothed_state_typed_by_hand_reads_without_its_errors(tmp_path):
    back = read_trajectory(table(tmp_path, "t_s,x_m,smooth_x_m,d_x_m_s\n0,1,1,2\n1,3,3,2\n"))
    np.testing.assert_array_equal(back.smoothed.velocity, [[2], [2]])
    assert np.isnan(np.diagonal(back.smoothed.covariance, axis1=1, axis2=2)).all()


# --------------------------------------------------------------------------- hostile tables

BAD_TABLES = [
    ("", "is empty: it needs a header line, e.g. t_s,theta_rad"),
    ("\n\n\n", "is empty"),
    ("t_s,theta_rad\n", "has a header but no line of data"),
    ("hours,theta_rad\n0,1\n", "has no column t_s, nor one that is called a time; its columns are 'hours'"),
    ("0,1\n0.1,2\n", "has no column t_s, nor one that is called a time; its columns are '1', '2'"),
    ("t_s\n0\n1\n", "has no quantity beside t_s; add a column such as theta_rad"),
    ("t_s,u_V\n0,1\n1,1\n", "has no quantity beside t_s"),
    ("t_s,theta_rad,theta_rad\n0,1,2\n", "two columns 'theta_rad'; rename or delete one"),
    ("t_s,t_s,theta_rad\n0,1,2\n", "two columns 't_s'"),
    ("t_s,theta_rad,theta_deg\n0,1,2\n1,1,2\n", "theta_rad and theta_deg hold the same; delete one"),
    ("t_s,theta\n0,1\n", "column 'theta' is not <name>_<unit>; units are rad, deg"),
    ("t_s,theta_degr\n0,1\n", "'theta_degr' is not <name>_<unit> .is theta_deg meant"),
    ("t_s,x_furlong\n0,1\n", "'x_furlong' is not <name>_<unit>"),
    ("t_s," + "x" * 100_000 + "_m2s\n0,1\n", "column 'x+ is not <name>_<unit> .is x+"),
    ("t_s,x_m,comment\n0,1,hello\n", "column 'comment' is not <name>_<unit>"),
    ("t_s,sigma_x_m\n0,1\n1,1\n", "sigma_x_m belongs to a quantity 'x', which has no column"),
    ("t_s,x_m,sigma_x_rad\n0,1,1\n1,1,1\n", "sigma_x_rad does not have the unit m, as x_m requires"),
    ("t_s,x_m,smooth_x_m\n0,1,1\n1,1,1\n", "has part of a smoothed state; d_x_<unit> is missing"),
    ("t_s,x_m,smooth_x_m,d_x_m\n0,1,1,1\n1,1,1,1\n", "d_x_m does not have the unit m/s, as x_m requires"),
    ("t_s,x_m,cov_x_y\n0,1,1\n1,1,1\n", "has part of a smoothed state"),
    ("t_s,x_m,smooth_x_m,d_x_m_s,cov_x\n0,1,1,1,1\n1,1,1,1,1\n", "cov_x is not a covariance of this table"),
    ("t_s,x_m,u_V,sigma_u_V\n0,1,1,1\n1,1,1,1\n", "sigma_u_V belongs to an input; inputs are known"),
    ("t_s,x_m,sigma_x_m\n0,1,0.1\n1,1,-0.1\n", r"line 3, column sigma_x_m: '-0\.1' is below zero"),
    ("t_s,x_m,\n0,1,2\n", "column 3 has no name; name it or delete it"),
    ("t_s,x_m\n0,1\n1,abc\n", "line 3, column x_m: 'abc' is not a number"),
    ("t_s,x_m\n0,1\n1,1_000\n", "line 3, column x_m: '1_000' is not a number"),
    ("t_s,x_m\n0,1\n1,0x10\n", "'0x10' is not a number"),
    ("t_s,x_m\n0,1\n1,1e999\n", "line 3, column x_m: '1e999' is infinite; leave the cell blank for a gap"),
    ("t_s,x_m\n0,1\n1,-inf\n", "'-inf' is infinite"),
    ("t_s,p_kPa\n0,1\n1,1e308\n", "line 3, column p_kPa: '1e308' is too large for a number in Pa"),
    ("t_s,x_m\n0,1\n,1\n", "line 3, column t_s: '' is blank or not a number"),
    ("t_s,x_m\n0,1\nnan,1\n", "line 3, column t_s: 'nan' is blank or not a number"),
    ("t_s,x_m\n0,1\ninf,1\n", "line 3, column t_s: 'inf' is infinite"),
    ("t_s,x_m\n0,1\n0.2,1\n0.1,1\n", r"line 4, column t_s: '0\.1' is not later than 0\.2 in line 3; sort the rows"),
    ("t_s,x_m\n0,1\n0.1,1\n\n0.10,1\n", r"line 5, column t_s: '0\.10' is not later than 0\.1 in line 3"),
    ("t_s,x_m\n0,1\n1\n", "line 3 has 1 cells, but the header has 2 columns$"),
    ("t_s,x_m\n0,1,2\n", "line 2 has 3 cells, but the header has 2 columns; decimal commas"),
    ("t_s,x_m\n0,1,0,5\n", "line 2 has 4 cells.*decimal commas. separate the cells by semicolons"),
    ("t_s;x_m\n0;1.000,5\n1;2\n", r"line 2, column x_m: '1\.000,5' is not a number"),
    ("t_s,x_m\n0,\n1,nan\n", "no line has a value for x_m; there is nothing to use"),
    ("t_s,theta1_rad,theta2_rad\n0,1,\n1,,1\n", "no line has a value for theta1_rad and theta2_rad"),
    ("t_s,x_m\n0,1\n", "holds one sample; a trajectory needs at least 2"),
    ("t_s,x_m,segment\n0,1,motion\n1,1,flying\n", "line 3, column segment: 'flying' is not a segment; there are hand"),
    ("t_s,x_m,valid\n0,1,1\n1,,1\n", "line 3, column x_m: '' is blank although valid is 1"),
    ("frame,t_s,body,x_px,y_px\n0,0,1,2,3\n", "is a track, in pixels; it needs read_track and to_world"),
    ("t_s,x_m\n0," + "1" * 200_000 + "\n", r"line 2: field larger than field limit \(131072\)"),
    ('t_s,x_m\n0,"1\n1,2\n', "line 2 has 2 cells|not a number"),
    ("t_s,x_m\n0," + "z" * 1000 + "\n", "line 2, column x_m: .{1,60} is not a number"),
    (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "is not a table: it holds NUL bytes"),
    (b"PK\x03\x04\x14\0\x06\0", "cannot be read as an Excel file"),
    (b"t_s,\xe4_m\n0,1\n", "is not text: byte 4 is 0xe4"),
    ("t_s,x_m\n0,1\n".encode("utf-16-le"), "holds NUL bytes"),
    (b"\xff\xfet\0_", "is not a table: it holds NUL bytes"),
]


@pytest.mark.parametrize(("text", "message"), BAD_TABLES)
def test_read_trajectory_bad_table_is_one_data_error_that_names_the_place(tmp_path, text, message):
    path = table(tmp_path, text)
    with pytest.raises(DataError, match=message) as caught:
        read_trajectory(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < len(str(path)) + 400


@pytest.mark.parametrize("read", [read_track, read_trajectory])
@pytest.mark.parametrize("name", ["gone.csv", ".", "a\0b"])
def test_read_of_no_file_is_a_data_error(tmp_path, read, name):
    with pytest.raises(DataError, match="cannot read"):
        read(f"{tmp_path}/{name}")


# --------------------------------------------------------------------------- names and units


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_unit_is_read_and_those_kept_are_written_alike(suffix):
    column = parse_column(f"q_{suffix}")
    assert column.name == "q"
    if column.factor == 1:
        assert unit_suffix(column.unit) == suffix
        assert column_of(column.quantity) == f"q_{suffix}"


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("theta_rad", ("measured", False, "theta", "rad")),
        ("sigma_theta_rad", ("measured", True, "theta", "rad")),
        ("x_m_s", ("measured", False, "x", "m/s")),
        ("d_x_m_s2", ("rate", False, "x", "m/s^2")),
        ("sigma_d_theta1_rad_s", ("rate", True, "theta1", "rad/s")),
        ("sigma_smooth_I_1", ("smooth", True, "I", "")),
        ("d_m", ("measured", False, "d", "m")),
        ("sigma_m", ("measured", False, "sigma", "m")),
        ("water_level_m", ("measured", False, "water_level", "m")),
        ("r_px", ("measured", False, "r", "px")),
        ("φ_rad", ("measured", False, "φ", "rad")),
    ],
)
def test_parse_column_takes_a_name_apart(header, expected):
    column = parse_column(header)
    assert (column.part, column.is_sigma, column.name, column.unit) == expected


@pytest.mark.parametrize("header", ["", "_rad", "rad", "theta_", "1_m", "theta rad", "theta_RAD", "x_m\n", "-x_m"])
def test_parse_column_of_no_column_name_is_a_data_error(header):
    with pytest.raises(DataError, match="is not <name>_<unit>"):
        parse_column(header)


def test_rate_of_units_climbs_in_powers():
    assert [rate_of(unit) for unit in ("m", "m/s", "m/s^2", "")] == ["m/s", "m/s^2", "m/s^3", "1/s"]


def test_symbol_of_greek_and_numbered_names():
    assert [symbol_of(name) for name in ("theta", "theta12", "z", "x1", "water_level")] == [
        r"\theta",
        r"\theta_{12}",
        "z",
        "x_{1}",
        "water_level",
    ]


# --------------------------------------------------------------------------- frames


def test_frame_of_a_track_has_units_and_missing_values():
    frame = to_frame(track())
    assert frame["x_px"].isna().tolist() == [False, True, False, False]
    assert frame["valid"].dtype == bool
    assert frame["hand"].isna().all()


def test_frame_of_a_fit_splits_what_was_observed():
    frame = to_frame(fit_result(predicted=np.ones((5, 1)), residual=np.full((5, 1), 0.25)))
    assert list(frame.columns) == ["t_s", "used", "observed_theta_rad", "predicted_theta_rad", "residual_theta_rad"]
    assert frame["observed_theta_rad"].tolist() == [1.25] * 5


def test_frame_of_estimates_has_one_row_a_name():
    frame = estimates_frame(fit_result())
    assert frame.loc["length", ["value", "stderr", "unit"]].tolist() == [1.7, 0.01, "m"]
    assert frame["free"].tolist() == [True, False]


def test_frames_are_copies_of_the_box():
    original = trajectory()
    frame = to_frame(original)
    frame.loc[0, "theta_rad"] = 99.0
    assert original.position[0, 0] != 99.0


# --------------------------------------------------------------------------- real recordings


def test_track_made_from_the_alexiev_files_reads_exactly(tmp_path):
    t_s, x_px, y_px = (np.loadtxt(recording(f"alexiev_pendulum/length_68_{name}.csv")) for name in "txy")
    pd.DataFrame({"t_s": t_s, "x_px": x_px, "y_px": y_px}).to_csv(tmp_path / "track.csv", index=False)
    (back,) = read_track(tmp_path / "track.csv")
    np.testing.assert_array_equal(back.t_s, t_s)
    np.testing.assert_array_equal(back.xy_px, np.column_stack([x_px, y_px]))
    assert back.n_valid == t_s.size


def test_trajectory_made_from_the_tanks_has_an_input_and_a_level(tmp_path):
    tanks = pd.read_csv(recording("cascaded_tanks/tanque.csv"))
    table = pd.DataFrame({"t_s": 4.0 * np.arange(len(tanks)), "y_V": tanks["yEst"], "u_V": tanks["uEst"]})
    table.to_csv(tmp_path / "tanks.csv", index=False)
    back = read_trajectory(tmp_path / "tanks.csv")
    assert (back.n, [quantity.column for quantity in back.input_quantities]) == (1024, ["u_V"])
    np.testing.assert_array_equal(back.inputs[:, 0], tanks["uEst"])


def test_table_is_not_written_over_what_belongs_to_another_one(tmp_path):
    path = write_trajectory(trajectory(), tmp_path / "t.csv")
    before = (tmp_path / "t.csv.origin.json").read_bytes()
    with pytest.raises(OutputError, match=r"a name that ends in \.origin\.json is for what belongs to a table"):
        write_trajectory(trajectory(), tmp_path / "t.csv.origin.json", overwrite=True)
    assert (tmp_path / "t.csv.origin.json").read_bytes() == before
    assert read_trajectory(path).t_s.size == 5


def test_value_whose_powers_overflow_is_refused():
    with pytest.raises(
        DataError, match=r"a position of 1e\+160 is too large to compute with; give it in a larger unit"
    ):
        trajectory(position=np.full((5, 1), 1e160))


def test_reading_a_long_table_takes_some_times_the_memory_of_its_text(tmp_path):
    path = tmp_path / "long.csv"
    path.write_text("t_s,theta_rad\n" + "".join(f"{k / 100:.2f},{k % 97 / 100}\n" for k in range(50_000)))
    tracemalloc.start()
    sheet = read_sheet(path)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(sheet.lines) == 50_000
    assert sheet.columns["theta_rad"][43_210] == "0.45"
    assert held < 3 * path.stat().st_size  # 20 times with a text a cell
    assert peak < 15 * path.stat().st_size  # of which 5,000 rows, as lists, take most
