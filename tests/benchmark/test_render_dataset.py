"""The whole data set by one call: folders, trials, taking up again, gaps that are named."""

import json

import pytest

from iris_sysid.benchmark import render_dataset as dataset
from iris_sysid.benchmark.render_dataset import render_dataset
from iris_sysid.errors import DataError, IrisError, OutputError, UnknownNameError
from iris_sysid.synthetic import SCENES, Look, read_truth

TINY = {"size": (64, 36), "fps": 5.0, "duration_s": 1.0, "look": Look.plain(read_noise=1.0)}


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dataset")
    steps = []
    done = render_dataset(folder, trials=2, progress=lambda *step: steps.append(step), **TINY)
    return folder, done, steps


def test_every_class_setting_and_trial_has_its_clip(rendered):
    folder, done, _ = rendered
    clips = {path.relative_to(folder).as_posix() for path in folder.glob("*/*/*.mp4")}
    expected = {f"{s.folder}/{setting}/{k:02d}.mp4" for s in SCENES.values() for setting in s.settings for k in (1, 2)}
    assert clips == expected
    assert len(clips) == 60
    assert {path.parent.name for path in folder.glob("*/checkerboard.mp4")} == {s.folder for s in SCENES.values()}
    assert len(done.written) == 70
    assert done.kept == ()


def test_names_are_the_benchmarks(rendered):
    folder, _, _ = rendered
    for name in (
        *(
            "Pendulum/pendulum_45",
            "Dropping_ball/drop_100",
            "Falling_ball/big",
            "Sliding_cone/cone_60",
            "Rotation/fast",
        ),
        *("Hitting_cones/mid", "Two_Moving_Pendulums/pendulum_20", "Two_Moving_Pendulum_One_Static/pendulum_90"),
    ):
        assert (folder / name / "01.mp4").is_file()


def test_every_clip_has_its_truth(rendered):
    folder, _, _ = rendered
    for clip in folder.glob("*/*/*.mp4"):
        truth = read_truth(clip)
        assert truth.setting == clip.parent.name
        assert SCENES[truth.phenomenon].folder == clip.parent.parent.name
        assert json.loads(clip.with_suffix(".truth.json").read_text())["clip"] == clip.name


def test_trials_differ_as_repeated_experiments_do(rendered):
    folder, _, _ = rendered
    first, second = (read_truth(folder / f"Pendulum/pendulum_45/{k:02d}.mp4") for k in (1, 2))
    angles = [abs(truth.parameters["theta_0"].value) for truth in (first, second)]
    assert angles[0] != angles[1]
    assert angles == pytest.approx([0.785, 0.785], abs=0.015)
    assert first.parameters["length"] == second.parameters["length"]


def test_parameters_are_read_as_the_benchmark_reads_them(rendered):
    folder, _, _ = rendered
    document = json.loads((folder / "parameters.json").read_text())
    assert set(document) == {scene.folder.lower() for scene in SCENES.values()}
    rope = document["pendulum"]["pendulum_45"]["rope_length"]
    assert (rope["mean"], rope["std"], rope["min"], rope["max"]) == (0.5, 0.0, 0.5, 0.5)
    assert document["sliding_cone"]["cone_60"]["angle"]["mean"] == pytest.approx(60.0)
    friction = document["sliding_cone"]["cone_60"]["friction"]
    assert friction["min"] < friction["mean"] < friction["max"]
    assert friction["n"] == 2
    assert document["led"]["led_2s"]["decay"]["mean"] == pytest.approx(2.303, abs=1e-3)
    assert document["two_moving_pendulums"]["pendulum_20"]["rope_length_2"]["mean"] == 0.5


def test_progress_counts_clips(rendered):
    assert rendered[2] == [(k, 70) for k in range(1, 71)]


def test_nothing_unfinished_is_left(rendered):
    assert not [name for name in contents(rendered[0]) if "/." in f"/{name}"]


def test_second_run_does_only_what_is_missing(rendered):
    folder, _, _ = rendered
    before = contents(folder)
    lost = folder / "Rotation/mid/02.mp4"
    lost.unlink()
    (folder / ".rendering").mkdir()
    (folder / ".rendering/half.mp4").write_bytes(b"half")
    again = render_dataset(folder, trials=2, **TINY)
    assert again.written == (lost,)
    assert len(again.kept) == 69
    assert contents(folder) == before


def test_one_phenomenon_alone_gives_the_same_clips(rendered, tmp_path):
    folder, _, _ = rendered
    render_dataset(tmp_path, trials=1, phenomena=["rotating-cone"], **TINY)
    for name in ("Rotation/mid/01.mp4", "Rotation/slow/01.truth.csv", "Rotation/checkerboard.mp4"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_more_trials_can_be_added_later(tmp_path):
    render_dataset(tmp_path, trials=1, phenomena=["led"], **TINY)
    more = render_dataset(tmp_path, trials=2, phenomena=["led"], **TINY)
    assert [path.name for path in more.written] == ["02.mp4"] * 3
    assert json.loads((tmp_path / "parameters.json").read_text())["led"]["led_2s"]["decay"]["n"] == 2


@pytest.mark.slow
def test_two_workers_give_the_same_bytes_as_one(rendered, tmp_path):
    render_dataset(tmp_path, trials=2, workers=2, **TINY)
    assert contents(tmp_path) == contents(rendered[0])


def test_folder_of_another_dataset_is_refused(rendered):
    folder, _, _ = rendered
    with pytest.raises(OutputError, match=r"holds a data set with seed = 0; give another folder"):
        render_dataset(folder, trials=2, seed=1, **TINY)


def test_folder_with_a_foreign_manifest_is_refused(tmp_path):
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(OutputError, match="not the manifest of a rendered data set"):
        render_dataset(tmp_path, trials=1, **TINY)


def test_failed_clip_is_named_and_the_others_are_done(tmp_path, monkeypatch):
    def fail_once(job, root, *, real=dataset._render_one):
        if job.place == "led/led_5s/01.mp4":
            raise OutputError("the disk is full")
        real(job, root)

    monkeypatch.setattr(dataset, "_render_one", fail_once)
    with pytest.raises(IrisError, match=r"1 of 4 clips could not be rendered.*led/led_5s/01.mp4: the disk is full"):
        render_dataset(tmp_path, trials=1, phenomena=["led"], **TINY)
    assert (tmp_path / "led/led_10s/01.mp4").exists()
    assert not (tmp_path / "led/led_5s/01.mp4").exists()
    assert not (tmp_path / ".rendering").exists()


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"trials": 0}, DataError, "trials must be a whole number from 1 to 999, not 0"),
        ({"trials": 2.5}, DataError, "trials must be"),
        ({"workers": -1}, DataError, "workers must be a whole number from 0"),
        ({"size": (63, 36)}, DataError, "size must be two even numbers"),
        ({"fps": -1.0}, DataError, "fps must lie"),
        ({"duration_s": -1.0}, DataError, "at least two frames"),
        ({"seed": -1}, DataError, "seed must be"),
        ({"phenomena": ["pendulums"]}, UnknownNameError, "no scene is named 'pendulums'; did you mean 'pendulum'"),
    ],
)
def test_bad_dataset_request_is_refused_and_nothing_is_written(tmp_path, changes, error, message):
    with pytest.raises(error, match=message):
        render_dataset(tmp_path / "new", **{**TINY, "trials": 1, **changes})
    assert not (tmp_path / "new").exists()


def test_dataset_in_place_of_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="cannot write"):
        render_dataset(tmp_path / "file", trials=1, **TINY)
