"""SampledFrames that show what is behind a body that rests for most of a clip."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trackers._background.median import estimate_background, with_unseen
from trackers._detection.background_samples import usable_samples

SHAPE = (80, 60)
WALL, STRIP, BALL = (190.0, 125.0, 130.0), (110.0, 110.0, 130.0), (120.0, 90.0, 180.0)  # luma and two of colour
REST = (30, 58)  # where the ball comes to rest: it covers the edge between wall and strip


def image(centre, rng):
    """A wall above a strip, with a ball of 8 px and its shadow before them, and noise of one grey level."""
    image = np.full((*SHAPE, 3), WALL, dtype=np.float32)
    image[60:] = STRIP
    if centre is not None:
        shadow = np.zeros(SHAPE, dtype=np.float32)
        cv2.circle(shadow, (centre[0] + 8, centre[1] + 12), 8, 1.0, -1)
        image[..., 0] *= 1 - 0.12 * cv2.GaussianBlur(shadow, (0, 0), 3)
        cv2.circle(image, centre, 8, BALL, -1, cv2.LINE_AA)
    return np.clip(np.rint(image + rng.normal(0, 1, image.shape)), 0, 255).astype(np.uint8)


def samples(places, seed=3):
    rng = np.random.default_rng(seed)
    return np.stack([image(place, rng) for place in places])


def test_samples_before_a_ball_comes_to_rest_show_what_is_behind_it():
    stack = samples([(30, 5 + 2 * k) for k in range(12)] + [REST] * 20)
    usable = usable_samples(stack, estimate_background(stack)).samples
    assert usable is not None
    assert usable[:12, REST[1], REST[0]].all()
    assert not usable[12:, REST[1], REST[0]].any()
    assert usable[:, 10, 10].all()


def test_ball_that_passes_beside_its_resting_position_is_no_background_there():
    passing = [(30, 44), (30, 42), (31, 43)]
    stack = samples([(30, 5 + 2 * k) for k in range(12)] + passing + [REST] * 20)
    usable = usable_samples(stack, estimate_background(stack)).samples
    assert usable is not None
    above = usable[:, 43, 30]
    assert above[15:].all(), "the samples in which the ball has come to rest show the wall above it"


def test_ball_that_touches_its_resting_position_in_every_bounce_leaves_a_hole_there():
    """Darker than the wall and brighter than the strip, ball and hole are one part where channels are mixed."""
    stack = samples([(30, 5 + 3 * k) for k in range(5)] + [(30, 42)] * 7 + [REST] * 20)
    usable = usable_samples(stack, estimate_background(stack)).samples
    assert usable is not None
    background = estimate_background(stack, usable).background
    for (x, y), behind in (((30, 40), WALL), ((26, 38), WALL), ((30, 56), WALL), ((30, 63), STRIP)):
        assert np.abs(background[y, x] - behind).max() < 10, (x, y)  # the shadow passes there


def test_ball_that_never_rests_leaves_every_sample_usable():
    stack = samples([(30, 5 + 2 * k) for k in range(30)])
    assert usable_samples(stack, estimate_background(stack)) == (None, None, None)


def large_ball(centre, rng):
    """A ball of 18 px before a wall that is brighter to the left, and noise; the wall alone without a centre."""
    image = np.tile(np.linspace(200, 170, 60, dtype=np.float32), (80, 1))
    image[70:] -= 60
    if centre is None:
        return image
    cv2.circle(image, centre, 18, 110.0, -1, cv2.LINE_AA)
    return np.clip(np.rint(image + rng.normal(0, 1, image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    ("places", "hidden"),
    [
        ([(30, 18 + k) for k in range(44)], False),
        ([(round(30 + 9 * np.cos(0.3 * k)), round(38 + 9 * np.sin(0.3 * k))) for k in range(44)], True),
    ],
    ids=["falling", "on a circle"],
)
def test_background_behind_a_large_ball_that_covers_it_in_most_samples_shows_no_ball(places, hidden):
    rng = np.random.default_rng(5)
    stack = np.stack([large_ball(place, rng) for place in places])
    estimate = estimate_background(stack)
    assert estimate.background[38, 30] < 140, "it is the ball that most samples show"
    usable, unseen, _ = usable_samples(stack, estimate)
    background = with_unseen(estimate_background(stack, usable), unseen).background
    assert np.abs(background - large_ball(None, None)).max() < 8
    assert (unseen is not None) == hidden


def test_background_behind_a_large_ball_whose_rim_hardly_differs_on_one_side_is_the_wall_about_it():
    rng = np.random.default_rng(7)
    wall = np.tile(np.linspace(190, 100, 120, dtype=np.float32), (100, 1))
    stack = []
    for k in range(40):
        image = wall.copy()
        cv2.circle(image, (round(60 + 22 * np.sin(0.45 * k)), 50), 30, 96.0, -1, cv2.LINE_AA)
        stack.append(np.clip(np.rint(image + rng.normal(0, 2, image.shape)), 0, 255).astype(np.uint8))
    usable, unseen, _ = usable_samples(np.stack(stack), estimate_background(np.stack(stack)))
    off = with_unseen(estimate_background(np.stack(stack), usable), unseen).background - wall
    assert np.abs(off[:, :30]).max() < 5
    assert np.abs(off[:, 95:]).max() < 5, "nothing is added where the ball never is"
    assert np.abs(off).max() < 40


def test_still_object_behind_a_ball_that_passes_stays_in_the_background():
    rng = np.random.default_rng(6)
    stack = np.stack([large_ball((30, 20 + k), rng) for k in range(40)])
    stack[:, 5:12, 4:10] = 60
    usable, unseen, _ = usable_samples(stack, estimate_background(stack))
    background = with_unseen(estimate_background(stack, usable), unseen).background
    assert np.abs(background[5:12, 4:10] - 60).max() < 2
