"""The request of a run is found again in its files, and that of a review in its log."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from iris_sysid.calibration.pixel_scale import scale_from_text
from iris_sysid.errors import CalibrationError, DataError, UnknownNameError
from iris_sysid.pipeline import one_clip
from iris_sysid.registry import PHENOMENA
from iris_sysid.review.opening import open_clip
from iris_sysid.review.request import ReviewRequest, request_of
from iris_sysid.types import Calibration, ClipOptions, Estimate, GeometryOptions, TrackMark, TrackOptions

WHOLE = ReviewRequest(
    phenomenon=PHENOMENA["pendulum"],
    calibration=scale_from_text("180+-2px=0.5m"),
    settings={"ball_radius": Estimate(0.0335, 0.0005, "m", "direct", "given")},
    free=("gravity",),
    clip=ClipOptions(fps=60.0, fps_stderr=1e-4, start_s=0.1, stop_s=1.9),
    geometry=GeometryOptions(marks_px={"pivot": (160.0, 19.0)}, plumb_px=(10.0, 0.0, 10.0, 170.0)),
    tracking=TrackOptions(roi=(0, 0, 320, 180), marks=(TrackMark("1", 100.0, 140.0, 60),)),
)


def same(one: ReviewRequest, other: ReviewRequest) -> None:
    assert (one.phenomenon.name, one.phenomenon.tracker) == (other.phenomenon.name, other.phenomenon.tracker)
    assert np.allclose(one.calibration.values, other.calibration.values, rtol=1e-12)
    assert one.calibration.scale.stderr == pytest.approx(other.calibration.scale.stderr)
    assert {name: (value.value, value.stderr, value.unit) for name, value in one.settings.items()} == {
        name: (value.value, value.stderr, value.unit) for name, value in other.settings.items()
    }
    assert (one.free, one.clip) == (other.free, other.clip)
    assert dict(one.geometry.marks_px) == dict(other.geometry.marks_px)
    assert one.geometry.plumb_px == other.geometry.plumb_px
    assert (one.tracking.roi, one.tracking.marks) == (other.tracking.roi, other.tracking.marks)


def test_request_in_the_origin_of_a_track_reads_back():
    same(request_of(WHOLE.recorded()), WHOLE)


def test_scale_from_gravity_reads_back_with_its_error():
    gravity = Estimate(9.79, 0.01, "m/s^2", "direct", "given")
    request = ReviewRequest(phenomenon=PHENOMENA["projectile"], geometry=GeometryOptions(scale_from_gravity=gravity))
    again = request_of(request.recorded()).geometry.scale_from_gravity
    assert (again.value, again.stderr) == (9.79, 0.01)


def test_run_with_a_scale_opens_with_it(project, opened):
    out = project / "scaled"
    one_clip.save(one_clip.run(project / "pendulum.mp4", "pendulum", calibration="180px=0.5m"), out)
    calibration = opened(out).state.request.calibration
    assert calibration.scale.value == pytest.approx(360.0)


def test_camera_of_a_run_has_to_be_given_again():
    plain = scale_from_text("180px=0.5m")
    tilted = np.array(plain.homography)
    tilted[2, 0] = 1e-5
    recorded = replace(WHOLE, calibration=Calibration(tilted, plain.scale)).recorded()
    with pytest.raises(DataError, match="--calibration"):
        request_of(recorded)
    assert request_of(recorded, plain).calibration is plain


def test_review_that_was_left_has_its_request_again(project, opened):
    session = open_clip(project / "pendulum.mp4", project / "new", WHOLE)
    session.close()
    same(opened(project / "new").state.request, WHOLE)


@pytest.mark.parametrize(
    "damage",
    [
        {"settings": {"length": 3}},
        {"settings": {"length": {"value": "x", "stderr": 0, "unit": "m"}}},
        {"marks_px": {"pivot": [1]}},
        {"plumb_px": [1, 2]},
        {"roi": "all"},
        {"body_marks": [[1]]},
        {"scale": {}},
        {"clock_stderr": "much"},
    ],
)
def test_damaged_request_is_refused(damage):
    with pytest.raises(DataError):
        request_of({**WHOLE.recorded(), **damage})


def test_scale_that_cannot_be_is_refused():
    with pytest.raises(CalibrationError):
        request_of({**WHOLE.recorded(), "scale": {"px_per_unit": 0, "stderr": 0, "source": "", "plain": True}})


@pytest.mark.parametrize("name", ["none", "/tmp/mine.py:x", "../mine.py:mine"])
def test_name_in_a_file_runs_no_file(name, tmp_path: Path):
    Path(tmp_path / "mine.py").write_text("raise SystemExit('the file was run')\n")
    for content in ({"phenomenon": name}, {"phenomenon": "pendulum", "tracker": f"{tmp_path}/mine.py:{name}"}):
        with pytest.raises(UnknownNameError):
            request_of(content)


def test_request_that_the_phenomenon_cannot_use_is_refused_before_anything_is_written(project):
    wrong = replace(WHOLE, settings={"mass": Estimate(1.0, 0.0, "kg")})
    with pytest.raises(UnknownNameError, match="pendulum has nothing named 'mass'"):
        open_clip(project / "pendulum.mp4", project / "new", wrong)
    assert not (project / "new").exists()
