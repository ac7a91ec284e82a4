"""The tracker and the detector of the guide run as printed, and an error in such a file is told with its line."""

import re

import numpy as np
import pytest

from iris_sysid import detect, read_track, track
from tests._drawn import noisy
from tests._motions import on_arc, pendulum_angle
from tests._project import ROOT
from tests.conftest import discs, write_video

GUIDE = (ROOT / "docs" / "guide" / "plugins.md").read_text("utf-8")
CODE, STAGES = (
    re.search(rf"^```python\n(# my_{name}\.py\n.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL)[1]
    for name in ("trackers", "stages")
)


@pytest.fixture
def own_file(tmp_path):
    path = tmp_path / "my_trackers.py"
    path.write_text(CODE)
    return path


def test_tracker_of_the_guide_follows_a_bright_disc(cli, own_file, leaving_clip, tmp_path):
    outcome = cli("track", leaving_clip, "--tracker", f"{own_file}:brightest", "-o", tmp_path / "track.csv")
    assert outcome.status == 0, outcome.err
    (body,) = read_track(tmp_path / "track.csv")
    inside = (body.frame > 2) & (body.frame < 18)
    np.testing.assert_allclose(body.xy_px[inside, 0], -10.0 + 7.0 * body.frame[inside], atol=0.5)
    np.testing.assert_allclose(body.xy_px[inside, 1], 40.0, atol=0.5)
    assert not body.valid[body.frame > 22].any()


def test_tracker_of_the_guide_serves_a_whole_run(cli, own_file, tmp_path):
    theta = pendulum_angle(np.arange(90) / 30, 0.5, 0.3)
    across, up = on_arc(theta, 60.0, (64.0, 0.0)).T
    clip = write_video(tmp_path / "swing.mp4", noisy([discs((x, -z)) for x, z in zip(across, up, strict=True)], 3.0))
    command = ("run", clip, "--phenomenon", "pendulum", "--tracker", f"{own_file}:brightest", "-o", tmp_path / "out")
    outcome = cli(*command)
    assert outcome.status == 0, outcome.err
    (length,) = re.findall(r"^length +([0-9.]+)", outcome.out, re.MULTILINE)
    assert float(length) == pytest.approx(0.3, rel=0.01)


def test_error_in_a_file_of_ones_own_names_file_and_line(cli, own_file, leaving_clip, tmp_path):
    own_file.write_text(CODE.replace("light.max()", "light.maximum()"))
    line = 1 + CODE.splitlines().index(next(text for text in CODE.splitlines() if "light.max()" in text))
    outcome = cli("track", leaving_clip, "--tracker", f"{own_file}:brightest", "-o", tmp_path / "track.csv")
    assert outcome.status == 1
    assert f"unexpected AttributeError in {own_file}, line {line}: " in outcome.err
    assert len(outcome.err.splitlines()) == 1


def test_detector_of_the_guide_is_linked_and_measured(pendulum_clip, tmp_path):
    file = tmp_path / "my_stages.py"
    file.write_text(STAGES)
    detections = detect(pendulum_clip, f"{file}:coloured")
    (body,) = track(pendulum_clip, f"{file}:tracker")
    assert body.valid.mean() > 0.7
    apart = np.hypot(*(body.xy_px[body.valid] - detections.xy_px[np.isin(detections.frame, body.frame[body.valid])]).T)
    assert np.median(apart) < 2.0
