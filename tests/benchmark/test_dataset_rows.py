"""A data set to flat rows: measured once, studied once, failures as rows, and nothing done twice."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from iris_sysid.benchmark import dataset_rows as module
from iris_sysid.benchmark.dataset import list_clips
from iris_sysid.benchmark.dataset_rows import RowPlan, dataset_rows
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement, measure
from iris_sysid.benchmark.sources.rows import flat_rows
from iris_sysid.benchmark.studies.studies import AHEAD, studied
from iris_sysid.benchmark.studies.subjects import subjects_of
from iris_sysid.errors import DataError
from iris_sysid.io.schemas.groundtruth import ClipDocument
from iris_sysid.synthetic import read_truth, render_clip
from iris_sysid.types import Estimate

STUDIES = ("identifiability", "extrapolation", "selection", "sharing")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two pendulums, a file that is no video, and a class that nobody knows."""
    root = tmp_path_factory.mktemp("data") / "tiny"
    for clip in (1, 2):
        path = root / "Pendulum/pendulum_45" / f"{clip:02d}.mp4"
        render_clip("pendulum", path, size=(160, 90), fps=30.0, duration_s=6.0, seed=clip, setting="pendulum_45")
    (root / "Pendulum/pendulum_45/03.mp4").write_text("no video")
    (root / "Wave/high").mkdir(parents=True)
    return root


@pytest.fixture(scope="module")
def built(folder, tmp_path_factory):
    work = tmp_path_factory.mktemp("work")
    return work, dataset_rows(folder, work, RowPlan("tiny", studies=STUDIES))


@pytest.fixture(scope="module")
def subject(folder, built):
    """The first clip as it was measured."""
    return subjects_of(measure(folder, built[0]).clips, folder, "tiny")[0]


def values(rows, **wanted):
    for name, value in wanted.items():
        rows = rows[rows[name] == value]
    return rows


def test_the_banks_rows_are_near_the_truth_beside_each_clip(folder, built):
    rows = values(built[1].rows, study="parameters", method="ode", parameter="length", status="ok")
    assert rows["clip"].tolist() == ["01", "02"]
    truth = read_truth(folder / "Pendulum/pendulum_45/01.mp4").parameters["length"].value
    assert rows["truth"].iloc[0] == truth
    assert rows["truth_source"].iloc[0] == "01.truth.json"
    assert np.all(np.abs(rows["error"]) < 0.01)
    assert not values(built[1].rows, study="parameters", parameter="damping").empty


def test_a_clip_that_cannot_be_read_is_failed_rows_of_the_same_parameters(built):
    rows = values(built[1].rows, study="parameters", method="ode", clip="03")
    assert set(rows["parameter"]) >= {"length", "damping"}
    assert set(rows["status"]) == {"failed"}
    assert rows["value"].isna().all()


def test_gaps_name_the_bad_clip_the_unknown_class_and_what_is_missing(built):
    text = "\n".join(built[1].gaps)
    for name in ("Pendulum/pendulum_45/03", "Wave", "Pendulum/pendulum_20", "Pendulum/pendulum_45/10", "checkerboard"):
        assert name in text


def test_every_clip_has_its_hash(built):
    assert len(built[1].clips["Pendulum/pendulum_45/01"]) == 64


def test_every_study_has_rows_and_no_value_where_there_is_none(built):
    rows = built[1].rows
    assert set(rows["study"]) == {"parameters", *STUDIES}
    assert set(values(rows, study="selection", clip="01")["answer"]) == {"pendulum"}
    assert values(rows, study="extrapolation", clip="01", parameter="E_10")["value"].iloc[0] < 1e-3
    condition = values(rows, study="identifiability", parameter="condition", clip="01")["value"].iloc[0]
    assert 1 < condition < 1e6


def test_sharing_has_one_value_for_all_clips_that_is_near_the_truth(built):
    rows = values(built[1].rows, study="sharing", parameter="length").set_index("method")
    assert len(rows.loc[["clip by clip"]]) == 2
    assert abs(rows.loc["one shared value", "error"]) < 0.01


def test_a_second_run_does_only_what_is_missing_and_gives_the_same_rows(folder, built, monkeypatch):
    work, first = built
    done = []
    working = module.work_on

    def noted(folder, unit):
        done.append(Path(unit.place).name)
        return working(folder, unit)

    monkeypatch.setattr(module, "work_on", noted)
    again = dataset_rows(folder, work, RowPlan("tiny", studies=STUDIES))
    assert done == []
    assert again.rows.equals(first.rows)
    piece = next((work / "Pendulum/pendulum_45").glob("02.extrapolation.*.csv"))
    piece.write_text("half a li")
    assert dataset_rows(folder, work, RowPlan("tiny", studies=STUDIES)).rows.equals(first.rows)
    assert done == [piece.name]


def test_an_unknown_study_is_refused(folder, tmp_path):
    with pytest.raises(DataError, match="there is no study 'magic'; there are ode\\+effects"):
        dataset_rows(folder, tmp_path, RowPlan("tiny", studies=("magic",)))


@pytest.mark.parametrize(
    ("error", "reason"),
    [(DataError("no\nway"), "no way"), (ZeroDivisionError("by zero"), "unexpected ZeroDivisionError: by zero")],
)
def test_a_study_that_fails_is_a_row_with_the_reason(error, reason, subject, monkeypatch):
    def fails(_):
        raise error

    monkeypatch.setitem(module.STUDY_OF, "sindy", (fails, "", "sindy", ""))
    rows = flat_rows(studied(subject, "sindy"))
    assert set(rows["status"]) == {"failed"}
    assert set(rows["answer"]) == {reason}


def test_what_a_fit_was_given_and_what_has_no_scale_is_no_estimate(subject):
    estimates = {"length": Estimate(0.5, 0.0, "m", "assumed"), "damping": Estimate(0.1, 0.0, "1/s", "fitted")}
    rows = flat_rows(subject.records(estimates, "ok", method="x")).set_index("parameter")
    assert rows.loc["length", "status"] == "not estimated"
    assert np.isnan(rows.loc["length", "value"])
    assert rows.loc["damping", "value"] == 0.1
    pixels = flat_rows(subject.records({"length": Estimate(90.0, 0.0, "px")}, "ok", method="x")).set_index("parameter")
    assert pixels.loc["length", "status"] == "no scale"


def test_extrapolation_needs_more_samples_than_are_fitted(subject):
    short = subject.trajectory()
    assert short.n > 150
    rows = studied(subject, "extrapolation")
    assert [row["parameter"] for row in rows] == [f"E_{k}" for k in AHEAD]


def test_a_refit_is_given_what_the_measurement_was_given_and_no_more(tmp_path):
    clip = failed_clip(tmp_path, "Falling_ball/big/01")
    entries = {"r0_f": (76.3, "direct"), "gravity": (9.8, "fitted"), "h_0": (0.75, "fitted"), "h0": (0.75, "derived")}
    parameters = {
        name: {"value": value, "stderr": 0.1, "ci95": [None, None], "unit": "1", "measurement_type": kind}
        for name, (value, kind) in entries.items()
    }
    content = clip.document.model_dump(mode="json") | {"model": "apparent-radius", "free": ["gravity", "h_0"]}
    document = ClipDocument.model_validate_json(json.dumps(content | {"parameters": parameters}))
    (subject,) = subjects_of([ClipMeasurement(clip.clip, document, tmp_path)], tmp_path, "x")
    known, free = subject.known_and_free()
    assert {name: known_value.value for name, known_value in known.items()} == {"r0_f": 76.3}
    assert free == ["gravity"]


# --------------------------------------------------------------------------- truth


def failed_clip(root, place):
    """A data set of one clip that failed."""
    path = root / f"{place}.mp4"
    path.parent.mkdir(parents=True)
    path.write_text("no video")
    clip = list_clips(root).clips[0]
    names = {"class_name": clip.class_name, "setting": clip.setting, "clip": clip.clip, "phenomenon": clip.phenomenon}
    document = ClipDocument(**names, model="pendulum", equation="", status="failed", message="no", origin={})
    return ClipMeasurement(clip, document, root)


def test_truth_is_published_unless_the_data_set_says_it_itself(tmp_path):
    clip = failed_clip(tmp_path, "Pendulum/pendulum_45/01")
    (published,) = subjects_of([clip], tmp_path, "x")
    assert published.truth["length"].value == 0.5
    assert published.truth["length"].source.startswith("published: ")
    truth = {"pendulum": {"pendulum_45": {"rope_length": {"mean": 0.47}, "damping": {"mean": None}}}}
    (tmp_path / "parameters.json").write_text(json.dumps(truth))
    (own,) = subjects_of([clip], tmp_path, "x")
    assert (own.truth["length"].value, own.truth["length"].source) == (0.47, "parameters.json")
    assert "damping" not in own.truth


def test_classes_of_delfys75_have_their_own_names_and_truth(tmp_path):
    clip = failed_clip(tmp_path, "torricelli/small/01")
    (subject,) = subjects_of([clip], tmp_path, "delfys75")
    row = flat_rows(subject.records({}, "failed", method="ode")).iloc[0]
    assert (row["phenomenon"], row["parameter"], row["unit"]) == ("torricelli", "outflow", "m^0.5/s")
    assert math.isfinite(row["truth"])


def test_an_angle_is_in_degrees_as_it_is_published(tmp_path):
    clip = failed_clip(tmp_path, "Sliding_cone/cone_60/01")
    (subject,) = subjects_of([clip], tmp_path, "x")
    row = flat_rows(subject.records({}, "failed", method="ode")).set_index("parameter").loc["angle"]
    assert (row["unit"], row["truth"]) == ("deg", 60.0)


def test_a_parameters_file_that_is_damaged_is_named(tmp_path):
    clip = failed_clip(tmp_path, "Pendulum/pendulum_45/01")
    (tmp_path / "parameters.json").write_text("[1")
    with pytest.raises(DataError, match=r"cannot read parameters.json"):
        subjects_of([clip], tmp_path, "x")


# --------------------------------------------------------------------------- the command


def test_the_command_builds_all_tables_from_a_data_set_and_again_the_same(cli, folder, built, tmp_path):
    work = tmp_path / "work"
    shutil.copytree(built[0], work)
    arguments = ["benchmark", folder, "--work", work, "-o", tmp_path / "out", "--study", "identifiability"]
    first = cli(*arguments)
    assert first.status == 0, first.err
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {"rows.csv", "benchmark.html", "headline.csv", "identifiability.csv", "manifest.json"} <= set(before)
    assert len(json.loads(before["manifest.json"])["clips"]) == 3
    assert cli(*arguments).status == 0
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").rglob("*") if path.is_file()} == before
