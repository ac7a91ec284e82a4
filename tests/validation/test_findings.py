"""Each point of the audit is rediscovered from the files; the expected numbers were worked out by hand before."""

import shutil

import pandas as pd
import pytest

from tests._project import recording
from validation.audit.findings import findings
from validation.audit.findings_tables import attainable


@pytest.fixture(scope="module")
def by_point():
    return {finding.point: finding for finding in findings(recording("iris_published"))}


def column(finding, name):
    return finding.evidence[name].tolist()


def test_all_points_are_confirmed(by_point):
    assert {1, 2, 3, 5, 6, 7, 9, 12, 13, 23, 24, 25, 26} <= set(by_point)
    assert [finding.point for finding in by_point.values() if finding.verdict != "confirmed"] == []


def test_1_alpha_is_a_length(by_point):
    table = by_point[1].evidence
    assert column(by_point[1], "mean alpha") == pytest.approx([0.1027, 0.1921, 0.3131], abs=1e-4)
    assert column(by_point[1], "alpha as length (m)") == pytest.approx([0.347, 0.708, 1.187], abs=1e-3)
    assert column(by_point[1], "g/alpha (m)") == pytest.approx([95.07, 50.15, 29.83], abs=5e-3)
    assert (table["corrected (m)"] > table["alpha as length (m)"]).tolist() == [True, True, False]
    for number in ("10.6, 14.5, 13.4", "6.51, 5.12, 2.73", "7.03, 9.39, 7.89"):
        assert number in by_point[1].statement


def test_2_failures_are_zeros(by_point):
    assert "48 of 90" in by_point[2].statement
    errors = by_point[2].evidence[by_point[2].evidence["column"] == "baseline"]["error in the file"].tolist()
    assert errors == pytest.approx([9.80665, 9.80665, 0.2076], abs=1e-4)


def test_3_initial_values(by_point):
    nothing = by_point[3].evidence.set_index("row")["initial value alone"]
    assert nothing["tab:iris_results: Dropping_ball/drop_50/gravity"] == pytest.approx(0.193, abs=1e-3)
    assert nothing["tab:iris_results: Pendulum/pendulum_20/length"] == pytest.approx(0.481, abs=1e-3)
    assert "Dropping_ball 1; Falling_ball 1; Hitting_cones 1; Sliding_cone 10" in by_point[3].statement


def test_4_the_uncorrected_baseline_was_trained(by_point):
    assert "from 4.8 to 17.3" in by_point[4].statement


def test_5_one_step_column(by_point):
    table = by_point[5].evidence.set_index("row")
    corrected = [table.loc[f"Dropping_ball/drop_{h}/gravity", "iris_unified"] for h in (50, 100, 150)]
    assert corrected == pytest.approx([6.48, 7.21, 8.93], abs=5e-3)
    pairs = [table.loc[f"Two_Moving_Pendulums/pendulum_{a}/length", "iris_unified"] for a in (20, 45, 90)]
    assert pairs == pytest.approx([8.74, 1.72, 2.16], abs=5e-3)
    assert by_point[5].statement.startswith("21 of 21")


def test_6_differences_mix_references(by_point):
    table = by_point[6].evidence
    printed = table[table["place"] == "tab:iris_results"]
    assert printed["printed"].tolist() == ["-0.64", "-1.21", "-2.11"]
    assert printed["minus baseline"].tolist() == pytest.approx([0.915, 0.952, 3.032], abs=1e-3)
    assert "3 of them set the larger error in bold" in by_point[6].statement
    text = table[table["place"] != "tab:iris_results"].set_index("row")["printed"]
    assert (text["Pendulum/pendulum_20/length"], text["Pendulum/pendulum_90/length"]) == ("-0.44", "+20.49")


def test_7_multi_step_is_not_consistently_worse(by_point):
    expected = [0.40, 1.08, -0.07, -0.90, 1.80, -0.97]
    assert column(by_point[7], "minus corrected one-step") == pytest.approx(expected, abs=5e-3)
    assert min(column(by_point[7], "minus baseline")) > 0


def test_9_lengths_are_one_over_alpha(by_point):
    means, invalid = column(by_point[9], "mean alpha"), column(by_point[9], "clips with alpha <= 0")
    assert (min(means), max(means)) == pytest.approx((0.026, 0.336), abs=1e-3)
    assert (min(invalid), max(invalid)) == (1, 3)
    assert "identical" in by_point[9].statement


def test_12_all_clips_not_two(by_point):
    assert "n = 10" in by_point[12].statement
    assert 0 in column(by_point[12], "pairs of clips that give it")
    assert "0 choices of 2 clips" in by_point[12].statement


def test_13_variance_table(by_point):
    table = by_point[13].evidence.set_index("row")
    assert table.loc["Dropping_ball/drop_50/gravity", "mean of the runs"] == pytest.approx(8.79, abs=5e-3)
    assert table["truth -/+ error"].tolist() == pytest.approx([float(value) for value in table["printed mean"]])
    assert table["sd of the runs"].tolist() == pytest.approx([1.75, 1.39, 1.52, 0.51, 0.47, 0.79, 0.36], abs=5e-3)


def test_14_kappa_is_alpha(by_point):
    assert column(by_point[14], "mean_kappa") == pytest.approx(column(by_point[14], "mean_alpha"))


def test_23_counts(by_point):
    assert "75 videos of 5 phenomena are printed, 90 of 6 were run" in by_point[23].statement
    assert "five, four, three strategies" in by_point[23].statement


def test_24_cnn_accuracy(by_point):
    table = by_point[24].evidence.set_index(["dataset", "method"])
    assert table.loc[("iris", "cnn"), "nearest"] == "97.92 or 100.00 of 48; 99.17 or 99.58 of 240"
    assert table.loc[("delfys75", "cnn"), "nearest"] == "94.44 or 100.00 of 18; 97.78 or 98.89 of 90"
    assert table.loc[("iris", "vlm-temporal"), "balls"] == "dropping_ball 0/30, falling_ball 0/30"
    assert table.loc[("iris", "vlm-describe"), "balls"] == "dropping_ball 20/30, falling_ball 1/30"


@pytest.mark.parametrize(("n", "possible"), [(48, False), (240, False), (143, True)])
def test_accuracy_is_attainable_only_as_a_fraction(n, possible):
    assert attainable(99.30, 0.005, n) is possible


def test_25_no_file_holds_the_diagnostics(by_point):
    assert "20 to 100 times" in by_point[25].statement
    searched = dict(by_point[25].evidence.to_numpy().tolist())
    assert searched["columns of that kind"] == "ablations/integrator_comparison.csv: ode_residual"


def test_26_multi_clip_is_one_setting_and_one_number(by_point):
    assert column(by_point[26], "tested") == ["drop_50", "small", "pendulum_90", "slow", "cone_80"]
    assert set(column(by_point[26], "different alphas")) == {1}
    assert set(column(by_point[26], "clips")) == {"4, 5, 6, 7, 8, 9"}


def test_28_copies(by_point):
    assert column(by_point[28], "setting") == ["drop_150", "mid", "pendulum_20", "pendulum_45"]


def test_32_latents_collapsed(by_point):
    assert column(by_point[32], "collapsed") == [0, 0, 60]


def test_33_negative_damping_counts_as_zero(by_point):
    assert column(by_point[33], "negative values") == [7, 5, 8]
    assert column(by_point[33], "as they are")[-1] == pytest.approx(2.97, abs=5e-3)


def test_34_corrected_error_file_has_no_runs(by_point):
    assert by_point[34].statement.startswith("21 of 21")


def test_35_led_error_is_the_truth(by_point):
    assert "the printed error 2.30 is the truth itself" in by_point[35].statement


def test_36_ranking_reverses_by_two_classes(by_point):
    assert column(by_point[36], "without the balls") == ["156/180", "154/180"]


def changed(tmp_path, name, edit):
    shutil.copytree(recording("iris_published"), tmp_path / "part", copy_function=shutil.copyfile)
    path = tmp_path / "part" / name
    path.chmod(0o644)
    path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
    return {finding.point: finding for finding in findings(tmp_path / "part")}


def test_finding_is_not_confirmed_by_files_that_show_otherwise(tmp_path):
    def trained(text):
        return text.replace(",1.0,", ",1.1,", 1)

    report = changed(tmp_path, "iris_baseline/iris_baseline.csv", trained)
    assert report[3].verdict == "not confirmed"


def test_finding_without_its_file_names_the_gap(tmp_path):
    report = changed(tmp_path, "iris_unified/iris_unified.csv", lambda text: "")
    assert report[5].verdict == "cannot be derived"
    assert report[5].statement.startswith("iris_unified/iris_unified.csv holds 0 lines")
    assert isinstance(report[5].evidence, pd.DataFrame)
    assert report[2].verdict == "cannot be derived"
    assert report[13].verdict == "confirmed"
