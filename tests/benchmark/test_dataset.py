"""A data set's folder is listed as it is: clips in order, and everything missing or odd by name."""

import os

import pytest

from iris_sysid.benchmark.dataset import list_clips
from iris_sysid.benchmark.sources.published import truths
from iris_sysid.errors import DataError
from iris_sysid.pipeline.clip_folders import benchmark_classes
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.synthetic import SCENES
from validation.audit.folder import PARAMETERS


def put(folder, *places):
    for place in places:
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_bytes(b"")
    return folder


def reasons(listing):
    return {gap.place: gap.reason for gap in listing.gaps}


def test_dataset_clips_are_listed_in_order_with_their_phenomenon(tmp_path):
    put(tmp_path, "Pendulum/pendulum_45/02.mp4", "Pendulum/pendulum_45/01.mp4", "Dropping_ball/drop_100/01.mp4")
    put(tmp_path, "Pendulum/pendulum_45/01.truth.json", "Pendulum/checkerboard.mp4", "parameters.json")
    listing = list_clips(tmp_path)
    assert [(clip.place, clip.phenomenon) for clip in listing.clips] == [
        ("Dropping_ball/drop_100/01", "dropping-ball"),
        ("Pendulum/pendulum_45/01", "pendulum"),
        ("Pendulum/pendulum_45/02", "pendulum"),
    ]
    assert listing.boards == {"Pendulum": tmp_path / "Pendulum/checkerboard.mp4"}


def test_dataset_missing_settings_and_numbers_are_named(tmp_path):
    put(tmp_path, *(f"Rotation/slow/{k:02d}.mp4" for k in (1, 2, 3, 4, 6, 7, 8, 10)))
    reason_of = reasons(list_clips(tmp_path))
    assert list(reason_of) == ["Rotation/fast", "Rotation/mid", "Rotation/slow/05", "Rotation/slow/09"]


def test_dataset_unknown_class_is_named_with_the_one_that_was_meant(tmp_path):
    put(tmp_path, "Pendulum/pendulum_45/01.mp4", "Pendulums/x/01.mp4", "Wave/a/01.mp4")
    listing = list_clips(tmp_path)
    assert listing.unknown == ("Pendulums", "Wave")
    assert "did you mean Pendulum?" in reasons(listing)["Pendulums"]


def test_dataset_odd_files_are_left_out_by_name(tmp_path):
    folder = tmp_path / "Pendulum/pendulum_45"
    put(tmp_path, *(f"Pendulum/pendulum_45/{name}" for name in ("01.mp4", "01.avi", "a\nb.mp4", ".hidden.mp4")))
    (folder / "03.mp4").symlink_to(tmp_path / "nowhere.mp4")
    (folder / "04.mp4").symlink_to(folder / "01.mp4")
    os.mkfifo(folder / "05.mp4")
    listing = list_clips(tmp_path)
    assert [clip.clip for clip in listing.clips] == ["01", "04"]
    assert listing.clips[0].path.name == "01.avi"
    reason_of = reasons(listing)
    assert "same clip" in reason_of["Pendulum/pendulum_45/01.mp4"]
    assert "rename it" in reason_of["Pendulum/pendulum_45/'a\\nb.mp4'"]
    assert "broken link" in reason_of["Pendulum/pendulum_45/03.mp4"]
    assert "not a regular file" in reason_of["Pendulum/pendulum_45/05.mp4"]


@pytest.mark.parametrize("place", ["missing", "file.mp4"])
def test_dataset_that_is_no_folder_is_refused(tmp_path, place):
    put(tmp_path, "file.mp4")
    with pytest.raises(DataError, match="is not a folder that can be read"):
        list_clips(tmp_path / place)


def test_dataset_without_any_class_is_refused_with_the_names_of_classes(tmp_path):
    put(tmp_path, "videos/01.mp4")
    with pytest.raises(DataError, match=r"has no class of a data set; .*Pendulum"):
        list_clips(tmp_path)


def test_dataset_classes_have_each_setting_of_the_published_truth():
    classes = benchmark_classes()
    for (name, setting), _ in truths().groupby(["phenomenon", "setting"]):
        assert setting in classes[name][1].settings, (name, setting)


def test_dataset_class_has_one_phenomenon_and_the_settings_of_the_twin():
    folders = [class_name.folder for phenomenon in PHENOMENA.values() for class_name in phenomenon.classes]
    assert len(folders) == len(set(folders))
    for scene in SCENES.values():
        if scene.folder in folders:
            assert set(benchmark_classes()[scene.folder][1].settings) == set(scene.settings)


def test_dataset_names_in_the_parameter_file_are_of_values_that_the_model_gives_or_the_geometry():
    for name, described in benchmark_classes().values():
        model = MODELS[PHENOMENA[name].model]
        ours = {parameter.name for parameter in (*model.parameters, *model.derived)}
        assert described.parameters.keys() <= ours, described.folder
        for mine, theirs in described.parameters.items():
            assert PARAMETERS.get(theirs, theirs) == mine, (described.folder, theirs)
