"""Tables that validation programs write into the docs."""

import re

import pytest

from iris_sysid.benchmark.sources.rows import flat_rows, rows_text
from tests._project import ROOT
from validation import benchmark_tables, pages
from validation.__main__ import programs
from validation.benchmark_tables import TABLES

PAGE = """# Title

Text before.

<!-- table: first -->
<!-- end -->

Between.

<!-- table: second -->
old
<!-- end -->
After.
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "page.md").write_text(PAGE, encoding="utf-8")
    (tmp_path / "other.md").write_text("# Other\n", encoding="utf-8")
    monkeypatch.setattr(pages, "ROOT", tmp_path)
    monkeypatch.setattr(pages, "page_with", lambda name: page_with(name, tmp_path))
    return tmp_path


page_with = pages.page_with


def test_table_replaces_only_its_own_block(folder):
    pages.write_table(folder / "page.md", "second", "| a |\n|---|\n| 1 |\n", "python -m validation.coverage")
    text = (folder / "page.md").read_text(encoding="utf-8")
    assert text.startswith(PAGE.partition("<!-- table: second -->")[0])
    assert text.endswith("| 1 |\n<!-- end -->\nAfter.\n")
    assert "old" not in text


def test_header_says_command_commit_and_date(folder):
    pages.write_table(folder / "page.md", "first", "| a |", "python -m validation.coverage --seeds 4")
    header = (folder / "page.md").read_text(encoding="utf-8").splitlines()[5]
    assert re.fullmatch(
        r"\*`python -m validation.coverage --seeds 4`, commit (unknown|[0-9a-f]+( \+ changes)?), \d{4}-\d\d-\d\d\*",
        header,
    )


def test_second_writing_replaces_the_first(folder):
    for value in "12":
        pages.write_table(folder / "page.md", "first", f"| {value} |", "python -m validation.coverage")
    text = (folder / "page.md").read_text(encoding="utf-8")
    assert "| 1 |" not in text
    assert text.count("python -m validation.coverage") == 1


def test_paragraph_and_table_are_kept_apart(folder):
    pages.write_table(folder / "page.md", "first", "\nFour rows\n| a |\n|---|\n| 1 |\nA note\n", "python -m x")
    text = (folder / "page.md").read_text(encoding="utf-8")
    assert "Four rows\n\n| a |\n|---|\n| 1 |\n\nA note\n<!-- end -->" in text


def test_printed_output_goes_to_the_terminal_and_to_the_page(folder, capsys):
    with pages.table("first", True):
        print("| a |")
    assert capsys.readouterr().out == "| a |\n"
    assert "\n\n| a |\n<!-- end -->" in (folder / "page.md").read_text(encoding="utf-8")


def test_without_the_option_no_page_is_touched(folder):
    with pages.table("no such table", False):
        print("| a |")
    assert (folder / "page.md").read_text(encoding="utf-8") == PAGE


def test_unknown_table_is_refused_before_the_work(folder):
    with pytest.raises(LookupError, match=r"no page of . has <!-- table: third -->"), pages.table("third", True):
        pytest.fail("nothing should be measured")
    with pytest.raises(LookupError, match=r"other.md needs one pair of lines <!-- table: first -->"):
        pages.write_table(folder / "other.md", "first", "", "python -m x")


def test_failed_run_leaves_the_page_as_it_was(folder):
    with pytest.raises(ZeroDivisionError), pages.table("first", True):
        print(1 / 0)
    assert (folder / "page.md").read_text(encoding="utf-8") == PAGE


def test_command_names_no_folder_of_this_machine():
    given = ["--dataset", str(ROOT / "dataset"), "--seeds", "4", "--write-docs"]
    assert pages.command_line(given).endswith(" --dataset dataset --seeds 4")


SOURCES = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "validation").rglob("*.py")}
WRITTEN = [
    name
    for source in SOURCES.values()
    for names in re.findall(r"pages\.table\(((?:\"[\w-]+\"|[\w .]| if | else )+),", source)
    for name in re.findall(r"\"([\w-]+)\"", names)
]


@pytest.mark.parametrize("name", sorted({*WRITTEN, *TABLES.values(), "blind", "mismatch", "calibration-reference"}))
def test_every_table_that_a_program_writes_has_one_place_in_the_docs(name):
    assert page_with(name).suffix == ".md"


def test_benchmark_tables_are_printed_from_rows(tmp_path, monkeypatch, capsys):
    row = {"dataset": "iris", "phenomenon": "Pendulum", "setting": "pendulum_20", "clip": "01", "method": "ode"}
    row |= {"parameter": "length", "value": 0.51, "unit": "m", "truth": 0.5, "status": "ok"}
    (tmp_path / "rows.csv").write_text(rows_text(flat_rows([row])), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["benchmark_tables", str(tmp_path / "rows.csv")])
    benchmark_tables.main()
    assert "| Pendulum | pendulum_20 | length |" in capsys.readouterr().out


def test_programs_are_listed_with_what_they_do():
    listed = programs()
    assert {"audit", "coverage", "groundtruth"} <= set(listed)
    assert "pages" not in listed
    assert all(listed.values())
