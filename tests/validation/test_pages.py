"""Tables that validation programs write into the docs."""

import re

import pandas as pd
import pytest

from iris_sysid.benchmark.sources.rows import flat_rows, rows_text
from tests._project import ROOT
from validation import benchmark_tables, pages, plots
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
    monkeypatch.setattr(pages, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(pages, "page_with", lambda name: page_with(name, tmp_path))
    return tmp_path


page_with = pages.page_with


def test_table_replaces_only_its_own_block(folder):
    pages.write_table(folder / "page.md", "second", "| a |\n|---|\n| 1 |\n", "python -m validation.coverage")
    text = (folder / "page.md").read_text(encoding="utf-8")
    assert text.startswith(PAGE.partition("<!-- table: second -->")[0])
    assert text.endswith("| 1 |\n\n[second.csv](../../validation/results/second.csv)\n<!-- end -->\nAfter.\n")
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
    link = "[first.csv](../../validation/results/first.csv)"
    assert f"Four rows\n\n| a |\n|---|\n| 1 |\n\n{link}\n\nA note\n<!-- end -->" in text


def test_printed_output_goes_to_the_terminal_and_to_the_page(folder, capsys):
    with pages.table("first", True):
        print("| a |")
    assert capsys.readouterr().out == "| a |\n"
    assert "\n\n| a |\n\n[first.csv]" in (folder / "page.md").read_text(encoding="utf-8")


def test_without_the_option_no_page_is_touched(folder):
    with pages.table("no such table", False):
        print("| a |")
    assert (folder / "page.md").read_text(encoding="utf-8") == PAGE


def test_unknown_table_is_refused_before_the_work(folder):
    with pytest.raises(LookupError, match=r"no page of . has <!-- table: third -->"), pages.table("third", True):
        pytest.fail("nothing should be measured")
    with pytest.raises(LookupError, match=r"other.md needs one pair of lines <!-- table: first -->"):
        pages.write_table(folder / "other.md", "first", "", "python -m x")


def test_long_table_goes_to_its_file_alone_and_a_second_one_to_another(folder):
    long = "| a | b |\n|---|--:|\n" + "| x \\| y, z | 2 |\n" * (pages.MAX_ROWS_SHOWN + 1)
    pages.write_table(folder / "page.md", "first", f"Of two:\n\n{long}\nand\n\n| c |\n|---|\n| 3 |", "python -m x")
    text = (folder / "page.md").read_text(encoding="utf-8")
    assert f"Of two:\n\n{pages.MAX_ROWS_SHOWN + 1} rows: [first.csv]" in text
    assert "| x " not in text
    assert "| 3 |" in text
    rows = pd.read_csv(folder / "results" / "first.csv")
    assert list(rows.columns) == ["a", "b"]
    assert rows.to_numpy().tolist() == [["x | y, z", 2]] * (pages.MAX_ROWS_SHOWN + 1)
    assert (folder / "results" / "first-2.csv").read_text(encoding="utf-8") == "c\n3\n"


def test_table_that_stands_in_a_page_in_full_is_moved_once_and_keeps_its_line(folder):
    header = "*`python -m validation.x`, commit 1234567, 2026-11-20*"
    page = folder / "page.md"
    page.write_text(PAGE.replace("old\n", f"{header}\n\n| a |\n|---|\n" + "| 1 |\n" * 20), encoding="utf-8")
    pages.store_all(folder, folder / "results")
    once = page.read_text(encoding="utf-8")
    assert f"{header}\n\n20 rows: [second.csv]" in once
    pages.store_all(folder, folder / "results")
    assert page.read_text(encoding="utf-8") == once


def test_files_of_tables_are_those_that_pages_lead_to_and_no_page_holds_a_long_one():
    linked = re.findall(
        r"\(../../validation/results/([\w-]+\.csv)\)", "".join(p.read_text("utf-8") for p in pages.PAGES.glob("*.md"))
    )
    assert sorted(linked) == sorted(path.name for path in pages.RESULTS.glob("*.csv"))
    for page in pages.PAGES.glob("*.md"):
        for table in re.findall(r"(?:^\|.*\n)+", page.read_text("utf-8"), re.MULTILINE):
            assert len(pages.cells(table)) <= pages.MAX_ROWS_SHOWN + 1, page.name


@pytest.mark.parametrize("page", sorted(plots.PLOTS))
def test_figure_of_a_page_is_of_its_table_and_shown_there(page):
    assert plots.fingerprint(page) in (plots.FIGURES / f"{page}.svg").read_text("utf-8")
    assert f"](figures/{page}.svg)" in (pages.PAGES / f"{page}.md").read_text("utf-8")


def test_cells_of_a_plot_are_numbers_with_the_half_widths_of_their_intervals():
    plot = plots.Plot("a", ("n",), ("v",), "x", target=1.0)
    labels, values, errors = plots.numbers(
        plot, pd.DataFrame({"n": ["p", "q"], "v": ["9.81 ± 0.01 m", "95 % (1 of 2)"]})
    )
    assert labels == ["p", "q"]
    assert values.tolist() == [[9.81], [95.0]]
    assert errors.tolist() == [[pytest.approx(0.0196)], [0.0]]


def test_texts_of_a_column_are_counted_the_most_frequent_first():
    labels, values, _ = plots.counts(pd.Series(["**wrong**", "located", "located"]))
    assert labels == ["located", "wrong"]
    assert values.tolist() == [[2.0], [1.0]]


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
