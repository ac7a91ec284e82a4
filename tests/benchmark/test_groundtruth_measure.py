"""A data set is measured clip by clip: bad ones are rows, what was done is kept, same input gives same bytes."""

import json
import shutil

import pytest

from iris_sysid.benchmark.groundtruth import clip
from iris_sysid.benchmark.groundtruth.boards import board_of, calibrate_class
from iris_sysid.benchmark.groundtruth.clip import Conditions
from iris_sysid.benchmark.groundtruth.measure import measure
from iris_sysid.calibration.pixel_scale import scale
from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas.groundtruth import ClipDocument, MeasuredDocument, ParametersDocument
from iris_sysid.registry import PHENOMENA
from iris_sysid.synthetic import read_truth
from iris_sysid.types import Estimate
from tests.conftest import listing

GRAVITY = {"parameter": "gravity", "value": 9.79, "uncertainty": 0.01, "kind": "standard", "unit": "m/s^2"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, pendulum_clip, cut_clip):
    """Two clips of a pendulum, one of them twice as a file with other bytes, a corrupt one, and an unknown class."""
    folder = tmp_path_factory.mktemp("dataset")
    setting = folder / "Pendulum" / "pendulum_45"
    setting.mkdir(parents=True)
    shutil.copy(pendulum_clip, setting / "01.mp4")
    (setting / "02.mp4").write_bytes(pendulum_clip.read_bytes() + b"\0\0\0\x08free")
    shutil.copy(cut_clip, setting / "03.mp4")
    (folder / "Wave" / "a").mkdir(parents=True)
    shutil.copy(pendulum_clip, folder / "Wave" / "a" / "01.mp4")
    return folder


@pytest.fixture(scope="module")
def work(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    messages, steps = [], []
    measurements = measure(dataset, folder, progress=lambda *step: steps.append(step), tell=messages.append)
    return folder, measurements, messages, steps


def test_measure_gives_the_fit_of_each_clip(work, pendulum_clip):
    _, measurements, _, steps = work
    first = measurements.clips[0]
    assert (first.document.status, first.document.model) == ("ok", "pendulum")
    truth = read_truth(pendulum_clip).parameters["length"]
    assert first.document.estimates()["length"].value == pytest.approx(truth.value, rel=0.02)
    assert first.document.budget["length"]["random"] > 0
    assert first.trajectory().quantities[0].name == "theta"
    assert first.tracks()[0].n_valid > 60
    assert steps[-1] == (3, 3)


def test_measure_makes_a_corrupt_clip_a_failed_row_and_does_the_rest(work):
    _, measurements, messages, _ = work
    assert [clip.document.status for clip in measurements.clips] == ["ok", "ok", "failed"]
    assert "03.mp4" in measurements.clips[2].document.message
    assert measurements.clips[2].trajectory() is None
    assert messages == [f"Pendulum/pendulum_45/03: {measurements.clips[2].document.message}"]


def test_measure_names_the_gaps(work):
    gaps = dict(work[1].gaps)
    assert gaps["Wave"].startswith("unknown class")
    assert gaps["Pendulum/pendulum_45/04"] == "this clip is missing"
    assert gaps["Pendulum/pendulum_90"] == "this setting is missing"
    assert gaps["Pendulum/pendulum_45/03"].startswith("failed: ")
    assert "lengths stay in px" in gaps["Pendulum/checkerboard"]


def test_measure_again_measures_nothing_and_changes_nothing(work, dataset, monkeypatch):
    folder, measurements, _, _ = work
    before = listing(folder)
    monkeypatch.setattr(clip, "open_video", None)  # would be called for a clip that is read again
    again = measure(dataset, folder)
    assert again.now == 0
    assert [clip.document for clip in again.clips] == [clip.document for clip in measurements.clips]
    assert listing(folder) == before


@pytest.mark.parametrize("lost", ["01.json", "01.trajectory.csv", "01.track.csv"])
def test_measure_after_an_interrupted_run_does_what_is_missing_with_the_same_bytes(work, dataset, tmp_path, lost):
    folder = work[0]
    shutil.copytree(folder, tmp_path / "half")
    (tmp_path / "half" / "Pendulum" / "pendulum_45" / lost).unlink()
    assert measure(dataset, tmp_path / "half").now == 1
    assert listing(tmp_path / "half") == listing(folder)


def test_measure_does_a_clip_again_whose_document_is_damaged(work, dataset, tmp_path):
    folder = work[0]
    shutil.copytree(folder, tmp_path / "half")
    (tmp_path / "half" / "Pendulum" / "pendulum_45" / "02.json").write_text('{"document": "clip"')
    assert measure(dataset, tmp_path / "half").now == 1
    assert listing(tmp_path / "half") == listing(folder)


def test_measure_does_only_the_clip_whose_file_changed(work, dataset, tmp_path):
    shutil.copytree(work[0], tmp_path / "work")
    shutil.copytree(dataset, tmp_path / "data")
    with (tmp_path / "data/Pendulum/pendulum_45/02.mp4").open("ab") as file:
        file.write(b"\0\0\0\x08free")
    again = measure(tmp_path / "data", tmp_path / "work")
    assert again.now == 1
    assert again.clips[1].document.origin["sha256"] != work[1].clips[1].document.origin["sha256"]


def test_measure_with_another_gravity_fits_again_without_tracking_again(work, dataset, tmp_path, monkeypatch):
    shutil.copytree(work[0], tmp_path / "work")
    monkeypatch.setattr(clip, "track", None)
    measured = MeasuredDocument.model_validate({"values": [GRAVITY]})
    again = measure(dataset, tmp_path / "work", measured=measured)
    lengths = [measurements.clips[0].document.estimates()["length"] for measurements in (work[1], again)]
    assert lengths[1].value / lengths[0].value == pytest.approx(9.79 / 9.80665, rel=1e-4)
    assert again.clips[0].document.budget["length"]["gravity"] == pytest.approx(
        lengths[1].value * 0.01 / 9.79, rel=0.01
    )


def test_measure_in_two_processes_gives_the_same_bytes(work, dataset, tmp_path):
    assert measure(dataset, tmp_path, workers=2).now == 3
    assert listing(tmp_path) == listing(work[0])


def test_measure_outlives_a_clip_that_raises_what_nobody_foresaw(work, dataset, tmp_path, monkeypatch):
    shutil.copytree(work[0], tmp_path / "work")
    (tmp_path / "work/Pendulum/pendulum_45/01.track.csv").unlink()

    def broken(*_):
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(clip, "track", broken)
    measurements = measure(dataset, tmp_path / "work")
    assert measurements.clips[0].document.message == "unexpected ZeroDivisionError: by zero"
    monkeypatch.undo()
    assert measure(dataset, tmp_path / "work").now == 1  # tried again, though nothing changed
    assert listing(tmp_path / "work") == listing(work[0])


def test_measure_takes_the_first_trials_of_each_setting(work, dataset):
    assert len(measure(dataset, work[0], conditions=Conditions(trials=1)).clips) == 1


@pytest.mark.parametrize(
    ("changes", "message"), [({"workers": -1}, "workers"), ({"conditions": Conditions(trials=0)}, "trials")]
)
def test_measure_refuses_numbers_that_make_no_sense(work, dataset, changes, message):
    with pytest.raises(DataError, match=message):
        measure(dataset, work[0], **changes)


def test_fit_is_given_nothing_that_it_is_to_find():
    known = {"gravity": Estimate(9.8, 0.01, "m/s^2"), "length": Estimate(0.5, 0.1, "m"), "angle": Estimate(1, 0, "rad")}
    uncalibrated = clip.uncalibrated()
    assert clip.known_to_fit(PHENOMENA["dropping-ball"], known, uncalibrated) == ({}, [])
    assert list(clip.known_to_fit(PHENOMENA["pendulum"], known, uncalibrated)[0]) == ["gravity"]
    assert list(clip.known_to_fit(PHENOMENA["sliding-cone"], known, scale(400.0, 1.0))[0]) == ["gravity"]
    assert clip.known_to_fit(PHENOMENA["sliding-cone"], known, uncalibrated) == ({}, [])  # metres mean nothing in px


# --------------------------------------------------------------------------- boards


@pytest.mark.parametrize(("text", "px_per_m"), [("400px=1m", 400.0), ("0,0,300,400=2m", 250.0)])
def test_class_without_a_board_has_the_stated_scale(work, dataset, tmp_path, text, px_per_m):
    shutil.copytree(work[0], tmp_path / "work")
    measured = MeasuredDocument.model_validate({"scales": [{"class": "Pendulum", "scale": text}]})
    measurements = measure(dataset, tmp_path / "work", measured=measured, conditions=Conditions(trials=1))
    assert measurements.clips[0].document.geometry["scale"].value == pytest.approx(px_per_m)
    assert "Pendulum/checkerboard" not in dict(measurements.gaps)


def test_board_without_its_squares_says_where_to_state_them(tmp_path):
    with pytest.raises(CalibrationError, match="a board of unknown squares; give them under boards"):
        board_of(tmp_path / "checkerboard.mp4", "Pendulum", MeasuredDocument())


def test_board_is_read_beside_its_clip_unless_measured(tmp_path):
    settings = {"board": {"inner_corners": [9, 6], "square_m": 0.025}}
    (tmp_path / "checkerboard.json").write_text(json.dumps(settings))
    assert board_of(tmp_path / "checkerboard.mp4", "Pendulum", MeasuredDocument()).square_m == 0.025
    stated = {"class": "Pendulum", "inner_corners": [9, 6], "square_m": 0.03}
    document = MeasuredDocument.model_validate_json(json.dumps({"boards": [stated]}))
    assert board_of(tmp_path / "checkerboard.mp4", "Pendulum", document).square_m == 0.03


def test_board_description_that_is_wrong_is_named(tmp_path):
    (tmp_path / "checkerboard.json").write_text('{"board": {"inner_corners": [9]}}')
    with pytest.raises(DataError, match=r"checkerboard\.json should say"):
        board_of(tmp_path / "checkerboard.mp4", "Pendulum", MeasuredDocument())


def test_class_is_calibrated_once(tmp_path, monkeypatch):
    from iris_sysid.benchmark.groundtruth import boards

    calls = []

    class Made:
        calibration = scale(400.0, 1.0)

    monkeypatch.setattr(boards, "calibrate_by_board", lambda clips, board: calls.append(clips) or Made())
    (tmp_path / "checkerboard.mp4").write_bytes(b"a film of a board")
    board = boards.BoardEntry(inner_corners=(9, 6), square_m=0.025)
    for _ in range(2):
        path = calibrate_class(tmp_path / "checkerboard.mp4", board, tmp_path / "out")
    assert len(calls) == 1
    (tmp_path / "checkerboard.mp4").write_bytes(b"another one")
    calibrate_class(tmp_path / "checkerboard.mp4", board, tmp_path / "out")
    assert len(calls) == 2
    assert path.name == "calibration.json"


# --------------------------------------------------------------------------- command line


def test_gt_command_writes_parameters_and_names_what_failed(cli, work, dataset, tmp_path):
    output = tmp_path / "parameters.json"
    outcome = cli("gt", dataset, "-o", output, "--work", work[0])
    assert outcome.status == 0, outcome.err
    assert "3 clips, 0 measured now" in outcome.err
    entry = read_document(output, ParametersDocument).classes["pendulum"]["pendulum_45"]["rope_length"]
    assert (entry.n, entry.unit) == (2, "m")


def test_gt_command_refuses_to_replace_a_file_before_any_work(cli, dataset, tmp_path):
    (tmp_path / "parameters.json").write_text("mine")
    outcome = cli("gt", dataset, "-o", tmp_path / "parameters.json")
    assert outcome.status == 1
    assert "exists already" in outcome.err
    assert not (tmp_path / "parameters.work").exists()


def test_gt_command_prints_a_template(cli):
    outcome = cli("gt", "--template")
    assert outcome.status == 0
    assert MeasuredDocument.model_validate_json(outcome.out).values


def test_gt_command_without_a_data_set_is_wrong_usage(cli):
    assert cli("gt").status == 2


def test_clip_document_is_published_as_a_schema(cli):
    assert set(ClipDocument.model_fields) <= set(json.loads(cli("schema", "clip").out)["properties"])
