"""The transcribed numbers agree with the stated positions in the paper, digit by digit."""

import re

import pytest

from iris_sysid.benchmark.sources.published import truth_of, truths
from tests._project import publication
from validation.audit.printed import PublishedValue, published_values

VALUES = published_values()


@pytest.fixture(scope="module")
def lines():
    text = publication("iris_benchmark.tex").read_text(encoding="utf-8").split("\n")
    return [re.sub(r"\{\\times\}10\^\{(-?\d+)\}", r"e\1", line) for line in text]


@pytest.mark.parametrize("row", VALUES.to_dict("records"), ids=VALUES["key"])
def test_number_stands_on_its_line_as_printed(lines, row):
    token = re.escape(row["printed"].lstrip("+"))
    assert re.search(rf"(?<![\d.]){token}(?!\d|\.\d)", lines[row["line"] - 1])


def test_bold_numbers_are_bold_on_their_line(lines):
    for row in VALUES[VALUES["bold"]].to_dict("records"):
        assert rf"\textbf{{{row['printed']}}}" in lines[row["line"] - 1], row["key"]


def test_every_table_label_is_in_the_source(lines):
    text = "\n".join(lines)
    for place in VALUES["place"].unique():
        label = place.removeprefix("text:")
        assert label in ("abstract",) or rf"\label{{{label}}}" in text, place


def test_each_number_has_a_name_of_its_own():
    assert not VALUES["key"].duplicated().any()


@pytest.mark.parametrize(
    ("printed", "number", "tolerance"),
    [
        ("95.07", 95.07, 0.005),
        ("+740.0", 740.0, 0.05),
        ("2.4e-2", 0.024, 0.0005),
        ("10", 10.0, 0.5),
        ("four", 4.0, 0.0),
    ],
)
def test_tolerance_is_half_of_the_last_printed_digit(printed, number, tolerance):
    value = PublishedValue("tab:x", 1, "iris", "Pendulum", "", "length", "mean", printed, "m", False)
    assert value.number == number
    assert value.tolerance == pytest.approx(tolerance)


def test_truth_is_given_with_its_source_or_not_at_all():
    rope = truth_of("iris", "Pendulum", "pendulum_45", "length")
    assert rope is not None
    assert (rope.value, rope.unit, rope.uncertainty, rope.measurement_type) == (0.5, "m", 0.002, "direct")
    assert truth_of("iris", "Hitting_cones", "slow", "coupling") is None


def test_rotation_truth_is_called_assumed():
    table = truths()
    assert set(table[table["phenomenon"] == "Rotation"]["measurement_type"]) == {"assumed"}
