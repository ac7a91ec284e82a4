"""Units and numbers as a user types them."""

import math

import pytest

from iris_sysid.errors import DataError
from iris_sysid.units import (
    ANGLES,
    FRACTIONS,
    LENGTHS,
    SETTINGS,
    UNITS,
    base_unit,
    parse_measure,
    parse_numbers,
    parse_scale,
    parse_scale_bar,
    rate_of,
)


@pytest.mark.parametrize(
    ("text", "units", "value", "stderr"),
    [
        ("5cm+-2mm", LENGTHS, 0.05, 0.002),
        ("-5 cm", LENGTHS, -0.05, 0.0),
        ("25.0+-0.1mm", LENGTHS, 0.025, 0.0001),
        ("25.0(1)mm", LENGTHS, 0.025, 0.0001),
        ("60deg±1deg", ANGLES, math.pi / 3, math.pi / 180),
        ("50ppm", FRACTIONS, 5e-5, 0.0),
        ("0.3 1/s", SETTINGS, 0.3, 0.0),
        ("180deg/s", SETTINGS, math.pi, 0.0),
    ],
)
def test_measure_is_read_with_its_standard_error(text, units, value, stderr):
    measure = parse_measure(text, units, "x")
    assert (measure.value, measure.stderr) == pytest.approx((value, stderr))


@pytest.mark.parametrize(
    "text", ["", "5", "5furlong", "5cm+-2deg", "1e999m", "5cm+-", "5cm+-2mm+-1mm", "nan m", "5(1)cm+-1mm", "0.31/s"]
)
def test_measure_that_cannot_be_read_shows_one_that_can(text):
    with pytest.raises(DataError, match="write it as 5cm"):
        parse_measure(text, LENGTHS, "5cm")


def test_standard_error_of_another_kind_than_the_value_is_refused():
    with pytest.raises(DataError, match="are in px and m"):
        parse_measure("5px+-2mm", ("px", *LENGTHS), "5px")


@pytest.mark.parametrize("spelled", UNITS)
def test_rate_of_a_unit_is_the_unit_of_the_rate(spelled):
    base, factor = base_unit(spelled)
    assert base_unit(f"{spelled}/s") == (rate_of(base), factor)
    assert base_unit(f"{spelled}/s^2") == (rate_of(rate_of(base)), factor)


def test_numbers_are_read_one_for_each_name():
    assert parse_numbers(" 1, -2.5,3e2 ", "x,y,z") == (1.0, -2.5, 300.0)


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan", "1,2,1e999", "1,2,", "1_0,2,3"])
def test_numbers_that_cannot_be_read_are_refused(text):
    with pytest.raises(DataError, match=r"it must be x,y,z, e\.g\. 10,10,10"):
        parse_numbers(text, "x,y,z")


def test_scale_is_read_in_either_order():
    assert parse_scale("640+-3px=200(1)cm") == parse_scale("200(1)cm=640+-3px")
    assert parse_scale("640px=1m") == ((640.0, 0.0, "px"), (1.0, 0.0, "m"))


def test_scale_bar_is_read_with_its_ends():
    start, end, length = parse_scale_bar("1,2,300,4=84.0(5)cm")
    assert (start, end) == ((1.0, 2.0), (300.0, 4.0))
    assert (length.value, length.stderr) == pytest.approx((0.84, 0.005))
