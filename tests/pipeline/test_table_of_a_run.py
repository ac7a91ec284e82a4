"""The table that a run writes leads to the same results as the run: constants and their errors travel with it."""

import json

import pytest

from iris_sysid import MODELS, fit, read_trajectory, render_clip, run, save
from iris_sysid.synthetic.look import Look
from iris_sysid.types import TrackOptions


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    """The run of a clean pendulum before a camera that is rolled by 1 degree, and its folder."""
    folder = tmp_path_factory.mktemp("rolled")
    look = Look(roll_deg=1.0, cord=False, hand=False)
    clip = folder / "pendulum.mp4"
    render_clip("pendulum", clip, size=(320, 180), fps=30, duration_s=3.0, setting="pendulum_20", look=look)
    result = run(clip, "pendulum", options=TrackOptions(roi=(0, 0, 320, 180)))
    save(result, folder / "run")
    return result, folder / "run"


def test_fit_of_the_table_of_a_rolled_clip_is_that_of_the_run(rolled):
    result, folder = rolled
    again = fit(read_trajectory(folder / "trajectory.csv"), MODELS["pendulum"])
    assert again.free == result.fit.free
    for name, estimate in result.fit.estimates.items():
        assert again.estimates[name].value == pytest.approx(estimate.value, rel=1e-6, nan_ok=True), name
        assert again.estimates[name].stderr == pytest.approx(estimate.stderr, rel=1e-3, nan_ok=True), name
    assert abs(again.estimates["vertical"].value) > 0.01  # the roll


@pytest.mark.slow
def test_diagnosis_of_a_rolled_clip_is_the_same_by_model_and_by_phenomenon(rolled, tmp_path, cli):
    _, folder = rolled
    documents = []
    for name, options in (
        ("model", [folder / "trajectory.csv", "--model", "pendulum"]),
        ("phenomenon", [folder, "--phenomenon", "pendulum"]),
    ):
        assert cli("diagnose", *options, "-o", tmp_path / name).status == 0
        documents.append(json.loads((tmp_path / name / "diagnosis.json").read_text()))
    by_model, by_phenomenon = documents
    assert by_model["base"]["parameters"] == by_phenomenon["base"]["parameters"]
    assert by_model["sentence"] == by_phenomenon["sentence"]
    assert by_model["added"] == []
