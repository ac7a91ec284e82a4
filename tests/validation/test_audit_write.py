"""The written audit: a table and a page, the same bytes, gaps named, nothing run from what was read."""

import csv
import shutil
import sys

import pytest

from iris_sysid.errors import DataError, OutputError
from tests._project import recording
from validation.audit.__main__ import main
from validation.audit.write import write_audit

NAMES = ["audit.csv", "audit.md"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    return write_audit(recording("iris_published"), tmp_path_factory.mktemp("audit") / "out")


@pytest.fixture
def part(tmp_path):
    shutil.copytree(recording("iris_published"), tmp_path / "part", copy_function=shutil.copyfile)
    return tmp_path / "part"


def text_of(paths, name):
    return paths[name].read_text(encoding="utf-8")


def test_table_and_page_are_written(written):
    assert list(written) == NAMES
    assert all(path.is_file() for path in written.values())


def test_command_writes_the_audit(tmp_path, monkeypatch, capsys, written):
    monkeypatch.setattr(sys, "argv", ["audit", str(recording("iris_published")), "-o", str(tmp_path / "out")])
    main()
    assert capsys.readouterr().out.split() == [str(tmp_path / "out" / name) for name in NAMES]
    assert (tmp_path / "out" / "audit.csv").read_bytes() == written["audit.csv"].read_bytes()


@pytest.mark.parametrize(
    ("folder", "message"),
    [("absent", "absent is not a folder; give the folder that holds"), (".", "holds none of the released files")],
)
def test_command_says_what_is_wrong_with_a_folder(tmp_path, monkeypatch, folder, message):
    monkeypatch.setattr(sys, "argv", ["audit", str(tmp_path / folder), "-o", str(tmp_path / "out")])
    with pytest.raises(SystemExit, match=message):
        main()


def test_second_run_gives_the_same_bytes(written, tmp_path):
    again = write_audit(recording("iris_published"), tmp_path)
    assert all(written[name].read_bytes() == again[name].read_bytes() for name in NAMES)


def test_pages_name_no_folder_of_this_machine(written):
    for name in NAMES:
        assert str(recording("iris_published")) not in text_of(written, name)


def test_csv_has_a_line_for_every_derivation_of_every_number(written):
    rows = list(csv.DictReader(text_of(written, "audit.csv").splitlines()))
    assert len({row["key"] for row in rows}) == 494
    assert len(rows) > 800


def test_page_holds_the_findings_the_counts_and_the_copies(written):
    page = text_of(written, "audit.md")
    assert "alpha is a length, reported as g/alpha" in page
    assert "341 reproduced" in page
    assert "line 15 repeats line 14" in page


def test_existing_audit_is_not_replaced_unless_overwrite_is_given(written):
    folder = written["audit.csv"].parent
    with pytest.raises(OutputError, match="exists already"):
        write_audit(recording("iris_published"), folder)
    assert list(write_audit(recording("iris_published"), folder, overwrite=True)) == NAMES


def test_folder_without_any_released_file_is_refused(tmp_path):
    with pytest.raises(DataError, match="holds none of the released files"):
        write_audit(tmp_path, tmp_path / "out")


def test_missing_and_damaged_files_are_named(part, tmp_path):
    (part / "vlm_eval_iris").chmod(0o755)
    (part / "vlm_eval_iris" / "vlm_iris_results.csv").unlink()
    damaged = part / "iris_unified" / "iris_unified.csv"
    damaged.chmod(0o644)
    damaged.write_text(damaged.read_text(encoding="utf-8") + "Pendulum,pendulum_20,x,1,2,3,4,5\n", encoding="utf-8")
    page = text_of(write_audit(part, tmp_path / "out"), "audit.md")
    assert "vlm_eval_iris/vlm_iris_results.csv does not exist" in page
    assert "iris_unified/iris_unified.csv line 242: 'x' is not a number" in page
    assert "| vlm_eval_iris/vlm_iris_results.csv | absent |" in page


def test_names_from_a_file_are_escaped(part, tmp_path):
    hostile = part / "vlm_eval_iris" / "vlm_iris_results.csv"
    hostile.chmod(0o644)
    text = hostile.read_text(encoding="utf-8").replace("free_fall,falling_ball", "x,<script>alert(1)</script>")
    hostile.write_text(text, encoding="utf-8")
    page = text_of(write_audit(part, tmp_path / "out"), "audit.md")
    assert r"\<script" in page
    assert "<script" not in page.replace(r"\<", "")
