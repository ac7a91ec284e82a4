"""The chain as the library runs it: names are checked first, every box says where it comes from."""

import copy
import pickle

import numpy as np
import pytest
from matplotlib.figure import Figure

from iris_sysid import TRACKERS, Estimate, plot, run, save, scale, track
from iris_sysid.errors import CalibrationError, DataError, OutputError, UnknownNameError
from iris_sysid.io.files import sha256_of
from iris_sysid.pipeline import one_clip
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.synthetic import read_truth
from iris_sysid.types import GeometryOptions, Track, TrackOptions
from tests._changing import fading
from tests.conftest import listing, write_video

NAME = "median-background"


@pytest.fixture(scope="module")
def result(pendulum_clip):
    settings = {"ball_radius": Estimate(0.03, 0.001, "m", "direct"), "gravity": Estimate(9.80665, 0.0, "")}
    return run(pendulum_clip, "pendulum", settings=settings, options=TrackOptions(roi=(0, 0, 160, 90)))


def test_run_on_a_tiny_clip_finds_the_length(result, pendulum_clip):
    truth = read_truth(pendulum_clip).parameters["length"].value
    length = result.fit.estimates["length"]
    assert result.fit.ok, result.fit.message
    assert length.value == pytest.approx(truth, rel=0.01)
    assert 0 < length.stderr < 0.01


def test_run_tracks_most_of_so_small_an_image(result):
    (track,) = result.tracks
    assert track.t_s.size == 90
    assert track.n_valid >= 60


def test_run_says_what_each_box_comes_from(result, pendulum_clip):
    for box in (result.tracks[0], result.world[0], result.trajectory, result.fit):
        origin = box.origin
        assert origin["source"] == "pendulum.mp4"
        assert origin["sha256"] == sha256_of(pendulum_clip)
        assert origin["versions"]["numpy"] == np.__version__
        assert origin["roi"] == (0, 0, 160, 90)
        assert origin["options"]["phenomenon"] == "pendulum"
        assert origin["options"]["tracker"] == "auto"
        assert origin["options"]["settings"]["ball_radius"] == {"value": 0.03, "stderr": 0.001, "unit": "m"}


def test_vertical_is_noted_where_a_direction_is_measured_alone(result, tmp_path):
    assert any("the vertical is the image's" in note for note in result.notes)
    brightness = run(write_video(tmp_path / "lamp.mp4", fading()[0].images), "led")
    assert not any("vertical" in note for note in brightness.notes)


def test_track_takes_a_file_and_a_tracker_by_name_or_itself(pendulum_clip):
    by_name, by_object = (track(pendulum_clip, tracker)[0] for tracker in (NAME, TRACKERS[NAME]))
    np.testing.assert_array_equal(by_name.xy_px, by_object.xy_px)
    assert by_name.n_valid >= 60


def test_scale_may_be_text_and_is_read_before_the_clip():
    with pytest.raises(CalibrationError, match="640px=1m"):
        run("none.mp4", "pendulum", calibration="about a metre")


def test_run_comes_back_from_a_process(result):
    again = pickle.loads(pickle.dumps(result))
    assert repr(again) == repr(copy.deepcopy(result)) == repr(result)
    assert len(repr(again).splitlines()) == 3
    np.testing.assert_array_equal(again.trajectory.position, result.trajectory.position)


def test_run_is_drawn_on_its_clip_and_shown_in_a_notebook(result):
    picture, data, residual = plot(result, Figure())
    assert picture.get_images()
    assert [data.get_ylabel(), residual.get_ylabel()] == ["theta (rad)", "residual (rad)"]
    assert "<td>length</td>" in result._repr_html_()


def test_stated_value_without_unit_is_in_that_of_the_model(result):
    assert result.fit.estimates["gravity"].unit == "m/s^2"


def test_stated_length_and_free_gravity_need_no_scale(pendulum_clip):
    result = run(pendulum_clip, "pendulum", settings={"length": Estimate(0.5, 0.0, "m")}, free=("gravity",))
    assert result.fit.estimates["gravity"].value == pytest.approx(9.80665, rel=0.01)


@pytest.mark.parametrize("name", one_clip.FILES)
def test_save_refuses_before_it_writes_when_one_file_is_there(result, tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match=f"{name} exists already"):
        save(result, tmp_path)
    assert listing(tmp_path) == {name: b"mine"}


@pytest.mark.parametrize("name", PHENOMENA)
def test_accepted_settings_are_the_parameters_and_what_the_phenomenon_declares(name):
    phenomenon = PHENOMENA[name]
    units = one_clip.accepted_settings(phenomenon)
    for parameter in MODELS[phenomenon.model].parameters:
        assert units[parameter.name] == parameter.unit
    assert set(phenomenon.settings) <= set(units)


@pytest.mark.parametrize(
    ("phenomenon", "options", "error", "message"),
    [
        ("pendulums", {}, UnknownNameError, "no phenomenon is named 'pendulums'; did you mean 'pendulum'"),
        (
            "pendulum",
            {"settings": {"nonsense": Estimate(1, 0, "")}},
            UnknownNameError,
            "pendulum has nothing named 'nonsense'; it has length, damping, .*arc_radius",
        ),
        ("pendulum", {"free": ["nonsense"]}, UnknownNameError, "pendulum has nothing named 'nonsense'; it has length"),
        ("pendulum", {"free": ["arc_radius"]}, UnknownNameError, "pendulum has nothing named 'arc_radius'"),
        (
            "pendulum",
            {"free": ["gravity"], "settings": {"gravity": Estimate(9.8, 0, "")}},
            DataError,
            "gravity cannot be both set and free",
        ),
        (
            "pendulum",
            {"geometry": GeometryOptions(marks_px={"launch": (1, 2)})},
            UnknownNameError,
            "pendulum has no use for the mark 'launch'",
        ),
        (
            "projectile",
            {"geometry": GeometryOptions(marks_px={"pivot": (1, 2)})},
            UnknownNameError,
            "projectile has no use for the mark 'pivot'",
        ),
        (
            "pendulum",
            {"geometry": GeometryOptions(scale_from_gravity=Estimate(9.8, 0, "m/s^2"))},
            CalibrationError,
            "gravity gives the scale of a free flight only, not of pendulum",
        ),
    ],
)  # fmt: skip
def test_run_refuses_what_it_does_not_know_before_any_frame_is_read(
    phenomenon, options, error, message, tmp_path, monkeypatch
):
    monkeypatch.setattr(one_clip, "open_video", lambda *_, **__: pytest.fail("the video was opened"))
    with pytest.raises(error, match=message):
        run(tmp_path / "no.mp4", phenomenon, **options)


def test_observe_with_too_few_tracks_is_refused(result):
    with pytest.raises(DataError, match="pendulum needs 1 bodies, but 0 were tracked"):
        one_clip.observe([], result.calibration, "pendulum")


def test_throw_is_followed_back_to_where_its_launch_was_marked():
    t_s = np.arange(20, 90) / 240  # the launcher hides the first 20 frames
    x_m, z_m = 1.2 * t_s, 2.0 * t_s - 9.80665 / 2 * t_s**2
    xy_px = np.column_stack([300 * x_m, 400 - 300 * z_m]) + np.random.default_rng(0).normal(0, 0.05, (t_s.size, 2))
    body = Track(t_s, xy_px, np.full_like(xy_px, 0.05), np.ones(t_s.size, bool), np.arange(20, 90))
    _, _, result = one_clip.observe_and_fit(
        [body], scale(300.0, 1.0), PHENOMENA["projectile"], {}, marks_px={"launch": (0, 400)}
    )
    speed = result.estimates["launch_speed"]
    assert speed.value == pytest.approx(np.hypot(1.2, 2.0), abs=4 * speed.stderr)
    assert speed.stderr < 0.02
    assert result.estimates["launch_z"].measurement_type == "direct"
