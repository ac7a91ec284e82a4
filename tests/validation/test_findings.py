"""Each point of the audit is rediscovered from the files; the expected numbers were worked out by hand before."""

import shutil

import pandas as pd
import pytest

from tests._project import recording
from validation.audit.findings import findings
from validation.audit.findings_tables import attainable


@pytest.fixture(scope="module")
def found():
    return {finding.point: finding for finding in findings(recording("iris_published"))}


def column(finding, name):
    return finding.evidence[name].tolist()


def test_all_points_are_confirmed(found):
    assert {1, 2, 3, 5, 6, 7, 9, 12, 13, 23, 24, 25, 26} <= set(found)
    assert [finding.point for finding in found.values() if finding.verdict != "confirmed"] == []


def test_1_alpha_is_a_length(found):
    table = found[1].evidence
    assert column(found[1], "mean alpha") == pytest.approx([0.1027, 0.1921, 0.3131], abs=1e-4)
    assert column(found[1], "alpha as length (m)") == pytest.approx([0.347, 0.708, 1.187], abs=1e-3)
    assert column(found[1], "g/alpha (m)") == pytest.approx([95.07, 50.15, 29.83], abs=5e-3)
    assert (table["corrected (m)"] > table["alpha as length (m)"]).tolist() == [True, True, False]
    for number in ("10.6, 14.5, 13.4", "6.51, 5.12, 2.73", "7.03, 9.39, 7.89"):
        assert number in found[1].statement


def test_2_failures_are_zeros(found):
    assert "48 of 90" in found[2].statement
    errors = found[2].evidence[found[2].evidence["column"] == "baseline"]["error in the file"].tolist()
    assert errors == pytest.approx([9.80665, 9.80665, 0.2076], abs=1e-4)


def test_3_initial_values(found):
    nothing = found[3].evidence.set_index("row")["initial value alone"]
    assert nothing["tab:iris_results: Dropping_ball/drop_50/gravity"] == pytest.approx(0.193, abs=1e-3)
    assert nothing["tab:iris_results: Pendulum/pendulum_20/length"] == pytest.approx(0.481, abs=1e-3)
    assert "Dropping_ball 1; Falling_ball 1; Hitting_cones 1; Sliding_cone 10" in found[3].statement


def test_4_the_uncorrected_baseline_was_trained(found):
    assert "from 4.8 to 17.3" in found[4].statement


def test_5_one_step_column(found):
    table = found[5].evidence.set_index("row")
    corrected = [table.loc[f"Dropping_ball/drop_{h}/gravity", "iris_unified"] for h in (50, 100, 150)]
    assert corrected == pytest.approx([6.48, 7.21, 8.93], abs=5e-3)
    pairs = [table.loc[f"Two_Moving_Pendulums/pendulum_{a}/length", "iris_unified"] for a in (20, 45, 90)]
    assert pairs == pytest.approx([8.74, 1.72, 2.16], abs=5e-3)
    assert found[5].statement.startswith("21 of 21")


def test_6_differences_mix_references(found):
    table = found[6].evidence
    printed = table[table["place"] == "tab:iris_results"]
    assert printed["printed"].tolist() == ["-0.64", "-1.21", "-2.11"]
    assert printed["minus baseline"].tolist() == pytest.approx([0.915, 0.952, 3.032], abs=1e-3)
    assert "3 of them set the larger error in bold" in found[6].statement
    text = table[table["place"] != "tab:iris_results"].set_index("row")["printed"]
    assert (text["Pendulum/pendulum_20/length"], text["Pendulum/pendulum_90/length"]) == ("-0.44", "+20.49")


def test_7_multi_step_is_not_consistently_worse(found):
    expected = [0.40, 1.08, -0.07, -0.90, 1.80, -0.97]
    assert column(found[7], "minus corrected one-step") == pytest.approx(expected, abs=5e-3)
    assert min(column(found[7], "minus baseline")) > 0


def test_9_lengths_are_one_over_alpha(found):
    means, invalid = column(found[9], "mean alpha"), column(found[9], "clips with alpha <= 0")
    assert (min(means), max(means)) == pytest.approx((0.026, 0.336), abs=1e-3)
    assert (min(invalid), max(invalid)) == (1, 3)
    assert "identical" in found[9].statement


def test_12_all_clips_not_two(found):
    assert "n = 10" in found[12].statement
    assert 0 in column(found[12], "pairs of clips that give it")
    assert "0 choices of 2 clips" in found[12].statement


def test_13_variance_table(found):
    table = found[13].evidence.set_index("row")
    assert table.loc["Dropping_ball/drop_50/gravity", "mean of the runs"] == pytest.approx(8.79, abs=5e-3)
    assert table["truth -/+ error"].tolist() == pytest.approx([float(value) for value in table["printed mean"]])
    assert table["sd of the runs"].tolist() == pytest.approx([1.75, 1.39, 1.52, 0.51, 0.47, 0.79, 0.36], abs=5e-3)


def test_14_kappa_is_alpha(found):
    assert column(found[14], "mean_kappa") == pytest.approx(column(found[14], "mean_alpha"))


def test_23_counts(found):
    assert "75 videos of 5 phenomena are printed, 90 of 6 were run" in found[23].statement
    assert "five, four, three strategies" in found[23].statement


def test_24_cnn_accuracy(found):
    table = found[24].evidence.set_index(["dataset", "method"])
    assert table.loc[("iris", "cnn"), "nearest"] == "97.92 or 100.00 of 48; 99.17 or 99.58 of 240"
    assert table.loc[("delfys75", "cnn"), "nearest"] == "94.44 or 100.00 of 18; 97.78 or 98.89 of 90"
    assert table.loc[("iris", "vlm-temporal"), "balls"] == "dropping_ball 0/30, falling_ball 0/30"
    assert table.loc[("iris", "vlm-describe"), "balls"] == "dropping_ball 20/30, falling_ball 1/30"


@pytest.mark.parametrize(("n", "possible"), [(48, False), (240, False), (143, True)])
def test_accuracy_is_attainable_only_as_a_fraction(n, possible):
    assert attainable(99.30, 0.005, n) is possible


def test_25_no_file_holds_the_diagnostics(found):
    assert "20 to 100 times" in found[25].statement
    searched = dict(found[25].evidence.to_numpy().tolist())
    assert searched["columns of that kind"] == "ablations/integrator_comparison.csv: ode_residual"


def test_26_multi_clip_is_one_setting_and_one_number(found):
    assert column(found[26], "tested") == ["drop_50", "small", "pendulum_90", "slow", "cone_80"]
    assert set(column(found[26], "different alphas")) == {1}
    assert set(column(found[26], "clips")) == {"4, 5, 6, 7, 8, 9"}


def test_28_copies(found):
    assert column(found[28], "setting") == ["drop_150", "mid", "pendulum_20", "pendulum_45"]


def test_32_latents_collapsed(found):
    assert column(found[32], "collapsed") == [0, 0, 60]


def test_33_negative_damping_counts_as_zero(found):
    assert column(found[33], "negative values") == [7, 5, 8]
    assert column(found[33], "as they are")[-1] == pytest.approx(2.97, abs=5e-3)


def test_34_corrected_error_file_has_no_runs(found):
    assert found[34].statement.startswith("21 of 21")


def test_35_led_error_is_the_truth(found):
    assert "the printed error 2.30 is the truth itself" in found[35].statement


def test_36_ranking_reverses_by_two_classes(found):
    assert column(found[36], "without the balls") == ["156/180", "154/180"]


def changed(tmp_path, name, edit):
    shutil.copytree(recording("iris_published"), tmp_path / "part", copy_function=shutil.copyfile)
    path = tmp_path / "part" / name
    path.chmod(0o644)
    path.write_text(edit(path.read_text(encoding="utf-8")), encoding="utf-8")
    return {finding.point: finding for finding in findings(tmp_path / "part")}


def test_finding_is_not_confirmed_by_files_that_show_otherwise(tmp_path):
    def trained(text):
        return text.replace(",1.0,", ",1.1,", 1)

    found = changed(tmp_path, "iris_baseline/iris_baseline.csv", trained)
    assert found[3].verdict == "not confirmed"


def test_finding_without_its_file_names_the_gap(tmp_path):
    found = changed(tmp_path, "iris_unified/iris_unified.csv", lambda text: "")
    assert found[5].verdict == "cannot be derived"
    assert found[5].statement.startswith("iris_unified/iris_unified.csv holds 0 lines")
    assert isinstance(found[5].evidence, pd.DataFrame)
    assert found[2].verdict == "cannot be derived"
    assert found[13].verdict == "confirmed"
