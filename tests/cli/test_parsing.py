"""What users type is read as they mean it, or refused with an example of what is right."""

import math
import time

import pytest

from iris_sysid.cli import _parsing
from iris_sysid.cli._own_equation import parsed_bounds
from iris_sysid.cli._terminal import one_line
from iris_sysid.errors import DataError
from iris_sysid.io.table_headers import parse_columns
from iris_sysid.types import TrackMark

LONG = 30_000
UNITS = {"gravity": "m/s^2", "length": "m", "angle": "rad"}


@pytest.mark.parametrize(
    ("text", "name", "value", "stderr", "unit"),
    [
        ("gravity=9.79", "gravity", 9.79, 0.0, ""),
        (" gravity=9.79 ", "gravity", 9.79, 0.0, ""),
        ("gravity=9.79+-0.01", "gravity", 9.79, 0.01, ""),
        ("gravity=9.79 +/- 0.01 m/s^2", "gravity", 9.79, 0.01, "m/s^2"),
        ("gravity=9.79±.01m/s^2", "gravity", 9.79, 0.01, "m/s^2"),
        ("ball_radius=33.5+-0.5mm", "ball_radius", 0.0335, 0.0005, "m"),
        ("length=50cm", "length", 0.5, 0.0, "m"),
        ("arc_radius=120px", "arc_radius", 120.0, 0.0, "px"),
        ("angle=-90deg", "angle", -math.pi / 2, 0.0, "rad"),
        ("omega_0=180deg/s", "omega_0", math.pi, 0.0, "rad/s"),
        ("damping=1e-3", "damping", 0.001, 0.0, ""),
        ("damping=.5", "damping", 0.5, 0.0, ""),
    ],
)
def test_setting_is_read_in_si_units(text, name, value, stderr, unit):
    (setting,) = _parsing.settings([text]).items()
    assert setting[0] == name
    assert setting[1].value == pytest.approx(value)
    assert setting[1].stderr == pytest.approx(stderr)
    assert setting[1].unit == unit
    assert setting[1].measurement_type == "direct"
    assert setting[1].source == f"given: {text.strip()}"


def test_setting_without_unit_takes_the_unit_of_its_name():
    settings = _parsing.settings(["gravity=9.79", "length=50cm", "friction=0.3"], UNITS)
    assert [estimate.unit for estimate in settings.values()] == ["m/s^2", "m", ""]
    assert settings["length"].value == 0.5


def test_setting_in_pixels_is_kept_for_a_clip_without_scale():
    assert _parsing.settings(["length=120px"], UNITS)["length"].unit == "px"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("length=3deg", "length is in m, not in rad .given: length=3deg."),
        ("angle=29mm", "angle is in rad, not in m"),
        ("gravity=9.79m", "gravity is in m/s.2, not in m "),
    ],
)
def test_setting_in_a_unit_of_another_kind_is_refused(text, message):
    with pytest.raises(DataError, match=message):
        _parsing.settings([text], UNITS)


@pytest.mark.parametrize(
    "text",
    [
        "", "gravity", "gravity=", "=9.79", "gravity=nine", "gravity=nan", "gravity=9,79", "9.79=gravity", "gravity 9",
        "gravity==9.79", "gravity=9.79+-", "ball_radius=3furlong", "ball-radius=3mm", "gravity=9.79 9.81", "a\n=3",
    ],
)  # fmt: skip
def test_setting_that_cannot_be_read_is_refused_with_an_example(text):
    with pytest.raises(DataError, match=r"write it as gravity=9\.79 or ball_radius=33\.5"):
        _parsing.settings([text])


@pytest.mark.parametrize("text", ["gravity=1e999", "gravity=1+-1e999"])
def test_setting_that_is_not_finite_is_refused(text):
    with pytest.raises(DataError, match="not a finite number"):
        _parsing.settings([text])


@pytest.mark.parametrize(
    ("read", "texts", "name"),
    [
        (_parsing.settings, ["gravity=9.79", "gravity=9.81"], "gravity"),
        (_parsing.marks, ["pivot=1,2", "pivot=3,4"], "pivot"),
        (_parsing.effects, ["impact=1", "impact=2"], "impact"),
    ],
)
def test_name_given_twice_is_refused(read, texts, name):
    with pytest.raises(DataError, match=f"'{name}' is given twice; give it once"):
        read(texts)


def test_region_is_read_in_whole_pixels():
    assert _parsing.region("10,20,300.4,200") == (10, 20, 300, 200)
    assert _parsing.region(None) is None


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5", "a,b,c,d", "1;2;3;4", "1,2,nan,4", "1,2,inf,4"])
def test_region_that_cannot_be_read_is_refused_with_its_form(text):
    with pytest.raises(DataError, match=r"it must be x,y,width,height, e\.g\. 10,10,10,10"):
        _parsing.region(text)


@pytest.mark.parametrize("text", ["0,0,0,10", "0,0,10,0", "0,0,-10,10", "0,0,0.4,10"])
def test_region_without_area_is_refused(text):
    with pytest.raises(DataError, match="is empty: its width and height must be at least 1 px"):
        _parsing.region(text)


def test_marks_of_bodies_in_frames_are_told_from_points():
    texts = ["pivot=437,42", "1=120,88.5@35", "left ball = 3,4 @ 0", "plumb=1,2,3,4"]
    assert _parsing.body_marks(texts) == (TrackMark("1", 120.0, 88.5, 35), TrackMark("left ball", 3.0, 4.0, 0))
    assert _parsing.marks(texts) == {"pivot": (437.0, 42.0)}


@pytest.mark.parametrize("text", ["1=120@35", "1=120,88@", "1=120,88@3.5", "=1,2@3", "1=a,b@3"])
def test_mark_of_a_body_that_cannot_be_read_is_refused_with_the_right_form(text):
    with pytest.raises(DataError, match="body=x,y@frame"):
        _parsing.body_marks([text])


def test_marks_are_read_by_name():
    assert _parsing.marks(["pivot=437,42.5", "launch=-5,103"]) == {"pivot": (437.0, 42.5), "launch": (-5.0, 103.0)}


@pytest.mark.parametrize("text", ["pivot", "437,42", "nail=437,42", ""])
def test_mark_of_another_name_is_refused_with_the_names_there_are(text):
    with pytest.raises(DataError, match="write it as pivot=437,42; marks are pivot, launch"):
        _parsing.marks([text])


@pytest.mark.parametrize("text", ["pivot=", "pivot=437", "pivot=437,42,1", "pivot=here,there", "pivot=nan,3"])
def test_mark_without_two_numbers_is_refused(text):
    with pytest.raises(DataError, match="it must be x,y"):
        _parsing.marks([text])


def test_size_is_read():
    assert _parsing.size("1280x720") == (1280, 720)


@pytest.mark.parametrize("text", ["", "1280", "1280*720", "1280x", "axb", "-1x5", "1280x720x3", "999999x10"])
def test_size_that_cannot_be_read_is_refused_with_an_example(text):
    with pytest.raises(DataError, match="write it as 1280x720"):
        _parsing.size(text)


def test_effects_are_read_by_name():
    assert _parsing.effects(["quadratic-drag=0.08", "zero-offset=-1e-2"]) == {
        "quadratic-drag": 0.08,
        "zero-offset": -0.01,
    }


@pytest.mark.parametrize("text", ["", "quadratic-drag", "quadratic-drag=", "quadratic-drag=much", "Quadratic=1", "=1"])
def test_effect_that_cannot_be_read_is_refused_with_an_example(text):
    with pytest.raises(DataError, match=r"write it as quadratic-drag=0\.08"):
        _parsing.effects([text])


def test_board_is_read_as_a_user_writes_it():
    board = _parsing.board("9x6", "25.0+-0.1mm", "18 mm")
    assert (board.columns, board.rows, board.label) == (9, 6, "9x6")
    assert (board.square_m, board.square_stderr_m, board.marker_m) == pytest.approx((0.025, 0.0001, 0.018))
    assert _parsing.board("9×6", "2.5cm").square_m == pytest.approx(0.025)


@pytest.mark.parametrize(
    ("corners", "square", "message"),
    [
        ("9", "25mm", "columns x rows, e.g. 9x6"),
        ("9x6", "25", "'25' has no unit; units are m, cm, mm; write it as 25mm"),
        ("9x6", "25px", "has the unit 'px'"),
        ("9x6", None, "both --board 9x6 and --square 25mm"),
        (None, "25mm", "both --board 9x6 and --square 25mm"),
    ],
)
def test_board_that_cannot_be_read_is_refused_with_an_example(corners, square, message):
    with pytest.raises(DataError, match=message):
        _parsing.board(corners, square)


@pytest.mark.parametrize(("text", "value"), [("50ppm", 5e-5), ("0.01%", 1e-4), ("0%", 0.0)])
def test_fraction_is_read(text, value):
    assert _parsing.fraction(text) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "name", "gamma", "stderr"),
    [
        ("srgb", "srgb", 1.0, 0.10),
        ("BT709", "bt709", 1.0, 0.10),
        ("linear", "linear", 1.0, 0.01),
        ("gamma=2.2", "gamma", 2.2, 0.10),
        ("gamma=2.2+-2%", "gamma", 2.2, 0.02),
        ("bt709 +- 0%", "bt709", 1.0, 0.0),
    ],
)
def test_transfer_function_is_read_with_the_error_of_its_exponent(text, name, gamma, stderr):
    curve = _parsing.transfer(text)
    assert (curve.name, curve.gamma, curve.source) == (name, gamma, "given")
    assert curve.stderr == pytest.approx(stderr)


@pytest.mark.parametrize("text", ["rec709", "gamma", "gamma=much", "gamma=50", "bt709=3", "", "srgb+-500%"])
def test_transfer_function_that_is_none_is_refused(text):
    with pytest.raises(DataError, match=r"gamma"):
        _parsing.transfer(text)


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (lambda text: _parsing.settings([text]), "x=" + "1" * LONG),
        (lambda text: _parsing.settings([text]), "x=" + f" {'1' * LONG}" * 2),
        (lambda text: _parsing.settings([text]), f"x=1e-{'1' * LONG}(1)m"),
        (lambda text: _parsing.settings([text]), f"x=1e{'1' * LONG}(1)m"),
        (lambda text: _parsing.effects([text]), f"a={'1' * LONG}:"),
        (_parsing.region, f"{'1' * LONG}!,1,1,1"),
        (lambda text: _parsing.body_marks([text]), f"1{' ' * LONG}@"),
        (lambda text: parsed_bounds([text]), f"x={'1' * LONG}"),
        (lambda text: parsed_bounds([text]), f"x={' ' * LONG}"),
        (parse_columns, f",a{' ' * LONG}"),
        (parse_columns, ",a[" * (LONG // 3)),
    ],
)
def test_long_text_is_refused_in_time_that_grows_with_its_length(read, text):
    start = time.process_time()
    with pytest.raises(DataError):
        read(text)
    assert time.process_time() - start < 2.0  # about a minute where it grew with the square


def test_message_of_an_error_is_a_line_of_bounded_length():
    line = one_line("cell '" + "x\n" * 100_000 + "' is no number")
    assert len(line) < 10_000
    assert line.startswith("cell 'x\\nx")
    assert line.endswith("is no number")
