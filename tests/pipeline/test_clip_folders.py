"""Folders that diagnose is given: of tables, of what run or gt wrote; or none of these, and why."""

import pandas as pd
import pytest

from iris_sysid.errors import DataError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.pipeline.clip_folders import tables_in


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
    with pytest.raises(DataError, match=r"holds no clip: .*\*.csv.*trajectory.csv"):
        tables_in(tmp_path)


def test_setting_that_gt_measured_gives_the_trajectories_of_its_clips(halves):
    for name in ("a", "b"):
        (halves / "tables" / f"{name}.csv").rename(halves / "tables" / f"{name}.trajectory.csv")
        (halves / "tables" / f"{name}.track.csv").write_text("frame,t_s\n")
    assert [path.name for path in tables_in(halves / "tables")] == ["a.trajectory.csv", "b.trajectory.csv"]


@pytest.mark.parametrize("each", [(), ("--each",)])
def test_data_set_is_to_be_measured_first(tmp_path, cli, each):
    (tmp_path / "Pendulum").mkdir()
    outcome = cli("diagnose", tmp_path, "--model", "pendulum", "-o", tmp_path / "out", *each)
    assert outcome.status == 1
    assert "is a data set: measure it first (iris-sysid gt" in outcome.err


def test_diagnose_asks_for_a_model_or_a_phenomenon(angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "-o", tmp_path / "out")
    assert outcome.status == 2
    assert "Missing option '--model' or '--phenomenon'" in outcome.err
