"""Folders that diagnose is given: of tables, of what run wrote, of a data set; or none of these, and why."""

import json
import shutil

import pandas as pd
import pytest

from iris_sysid.errors import DataError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.pipeline.clip_folders import is_dataset, tables_in


@pytest.fixture
def halves(tmp_path, angles):
    """Two tables in a folder, the two halves of one; and the folders that run would have made of them."""
    table = pd.read_csv(angles)
    for name, part in (("a", table[: len(table) // 2]), ("b", table[len(table) // 2 :])):
        for path in (tmp_path / "tables" / f"{name}.csv", tmp_path / "runs" / name / "trajectory.csv"):
            path.parent.mkdir(parents=True, exist_ok=True)
            part.to_csv(path, index=False)
        (tmp_path / "runs" / name / "track.csv").write_text("frame,t_s\n")
    return tmp_path


def test_table_is_itself_and_folders_give_their_trajectories_in_order(halves, angles):
    assert tables_in(angles) == [angles]
    assert [path.name for path in tables_in(halves / "tables")] == ["a.csv", "b.csv"]
    assert [path.parent.name for path in tables_in(halves / "runs")] == ["a", "b"]
    assert tables_in(halves / "runs" / "a") == [halves / "runs" / "a" / "trajectory.csv"]
    tables = [*tables_in(halves / "tables"), *tables_in(halves / "runs")]
    starts = [read_trajectory(table).t_s[0] for table in tables]
    assert starts == [starts[0], starts[1]] * 2
    assert starts[0] < starts[1]


def test_folder_without_a_clip_is_refused_with_what_it_might_have_held(tmp_path):
    with pytest.raises(DataError, match=r"holds no clip: .*\*.csv.*trajectory.csv.*Pendulum"):
        tables_in(tmp_path)


def test_folder_of_a_class_is_a_data_set(tmp_path):
    (tmp_path / "Pendulum").mkdir()
    assert is_dataset(tmp_path)
    assert not is_dataset(tmp_path / "Pendulum")


def test_data_set_needs_a_phenomenon(tmp_path, cli):
    (tmp_path / "Pendulum").mkdir()
    outcome = cli("diagnose", tmp_path, "--model", "pendulum", "-o", tmp_path / "out")
    assert outcome.status == 1
    assert "is a data set: choose its clips, e.g. --phenomenon pendulum" in outcome.err


def test_diagnose_asks_for_a_model_or_a_phenomenon(angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "-o", tmp_path / "out")
    assert outcome.status == 2
    assert "Missing option '--model' or '--phenomenon'" in outcome.err


def test_clips_of_a_data_set_are_measured_once_and_questioned_together(tmp_path, pendulum_clip, cut_clip, cli):
    setting = tmp_path / "data" / "Pendulum" / "pendulum_45"
    setting.mkdir(parents=True)
    shutil.copy(pendulum_clip, setting / "01.mp4")
    (setting / "02.mp4").write_bytes(pendulum_clip.read_bytes() + b"\0\0\0\x08free")
    shutil.copy(cut_clip, setting / "03.mp4")
    outcome = cli("diagnose", tmp_path / "data", "--phenomenon", "pendulum", "-o", tmp_path / "out", "--json")
    assert outcome.status == 0, outcome.err
    assert "03: " in outcome.err
    assert len(json.loads(outcome.out)["further_clips"]) == 1
    assert (tmp_path / "out.work" / "Pendulum" / "pendulum_45" / "01.json").is_file()


def test_data_set_without_a_clip_that_can_be_fitted_is_refused(tmp_path, cut_clip, cli):
    setting = tmp_path / "data" / "Pendulum" / "pendulum_45"
    setting.mkdir(parents=True)
    shutil.copy(cut_clip, setting / "01.mp4")
    outcome = cli("diagnose", tmp_path / "data", "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert outcome.status == 1
    assert "has no clip of pendulum that could be fitted; 1 were tried" in outcome.err
    assert not (tmp_path / "out").exists()
