"""The whole data set by one command: folders and truth, contradictions refused in words."""

import json

import pytest

TINY = ("--size", "64x36", "--fps", "5", "--seconds", "1", "--trials", "1", "--classes", "led", "--seed", "3")


def test_dataset_has_its_folders_truth_and_checkerboard(tmp_path, cli):
    folder = tmp_path / "set"
    outcome = cli("render", "--dataset", folder, *TINY)
    assert outcome.status == 0, outcome.err
    clips = {path.relative_to(folder).as_posix() for path in folder.rglob("*.mp4")}
    assert clips == {"led/checkerboard.mp4", *(f"led/led_{duration}/01.mp4" for duration in ("2s", "5s", "10s"))}
    assert set(json.loads((folder / "parameters.json").read_text())["led"]) == {"led_2s", "led_5s", "led_10s"}
    assert "4 clips rendered, 0 kept" in outcome.err
    assert outcome.out == ""


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
