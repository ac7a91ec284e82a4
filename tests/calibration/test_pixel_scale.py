"""Pixels to metres: known answers by hand, and errors that teach."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iris_sysid.calibration.calibration_json import read_calibration, write_calibration
from iris_sysid.calibration.pixel_scale import (
    from_osp,
    scale,
    scale_bar,
    scale_bar_from_text,
    scale_from_text,
    to_world,
    uncalibrated,
)
from iris_sysid.errors import CalibrationError, DataError, OutputError
from iris_sysid.types import Calibration, Estimate, Track
from tests._project import recording

# A camera that looks down on the plane: rows of x/m, z/m and the horizon.
TILTED = np.array([[2e-3, 1e-4, -0.5], [1e-4, -2.5e-3, 0.9], [1e-5, 4e-4, 1.0]])


def track(xy_px, sigma_px=0.1, valid=None, **fields):
    xy_px = np.asarray(xy_px, dtype=float)
    n = len(xy_px)
    defaults = {
        "t_s": np.arange(n) / 60,
        "xy_px": xy_px,
        "sigma_px": np.broadcast_to(sigma_px, (n, 2)),
        "valid": np.isfinite(xy_px).all(axis=1) if valid is None else valid,
        "frame": np.arange(n),
    }
    return Track(**(defaults | fields))


def of_homography(homography):
    return Calibration(np.asarray(homography), Estimate(500.0, 1.0, "px/m"))


# --------------------------------------------------------------------------- scales


@pytest.mark.parametrize(
    ("text", "px_per_m", "stderr"),
    [
        ("640px=1m", 640.0, 0.0),
        ("398.7px=100cm", 398.7, 0.0),
        ("398.7px=1000mm", 398.7, 0.0),
        ("1m=640px", 640.0, 0.0),
        (" 640 px = 1 m ", 640.0, 0.0),
        ("640(3)px=1m", 640.0, 3.0),
        ("398.7(5)px=1m", 398.7, 0.5),
        ("398.70(12)px=1m", 398.7, 0.12),
        ("640(1.5)px=1m", 640.0, 1.5),
        ("6.40e2(3)px=1m", 640.0, 3.0),
        ("640+-3px=1m", 640.0, 3.0),
        ("640+/-3px=1m", 640.0, 3.0),
        ("640 ± 3 px = 1m", 640.0, 3.0),
        ("640px=2.00(1)m", 320.0, 1.6),
        ("640+-3px=200(1)cm", 320.0, 320 * math.hypot(3 / 640, 1 / 200)),
        ("1e3px=.5m", 2000.0, 0.0),
    ],
)
def test_scale_from_text_reads_value_and_standard_error(text, px_per_m, stderr):
    calibration = scale_from_text(text)
    assert calibration.scale.value == pytest.approx(px_per_m, rel=1e-14)
    assert calibration.scale.stderr == pytest.approx(stderr, rel=1e-12)
    assert (calibration.scale.unit, calibration.unit) == ("px/m", "m")
    assert calibration.scale.measurement_type == ("direct" if stderr else "assumed")
    assert text.strip() in calibration.source


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "cannot read ''.*640px=1m"),
        ("640", "'640' has no unit.*640px=1m"),
        ("640px", "one side must be in px; write it as 640px=1m"),
        ("640px=", "cannot read ''"),
        ("640=1", "'640' has no unit"),
        ("640px=1furlong", "has the unit 'furlong'; units are px, m, cm, mm"),
        ("640px=1kg", "has the unit 'kg'"),
        ("640px=1M", "has the unit 'M'"),
        ("640px=640px", "one side must be in px"),
        ("1m=100cm", "one side must be in px"),
        ("640px=1m=1m", "one side must be in px"),
        ("0px=1m", r"above zero: px = 0 px"),
        ("640px=0m", r"above zero: metres = 0 m"),
        ("-640px=1m", r"above zero: px = -640 px"),
        ("nanpx=1m", "cannot read 'nanpx'"),
        ("infpx=1m", "cannot read 'infpx'"),
        ("1e999px=1m", "'1e999px' is not a finite number"),
        ("1e300px=1e-300m", "above zero: px per m = inf"),
        ("398,7px=1m", "decimals are written with a point"),
        ("640(700)px=1m", r"below the length: 640 \+- 700 px"),
        ("640(-3)px=1m", r"cannot read '640\(-3\)px'"),
        ("640px=1m/s", "has the unit 'm/s'"),
        ("640px:1m", "cannot read '640px:1m'"),
        ("six hundred px=1m", "cannot read"),
        ("٣px=1m", "cannot read"),
        ("640px=1m" + "0" * 5000, "cannot read"),
    ],
)
def test_scale_from_text_nonsense_is_refused_with_an_example(text, message):
    with pytest.raises(CalibrationError, match=message):
        scale_from_text(text)


def test_scale_bar_standard_error_counts_each_end_once():
    calibration = scale_bar((0.0, 0.0), (300.0, 400.0), 2.0, point_stderr_px=1.0)
    assert calibration.scale.value == 250.0
    assert calibration.scale.stderr == pytest.approx(math.sqrt(2) / 2, rel=1e-12)


def test_scale_bar_scatter_of_marks_is_the_stated_standard_error():
    rng = np.random.default_rng(1)
    ends = np.array([[10.0, 20.0], [250.0, 200.0]]) + rng.normal(0, 0.5, (20_000, 2, 2))
    scatter = np.std([scale_bar(tuple(start), tuple(end), 0.5).scale.value for start, end in ends])
    assert scale_bar((10.0, 20.0), (250.0, 200.0), 0.5).scale.stderr == pytest.approx(scatter, rel=0.02)


def test_scale_bar_from_text_is_the_bar_of_the_ball_toss_file():
    calibration = scale_bar_from_text("272.200469, 446.110869, 273.200990, 47.403208 = 1m")
    assert calibration.scale.value == pytest.approx(398.709, abs=1e-3)
    assert calibration.scale.stderr == pytest.approx(math.sqrt(0.5), rel=1e-12)


def test_scale_bar_from_text_takes_the_standard_error_of_the_length():
    calibration = scale_bar_from_text("0,0,1000,0=84.0(5)cm")
    relative = math.hypot(math.sqrt(0.5) / 1000, 0.5 / 84)
    assert calibration.scale.stderr / calibration.scale.value == pytest.approx(relative, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "cannot read the scale bar ''; write it as x1,y1,x2,y2=length"),
        ("1,2,3=1m", "cannot read the scale bar"),
        ("1,2,3,4,5=1m", "cannot read the scale bar"),
        ("1,2,x,4=1m", "cannot read the scale bar"),
        ("1,2,nan,4=1m", "cannot read the scale bar"),
        ("1,2,300,4", "cannot read ''"),
        ("1,2,300,4=1", "'1' has no unit"),
        ("1,2,300,4=1px", "has the unit 'px'; units are m, cm, mm"),
        ("1,2,300,4=1ft", "has the unit 'ft'"),
        ("1,2,300,4=0m", "above zero"),
        ("5,5,5,5=1m", r"are 0 px apart, known to 0\.71 px; mark two points far apart"),
        ("1e999,0,5,5=1m", "cannot read the scale bar"),
    ],
)
def test_scale_bar_from_text_nonsense_is_refused_with_an_example(text, message):
    with pytest.raises(CalibrationError, match=message):
        scale_bar_from_text(text)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0, 1), "px = 0 px"),
        ((1, -2), "metres = -2 m"),
        ((math.nan, 1), "px = nan px"),
        ((1, math.inf), "metres = inf m"),
    ],
)
def test_scale_of_a_length_that_is_none_is_refused(arguments, message):
    with pytest.raises(CalibrationError, match=message):
        scale(*arguments)


@pytest.mark.parametrize("stderr", [-1.0, math.nan, math.inf, 640.0])
def test_scale_with_an_impossible_standard_error_is_refused(stderr):
    with pytest.raises(CalibrationError, match="standard error of px must be at least zero and below the length"):
        scale(640.0, 1.0, px_stderr=stderr)


# --------------------------------------------------------------------------- to the world


def test_to_world_turns_y_down_into_z_up_in_metres():
    world = to_world(track([[0.0, 0.0], [400.0, 200.0]]), scale(400.0, 1.0))
    np.testing.assert_allclose(world.position, [[0.0, 0.0], [1.0, -0.5]], atol=1e-15)
    np.testing.assert_allclose(world.sigma, 0.1 / 400, rtol=1e-12)
    assert [quantity.column for quantity in world.quantities] == ["x_m", "z_m"]


def test_to_world_keeps_the_scales_error_out_of_sigma():
    world = to_world(track([[400.0, 200.0]] * 3), scale(400.0, 1.0, px_stderr=4.0))
    np.testing.assert_allclose(world.sigma, 0.1 / 400, rtol=1e-12)
    assert world.geometry["scale"] == Estimate(400.0, 4.0, "px/m", "direct", "stated scale")


def test_to_world_uncalibrated_stays_in_px_and_claims_no_scale():
    world = to_world(track([[3.0, 5.0]]), uncalibrated())
    np.testing.assert_array_equal(world.position, [[3.0, -5.0]])
    np.testing.assert_array_equal(world.sigma, [[0.1, 0.1]])
    assert [quantity.unit for quantity in world.quantities] == ["px", "px"]
    assert dict(world.geometry) == {}


def test_to_world_gap_is_nan_and_not_valid():
    world = to_world(track([[1.0, 2.0], [np.nan, np.nan], [3.0, 4.0]]), scale(400.0, 1.0))
    np.testing.assert_array_equal(world.valid, [True, False, True])
    assert np.isnan(world.position[1]).all()


def test_to_world_position_that_was_marked_as_wrong_is_a_gap():
    world = to_world(track([[1.0, 2.0], [900.0, 900.0]], valid=[True, False]), scale(400.0, 1.0))
    assert np.isnan(world.position[1]).all()


def test_to_world_unknown_error_of_x_does_not_spoil_z():
    world = to_world(track([[1.0, 2.0]], sigma_px=[np.nan, 0.4]), scale(400.0, 1.0))
    assert np.isnan(world.sigma[0, 0])
    assert world.sigma[0, 1] == pytest.approx(0.001, rel=1e-12)


def test_to_world_tilted_camera_positions_match_the_formula_by_hand():
    world = to_world(track([[100.0, 200.0]]), of_homography(TILTED))
    w = 1e-5 * 100 + 4e-4 * 200 + 1
    expected = [(2e-3 * 100 + 1e-4 * 200 - 0.5) / w, (1e-4 * 100 - 2.5e-3 * 200 + 0.9) / w]
    np.testing.assert_allclose(world.position[0], expected, rtol=1e-13)


def test_to_world_tilted_camera_sigma_is_the_scatter_of_noisy_tracks():
    rng = np.random.default_rng(2)
    noisy = rng.normal([100.0, 200.0], [0.5, 0.2], (40_000, 2))
    scatter = to_world(track(noisy), of_homography(TILTED)).position.std(axis=0)
    stated = to_world(track([[100.0, 200.0]], sigma_px=[0.5, 0.2]), of_homography(TILTED)).sigma[0]
    np.testing.assert_allclose(stated, scatter, rtol=0.02)


def test_to_world_homography_and_its_multiple_are_the_same():
    plain, other = (to_world(track([[100.0, 200.0]]), of_homography(factor * TILTED)) for factor in (1.0, -3.0))
    np.testing.assert_allclose(plain.position, other.position, rtol=1e-13)
    np.testing.assert_allclose(plain.sigma, other.sigma, rtol=1e-13)


@pytest.mark.parametrize(
    "homography", [np.zeros((3, 3)), np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan), np.ones((3, 3))]
)
def test_to_world_homography_without_an_inverse_is_refused(homography):
    with pytest.raises(CalibrationError, match="no inverse"):
        to_world(track([[1.0, 2.0]]), of_homography(homography))


def test_to_world_beyond_the_horizon_is_refused():
    with pytest.raises(CalibrationError, match="beyond the horizon"):
        to_world(track([[0.0, 0.0], [0.0, -3000.0]]), of_homography(TILTED))


def test_to_world_track_without_any_sample_is_all_gaps():
    world = to_world(track([[np.nan, np.nan]] * 2), of_homography(TILTED))
    assert not world.valid.any()


def test_to_world_body_number_ends_the_names():
    world = to_world(track([[1.0, 2.0]]), scale(400.0, 1.0), body=2)
    assert [quantity.name for quantity in world.quantities] == ["x2", "z2"]


def test_to_world_origin_names_body_calibration_and_first_frame():
    world = to_world(track([[1.0, 2.0]] * 2, frame=[7, 8], body="ball", origin={"source": "a.mp4"}), scale(400.0, 1.0))
    assert dict(world.origin) == {"source": "a.mp4", "body": "ball", "calibration": "stated scale"}
    assert world.first_frame == 7


def test_to_world_frames_left_out_give_no_first_frame():
    assert to_world(track([[1.0, 2.0]] * 2, frame=[7, 9]), scale(400.0, 1.0)).first_frame is None


# --------------------------------------------------------------------------- Open Source Physics Tracker


def test_from_osp_puts_origin_and_axes_where_the_file_does():
    axes = SimpleNamespace(scale_px_per_m=400.0, angle_rad=math.pi / 6, origin_px=(100.0, 300.0))
    along = (100 + 400 * math.cos(math.pi / 6), 300 - 400 * math.sin(math.pi / 6))  # up in the image is -y
    across = (100 - 400 * math.sin(math.pi / 6), 300 - 400 * math.cos(math.pi / 6))
    world = to_world(track([[100.0, 300.0], along, across]), from_osp(axes))
    np.testing.assert_allclose(world.position, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], atol=1e-14)
    assert "turned by 30 degrees" in world.origin["calibration"]


@pytest.mark.parametrize("px_per_m", [math.nan, 0.0, -1.0, math.inf])
def test_from_osp_without_a_scale_is_refused_with_the_remedy(px_per_m):
    with pytest.raises(CalibrationError, match=r"fixes no length.*--scale"):
        from_osp(SimpleNamespace(scale_px_per_m=px_per_m, angle_rad=0.0, origin_px=(0.0, 0.0)))


# --------------------------------------------------------------------------- calibration.json


@pytest.mark.parametrize("calibration", [scale_from_text("398.7(5)px=1m"), uncalibrated(), of_homography(TILTED)])
def test_calibration_written_and_read_is_the_same(tmp_path, calibration):
    back = read_calibration(write_calibration(calibration, tmp_path / "calibration.json"))
    np.testing.assert_array_equal(back.homography, calibration.homography)
    assert (back.scale, back.unit, back.source) == (calibration.scale, calibration.unit, calibration.source)


@given(st.floats(1e-6, 1e6), st.floats(1e-3, 1e3))
def test_scale_has_one_metre_at_its_px(px, metres):
    calibration = scale(px, metres)
    world = to_world(track([[px, 0.0], [0.0, px]]), calibration)
    np.testing.assert_allclose(world.position, [[metres, 0.0], [0.0, -metres]], rtol=1e-12)


def test_write_calibration_twice_is_the_same_bytes_and_refuses_to_replace(tmp_path):
    written = write_calibration(uncalibrated(), tmp_path / "1.json").read_bytes()
    assert write_calibration(uncalibrated(), tmp_path / "2.json").read_bytes() == written
    with pytest.raises(OutputError, match="--force"):
        write_calibration(uncalibrated(), tmp_path / "1.json")


def test_write_calibration_that_cannot_be_used_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match="no inverse"):
        write_calibration(of_homography(np.zeros((3, 3))), tmp_path / "calibration.json")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('"unit": "m"', '"unit": "ft"', DataError, "unit: Input should be 'm' or 'px', not 'ft'"),
        ('"document": "calibration"', '"document": "fit"', DataError, "document: .*not the file that is wanted here"),
        ('"homography"', '"matrix"', DataError, "(homography: Field required|matrix: Extra inputs)"),
        ("0.0025,", "0.0,", CalibrationError, "no inverse"),
        ("0.0025,", '"a",', DataError, r"homography\.0\.0: Input should be a valid number, not 'a'"),
        ('"value": 400.0', '"value": -400.0', DataError, r"scale\.value must be above zero"),
        ('"value": 400.0', '"value": null', DataError, r"scale\.value must be above zero"),
    ],
)
def test_read_calibration_edited_wrongly_says_what_is_wrong(tmp_path, old, new, error, message):
    path = write_calibration(scale(400.0, 1.0), tmp_path / "calibration.json")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(error, match=message):
        read_calibration(path)


@pytest.mark.parametrize("name", ["clip.trk", "clip.TRZ"])
def test_read_calibration_of_a_tracker_file_asks_its_reader(monkeypatch, name):
    axes = SimpleNamespace(scale_px_per_m=398.7, angle_rad=0.0, origin_px=(1.0, 2.0))
    monkeypatch.setattr("iris_sysid.calibration.calibration_json.read_osp", lambda path: axes)
    assert read_calibration(name).scale.value == 398.7


def test_read_calibration_of_the_ball_toss_has_its_scale_and_origin():
    calibration = read_calibration(recording("tracker_balltoss/BallToss.trz"))
    assert calibration.scale.value == pytest.approx(398.709, abs=1e-3)
    # the file's origin, 131.28, 207.86, counts from the corner of the image: half a pixel from ours
    world = to_world(track([[130.777, 207.358]]), calibration)
    np.testing.assert_allclose(world.position, 0, atol=1e-5)
