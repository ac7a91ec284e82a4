"""``diagnose --each``: every table of a folder by itself, a summary of all, and nothing done twice."""

import csv
import json
import shutil

import pandas as pd
import pytest

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.pipeline import diagnose_each as module
from iris_sysid.pipeline.diagnose_each import DiagnosisRequest, NamedTable, diagnose_each
from iris_sysid.registry import MODELS
from tests.conftest import listing


def prepared(table):
    return DiagnosisRequest(read_trajectory(table), MODELS["pendulum"])


def rows_of(folder):
    with (folder / "summary.csv").open(newline="") as file:
        return {row["clip"]: row for row in csv.DictReader(file)}


@pytest.fixture(scope="module")
def tables(angles, tmp_path_factory):
    """A table of a pendulum, the same without its gap, and one that is none."""
    folder = tmp_path_factory.mktemp("tables")
    shutil.copy(angles, folder / "swing.csv")
    pd.read_csv(angles).interpolate().to_csv(folder / "again.csv", index=False)
    (folder / "broken.csv").write_text("t_s,theta_rad\n0,one\n")
    return folder


@pytest.fixture(scope="module")
def named(tables):
    return [NamedTable(path.stem, path) for path in sorted(tables.glob("*.csv"))]


@pytest.fixture(scope="module")
def done(named, tmp_path_factory):
    folder, told = tmp_path_factory.mktemp("each"), []
    rows = diagnose_each(named, prepared, folder, tell=told.append)
    return folder, rows, told


def test_each_table_has_its_page_and_row_and_a_broken_one_its_reason(done):
    folder, rows, told = done
    assert [(row["clip"], row["status"]) for row in rows] == [
        ("again", "good"), ("broken", "failed"), ("swing", "good")
    ]  # fmt: skip
    assert rows_of(folder) == {row["clip"]: row for row in rows}
    assert told == [f"broken: {rows[1]['message']}"]
    assert "one" in rows[1]["message"]
    assert not (folder / "broken").exists()
    document = json.loads((folder / "swing" / "diagnosis.json").read_text())
    assert float(rows[2]["before"]) == document["before"]["heldout"] < 0.01
    assert (rows[2]["model"], rows[2]["unit"], rows[2]["effects"]) == ("pendulum", "rad", "")
    assert (folder / "swing" / "report.html").is_file()


def test_second_run_diagnoses_nothing_and_changes_nothing(done, named, monkeypatch):
    folder, rows, _ = done
    before = listing(folder)
    monkeypatch.setattr(module, "_diagnose", None)
    assert diagnose_each(named, prepared, folder) == rows
    assert listing(folder) == before


def test_interrupted_run_is_completed_with_the_same_bytes(done, named, tmp_path, monkeypatch):
    folder, rows, _ = done
    shutil.copytree(folder, tmp_path / "half")
    shutil.rmtree(tmp_path / "half" / "again")
    with monkeypatch.context() as patch:
        patch.setattr(module, "_diagnose", lambda request, table, folder: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            diagnose_each(named, prepared, tmp_path / "half")
    assert rows_of(tmp_path / "half")["again"]["message"] == "not diagnosed: the run was interrupted"
    assert diagnose_each(named, prepared, tmp_path / "half") == rows
    assert listing(tmp_path / "half") == listing(folder)


def test_changed_table_is_diagnosed_again(done, named, tmp_path, monkeypatch):
    shutil.copytree(done[0], tmp_path / "out")
    (tmp_path / "swing.csv").write_bytes(named[2].path.read_bytes() + b"\n")
    again = []
    monkeypatch.setattr(module, "_diagnose", lambda request, table, folder: again.append(folder.name))
    diagnose_each([named[0], NamedTable("swing", tmp_path / "swing.csv")], prepared, tmp_path / "out")
    assert again == ["swing"]


def test_two_tables_of_one_name_and_a_folder_of_other_results_are_refused(named, tmp_path):
    with pytest.raises(DataError, match="two tables are called 'again', which would be one folder"):
        diagnose_each([named[0], named[0]], prepared, tmp_path)
    (tmp_path / "again").mkdir()
    (tmp_path / "again" / "report.html").write_text("mine")
    with pytest.raises(OutputError, match=r"report\.html exists already"):
        diagnose_each(named, prepared, tmp_path)


@pytest.mark.slow
def test_command_takes_the_model_of_each_run_in_another_process(angles, tmp_path, cli):
    (tmp_path / "run").mkdir()
    shutil.copy(angles, tmp_path / "run" / "trajectory.csv")
    assert cli("fit", angles, "--model", "pendulum", "-o", tmp_path / "run" / "fit.json").status == 0
    outcome = cli("diagnose", tmp_path, "--each", "-o", tmp_path / "out", "--json")
    assert outcome.status == 0, outcome.err
    (row,) = json.loads(outcome.out)
    assert (row["clip"], row["model"], row["status"]) == ("run", "pendulum", "good")
    assert "1 clips, 0 failed" in outcome.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--each", "--clip-set", "1:mass=2"], "--clip-set belongs to a joint diagnosis"),
        (["--each", "--trials", "2"], "--trials belongs to a joint diagnosis"),
        (["--workers", "2"], "--workers belongs to --each"),
        (["--scheduler", "x.json"], "--scheduler belongs to --each"),
        (["--each", "--equation", "theta'' = -k*theta"], "give --model or --equation, not both"),
    ],
)
def test_options_that_exclude_each_other_are_refused(options, message, tables, tmp_path, cli):
    outcome = cli("diagnose", tables, "--model", "pendulum", "-o", tmp_path / "out", *options)
    assert outcome.status == 1
    assert message in outcome.err
    assert not (tmp_path / "out").exists()


def test_folder_without_a_model_is_wrong_usage(tables, tmp_path, cli):
    assert cli("diagnose", tables, "--each", "-o", tmp_path / "out").status == 2
    assert not (tmp_path / "out").exists()
