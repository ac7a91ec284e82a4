"""Each published number is derived again, with the file, the formula and the failures behind it."""

import math
import shutil

import numpy as np
import pytest

from iris_sysid.benchmark.sources.conversions import READINGS
from iris_sysid.errors import DataError
from tests._project import recording
from validation.audit.folder import ERRORS, PublishedFolder, estimates, reading_of, select
from validation.audit.reproduce import audit, status_of, verdicts


@pytest.fixture(scope="module")
def rows():
    return audit(recording("iris_published"))


@pytest.fixture(scope="module")
def numbers(rows):
    return verdicts(rows).set_index("key")


def ways(rows, key):
    matching = rows[rows["key"] == key]
    assert len(matching), key
    return matching


def test_every_number_has_one_verdict(rows, numbers):
    assert len(numbers) == rows["key"].nunique()
    assert set(numbers["status"]) == {"reproduced", "differs", "cannot be derived"}
    assert numbers["status"].value_counts().to_dict() == {"reproduced": 341, "cannot be derived": 119, "differs": 34}


def test_pendulum_of_the_baseline_is_given_under_both_readings_of_alpha(rows):
    values = ways(rows, "tab:delfys75_baseline_unified/delfys75/pendulum/pendulum_45/length/baseline")
    derived = dict(zip(values["conversion"], values["derived"], strict=True))
    assert derived["g/alpha"] == pytest.approx(95.067, abs=1e-3)
    assert derived["alpha as length"] == pytest.approx(0.347, abs=1e-3)


def test_one_run_makes_both_printed_errors_of_the_same_rope(numbers):
    first = numbers.loc["tab:delfys75_baseline_unified/delfys75/pendulum/pendulum_45/length/baseline"]
    second = numbers.loc["tab:multistep_ablation/delfys75/pendulum/pendulum_45/length/one-step"]
    assert (first["printed"], first["conversion"]) == ("95.07", "g/alpha")
    assert (second["printed"], second["conversion"]) == ("0.35", "alpha as length")
    assert first["source"] == second["source"] == "delfys75_baseline/delfys75_baseline.csv"


def test_failed_runs_scored_as_zeros_are_counted(rows):
    values = ways(rows, "tab:delfys75_baseline_unified/delfys75/dropped_ball/large/gravity/baseline")
    zeros = values[values["n_zero"] == 5].iloc[0]
    assert (zeros["status"], zeros["n_failed"]) == ("differs", 5)
    assert zeros["derived"] == pytest.approx(9.80665)
    left_out = values[values["rule"].str.contains("left out")].iloc[0]
    assert left_out["status"] == "cannot be derived"
    assert left_out["note"] == "all 5 runs failed"


def test_one_step_column_comes_from_the_baseline_file(numbers):
    column = numbers[(numbers["place"] == "tab:iris_results") & (numbers["column"] == "one-step")]
    estimated = column[column["parameter"] != "angle"]
    assert len(estimated) == 21
    assert (estimated["source"] == "iris_baseline/iris_baseline.csv").sum() == 20  # and one row agrees by chance
    assert (column[column["parameter"] == "angle"]["conversion"] == "metadata").all()


def test_split_really_used_is_all_ten_clips(rows):
    used = rows[(rows["place"] == "tab:iris_results") & (rows["kind"] == "result files")]
    assert set(used["split"]) == {"all 10 clips"}
    assert set(ways(rows, "text:sec:eval_protocol/iris/all/clips-per-setting/count")["derived"]) == {10.0}


def test_multi_clip_split_is_six_clips_of_one_setting(numbers):
    split = numbers.loc["tab:multi_clip/iris/Pendulum/length/multi-clip", "split"]
    assert split == "6 clips (4 to 9) of 1 setting (pendulum_90)"


def test_mixed_reference_is_found_by_the_error_files(numbers):
    number = numbers.loc["tab:iris_results/iris/Rotation/fast/stiffness/difference"]
    assert (number["status"], number["way"]) == ("reproduced", "not as stated, from error file")
    assert "reference is iris_unified" in number["rule"]


def test_numbers_without_a_file_say_so(numbers):
    for place in ("tab:identifiability", "tab:extrapolation"):
        matching = numbers[numbers["place"] == place]
        assert set(matching["status"]) == {"cannot be derived"}
        assert matching["note"].str.startswith("no result file").all()


def test_selection_is_derived_from_the_predictions(numbers):
    assert numbers.loc["tab:summary_vlm_methods/iris/all/accuracy/vlm-temporal", "status"] == "reproduced"
    cnn = numbers.loc["tab:summary_vlm_methods/iris/all/accuracy/cnn"]
    assert (cnn["status"], cnn["derived"]) == ("differs", 100.0)


@pytest.mark.parametrize("name", [name for name in ERRORS if name != "delfys75_unified"])
def test_error_files_follow_from_the_runs_by_the_stated_rule(name):
    folder = PublishedFolder(recording("iris_published"))
    proper = {key.lower(): key for key in READINGS if key[0].isupper() == name.startswith("iris")}
    checked = 0
    for row in folder.errors(name).to_dict("records"):
        if row["parameter"] == "angle":
            continue
        phenomenon = proper[row["dynamics"]]
        runs = select(folder.runs(name), phenomenon, row["setting"])
        values = estimates(runs, reading_of(phenomenon, row["parameter"].replace("_2", "_1")), zeros=True)
        assert values.mean() == pytest.approx(row["est_mean"], rel=1e-6)
        assert np.abs(values - row["gt_mean"]).mean() == pytest.approx(row["abs_err_mean"], rel=1e-6)
        checked += 1
    assert checked >= 21


@pytest.mark.parametrize(
    ("difference", "tolerance", "status"),
    [(0.004, 0.005, "reproduced"), (0.006, 0.005, "differs"), (math.nan, 0.005, "cannot be derived")],
)
def test_status_follows_from_the_printed_digits(difference, tolerance, status):
    assert status_of(difference, tolerance) == status


def test_absent_file_leaves_gaps_and_nothing_else_changes(tmp_path, rows):
    shutil.copytree(recording("iris_published"), tmp_path / "part", copy_function=shutil.copyfile)
    folder = tmp_path / "part" / "iris_baseline"
    folder.chmod(0o755)
    (folder / "iris_baseline.csv").unlink()
    part = audit(tmp_path / "part")
    gaps = part[part["note"].str.contains("iris_baseline/iris_baseline.csv does not exist")]
    assert len(gaps) > 20
    assert set(gaps["status"]) == {"cannot be derived"}
    key = "tab:multi_clip/iris/Pendulum/length/multi-clip"
    assert ways(part, key)["derived"].tolist() == ways(rows, key)["derived"].tolist()


def test_folder_that_is_none_is_refused(tmp_path):
    with pytest.raises(DataError, match="is not a folder"):
        audit(tmp_path / "absent")
