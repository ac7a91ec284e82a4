"""The trackers that need no still background, or learn it as the clip goes: light that drifts, a camera that moves."""

import numpy as np
import pytest

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.registry import TRACKERS
from iris_sysid.types import TrackOptions
from tests._drawn import DrawnClip, disc, noisy, paint, swing

SHAPE = (96, 128)
PATH = swing(40, (64, 48), (35, 20), period=37.3)
RED = (40.0, 50.0, 200.0)  # blue, green, red


def error(track, path=PATH):
    return np.sqrt(np.nanmean((track.xy_px - path) ** 2))


@pytest.mark.parametrize("name", ["mog2", "knn"])
def test_light_that_drifts_does_not_hide_a_body_from_a_background_that_learns(name):
    drift = np.linspace(0, 12, len(PATH))
    frames = [
        paint(np.full(SHAPE, 80.0), disc(SHAPE, *place, 9), 180.0) + d for place, d in zip(PATH, drift, strict=True)
    ]
    (track,) = TRACKERS[name].track(DrawnClip(noisy(frames, 2.0)), TrackOptions())
    assert track.n_valid >= 38
    assert error(track) < 0.7


def wandering(path, colour=RED, hidden=()):
    """A disc of one colour before a wall with a pattern that shifts as when the camera moves."""
    y, x = np.indices(SHAPE)
    frames = []
    for k, place in enumerate(path):
        wall = 90 + 25 * np.sin((x + 1.7 * k) / 6) * np.cos((y - 0.9 * k) / 8)
        image = np.repeat(wall[..., np.newaxis], 3, axis=2)
        frames.append(image if k in hidden else paint(image, disc(SHAPE, *place, 9), colour))
    return DrawnClip(noisy(frames, 2.0))


def test_colour_is_followed_before_a_camera_that_moves():
    (track,) = TRACKERS["colour"].track(wandering(PATH, hidden={20, 21}), TrackOptions(colour="red"))
    assert list(np.flatnonzero(~track.valid)) == [20, 21]
    assert error(track) < 0.3


def test_colour_is_followed_at_rest():
    still = np.tile([50.3, 40.6], (10, 1))
    (track,) = TRACKERS["colour"].track(wandering(still), TrackOptions(colour="red"))
    assert track.n_valid == 10
    assert error(track, still) < 0.3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "name it with --colour"),
        ({"colour": "cyan"}, "1 bodies of the colour cyan were requested, but 0 can be seen"),
    ],
)
def test_colour_that_is_not_given_or_not_there_is_refused(options, message):
    with pytest.raises(TrackingError, match=message):
        TRACKERS["colour"].track(wandering(PATH[:5]), TrackOptions(**options))


def pattern(path, noise=2.0, hidden=()):
    """A bright bar across a dark one at each position, drawn to a fraction of a pixel by shifting a smooth function."""
    y, x = np.indices(SHAPE, dtype=float)
    frames = []
    for k, (px, py) in enumerate(path):
        dx, dy = x - px, y - py
        mark = 90 * np.exp(-((dx / 2.5) ** 2)) * np.exp(-((dy / 7) ** 2)) - 60 * np.exp(
            -((dx / 7) ** 2) - (dy / 2.5) ** 2
        )
        frames.append(100 + (0 if k in hidden else 1) * mark * (1 - 0.005 * k) + 0.3 * k)
    return DrawnClip(noisy(frames, noise))


def test_template_is_found_to_a_fraction_of_a_pixel_with_the_standard_error_it_states():
    path = swing(40, (64, 48), (30, 20), period=37.3)
    path[0] = (94, 48)
    (track,) = TRACKERS["template"].track(pattern(path), TrackOptions(roi=(83, 37, 23, 23)))
    assert track.n_valid == 40
    off = (track.xy_px - path)[1:]
    assert np.abs(off.mean(axis=0)).max() < 0.06
    assert off.std() < 0.05
    pull = (off - off.mean(axis=0)) / track.sigma_px[1:]
    assert 0.5 < pull.std() < 1.2  # the patch's own noise is in the residual too: the error is on the safe side


def test_template_that_is_hidden_is_a_gap_and_is_found_again():
    (track,) = TRACKERS["template"].track(pattern(PATH, hidden={9, 10, 11}), TrackOptions(roi=(88, 37, 23, 23)))
    assert list(np.flatnonzero(~track.valid)) == [9, 10, 11]
    assert np.isnan(track.sigma_px[9:12]).all()


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({}, TrackingError, "give the region"),
        ({"roi": (1, 1, 20, 20), "bodies": 2}, DataError, "one patch"),
        ({"roi": (1, 1, 4, 20)}, DataError, "the patch is 4 x 20 px; it must be 6 px a side or more"),
    ],
)
def test_template_refuses_what_it_cannot_follow(options, kind, message):
    with pytest.raises(kind, match=message):
        TRACKERS["template"].track(pattern(PATH[:3]), TrackOptions(**options))


def test_template_of_a_bare_wall_is_refused():
    wall = DrawnClip(noisy([np.full(SHAPE, 90.0)] * 3, 1.0))
    with pytest.raises(TrackingError, match="nothing in the region but one grey level"):
        TRACKERS["template"].track(wall, TrackOptions(roi=(10, 10, 20, 20)))
