"""The disc tracker on drawn clips, whose truth is exact: at the Cramér-Rao bound, through blur, and what it refuses."""

import cv2
import numpy as np
import pytest

from iris_sysid.errors import TrackingError, VideoError
from iris_sysid.types import TrackOptions
from tests._drawn import DrawnClip, disc, moving_disc, noisy, paint, swing
from trackers._disc.fit import fit_disc, image_cutout
from trackers._disc.learn_appearance import DiscFitter
from trackers._disc.model import Disc, Form, Motion
from trackers.disc import track

SHAPE = (96, 160)
CENTRE = (80.0, 48.0)
PLAIN = np.full(SHAPE, 120.0)


def one_track(clip, **options):
    return track(clip, TrackOptions(**options))[0]


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


# --------------------------------------------------------------------------- sub-pixel


def cramer_rao_px(radius, contrast=100.0, noise=3.0):
    """Least standard error of x that pixels with white noise allow for a disc."""
    shape, at, step = (int(2 * radius) + 60,) * 2, radius + 30.3, 1e-3
    slope = (disc(shape, at + step, at, radius, 64) - disc(shape, at - step, at, radius, 64)) / (2 * step)
    return noise / (contrast * np.sqrt(np.sum(slope**2)))


@pytest.fixture(scope="module", params=[4, 12])
def measured(request):
    path = swing(150, CENTRE, (55, 25), period=73.7)
    return request.param, path, one_track(moving_disc(path, request.param, SHAPE, contrast=100.0, noise=3.0))


def test_centre_of_drawn_disc_is_within_a_quarter_of_the_cramer_rao_bound(measured):
    radius, path, track = measured
    assert track.n_valid == len(path)
    assert rms(track.xy_px - path) <= 1.25 * cramer_rao_px(radius)


def test_centre_of_drawn_disc_is_not_locked_to_the_pixels(measured):
    _, path, track = measured
    first_harmonic = 2 * np.mean((track.xy_px - path) * np.exp(2j * np.pi * path))
    assert abs(first_harmonic) < 0.005


def test_radius_of_drawn_disc_has_neither_bias_nor_scatter_beyond_a_fiftieth_of_a_pixel(measured):
    radius, _, track = measured
    assert abs(np.mean(track.radius_px) - radius) < 0.02
    assert np.std(track.radius_px) < 0.02


def test_standard_errors_of_drawn_disc_are_true(measured):
    radius, path, track = measured
    assert 0.88 < np.std((track.xy_px - path) / track.sigma_px) < 1.12
    assert 0.85 < np.std((track.radius_px - radius) / track.sigma_radius_px) < 1.15


# --------------------------------------------------------------------------- blur


def streaked_clip(exposure, n=40, radius=10.0, circle=30.0, step=12.0, noise=2.0):
    """A disc on a circle, exposed for that share of the time between frames, by 48 exact discs a frame."""
    turn = step / circle
    within = exposure * ((np.arange(48) + 0.5) / 48 - 0.5)

    def place(k):
        return CENTRE[0] + circle * np.cos(turn * k), CENTRE[1] + circle * np.sin(turn * k)

    def streak(k):
        return np.mean([disc(SHAPE, *place(k + delay), radius, 8) for delay in within], axis=0)

    images = noisy([paint(PLAIN, streak(k), 200.0) for k in range(n)], noise)
    return DrawnClip(images), np.array([place(k) for k in range(n)])


def test_streak_is_placed_at_the_middle_of_the_exposure_and_the_exposure_is_found():
    clip, path = streaked_clip(0.8)
    track = one_track(clip)
    assert track.origin["shutter"] == pytest.approx(0.8, abs=0.05)
    inwards = (np.array(CENTRE) - path) / 30.0
    mean_over_exposure_px = 12.0**2 / 30.0 * 0.8**2 / 24  # how far the mean of the streak lies inwards: v^2/R T^2/24
    assert mean_over_exposure_px > 0.12
    assert abs(np.mean(np.sum((track.xy_px - path) * inwards, axis=1))) < 0.015
    assert rms(track.xy_px - path) < 0.05
    assert np.median(track.radius_px) == pytest.approx(10.0, abs=0.05)


def test_short_exposure_leaves_no_streak():
    clip, path = streaked_clip(0.02, n=30)
    track = one_track(clip)
    assert track.origin["shutter"] < 0.15
    assert rms(track.xy_px - path) < 0.03


# --------------------------------------------------------------------------- apparent radius


def test_ball_that_goes_straight_away_is_measured_by_its_radius():
    radius = 22.0 / (1 + 0.04 * np.arange(40))
    images = [paint(PLAIN, disc(SHAPE, 80.3, 47.6, r, 16), 220.0) for r in radius]
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert track.n_valid >= 36
    assert rms(track.radius_px - radius) < 0.05
    assert rms(track.xy_px - [80.3, 47.6]) < 0.05


def test_hand_that_moves_beside_a_ball_that_goes_away_is_not_studied(monkeypatch):
    radius = 16.0 / (1 + 0.04 * np.arange(60))
    images = [paint(PLAIN, disc(SHAPE, 50.3, 47.6, r, 16), 220.0) for r in radius]
    for k, image in enumerate(images[:25]):  # as large as a hand that reaches in, but for its wrist
        image[20:78, 86 + k : 140 + k] = 60.0
    fit_as, radii = DiscFitter.fit_as, []

    def noted(fitter, appearance, body, frame, start=None, **how):
        radii.append((start or fitter.expected_paths[body].discs[frame.index]).radius)
        return fit_as(fitter, appearance, body, frame, start, **how)

    monkeypatch.setattr(DiscFitter, "fit_as", noted)
    track = one_track(DrawnClip(noisy(images, 2.0)))
    assert rms(track.radius_px - radius) < 0.05
    assert max(radii) < 20


FLOOR, BLUE = np.array([112.0, 136.0, 158.0]), (190.0, 120.0, 60.0)  # blue, green, red


def shrinking_on_its_shadow(colour, n=40):
    """A ball that goes away from the camera over its own soft shadow, and its radius (n,), px."""
    radius = 24.0 / (1 + 0.03 * np.arange(n))
    images = []
    for r in radius:
        shadow = cv2.GaussianBlur(disc(SHAPE, 80.3, 47.6, 1.25 * r, 16), (0, 0), 0.2 * r)[..., np.newaxis]
        images.append(paint(FLOOR * (1 - 0.12 * shadow), disc(SHAPE, 80.3, 47.6, r, 16), colour))
    return DrawnClip(noisy(images, 2.0)), radius


def test_ball_about_as_bright_as_the_floor_is_measured_by_its_colour_unasked():
    clip, radius = shrinking_on_its_shadow(BLUE)
    track = one_track(clip)
    assert track.origin["plane"] != "luma"
    assert track.n_valid >= 36
    assert rms((track.radius_px - radius)[track.valid]) < 0.1


def test_soft_shadow_round_a_ball_does_not_enlarge_it():
    clip, radius = shrinking_on_its_shadow(230.0)
    track = one_track(clip)
    assert track.origin["plane"] == "luma"
    assert abs((track.radius_px - radius)[track.valid].mean()) < 0.02


# --------------------------------------------------------------------------- gaps, two discs, bad input


def test_disc_that_leaves_the_image_leaves_a_gap():
    path = swing(60, (80, 48), (110, 10), period=60)
    track = one_track(moving_disc(path, 7, SHAPE))
    gone = (path[:, 0] < -8) | (path[:, 0] > SHAPE[1] + 7)
    inside = (path[:, 0] > 9) & (path[:, 0] < SHAPE[1] - 10)
    assert gone.any()
    assert not track.valid[gone].any()
    assert track.valid[inside].mean() > 0.95
    assert rms((track.xy_px - path)[inside]) < 0.05


def test_two_discs_are_fitted_side_by_side():
    paths = swing(50, (80, 26), (55, 5), 47.3), swing(50, (80, 70), (-55, 5), 53.1)
    images = [
        paint(paint(PLAIN, disc(SHAPE, *a, 9), 220.0), disc(SHAPE, *b, 6), 30.0) for a, b in zip(*paths, strict=True)
    ]
    tracks = track(DrawnClip(noisy(images, 2.0)), TrackOptions(bodies=2))
    for path, radius in zip(paths, (9.0, 6.0), strict=True):
        nearest = min(tracks, key=lambda track: rms(track.xy_px - path))
        assert rms(nearest.xy_px - path) < 0.03
        assert np.median(nearest.radius_px) == pytest.approx(radius, abs=0.03)


@pytest.mark.parametrize("sway_px", [4.0, 7.0])
def test_ball_that_hangs_at_rest_and_then_sways_less_than_its_radius_is_fitted_beside_one_that_swings(sway_px):
    k = np.arange(120)
    swings = np.column_stack([62.0 - 22.0 * np.abs(np.cos(k / 9)) * np.exp(-k / 150), np.full(k.size, 48.3)])
    sways = np.where(k < 30, 0.0, np.abs(np.sin((k - 30) / 9))) * np.exp(-k / 200)
    hangs = np.column_stack([85.4 + sway_px * sways, np.full(k.size, 47.8)])
    images = [
        paint(paint(PLAIN, disc(SHAPE, *a, 9), 210.0), disc(SHAPE, *b, 8), 200.0)
        for a, b in zip(swings, hangs, strict=True)
    ]
    tracks = track(DrawnClip(noisy(images, 2.0)), TrackOptions(bodies=2))
    for path in (swings, hangs):
        nearest = min(tracks, key=lambda track: rms(track.xy_px - path))
        assert nearest.n_valid == k.size
        assert rms(nearest.xy_px - path) < 0.02


def test_tiny_disc_is_found_without_bias():
    path = swing(60, CENTRE, (50, 20), period=57.3)
    track = one_track(moving_disc(path, 2.0, SHAPE))
    assert track.n_valid >= 57
    assert rms(track.xy_px - path) < 0.05
    assert np.nanmedian(track.radius_px) == pytest.approx(2.0, abs=0.05)


def bar_clip(n=30):
    """A bar, nine times as long as it is wide, that moves to and fro."""
    images = []
    for x, _ in swing(n, CENTRE, (40, 0), 29.3):
        image = PLAIN.copy()
        image[14:86, round(x) - 4 : round(x) + 4] = 220.0
        images.append(image)
    return DrawnClip(noisy(images, 2.0))


def test_what_is_large_and_soft_does_not_take_a_pixel_of_the_whole_image_each():
    image = noisy([120.0 + 100.0 * cv2.GaussianBlur(disc((700, 800), 400, 350, 180, 1), None, 80.0)], 3.0)[0]
    start = Disc(400, 350, 185, blur=6400.0)
    fitted = fit_disc(image_cutout(image, start), start, Form(), Motion())
    assert fitted.rows.size < 0.25 * image.size
    np.testing.assert_allclose([fitted.disc.x, fitted.disc.y], (400, 350), atol=5 * fitted.disc.sigma_x)


BAD = [
    (lambda: DrawnClip(noisy([PLAIN] * 25, 3.0)), TrackingError, "nothing"),
    (lambda: moving_disc(swing(2, CENTRE, (50, 20)), 7, SHAPE), VideoError, "2 frame.* at least 3"),
    (bar_clip, TrackingError, "not round.*median-background"),
]


@pytest.mark.parametrize(("clip", "error", "text"), BAD, ids=["empty", "two-frames", "bar"])
def test_clip_without_a_disc_is_refused_with_what_to_do(clip, error, text):
    with pytest.raises(error, match=text):
        track(clip(), TrackOptions())
