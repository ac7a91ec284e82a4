"""The command ``frame``: one frame with a grid whose lines lie where their labels say."""

import cv2
import numpy as np
import pytest

from iris_sysid.report.frame_sheet import frame_sheet


def test_frame_is_drawn_with_its_number_and_time(pendulum_clip, tmp_path, cli):
    outcome = cli("frame", pendulum_clip, "--time", "1.01", "-o", tmp_path / "frame.png")
    assert outcome.status == 0
    assert "frame 31, 1.0333 s, 160 x 90 px" in outcome.err
    assert min(cv2.imread(str(tmp_path / "frame.png")).shape[:2]) > 600


def test_frame_beyond_the_clip_says_how_many_there_are(pendulum_clip, tmp_path, cli):
    outcome = cli("frame", pendulum_clip, "--frame", "90", "-o", tmp_path / "frame.png")
    assert outcome.status == 1
    assert "has 90 frames" in outcome.err


def test_number_and_time_are_not_both_taken(pendulum_clip, tmp_path, cli):
    outcome = cli("frame", pendulum_clip, "--frame", "3", "--time", "1", "-o", tmp_path / "frame.png")
    assert "--frame or --time, not both" in outcome.err


@pytest.mark.parametrize(("width", "height", "zoom", "step"), [(360, 640, 2, 50), (3840, 2160, 1, 200)])
def test_lines_lie_at_the_pixels_that_their_labels_name(width, height, zoom, step):
    sheet = frame_sheet(np.full((height, width, 3), 90, np.uint8)).astype(int)
    row = np.median(sheet[sheet.shape[0] // 3 : sheet.shape[0] // 2, :, 0], axis=0)
    inside = np.flatnonzero(row < 250)
    bright = np.flatnonzero(row[inside[0] :][: zoom * width] > 170)  # of labelled lines
    assert sorted({int(at // zoom) // step * step for at in bright}) == list(range(0, width, step))
    assert {int(at // zoom) % step for at in bright} <= {0, 1}


@pytest.mark.parametrize(
    "command", ["frame {0} --fps 30 -o {0}/f.png", "run {0} --fps 30 --phenomenon pendulum -o {0}"]
)
def test_picture_is_not_written_among_the_pictures_that_it_is_made_from(tmp_path, cli, command):
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((48, 64), np.uint8))
    outcome = cli(*command.format(tmp_path).split())
    assert outcome.status == 1
    assert "the pictures of the clip are there; give another folder" in outcome.err
    assert [path.name for path in tmp_path.iterdir()] == ["1.png"]
