"""A disc that moves far in an exposure: its centre from the shape of the streak, against an image drawn otherwise."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trackers._detection.motion_blur import streak_centre
from trackers._detection.subpixel_centroid import Window, coverage_centre

SIZE, RADIUS, NOISE = 100, 22.0, 1.0


def drawn(way, where=(50.3, 48.8), shape="disc", seed=0):
    """A window with a shaded body that moves by ``way`` px while the image is taken, its mean over 60 instants."""
    rng = np.random.default_rng(seed)
    y, x = (np.indices((4 * SIZE, 4 * SIZE)) + 0.5) / 4 - 0.5
    wall = 90.0 + 0.1 * x
    shown = np.zeros_like(wall)
    for part in (np.arange(60) + 0.5) / 60 - 0.5:
        u, v = (x - where[0] - part * way[0]) / RADIUS, (y - where[1] - part * way[1]) / RADIUS
        inside = (u * u + v * v < 1) if shape == "disc" else (np.abs(u) < 0.8) & (np.abs(v) < 0.8) & (u + v < 0.9)
        body = 190.0 * (1.0 + 0.12 * u - 0.18 * v - 0.2 * (u * u + v * v))
        shown += np.where(inside, body, wall) / 60
    image = cv2.resize(shown, (SIZE, SIZE), interpolation=cv2.INTER_AREA) + NOISE * rng.standard_normal((SIZE, SIZE))
    background = cv2.resize(wall, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    core = (np.abs(image - background) > 40).astype(np.uint8)
    planes = [plane.astype(np.float32)[np.newaxis] for plane in (image, background, np.full_like(image, NOISE))]
    return Window(*planes, core, np.zeros_like(core))


@pytest.mark.parametrize("way", [(20.0, 0.0), (15.0, -18.0), (4.0, 30.0)])
def test_centre_of_a_streak_is_found_to_a_twentieth_of_a_pixel_where_the_outline_misleads(way):
    window = drawn(way)
    outline = coverage_centre(window)
    centre = streak_centre(window, outline)
    error = np.hypot(centre.x - 50.3, centre.y - 48.8)
    assert error < 0.05
    assert np.hypot(outline.x - 50.3, outline.y - 48.8) > 20 * error
    assert np.sqrt(centre.area / np.pi) == pytest.approx(RADIUS, abs=0.1)


def test_standard_error_of_a_streak_is_that_of_its_scatter():
    centres = [
        streak_centre(window, coverage_centre(window)) for window in (drawn((18.0, 6.0), seed=k) for k in range(12))
    ]
    pulls = [
        ((detection.x - 50.3) / detection.sigma_x, (detection.y - 48.8) / detection.sigma_y) for detection in centres
    ]
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.6


@pytest.mark.parametrize(("way", "shape"), [((3.0, 1.0), "disc"), ((0.0, 0.0), "square")])
def test_sharp_body_and_body_that_is_no_disc_keep_the_centre_of_their_outline(way, shape):
    window = drawn(way, shape=shape)
    outline = coverage_centre(window)
    assert streak_centre(window, outline) is outline


def test_cord_on_a_streak_does_not_move_it():
    window = drawn((20.0, 0.0))
    image = window.image.copy()
    image[:, :30, 48:53] -= 25.0
    with_cord = Window(image, window.background, window.noise, window.mask, window.other)
    centre = streak_centre(with_cord, coverage_centre(with_cord))
    assert np.hypot(centre.x - 50.3, centre.y - 48.8) < 0.1


def test_soft_glow_wider_than_its_core_is_no_swept_disc():
    rng = np.random.default_rng(0)
    y, x = np.indices((SIZE, SIZE)).astype(np.float64)
    wall = 90.0 + 0.1 * x
    glow = 80.0 * np.exp(-(((x - 50) / 80) ** 2) - ((y - 50) / 45) ** 2)
    core = (glow > 60).astype(np.uint8)
    image = wall + glow + NOISE * rng.standard_normal(glow.shape)
    planes = [plane.astype(np.float32)[np.newaxis] for plane in (image, wall, np.full_like(wall, NOISE))]
    window = Window(*planes, core, np.zeros_like(core))
    outline = coverage_centre(window)
    assert streak_centre(window, outline) is outline
