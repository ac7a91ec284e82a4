"""The pixels of synthetic clips are exact: coverage, centroids, blur, noise, colours, switches."""

from itertools import pairwise

import numpy as np
import pytest

from iris_sysid.errors import DataError
from iris_sysid.synthetic import Look
from iris_sysid.synthetic.backdrop import ycbcr
from iris_sysid.synthetic.camera import Camera, CameraView, camera_for
from iris_sysid.synthetic.coverage import Canvas, blend
from iris_sysid.synthetic.plan import plan_clip, scene_named, stage_of
from iris_sysid.synthetic.scene import SceneBody, Stage, Wall
from iris_sysid.synthetic.sensor import Sensor, kept_frames, shake
from iris_sysid.synthetic.shapes import Layer, circle, disc, polyline, rounded, still
from tests.synthetic._painted import painted

SIZE = (96, 64)
SCALE = 100.0  # px/m in the images of single discs


def stage_with(*layers, view=None):
    """A stage that shows only these layers, x and z in units of 1/100 m from the centre of the image."""
    half = (SIZE[0] / SCALE / 2, SIZE[1] / SCALE / 2)
    view = view or CameraView(-half[0], half[0], -half[1], half[1])
    return Stage(view, Wall((100.0, 100.0, 100.0)), (), layers, (), {}, lambda t: ["motion"] * len(t))


def picture_of(*layers, look=None, t_s=0.0, camera=None):
    stage = stage_with(*layers)
    return painted(stage, camera or camera_for(stage.view, SIZE), look or Look.plain(), [t_s])[0]


def centroid(image):
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(x * image).sum(), (y * image).sum()]) / image.sum()


def supersampled(polygon, width, height, n=24):
    """Coverage by counting points inside (even-odd rule): an independent oracle."""
    x = (np.arange(width * n) + 0.5) / n - 0.5
    inside = np.zeros((height * n, width * n), dtype=bool)
    y = ((np.arange(height * n) + 0.5) / n - 0.5)[:, None]
    for (xa, ya), (xb, yb) in pairwise([*polygon, polygon[0]]):
        if ya != yb:
            crosses = (ya <= y) != (yb <= y)
            inside ^= crosses & (x[None] > xa + (y - ya) * (xb - xa) / (yb - ya))
    return inside.reshape(height, n, width, n).mean(axis=(1, 3))


def coverage(polygon_px, width, height):
    """The fraction of each pixel of a grid that lies inside a polygon, as a canvas draws it."""
    canvas, out = Canvas(width, height), np.zeros((height, width), np.float32)
    canvas.add(polygon_px[np.newaxis], np.ones(1))
    blend([out], canvas, [1.0])
    return out.astype(np.float64)


@pytest.mark.parametrize(
    "polygon",
    [
        [(3.2, 2.1), (14.7, 5.3), (8.1, 12.9)],
        [(-6.0, 3.0), (30.0, 4.5), (30.0, 5.1), (-6.0, 9.0)],  # through both borders
        [(-5.3, -7.0), (3.25, 2.1), (60.0, 8.0), (3.0, 90.0)],  # beyond every border
        [(4.0, 4.0), (9.0, 4.0), (9.0, 9.0), (4.0, 9.0)],
        [(5.1, 5.1), (5.3, 5.1), (5.3, 5.2), (5.1, 5.2)],  # within one pixel
        [(-20.0, -20.0), (60.0, -20.0), (60.0, 60.0), (-20.0, 60.0)],  # all of the image
    ],
)
def test_coverage_agrees_with_counting_points(polygon):
    exact = coverage(np.array(polygon), 20, 16)
    assert np.abs(exact - supersampled(polygon, 20, 16)).max() < 0.05
    assert exact.sum() == pytest.approx(supersampled(polygon, 20, 16).sum(), rel=3e-3, abs=8e-3)


def test_coverage_of_a_rectangle_is_exact():
    area = coverage(np.array([(1.25, 0.5), (3.0, 0.5), (3.0, 2.25), (1.25, 2.25)]), 6, 4)
    columns, rows = np.array([0, 0.25, 1, 0.5, 0, 0]), np.array([0, 1, 0.75, 0])
    np.testing.assert_allclose(area, rows[:, None] * columns, atol=1e-7)


def test_canvas_is_empty_after_blending():
    canvas = Canvas(30, 30)
    canvas.add(circle(8, 1)[None] + 15.0, np.ones(1))
    blend([np.zeros((30, 30), np.float32)], canvas, [1.0])
    assert np.abs(canvas.area).max() == 0
    assert canvas.rows == (0, 0)


# A pixel gives its area no finer place than its centre: the bound on a small disc is that of the grid itself.
@pytest.mark.parametrize(("radius_px", "bound_px"), [(4.0, 0.004), (8.0, 0.002), (12.0, 0.002)])
def test_disc_centroid_equals_truth_at_every_subpixel_phase(radius_px, bound_px):
    rng = np.random.default_rng(11)
    worst_px = 0.0
    for offset in rng.uniform(-0.5, 0.5, (50, 2)):
        centre_m = offset / SCALE * [1, -1]
        image = picture_of(Layer(disc(still(*centre_m), radius_px / SCALE), (200, 200, 200))).luma - 100.0
        truth_px = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2]) + offset
        worst_px = max(worst_px, np.abs(centroid(image) - truth_px).max())
        assert image.sum() / 100.0 == pytest.approx(np.pi * radius_px**2, rel=2e-5)
    assert worst_px < bound_px


def test_disc_has_no_systematic_offset_over_the_subpixel_phase():
    errors = []
    for phase in (np.arange(16) + 0.5) / 16 - 0.5:
        image = picture_of(Layer(disc(still(phase / SCALE, 0.0), 4 / SCALE), (200, 200, 200))).luma - 100.0
        errors.append(centroid(image)[0] - (SIZE[0] - 1) / 2 - phase)
    assert abs(np.mean(errors)) < 2e-4


def moving(speed_m_s, acceleration=0.0):
    return lambda t_s: np.stack([speed_m_s * t_s + acceleration * t_s**2 / 2, 0 * t_s], axis=-1)


def test_blurred_disc_centroid_is_the_mean_position_over_the_exposure():
    exposure, speed, acceleration = 0.02, 5.0, 100.0  # 10 px of travel
    look = Look.plain(exposure_s=exposure)
    image = picture_of(Layer(disc(moving(speed, acceleration), 0.08), (200, 200, 200)), look=look).luma - 100.0
    mean_px = (SIZE[0] - 1) / 2 + SCALE * acceleration * exposure**2 / 24
    assert centroid(image)[0] == pytest.approx(mean_px, abs=0.002)
    assert image.sum() / 100.0 == pytest.approx(np.pi * 64, rel=1e-4)


def test_blurred_disc_is_longer_by_its_travel():
    still_image = picture_of(Layer(disc(moving(5.0), 0.08), (200, 200, 200))).luma - 100.0
    blurred = picture_of(Layer(disc(moving(5.0), 0.08), (200, 200, 200)), look=Look.plain(exposure_s=0.02)).luma - 100.0
    widths = [np.count_nonzero(image.max(axis=0) > 1.0) for image in (still_image, blurred)]
    assert widths[1] - widths[0] == pytest.approx(10, abs=1)


def test_flashing_layer_shows_the_mean_of_its_opacity_over_the_exposure():
    flash = Layer(disc(still(0, 0), 0.1), (200, 200, 200), opacity=lambda t_s: (t_s > 0).astype(float))
    image = picture_of(flash, look=Look.plain(exposure_s=0.01)).luma
    assert image[32, 48] == pytest.approx(150.0, abs=1e-3)


def test_moving_image_leaves_no_trace_behind():
    layers = (
        Layer(disc(moving(1.0), 0.05), (220, 90, 40)),
        Layer(polyline(lambda t_s: np.stack([still(0, 0.3)(t_s), moving(1.0)(t_s)], axis=1), 0.01), (20, 20, 20)),
    )
    stage = stage_with(*layers)
    camera = camera_for(stage.view, SIZE)
    directly = painted(stage, camera, Look.plain(), [0.3])[0]
    afterwards = painted(stage, camera, Look.plain(), [-0.4, -0.2, 0.0, 0.1, 0.3])[-1]
    for name in ("luma", "blue", "red"):
        np.testing.assert_allclose(getattr(afterwards, name), getattr(directly, name), atol=1e-5)


def test_colour_planes_agree_with_the_luma_plane():
    planes = picture_of(Layer(disc(still(0, 0), 0.2), (200, 40, 30)))
    luma, blue, red = ycbcr((200, 40, 30))
    assert planes.luma[32, 48] == pytest.approx(luma, abs=1e-3)
    assert planes.blue[16, 24] == pytest.approx(blue, abs=1e-3)
    assert planes.red[16, 24] == pytest.approx(red, abs=1e-3)
    weight = planes.red - 128.0
    np.testing.assert_allclose(2 * centroid(weight) + 0.5, centroid(planes.luma - 100.0), atol=0.01)


def test_ycbcr_of_grey_has_no_colour():
    assert ycbcr((90, 90, 90)) == pytest.approx((90, 128, 128))


# --------------------------------------------------------------------------- camera


def test_camera_is_a_similarity_without_tilt_and_lens():
    camera = camera_for(CameraView(-1, 1, -0.5, 0.5), (200, 100))
    assert camera.pixels_per_metre == 100
    np.testing.assert_allclose(camera.project(np.array([[0.0, 0.0], [0.5, 0.25]])), [[99.5, 49.5], [149.5, 24.5]])


def test_camera_shows_the_whole_view_at_any_shape_of_image():
    for size in ((200, 100), (100, 200), (160, 160)):
        camera = camera_for(CameraView(-1, 1, -0.5, 0.5), size)
        corners = camera.project(np.array([[-1.0, -0.5], [1.0, 0.5]]))
        assert np.all(corners > -0.51)
        assert np.all(corners < np.array(size) - 0.49)


def test_camera_agrees_with_opencv():
    import cv2

    camera = Camera((640, 480), 300.0, (0.1, -0.2), 1.5, (0.1, -0.15), 0.02, (-0.08, 0.03), 1.01)
    points = np.random.default_rng(3).uniform(-0.8, 0.8, (40, 2))
    seen = camera.description()
    right_down = np.stack([points[:, 0] - 0.1, -0.2 - points[:, 1], 0 * points[:, 0]], axis=-1)
    matrix = np.array([[seen["focal_px"][0], 0, 319.5], [0, seen["focal_px"][1], 239.5], [0, 0, 1]])
    vector = cv2.Rodrigues(np.array(seen["rotation"]))[0]
    expected = cv2.projectPoints(
        right_down, vector, np.array([0, 0, seen["distance_m"]]), matrix, np.array(seen["distortion"])
    )[0]
    np.testing.assert_allclose(camera.project(points), expected.reshape(-1, 2), atol=1e-8)


def test_tilted_disc_is_drawn_where_its_truth_says():
    look = Look.plain(tilt_deg=(8.0, -6.0), roll_deg=1.0, distortion=(-0.1, 0.02))
    plan = plan_clip("pendulum", size=(640, 360), duration_s=2.0, look=look, overrides={"ball_radius": 0.012})
    t_s = 1.4
    row = plan.truth.body().iloc[round(t_s * 60)]
    image = np.abs(painted(plan.stage, plan.camera, look, [t_s])[0].luma - 121.0)
    np.testing.assert_allclose(centroid(np.where(image > 1, image, 0)), [row.x_px, row.y_px], atol=0.03)


def test_rolling_shutter_draws_the_ball_where_the_truth_says():
    effects = {"rolling-shutter": 0.016}
    plan = plan_clip(
        "pendulum", effects=effects, size=(640, 360), duration_s=2, look=Look.plain(), setting="pendulum_90"
    )
    from iris_sysid.synthetic.picture import Picture

    picture = Picture(plan.stage, plan.camera, plan.look, np.random.default_rng(0))
    picture.readout_s = plan.readout_s
    row = plan.truth.body().iloc[60]
    image = np.abs(picture.at(1.0).luma - picture.background.luma)
    assert np.hypot(*(centroid(image) - [row.x_px, row.y_px])) < 0.03
    rigid = plan_clip("pendulum", size=(640, 360), duration_s=2, look=Look.plain(), setting="pendulum_90")
    assert abs(rigid.truth.body().iloc[60].x_px - row.x_px) > 1.0


# --------------------------------------------------------------------------- sensor


def noisy_frames(level, look, count=20):
    stage = stage_with()
    planes = painted(stage, camera_for(stage.view, SIZE), Look.plain(), [0.0])[0]
    planes.luma[:] = level
    sensor = Sensor(SIZE, look, np.random.default_rng(5))
    frames = []
    for _ in range(count):
        out = tuple(np.empty(plane.shape, np.uint8) for plane in (planes.luma, planes.blue, planes.red))
        sensor.read(planes, out)
        frames.append(out[0].astype(float))
    return np.array(frames)


@pytest.mark.parametrize(("read", "shot", "level"), [(3.0, 0.0, 120.0), (1.0, 0.05, 80.0), (0.0, 0.1, 150.0)])
def test_noise_has_the_requested_variance(read, shot, level):
    frames = noisy_frames(level, Look.plain(read_noise=read, shot_noise=shot))
    rounding = 1 / 12
    assert frames.std() == pytest.approx(np.sqrt(read**2 + shot * level + rounding), rel=0.01)
    assert frames.mean() == pytest.approx(level, abs=0.05)


def test_noise_is_independent_between_frames_rows_and_columns():
    frames = noisy_frames(120.0, Look.plain(read_noise=3.0), count=40) - 120.0
    bound = 5 / np.sqrt(frames.size) * 9
    assert abs(np.mean(frames[1:] * frames[:-1])) < bound
    assert abs(np.mean(frames[:, 1:] * frames[:, :-1])) < bound
    assert abs(np.mean(frames[:, :, 1:] * frames[:, :, :-1])) < bound


def test_no_noise_gives_the_nearest_grey_level():
    assert np.unique(noisy_frames(100.4, Look.plain(), count=1)).tolist() == [100.0]
    assert np.unique(noisy_frames(300.0, Look.plain(), count=1)).tolist() == [255.0]


def test_dropped_frames_keep_the_first_and_the_last():
    kept = kept_frames(1000, 0.1, np.random.default_rng(0))
    assert kept[0] == 0
    assert kept[-1] == 999
    assert 850 < kept.size < 950
    assert kept_frames(50, 0.0, np.random.default_rng(0)).tolist() == list(range(50))


def test_shake_has_the_requested_deviation():
    offsets = shake(40_000, 60.0, 0.7, np.random.default_rng(2))
    assert offsets.std(axis=0) == pytest.approx([0.7, 0.7], rel=0.05)
    assert np.abs(np.diff(offsets, axis=0)).max() < 0.7 * 2


# --------------------------------------------------------------------------- look


@pytest.mark.parametrize("switch", ["marks", "cord", "clamp", "hand", "shading"])
def test_switching_off_changes_the_image_and_not_the_motion(switch):
    pictures, tables = [], []
    for look in (Look(), Look(**{switch: False})):
        plan = plan_clip("pendulum", size=(320, 180), duration_s=1.0, look=look)
        pictures.append(painted(plan.stage, plan.camera, look, [0.3])[0].luma)
        tables.append(plan.truth.table[["x_px", "y_px"]].to_numpy())
    assert np.abs(pictures[0] - pictures[1]).max() > 2
    np.testing.assert_array_equal(*tables)


@pytest.mark.parametrize("number", ["texture", "vignetting", "uneven_light", "shadow", "exposure_s"])
def test_setting_a_number_to_zero_changes_the_image(number):
    pictures = []
    for look in (Look(), Look(**{number: 0.0})):
        stage = stage_of(scene_named("pendulum"), look=look, duration_s=2.0)
        pictures.append(painted(stage, camera_for(stage.view, (320, 180)), look, [1.0])[0].luma)
    assert np.abs(pictures[0] - pictures[1]).max() > 1


def test_plain_look_shows_nothing_but_the_bodies():
    look = Look.plain()
    plan = plan_clip("pendulum", size=(320, 180), duration_s=1.0, look=look)
    luma = painted(plan.stage, plan.camera, look, [0.3])[0].luma
    assert np.unique(luma[:, 200:]).size == 1


def test_plain_look_switches_on_the_requested_parts():
    assert Look.plain(read_noise=2.0).read_noise == 2.0
    assert Look.plain().codec == "lossless"


def test_bit_rate_is_a_phones():
    assert Look().bits_per_second((3840, 2160), 60.0) == pytest.approx(45e6)
    assert Look().bits_per_second((1920, 1080), 30.0) == pytest.approx(45e6 / 8)
    assert Look(bit_rate=1e6).bits_per_second((1920, 1080), 30.0) == 1e6


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"exposure_s": -0.1}, "exposure_s must lie between 0 and inf, not -0.1"),
        ({"vignetting": 2.0}, "vignetting must lie between 0 and 1"),
        ({"read_noise": float("nan")}, "read_noise must lie"),
        ({"dropped": 0.9}, "dropped must lie between 0 and 0.5"),
        ({"tilt_deg": (80.0, 0.0)}, "tilt_deg"),
        ({"tilt_deg": 3.0}, "tilt_deg must be two numbers, not 3.0"),
        ({"distortion": (0.1,)}, "distortion must be two numbers"),
        ({"codec": "mpeg2"}, "codec must be one of h264, lossless, ffv1"),
        ({"bit_rate": 0.0}, "bit_rate must lie"),
        ({"shadow": "dark"}, "shadow must lie"),
    ],
)
def test_bad_look_is_refused(settings, message):
    with pytest.raises(DataError, match=message):
        Look(**settings)


def test_rounded_polygon_passes_through_its_points():
    points = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])
    curve = rounded(points, per_side=4)
    assert curve.shape == (16, 2)
    np.testing.assert_allclose(curve[::4], points)


def test_body_radius_may_change_with_time():
    body = SceneBody("1", still(0, 0), lambda t_s: 1 + t_s)
    assert body.radius(np.array([0.0, 1.0])).tolist() == [1.0, 2.0]
    assert SceneBody("1", still(0, 0), 0.5).radius(np.zeros(3)).tolist() == [0.5, 0.5, 0.5]
