"""The whole data set by one command: folders and truth, taking up again, contradictions refused in words."""

import json

import pytest

TINY = ("--size", "64x36", "--fps", "5", "--seconds", "1", "--trials", "1", "--classes", "led", "--seed", "3")


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def rendered(tmp_path, cli):
    folder = tmp_path / "set"
    outcome = cli("render", "--dataset", folder, *TINY)
    assert outcome.status == 0, outcome.err
    return folder, outcome


def test_dataset_has_its_folders_truth_and_checkerboard(rendered):
    folder, outcome = rendered
    clips = {path.relative_to(folder).as_posix() for path in folder.rglob("*.mp4")}
    assert clips == {"led/checkerboard.mp4", *(f"led/led_{duration}/01.mp4" for duration in ("2s", "5s", "10s"))}
    assert set(json.loads((folder / "parameters.json").read_text())["led"]) == {"led_2s", "led_5s", "led_10s"}
    assert "4 clips rendered, 0 kept" in outcome.err
    assert outcome.out == ""


def test_dataset_that_was_interrupted_is_taken_up_with_the_same_bytes(rendered, cli):
    folder, _ = rendered
    before = contents(folder)
    (folder / "led/led_5s/01.mp4").unlink()
    (folder / ".rendering").mkdir()
    (folder / ".rendering/half.mp4").write_bytes(b"half")
    outcome = cli("render", "--dataset", folder, *TINY)
    assert "1 clips rendered, 3 kept" in outcome.err
    assert contents(folder) == before


def test_dataset_with_other_options_in_the_same_folder_is_refused(rendered, cli):
    folder, _ = rendered
    outcome = cli("render", "--dataset", folder, *TINY, "--seed", "4")
    assert outcome.status == 1
    assert "holds a data set with seed = 3; give another folder" in outcome.err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--dataset", "x", "-o", "clip.mp4"), "-o belongs to a single clip, not to --dataset; leave it out"),
        (("--dataset", "x", "--phenomenon", "led"), "--phenomenon belongs to a single clip"),
        (("--dataset", "x", "--effect", "linear-drag=1"), "--effect belongs to a single clip"),
        (("--dataset", "x", "--force"), "--force belongs to a single clip"),
        (("--dataset", "x", "--classes", "Pendula"), "no class is named 'Pendula'; there are: Dropping_ball"),
        (("--dataset", "x", "--trials", "0"), "trials must be a whole number from 1 to 999, not 0"),
        (("--phenomenon", "led", "-o", "clip.mp4", "--trials", "2"), "--trials belongs to --dataset; give its folder"),
    ],
)
def test_contradictory_request_is_refused_in_one_line_and_nothing_is_written(tmp_path, cli, options, message):
    outcome = cli("render", *(tmp_path / option if option in ("x", "clip.mp4") else option for option in options))
    assert outcome.status == 1
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
