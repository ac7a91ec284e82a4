"""The command ``class``: one line from a folder of tables to a page and a workbook, and the page in a real browser."""

import json
import re
import subprocess

import pytest

from tests._browser import BROWSER, FLAGS, browser_is_there
from tests.classroom._tables import FAULTS, write_class


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("class")
    write_class(folder / "clips", 6, faults={"group3": "scale", "group5": "clock"})
    return folder


@pytest.fixture(scope="module")
def first():
    """What the command did first, kept for all tests."""
    return []


@pytest.fixture
def done(cli, folder, first):
    if not first:
        known = ("--phenomenon", "pendulum", "--known", "length=50cm")
        first.append(cli("class", folder / "clips", *known, "-o", folder / "out"))
        assert first[0].status == 0, first[0].err
    return first[0]


def test_groups_with_a_fault_are_printed_with_the_cause(done):
    lines = {line.split()[0]: line for line in done.out.splitlines()}
    assert "wrong scale" in lines["group3"]
    assert "240 fps recording" in lines["group5"]
    assert re.search(r"^length 0\.\d+ ± 0\.\d+ m from 5 of 6 groups", done.out, re.MULTILINE)
    assert "agrees with what is known, 0.5 m" in done.out


def test_page_and_workbook_are_written_and_a_second_run_measures_nothing(cli, done, folder):
    assert (folder / "out" / "class.html").is_file()
    assert (folder / "out" / "class.xlsx").is_file()
    again = cli("class", folder / "clips", "--phenomenon", "pendulum", "--known", "length=50cm", "-o", folder / "out")
    assert "6 groups, 0 measured now" in again.err
    assert again.out == done.out


def test_rows_as_json(cli, done, folder):
    outcome = cli("class", folder / "clips", "--phenomenon", "pendulum", "-o", folder / "out", "--json")
    rows = json.loads(outcome.out)
    assert [row["group"] for row in rows] == [f"group{k}" for k in range(1, 7)]
    assert rows[4]["in the mean"] == "no"


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        ("team,scale\n", (), "it has no column 'team'|it needs a column group"),
        ("group,scale\ngroup9,1px=1m\n", (), "there is no group 'group9'; groups are group1"),
        ("group,scale\ngroup1,1px=1m\ngroup1,2px=1m\n", (), "the group 'group1' is there twice"),
        ("group,fps\ngroup1,fast\n", (), "line 2, column fps: 'fast' is not a number"),
        ("group,scale\ngroup1,big\n", (), "line 2: .*big"),
        ("", ("--known", "weight=1"), "pendulum has no value 'weight'; it has length, damping"),
        ("", ("--teacher", "nobody"), "--teacher 'nobody' is neither a group .* nor a file"),
    ],
)
def test_wrong_requests_are_refused_in_one_line(cli, tmp_path, text, arguments, message):
    write_class(tmp_path / "clips", 2, faults={})
    if text:
        (tmp_path / "clips" / "groups.csv").write_text(text)
    outcome = cli("class", tmp_path / "clips", "--phenomenon", "pendulum", "-o", tmp_path / "out", *arguments)
    assert outcome.status == 1
    assert re.search(message, outcome.err), outcome.err
    assert "Traceback" not in outcome.err


def test_a_groups_own_setting_takes_the_place_of_that_of_all(cli, tmp_path):
    write_class(tmp_path / "clips", 4, faults={"group2": "constant"})
    arguments = ("--phenomenon", "pendulum", "--set", "gravity=9.79", "-o", tmp_path / "out")
    outcome = cli("class", tmp_path / "clips", *arguments)
    assert "it was fitted with 1.62 m/s^2, the others with 9.79 m/s^2" in outcome.out


def test_existing_results_are_not_replaced_without_being_told(cli, tmp_path):
    write_class(tmp_path / "clips", 2, faults={})
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "class.html").write_text("mine")
    outcome = cli("class", tmp_path / "clips", "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert outcome.status == 1
    assert "exists already" in outcome.err
    assert (tmp_path / "out" / "class.html").read_text() == "mine"


# --------------------------------------------------------------------------- in a browser

BY_VALUE = """<script>
const heads = document.querySelectorAll("table.sortable th button");
const order = () => [...document.querySelectorAll("table.sortable tbody tr")].map((row) => row.cells[0].textContent);
const seen = [order()];
for (const click of [1, 1, 0]) { heads[click].click(); seen.push(order()); }
document.title = JSON.stringify(seen);
</script>"""
OPENED = """<script>document.querySelector("ul.named a").click()</script>"""


def browsed(page, script, folder):
    """The page as a real browser leaves it after a script."""
    browser_is_there(driven=False)
    acted = page.with_name("acted.html")
    acted.write_text(page.read_text("utf-8").replace("</body>", f"{script}</body>"), "utf-8")
    flags = ["--headless", *FLAGS, "--virtual-time-budget=5000", f"--user-data-dir={folder}", "--dump-dom"]
    shown = subprocess.run([BROWSER, *flags, acted.as_uri()], capture_output=True, check=True, timeout=120)
    return shown.stdout.decode()


def test_table_is_sorted_by_a_click_in_a_browser(done, folder, tmp_path):
    dom = browsed(folder / "out" / "class.html", BY_VALUE, tmp_path)
    first, up, down, by_name = json.loads(re.search(r"<title>(.*?)</title>", dom)[1])
    assert first == by_name == [f"group{k}" for k in range(1, 7)]
    assert up[-1] == down[0] == "group5"  # 64 times as long
    assert up == down[::-1]


def test_an_outlier_opens_its_own_page_in_a_browser(done, folder, tmp_path):
    assert "group3" in FAULTS
    dom = browsed(folder / "out" / "class.html", OPENED, tmp_path)
    assert "<title>group3: group3.csv</title>" in dom
