"""The page and the workbook: self-contained, escaped, the same bytes for the same class, readable by others."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
import python_calamine

from iris_sysid.classroom.page import page_text, write_page
from iris_sysid.classroom.summary import summary_of
from iris_sysid.classroom.workbook import write_workbook
from iris_sysid.errors import OutputError
from iris_sysid.io.schemas import EstimateEntry, GroupDocument, VerdictEntry
from iris_sysid.types import Completeness, Estimate, Verdict
from tests._browser import browser_is_there, started_browser

ODD = ['<script>alert("1")</script>', "=1+1", "$x_{$", "Ä & b", "http://example.org/", "g6", "g7"]


def document(name, length, tilt=0.0):
    def entry(value, stderr, unit, kind="fitted"):
        half = 1.96 * stderr
        return EstimateEntry(
            value=value, stderr=stderr, ci95=(value - half, value + half), unit=unit, measurement_type=kind
        )

    return GroupDocument(
        group=name,
        source=f"{name}.csv",
        model="pendulum",
        equation="",
        status="ok",
        message="",
        verdict=VerdictEntry.of(Verdict("good", (), Completeness(0.9999, True, 1.0))),
        parameters={"length": entry(length, 0.001, "m"), "damping": entry(0.05, 0.01, "1/s")},
        free=["length", "damping"],
        evidence={"tilt": entry(tilt, 0.002, "rad", "derived"), "time_step": entry(1 / 60, 0.0, "s", "derived")},
        origin={},
    )


def odd_class():
    lengths = [0.5, 0.502, 0.499, 0.501, 0.4985, 0.62, 0.5005]
    documents = [
        document(name, length, 0.2 if name == "g7" else 0.0) for name, length in zip(ODD, lengths, strict=True)
    ]
    pages = [f"groups/{k} #/report.html" for k in range(len(ODD))]
    return summary_of(documents, pages, known={"length": Estimate(0.5, 0.0, "m")})


class Tags(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))


def test_page_is_one_file_whose_texts_are_escaped():
    text = page_text(odd_class(), "<b>class</b>")
    tags = Tags(text).found
    assert [tag for tag, _ in tags].count("script") == 1
    assert "b" not in [tag for tag, _ in tags]
    addresses = [value for _, attributes in tags for name, value in attributes.items() if name in ("src", "href")]
    assert addresses
    assert all(value.startswith(("groups/", "#")) and " " not in value for value in addresses)


def test_page_names_the_groups_to_look_at_with_a_link_to_their_pages():
    text = page_text(odd_class(), "class")
    assert "Look at these 2 groups" in text
    assert re.search(r'<a href="groups/5%20%23/report.html">g6</a>: no cause found', text)
    assert re.search(r'<a href="groups/6%20%23/report.html">g7</a>: camera tilted', text)
    assert "Agrees with what is known" in text


def test_page_says_how_the_track_of_a_group_to_look_at_is_corrected():
    commands = {"g6": "iris-sysid review 'class/groups/<g6>' --clip clips/g6.mp4", "g1": "iris-sysid review one"}
    text = page_text(odd_class(), "class", commands)
    assert "no cause found<br>" in text
    assert "<code>iris-sysid review &#39;class/groups/&lt;g6&gt;&#39; --clip clips/g6.mp4</code>" in text
    assert "iris-sysid review one" not in text  # nothing is wrong with it


def test_page_that_is_served_links_to_reviews_and_to_nothing_else():
    address = "review/g6/?token=a&b"
    text = page_text(odd_class(), "class", {"g6": "iris-sysid review g6"}, served={"g6": address})
    addresses = [attributes["href"] for _, attributes in Tags(text).found if "href" in attributes]
    assert set(addresses) == {address}
    assert "Correct its track by hand</a>" in text
    assert "<code>" not in text


def test_table_of_the_page_is_whole_without_its_script():
    rows = re.findall(r"<tr[^>]*><td class=\"text\" data-key", page_text(odd_class(), "class"))
    assert len(rows) == len(ODD)


def test_every_cell_names_its_column_for_a_phone():
    cells = [attributes for tag, attributes in Tags(page_text(odd_class(), "class")).found if tag == "td"]
    assert cells
    assert all(cell["data-label"] for cell in cells)


@pytest.mark.parametrize("width", [400, 1200])
def test_nothing_is_cut_on_a_phone_or_a_desk(tmp_path, width):
    browser_is_there()
    page = write_page(odd_class(), "class", tmp_path / "class.html")
    with started_browser(tmp_path / "profile") as browser:
        size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width == 400}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        browser.get(page.as_uri())
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        cut = "return [...document.querySelectorAll('.scroll, td')].filter(b => b.scrollWidth > b.clientWidth + 1)"
        assert browser.execute_script(cut) == []


def test_page_and_workbook_are_the_same_bytes_again(tmp_path):
    for name in ("first", "second"):
        write_page(odd_class(), "class", tmp_path / f"{name}.html")
        write_workbook(odd_class(), tmp_path / f"{name}.xlsx")
    for suffix in ("html", "xlsx"):
        assert (tmp_path / f"first.{suffix}").read_bytes() == (tmp_path / f"second.{suffix}").read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        write_page(odd_class(), "class", tmp_path / "first.html")


def test_workbook_holds_the_groups_as_text_and_numbers(tmp_path):
    write_workbook(odd_class(), tmp_path / "class.xlsx")
    book = python_calamine.CalamineWorkbook.from_path(tmp_path / "class.xlsx")
    head, *rows = book.get_sheet_by_name("groups").to_python()
    assert [row[0] for row in rows] == ODD
    assert head[1:5] == ["length (m)", "standard error (m)", "95 % from", "95 % to"]
    assert rows[5][3] < rows[5][1] < rows[5][4]
    assert {row[head.index("numbers")] for row in rows} <= {"usable", "doubtful", "failed"}
    assert rows[5][1] == 0.62
    assert [row[head.index("in the mean")] for row in rows] == ["yes"] * 5 + ["no", "yes"]
    assert rows[6][head.index("what is wrong")].startswith("camera tilted")
    means = book.get_sheet_by_name("means").to_python()
    assert [row[1] for row in means[1:3]] == ["without outliers", "with outliers"]


def test_class_of_one_group_has_a_page_without_a_mean(tmp_path):
    result = summary_of([document("alone", 0.5)], ["groups/alone/report.html"])
    assert result.pooled is None
    assert "too few for a mean" in page_text(result, "class")
    write_workbook(replace(result, every=None), tmp_path / "class.xlsx")


def test_group_without_a_value_is_a_row_with_the_reason():
    failed = GroupDocument(
        group="g9", source="g9.mp4", model="pendulum", equation="", status="failed", message="no body moves", origin={}
    )
    documents = [document("a", 0.5), document("b", 0.501), failed]
    text = page_text(summary_of(documents, ["groups/a/report.html", "groups/b/report.html", ""]), "class")
    assert "<strong>g9</strong>: no value: no body moves" in text


def test_value_just_below_that_of_the_others_has_no_negative_zero():
    lengths = [0.499, 0.4995, 0.49999, 0.5, 0.5005, 0.501]
    result = summary_of([document(str(k), length) for k, length in enumerate(lengths)], [""] * len(lengths))
    assert min(abs(group.in_errors) for group in result.groups if group.in_errors < 0) < 0.05
    text = page_text(result, "class")
    assert "+0.0" in text
    assert "−0.0" not in text
