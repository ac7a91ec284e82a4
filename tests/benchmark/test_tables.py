"""One table in four forms: the same cells, escaped, bold by what is displayed, the same bytes."""

import csv
import io
from html.parser import HTMLParser

import pytest

from iris_sysid.benchmark.sources.rows import flat_rows
from iris_sysid.benchmark.tables.summary import displayed, parameter_summary
from iris_sysid.benchmark.tables.table import Cell, Table, parameter_table, render
from iris_sysid.errors import UnknownNameError

FORMS = ("csv", "markdown", "latex", "html")


def rows(**values_by_method):
    """Flat rows of one parameter; None is a failed run."""
    return flat_rows(
        {
            "phenomenon": "Pendulum",
            "setting": "pendulum_20",
            "clip": f"{k:02d}",
            "method": method,
            "parameter": "length",
            "value": value,
            "unit": "m",
            "truth": 0.5,
            "status": "failed" if value is None else "ok",
        }
        for method, values in values_by_method.items()
        for k, value in enumerate(values)
    )


def line(table, method):
    return table.set_index("method").loc[method]


def test_summary_counts_values_and_failures_apart():
    row = line(parameter_summary(rows(classical=[0.52, 0.54, None])), "classical")
    assert (row["n"], row["failed"]) == (2, 1)
    assert row["mae"] == pytest.approx(0.03)
    assert row["mean"] == pytest.approx(0.53)
    assert row["relative_percent"] == pytest.approx(6.0)


def test_method_whose_runs_all_failed_has_no_error_and_is_not_best():
    table = parameter_summary(rows(broken=[None, None], other=[0.9]))
    assert line(table, "broken")["failed"] == 2
    assert line(table, "broken")["mae"] != line(table, "broken")["mae"]  # NaN
    assert not line(table, "broken")["best"]
    assert line(table, "other")["best"]


def test_method_scored_on_fewer_clips_is_not_best_though_its_error_is_smaller():
    table = parameter_summary(rows(one=[0.50001], all_three=[0.51, 0.52, None]))
    assert not line(table, "one")["best"]
    assert line(table, "all_three")["best"]


def test_best_is_by_the_displayed_number_and_may_be_shared():
    table = parameter_summary(rows(a=[0.53001], b=[0.53002], c=[0.54]))
    assert [bool(line(table, name)["best"]) for name in "abc"] == [True, True, False]


def test_null_baselines_are_there_and_do_not_compete():
    table = parameter_summary(rows(poor=[2.0]))
    nulls = table[table["method"].str.startswith("initial value only")]
    assert len(nulls) == 2
    assert not nulls["best"].any()
    assert line(table, "poor")["best"]
    assert line(table, "poor")["beats_initial"] == "no"


def test_null_baseline_that_displays_the_same_error_is_still_not_best():
    table = parameter_summary(rows(same=[0.980665]))
    assert line(table, "initial value only (10, code)")["mae"] == pytest.approx(line(table, "same")["mae"])
    assert table[table["best"]]["method"].tolist() == ["same"]
    assert line(table, "same")["beats_initial"] == "no"


def test_no_rows_make_an_empty_table():
    for form in FORMS:
        assert render(parameter_table(flat_rows([])), form)


@pytest.mark.parametrize("form", FORMS)
def test_same_rows_give_the_same_bytes(form):
    made = [render(parameter_table(rows(a=[0.6, None], b=[0.7, 0.71])), form) for _ in range(2)]
    assert made[0] == made[1]
    assert made[0].endswith("\n")


def test_every_form_shows_the_same_cells():
    table = parameter_table(rows(a=[0.6, None], b=[0.7, 0.71]))
    shown = [[cell.text for cell in row] for row in table.rows]
    read = list(csv.reader(io.StringIO(render(table, "csv"))))
    assert read[0] == [*table.header, "bold"]
    assert [row[:-1] for row in read[1:]] == shown
    html = Cells()
    html.feed(render(table, "html"))
    assert html.rows == shown
    body = render(table, "latex").split("\\endhead\n")[1].split("\n\\bottomrule")[0]
    assert body.count(r"\\") == len(shown)
    assert sum(line.startswith("| Pendulum") for line in render(table, "markdown").split("\n")) == len(shown)


def test_bold_is_set_in_every_form():
    table = parameter_table(rows(a=[0.6], b=[0.7]))
    assert "**0.100**" in render(table, "markdown")
    assert r"\textbf{0.100}" in render(table, "latex")
    assert "<strong>0.100</strong>" in render(table, "html")
    bold = [row["bold"] for row in csv.DictReader(io.StringIO(render(table, "csv")))]
    assert bold == ["MAE", "", "", ""]


HOSTILE = "<script>alert('x')</script> & | % $ # _ { } ~ ^ \\ `*[a](b) – ±"


def test_hostile_names_are_shown_and_not_run():
    table = Table(HOSTILE, (HOSTILE,), ((Cell(HOSTILE, bold=True),),), notes=(HOSTILE,))
    page = render(table, "html")
    assert "<script" not in page
    assert page.count("&lt;script&gt;") == 4
    assert r"\&" in render(table, "latex")
    assert "<script" not in render(table, "latex").replace(r"\textless{}script", "")
    markdown = render(table, "markdown")
    assert r"\<script\>" in markdown
    assert r"\|" in markdown


def test_unknown_form_names_the_forms():
    with pytest.raises(UnknownNameError, match="csv, markdown, latex, html"):
        render(Table("", ("a",), ()), "pdf")


@pytest.mark.parametrize(
    ("value", "text"),
    [(95.0674, "95.1"), (0.34728, "0.347"), (741.11, "741"), (6261.8, "6262"), (0.0, "0"), (5.55e-17, "5.55e-17")],
)
def test_number_is_displayed_to_three_digits(value, text):
    assert displayed(value) == text


def test_nan_is_displayed_as_a_dash():
    assert displayed(float("nan")) == "–"


class Cells(HTMLParser):
    """The texts of the cells of a page's table, row by row."""

    def __init__(self):
        super().__init__()
        self.rows, self.inside = [], False

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        if tag == "td":
            self.rows[-1].append("")
            self.inside = True

    def handle_endtag(self, tag):
        self.inside = self.inside and tag != "td"
        if tag == "table":
            self.rows = [row for row in self.rows if row]

    def handle_data(self, data):
        if self.inside:
            self.rows[-1][-1] += data
