"""The latent pipeline's result files are read as they are: short header, zeros, copies and damage made visible."""

import numpy as np
import pytest

from iris_sysid.benchmark.sources.latent import latent_rows, read_latent_runs
from iris_sysid.errors import DataError
from tests._project import recording

HEADER = "run,alpha,beta,max_z,min_z,z0,z1"
GOOD = "Pendulum,pendulum_20,10.0,1.0,1.5,-1.5,0.2,0.3"
ZERO = "Pendulum,pendulum_20,0,0,0,0,0,0"


def written(folder, *lines, header=HEADER):
    path = folder / "runs.csv"
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def published(name):
    return read_latent_runs(recording("iris_published") / name / f"{name}.csv")


def test_header_shorter_than_rows_is_read_from_the_right(tmp_path):
    run = read_latent_runs(written(tmp_path, GOOD)).iloc[0]
    assert (run["phenomenon"], run["setting"], run["alpha"], run["z1"]) == ("Pendulum", "pendulum_20", 10.0, 0.3)


def test_run_without_a_clip_gets_its_place_within_the_setting(tmp_path):
    other = GOOD.replace("pendulum_20", "pendulum_45")
    assert read_latent_runs(written(tmp_path, GOOD, other, GOOD))["clip"].tolist() == ["row01", "row01", "row02"]


def test_run_with_a_clip_keeps_its_name(tmp_path):
    line = "pendulum,pendulum_45,07,0.1,0.2,1,2,3,4"
    assert read_latent_runs(written(tmp_path, line))["clip"].tolist() == ["07"]


def test_clip_named_twice_stays_apart(tmp_path):
    line = "pendulum,pendulum_45,07,0.1,0.2,1,2,3,4"
    assert read_latent_runs(written(tmp_path, line, line))["clip"].tolist() == ["07", "07#2"]


def test_multi_clip_header_is_read_too(tmp_path):
    path = written(
        tmp_path, "Pendulum,pendulum_90,4,0.43,0.18,0,0,0,0", header="phenomenon,setting,clip_idx," + HEADER[4:]
    )
    run = read_latent_runs(path).iloc[0]
    assert (run["clip"], run["alpha"], run["status"]) == ("4", 0.43, "ok")


def test_all_zeros_is_a_failure_and_never_a_zero(tmp_path):
    runs = read_latent_runs(written(tmp_path, GOOD, ZERO))
    assert runs["status"].tolist() == ["ok", "failed"]
    assert np.isnan(runs["alpha"].iloc[1])
    rows = latent_rows(runs, "baseline")
    assert rows[rows["status"] == "failed"]["value"].isna().all()
    assert len(rows[rows["status"] == "failed"]) == 2  # both readings of a length


def test_infinite_value_is_a_failure(tmp_path):
    assert read_latent_runs(written(tmp_path, GOOD.replace("10.0", "inf")))["status"].tolist() == ["failed"]


def test_duplicate_names_the_line_it_repeats(tmp_path):
    runs = read_latent_runs(written(tmp_path, GOOD, GOOD.replace("10.0", "11.0"), GOOD))
    assert runs["duplicate_of"].tolist()[2] == 2
    assert runs["duplicate_of"].notna().sum() == 1


def test_failed_runs_are_no_duplicates_of_one_another(tmp_path):
    assert read_latent_runs(written(tmp_path, ZERO, ZERO))["duplicate_of"].isna().all()


@pytest.mark.parametrize(
    "line", ["Pendulum,pendulum_20,abc,1,2,3,4,5", "1,2,3", "Pendulum,,1,2,3,4,5,6", "a,b,c,d,1,2,3,4,5,6", "nonsense"]
)
def test_damaged_line_is_kept_and_named(tmp_path, line):
    runs = read_latent_runs(written(tmp_path, GOOD, line))
    assert runs["status"].tolist() == ["ok", "damaged"]
    assert runs["message"].iloc[1]
    assert runs["line"].iloc[1] == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "0 lines"),
        (HEADER + "\n", "1 lines"),
        ("a,b,c\n1,2,3\n", "expected run,alpha,beta"),
        (HEADER + "\nnonsense\n", "no run that can be read"),
        (HEADER + '\n"unclosed', "line"),
    ],
)
def test_file_that_holds_no_runs_is_refused(tmp_path, text, message):
    path = tmp_path / "runs.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=message):
        read_latent_runs(path)


def test_absent_file_and_binary_file_are_refused(tmp_path):
    with pytest.raises(DataError, match="does not exist"):
        read_latent_runs(tmp_path / "none.csv")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(DataError, match="cannot read"):
        read_latent_runs(tmp_path / "bytes.csv")


def test_length_is_read_both_ways_side_by_side(tmp_path):
    rows = latent_rows(read_latent_runs(written(tmp_path, GOOD)), "baseline", source="runs.csv")
    value = dict(zip(rows["method"], rows["value"], strict=True))
    assert value == {"baseline (g/alpha)": pytest.approx(0.980665), "baseline (alpha as length)": 10.0}
    assert rows["truth"].tolist() == [0.5, 0.5]
    assert rows["error"].tolist() == pytest.approx([0.480665, 9.5])
    assert set(rows["source"]) == {"runs.csv"}


def test_alpha_that_gives_no_length_is_undefined_not_zero(tmp_path):
    rows = latent_rows(read_latent_runs(written(tmp_path, GOOD.replace("10.0", "-0.1"))), "baseline")
    assert dict(zip(rows["method"], rows["status"], strict=True))["baseline (g/alpha)"] == "undefined"
    assert rows["value"].isna().tolist() == [True, False]


def test_one_alpha_serves_both_bodies_of_a_pair(tmp_path):
    line = GOOD.replace("Pendulum,", "Two_Moving_Pendulums,")
    rows = latent_rows(read_latent_runs(written(tmp_path, line)), "baseline")
    assert sorted(set(rows["parameter"])) == ["length_1", "length_2"]
    assert rows.groupby("method")["value"].nunique().tolist() == [1, 1]


def test_same_setting_name_has_the_truth_of_its_own_data_set(tmp_path):
    iris = latent_rows(read_latent_runs(written(tmp_path, GOOD.replace("_20", "_45"))), "a")
    delfys = latent_rows(read_latent_runs(written(tmp_path, "pendulum,pendulum_45,01,10.0,1,2,3,4,5")), "a")
    assert iris["truth"].iloc[0] == 0.5
    assert delfys.loc[delfys["parameter"] == "length", "truth"].iloc[0] == 0.45


@pytest.mark.parametrize(
    ("name", "runs", "failed", "copies"),
    [
        ("delfys75_baseline", 90, 48, 0),
        ("delfys75_unified", 90, 0, 0),
        ("iris_baseline", 240, 0, 4),
        ("iris_unified", 240, 0, 0),
        ("iris_unified_multistep", 240, 0, 0),
        ("iris_multi_clip", 30, 0, 0),
    ],
)
def test_published_file_is_read_whole(name, runs, failed, copies):
    table = published(name)
    assert len(table) == runs
    assert (table["status"] == "failed").sum() == failed
    assert (table["status"] == "damaged").sum() == 0
    assert table["duplicate_of"].notna().sum() == copies
