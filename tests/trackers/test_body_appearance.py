"""A body is found where its colours, its pattern or its motion are ambiguous, but not all of them."""

import cv2
import numpy as np
import pytest

from tests._drawn import disc, noisy, paint
from trackers._auto.body_appearance import BodyAppearance, _pattern
from trackers._auto.marked_size import size_at

SHAPE, WALL, RED, RADIUS = (120, 160), (90.0, 130.0, 120.0), (110.0, 170.0, 110.0), 7.0
PATH = np.column_stack([np.linspace(20, 140, 13), 60 + 25 * np.sin(np.arange(13) / 2)])


def scene(wall=WALL, *, stripes=False, twin=None):
    """A wall (h, w, 3), perhaps with stripes, and with a disc at ``twin`` that looks like the body but rests."""
    image = np.ones((*SHAPE, 3)) * wall
    if stripes:
        image[..., 0] += 25 * np.sin(np.arange(SHAPE[1]) / 2)
    return image if twin is None else paint(image, disc(SHAPE, *twin, RADIUS), RED)


def filmed(wall, path=PATH, colour=RED, radius=RADIUS):
    """Search images of a disc on a path before a wall."""
    return noisy([paint(wall, disc(SHAPE, x, y, radius), colour) for x, y in path], 2.0)


def off(images, still, shown=6):
    """How far (n,) px the best place is off, with the body known in one image."""
    known = BodyAppearance.learned([images[shown]], [tuple(PATH[shown])], RADIUS, still)
    best = np.array([known.peaks(image).xy[0] for image in images])
    return np.hypot(*(best - PATH).T)


@pytest.mark.parametrize(
    "wall",
    [
        scene(twin=(30, 100)),  # colour and pattern are those of something else, which rests
        scene(RED, stripes=True),  # a body of the colour of the wall
        scene(stripes=True),
    ],
)
def test_body_is_found_by_what_tells_it_from_the_scene(wall):
    colour = (RED[0] + 35, *RED[1:])
    images = filmed(wall, colour=RED if wall[0, 0, 1] == WALL[1] else colour)
    assert off(images, wall).max() < RADIUS / 2


def test_body_that_comes_to_rest_is_found_by_its_colours_and_its_pattern():
    images = filmed(scene())
    still = scene()
    still[40:] = images[9][40:]  # the body is part of the background for most of the clip
    assert off(images, still)[9] < RADIUS / 2


def test_motion_of_another_body_does_not_hide_one_that_is_known():
    wall = scene()
    images = [
        noisy([paint(image.astype(float), disc(SHAPE, 150 - 10 * k, 20, 12), (40.0, 128.0, 128.0))], 0.0)[0]
        for k, image in enumerate(filmed(wall))
    ]
    assert off(images, wall).max() < RADIUS / 2


def test_without_a_patch_in_the_image_colours_and_motion_are_enough():
    wall, at = scene(), (4.0, 60.0)
    (image,) = filmed(wall, [at])
    known = BodyAppearance.learned([image], [at], RADIUS, wall)
    assert not known.patches
    np.testing.assert_allclose(known.peaks(image).xy[0], at, atol=RADIUS / 2)


@pytest.mark.parametrize("radius", [3.0, 7.0, 15.0])
def test_size_of_what_is_marked_is_that_of_what_moves_there_not_of_the_liquid_around_it(radius):
    jar = scene((200.0, 128.0, 128.0))
    jar[30:110, 20:140] = (60.0, 110.0, 170.0)
    images = filmed(jar, colour=(45.0, 112.0, 165.0), radius=radius)
    assert size_at(images[6], tuple(PATH[6]), images) == pytest.approx(radius, rel=0.25)


def test_pattern_in_strips_is_that_of_the_whole_image_where_it_is_wanted():
    luma = np.random.default_rng(0).integers(0, 255, (150, 90), dtype=np.uint8)
    patch = luma[60:71, 30:41].copy()
    wanted = np.zeros(luma.shape, np.bool_)
    wanted[2:140, 3:80:7] = True
    whole = np.zeros(luma.shape)
    whole[5:-5, 5:-5] = np.maximum(cv2.matchTemplate(luma, patch, cv2.TM_CCOEFF_NORMED), 0.0)
    found = _pattern(luma, [patch], wanted)
    np.testing.assert_allclose(found[wanted], whole[wanted], atol=1e-4)
    assert found[65, 35] == pytest.approx(1.0, abs=1e-4)
    assert not found[:, 85:].any()
