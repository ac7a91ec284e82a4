"""The median-background tracker on drawn clips, whose truth is exact."""

import re

import cv2
import numpy as np
import pytest

from iris_sysid.errors import DataError, TrackingError, UnknownNameError, VideoError
from iris_sysid.types import TrackOptions
from tests._drawn import DrawnClip, disc, moving_disc, noisy, paint, swing
from trackers._detection.detect_frames import detection_setup, observe
from trackers._frames.working_image import view_of
from trackers.median_background import track

SHAPE = (96, 160)
CENTRE = (80.0, 48.0)
PLAIN = np.full(SHAPE, 120.0)


def one_track(clip, **options):
    return track(clip, TrackOptions(**options))[0]


def errors_px(track, path):
    return (track.xy_px - path)[track.valid]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


# --------------------------------------------------------------------------- sub-pixel


def cramer_rao_px(radius, contrast, noise, x=30.2, y=30.3):
    """Least standard error of x that pixels with white noise allow for a disc."""
    shape = (int(2 * radius) + 60,) * 2
    step = 1e-3
    slope = (disc(shape, x + step, y, radius, 64) - disc(shape, x - step, y, radius, 64)) / (2 * step)
    return noise / (contrast * np.sqrt(np.sum(slope**2)))


@pytest.fixture(scope="module", params=[4, 12, 40])
def measured_disc(request):
    radius = request.param
    shape, amplitude = ((64, 96), (30, 14)) if radius == 4 else ((3 * radius + 60, 5 * radius + 100), (50, 20))
    path = swing(200 if radius == 40 else 300, (shape[1] / 2, shape[0] / 2), amplitude, period=73.7)
    return radius, path, one_track(moving_disc(path, radius, shape, contrast=100.0, noise=3.0))


def test_centre_of_drawn_disc_is_within_one_and_a_half_times_the_cramer_rao_bound(measured_disc):
    radius, path, track = measured_disc
    assert track.n_valid == len(path)
    assert rms(errors_px(track, path)) <= 1.5 * cramer_rao_px(radius, 100.0, 3.0)


def test_centre_of_drawn_disc_has_no_bias_over_the_sub_pixel_phase(measured_disc):
    _, path, track = measured_disc
    phase = (8 * (path % 1)).astype(int)
    bias = [errors_px(track, path)[phase == k].mean() for k in range(8)]
    assert np.abs(bias).max() < 0.005


def test_standard_error_of_drawn_disc_is_true(measured_disc):
    _, path, track = measured_disc
    assert 0.88 < np.std(errors_px(track, path) / track.sigma_px) < 1.12
    radius_pull = (track.radius_px - measured_disc[0]) / track.sigma_radius_px
    assert 0.8 < rms(radius_pull) < 1.2


def test_radius_of_drawn_disc_is_unbiased(measured_disc):
    radius, _, track = measured_disc
    assert abs(np.mean(track.radius_px) - radius) < 0.005


def test_blurred_and_flickering_disc_stays_unbiased():
    path = swing(80, CENTRE, (50, 20))
    images = [
        cv2.GaussianBlur(paint(PLAIN, disc(SHAPE, *at, 9), 30.0), (0, 0), 0.8) + 4 * np.sin(k)
        for k, at in enumerate(path)
    ]
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert np.abs(errors_px(track, path).mean(axis=0)).max() < 0.01
    assert rms(errors_px(track, path)) < 0.02


def test_body_brighter_above_and_darker_below_is_found_at_its_middle():
    path = swing(80, CENTRE, (50, 20))
    rows = np.arange(SHAPE[0])[:, np.newaxis]
    images = [
        paint(PLAIN, disc(SHAPE, x, y, 8), 0) + disc(SHAPE, x, y, 8) * np.where(rows > y, 50.0, 190.0) for x, y in path
    ]
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert rms(errors_px(track, path)) < 0.1


def test_textured_body_is_found_at_its_middle():
    path = swing(80, CENTRE, (50, 20))
    columns = np.arange(SHAPE[1])
    images = [paint(PLAIN, disc(SHAPE, x, y, 12), 60.0) for x, y in path]
    for image, (x, y) in zip(images, path, strict=True):
        image += disc(SHAPE, x, y, 12) * 30 * np.sin(0.6 * (columns - x))
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert rms(errors_px(track, path)) < 0.1


def test_wide_image_is_searched_small_and_measured_at_full_size():
    shape = (240, 2000)
    path = swing(30, (1000, 120), (800, 60), period=29.3)
    track = one_track(moving_disc(path, 20, shape))
    assert track.n_valid == 30
    assert rms(errors_px(track, path)) < 2 * cramer_rao_px(20, 100.0, 3.0)


# --------------------------------------------------------------------------- what is not the body


def cord(start, end, width):
    """Share of each pixel that a straight cord covers, about."""
    rows, columns = np.indices(SHAPE)
    along = np.subtract(end, start)
    place = ((columns - start[0]) * along[0] + (rows - start[1]) * along[1]) / (along @ along)
    off = np.abs((columns - start[0]) * along[1] - (rows - start[1]) * along[0]) / np.hypot(*along)
    return np.clip(width / 2 + 0.5 - off, 0, 1) * ((place >= 0) & (place <= 1))


def test_cord_is_cut_off_and_does_not_drag_the_centre():
    path = swing(60, (80, 70), (45, 8))
    images = [paint(paint(PLAIN, cord((80, 0), at, 3), 40.0), disc(SHAPE, *at, 11), 60.0) for at in path]
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert track.n_valid == 60
    assert not track.hand.any()
    assert rms(errors_px(track, path)) < 0.2  # a stub of the cord touches the ball


def test_shadow_that_is_larger_is_not_tracked():
    path = swing(60, (70, 40), (45, 12))
    images = []
    for x, y in path:
        shadow = cv2.GaussianBlur(disc(SHAPE, x + 14, y + 8, 7), (0, 0), 2.0)
        images.append(paint(PLAIN * (1 - 0.3 * shadow), disc(SHAPE, x, y, 4), 40.0))
    track = one_track(DrawnClip(noisy(images, 1.5)))
    assert track.n_valid == 60
    assert rms(errors_px(track, path)) < 0.1


def hand_clip(n_held=15, n=60):
    """A ball held at the left edge by a hand that then withdraws; the ball flies off to the right."""
    x = np.where(np.arange(n) < n_held, 40.0, 40.0 + 2.2 * (np.arange(n) - n_held))
    images = []
    for k in range(n):
        reach = 36 if k < n_held else max(0, 36 - 6 * (k - n_held))
        arm = np.zeros(SHAPE)
        arm[38:60, :reach] = 1
        images.append(paint(paint(PLAIN, arm, 70.0), disc(SHAPE, x[k], 48, 9), 200.0))
    return DrawnClip(noisy(images, 2.0)), np.column_stack([x, np.full(n, 48.0)])


def test_hand_that_holds_the_body_is_reported_until_it_lets_go():
    clip, path = hand_clip()
    track = one_track(clip)
    assert track.hand[:15].all()
    assert not track.hand[22:].any()
    assert track.valid[20:].all()
    assert rms((track.xy_px - path)[25:]) < 0.05


def test_mark_that_a_hand_hides_for_a_while_is_not_taken_for_a_body():
    path, images = swing(60, (50, 48), (25, 12)), []
    for k, (x, y) in enumerate(path):
        image = np.full(SHAPE, 120.0)
        image[10:22, 130:142] = 15.0  # a mark on the wall
        image[4:60, 160 - max(0, 40 - 4 * max(0, k - 12)) :] = 70.0  # a hand that withdraws
        images.append(paint(image, disc(SHAPE, x, y, 8), 200.0))
    clip = DrawnClip(noisy(images, 2.0))
    all_detections = observe(clip, detection_setup(clip, view_of(clip, TrackOptions())), TrackOptions())
    assert all(len(detection.detections) == 1 for detection in all_detections[24:])


def test_body_that_rests_for_most_of_the_clip_is_found_moving_and_at_rest():
    n, moving = 100, 30
    x = np.concatenate([np.linspace(20, 110, moving), np.full(n - moving, 110.0)])
    path = np.column_stack([x, np.full(n, 48.0)])
    track = one_track(moving_disc(path, 8, SHAPE))
    assert track.n_valid == n
    assert rms(errors_px(track, path)) < 0.05


def test_clip_of_a_body_that_comes_to_rest_on_its_shadow_is_read_once():
    y = np.append(12 + 58 * np.linspace(0, 1, 30) ** 2, np.full(70, 70.0))
    path, images = np.column_stack([np.full(y.size, 64.0), y]), []
    for place in path:
        shadow = cv2.GaussianBlur(disc(SHAPE, 64, 78, 9), (0, 0), 3.0) * np.exp(-(70 - place[1]) / 6)
        images.append(paint(120 * (1 - 0.12 * shadow), disc(SHAPE, *place, 9), 200.0))
    clip = DrawnClip(noisy(images, 2.0))
    track = one_track(clip)
    assert clip.decoded == track.n_valid == y.size
    assert rms(errors_px(track, path)) < 0.1


ORANGE, WALL = (40.0, 110.0, 215.0), (150.0, 165.0, 170.0)  # blue, green, red


def test_large_body_that_covers_the_middle_of_its_path_in_every_frame_is_found_where_it_is():
    """Most samples show it there: before a background that held it, it was tracked by what is left of it beside."""
    y = 60 + 24 * np.sin(np.linspace(0, 13, 60) ** 1.05)
    path = np.column_stack([64 + 5 * np.cos(np.linspace(0, 9, 60)), y])
    wall = np.full((120, 128), 180.0)
    wall[116:] = 110.0
    clip = DrawnClip(noisy([paint(wall, disc(wall.shape, *place, 30), 90.0) for place in path], 2.0))
    track = one_track(clip)
    assert track.n_valid == y.size
    assert np.abs(track.xy_px - path).max() < 0.1
    assert np.abs(track.radius_px - 30).max() < 0.1


@pytest.mark.parametrize(("moving", "rest"), [(36, 30), (36, 34), (40, 30)])
def test_body_that_rests_for_almost_half_of_the_clip_is_found(moving, rest):
    y = np.append(12 + 76 * np.linspace(0, 1, moving) ** 2, np.full(rest, 88.0))
    path = np.column_stack([np.full(y.size, 64.0), y])
    wall = np.full((112, 128), 80.0)
    wall[97:] = 110.0  # the floor on which it comes to rest
    clip = DrawnClip(noisy([paint(wall, disc(wall.shape, *place, 9), 180.0) for place in path], 3.0))
    track = one_track(clip)
    assert track.n_valid == y.size
    assert np.abs(track.xy_px - path).max() < 0.06


def test_large_body_that_hardly_leaves_its_position_leaves_no_rim_of_itself_in_the_background():
    shape = (180, 300)
    path = swing(75, (150.0, 90.0), (50, 20), period=73.7)
    (tracked,) = track(moving_disc(path, 40, shape, contrast=100, noise=3), TrackOptions())
    assert np.sqrt(np.mean((tracked.xy_px - path) ** 2)) < 0.006


def test_body_that_rests_before_a_floor_as_bright_as_itself_does_not_become_background():
    n, moving = 100, 30
    floor = np.full((*SHAPE, 3), 133.0)  # as bright as orange
    floor[:, :50] = WALL
    x = np.concatenate([np.linspace(20, 110, moving), np.full(n - moving, 110.0)])
    images = [paint(floor, disc(SHAPE, x_px, 48, 8), ORANGE) for x_px in x]
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert track.n_valid == n
    assert rms(errors_px(track, np.column_stack([x, np.full(n, 48.0)]))) < 0.1


@pytest.mark.parametrize(("gap", "least"), [(6, 0.6), (14, 0.1)])
def test_shadow_that_hangs_on_a_coloured_body_does_not_drag_its_centre(gap, least):
    path = swing(60, (70, 40), (40, 12))
    images = []
    for x, y in path:
        shadow = cv2.GaussianBlur(disc(SHAPE, x + gap, y + gap, 11), (0, 0), 3.0)[..., np.newaxis]
        images.append(paint(np.array(WALL) * (1 - 0.18 * shadow), disc(SHAPE, x, y, 10), ORANGE))
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert track.n_valid == 60
    assert rms(errors_px(track, path)) < least


def test_shadow_that_hangs_on_a_body_as_clear_in_luma_as_in_colour_does_not_drag_its_centre():
    path = swing(60, (70, 40), (40, 12))
    images = []
    for x, y in path:
        shadow = cv2.GaussianBlur(disc(SHAPE, x + 11, y + 15, 10), (0, 0), 3.0)[..., np.newaxis]
        images.append(paint(np.array((190, 202, 204)) * (1 - 0.15 * shadow), disc(SHAPE, x, y, 10), (38, 112, 222)))
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert track.n_valid == 60
    assert rms(errors_px(track, path)) < 0.2  # 3 px in luma alone


def test_streak_of_a_fast_shaded_ball_has_its_middle_and_its_area():
    radius, shape, travel = 24, (320, 160), 8
    y = np.linspace(80, 240, 41)
    rows, columns = np.indices(shape)
    images = []
    for middle in y:
        parts = []
        for at in middle + travel * (np.arange(15) - 7) / 15:
            limb = 1 - 0.12 * np.clip(((columns - 80) ** 2 + (rows - at) ** 2) / radius**2, 0, 1)
            share = disc(shape, 80.0, at, radius, 8)[..., np.newaxis]
            shade = (limb + 0.08 * (at - rows) / radius)[..., np.newaxis]
            parts.append(np.array(WALL) * (1 - share) + np.array(ORANGE) * shade * share)
        images.append(np.mean(parts, axis=0))
    track = one_track(DrawnClip(noisy(images, 2.0)))
    seen = slice(4, -4)
    assert track.valid[seen].all()
    assert rms((track.xy_px - np.column_stack([np.full(41, 80.0), y]))[seen]) < 0.1
    assert np.median(track.radius_px) == pytest.approx(radius, rel=0.01)


# --------------------------------------------------------------------------- gaps


def test_body_that_leaves_the_image_leaves_a_gap_and_is_found_again():
    path = swing(120, (80, 48), (110, 10), period=60)
    track = one_track(moving_disc(path, 7, SHAPE))
    inside = (path[:, 0] > 9) & (path[:, 0] < SHAPE[1] - 10)
    out = (path[:, 0] < -0.5) | (path[:, 0] > SHAPE[1] - 0.5)
    assert track.valid[inside].all()
    assert not track.valid[out].any()
    assert np.isnan(track.xy_px[out]).all()
    assert np.isnan(track.sigma_px[out]).all()
    assert rms((track.xy_px - path)[inside]) < 0.05


def test_a_body_that_the_edge_cuts_in_the_end_has_a_position_with_its_error():
    path = np.column_stack([np.linspace(30, SHAPE[1] + 20, 60), 48 + 10 * np.sin(np.arange(60) / 10)])
    track = one_track(moving_disc(path, 8, SHAPE))
    cut = (path[:, 0] > SHAPE[1] - 8) & (path[:, 0] < SHAPE[1] - 2)
    assert track.valid[cut].all()
    assert not track.valid[path[:, 0] > SHAPE[1] + 2].any()
    pulls = (track.xy_px - path)[cut] / track.sigma_px[cut]
    assert 0.05 < rms(pulls) < 1.25, "a side known to a pixel tells more than that here"


def test_body_that_is_hidden_for_a_moment_is_a_gap():
    path = swing(60, CENTRE, (50, 20))
    clip = moving_disc(path, 7, SHAPE)
    empty = noisy([np.full(SHAPE, 80.0)] * 4, 3.0, seed=1)
    clip.images[20:24] = empty
    track = one_track(clip)
    assert list(np.flatnonzero(~track.valid)) == [20, 21, 22, 23]


# --------------------------------------------------------------------------- several bodies, options


def two_bodies(n=90):
    """A light and a dark disc that swing through each other's positions."""
    paths = swing(n, (80, 30), (55, 5), 60), swing(n, (80, 66), (-55, 5), 47)
    images = [
        paint(paint(PLAIN, disc(SHAPE, *a, 9), 220.0), disc(SHAPE, *b, 9), 40.0) for a, b in zip(*paths, strict=True)
    ]
    return DrawnClip(noisy(images, 2.0)), paths


def test_two_bodies_keep_their_identity():
    clip, paths = two_bodies()
    tracks = track(clip, TrackOptions(bodies=2))
    assert [track.body for track in tracks] == ["1", "2"]
    for path in paths:
        assert min(rms(errors_px(track, path)) for track in tracks) < 0.05


def test_region_limits_the_search():
    clip, paths = two_bodies()
    track = one_track(clip, roi=(0, 48, 160, 48))
    assert rms(errors_px(track, paths[1])) < 0.05


def coloured_clip(n=50):
    """A red and a blue disc, equally bright in luma as the grey wall, that move alike."""
    grey = np.full((*SHAPE, 3), 100.0)
    red, blue = (30.0, 60.0, 205.0), (255.0, 108.0, 25.0)  # blue, green, red
    paths = swing(n, (80, 26), (50, 6)), swing(n, (80, 70), (-50, 6))
    images = [
        paint(paint(grey, disc(SHAPE, *a, 9), red), disc(SHAPE, *b, 9), blue) for a, b in zip(*paths, strict=True)
    ]
    return DrawnClip(noisy(images, 2.0)), paths


@pytest.mark.parametrize(("colour", "body"), [("red", 0), ("blue", 1), ("#1a6cff", 1)])
def test_colour_chooses_the_body(colour, body):
    clip, paths = coloured_clip()
    track = one_track(clip, colour=colour)
    assert track.n_valid == 50
    assert rms(errors_px(track, paths[body])) < 0.1


def test_body_as_bright_as_the_wall_is_found_by_its_colour_unasked():
    clip, paths = coloured_clip()
    tracks = track(clip, TrackOptions(bodies=2))
    assert tracks[0].origin["colour_used"]
    for path in paths:
        assert min(rms(errors_px(track, path)) for track in tracks) < 0.1


def test_progress_is_reported_and_the_clip_is_decoded_once():
    calls = []
    clip = moving_disc(swing(45, CENTRE, (50, 20)), 7, SHAPE)
    track(clip, TrackOptions(progress=lambda done, expected: calls.append((done, expected))))
    assert calls == [(10, 45), (20, 45), (30, 45), (40, 45), (45, 45)]
    assert clip.decoded == 45


def test_same_clip_gives_the_same_track():
    first, second = (one_track(moving_disc(swing(40, CENTRE, (50, 20)), 7, SHAPE)) for _ in range(2))
    np.testing.assert_array_equal(first.xy_px, second.xy_px)


# --------------------------------------------------------------------------- bad input


def still_clip(n=30):
    return DrawnClip(noisy([PLAIN] * n, 3.0))


def faint_clip():
    return moving_disc(swing(40, CENTRE, (50, 20)), 3, SHAPE, contrast=6.0, noise=3.0)


def swinging():
    return moving_disc(swing(40, CENTRE, (50, 20)), 7, SHAPE)


BAD = [
    (still_clip, {}, TrackingError, "nothing moves"),
    (faint_clip, {}, TrackingError, "nothing moves .* beyond the noise"),
    (lambda: still_clip(2), {}, VideoError, "2 frame.* at least 3"),
    (swinging, {"bodies": 2}, TrackingError, "2 bodies were requested, but only 1"),
    (swinging, {"bodies": 0}, DataError, "bodies = 0"),
    (swinging, {"roi": (0, 0, 500, 50)}, DataError, r"width=500.*160 px wide and 96 px high"),
    (swinging, {"roi": (10, 10, 0, 5)}, DataError, "width=0"),
    (swinging, {"roi": (-4, 0, 20, 20)}, DataError, "x=-4"),
    (swinging, {"roi": (0, 0, 20, 20)}, TrackingError, "nothing moves.*--roi"),
    (swinging, {"colour": "reddish"}, UnknownNameError, "'reddish'.*#rrggbb.*red"),
    (swinging, {"colour": "green"}, TrackingError, "--colour"),
]


@pytest.mark.parametrize(("clip", "options", "error", "text"), BAD)
def test_bad_input_is_refused_with_what_to_do(clip, options, error, text):
    with pytest.raises(error, match=re.compile(text, re.DOTALL)):
        track(clip(), TrackOptions(**options))
