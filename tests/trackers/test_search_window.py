"""Large images are searched round what changes: nothing that a search all over finds may be lost by it."""

import numpy as np
import pytest

from iris_sysid.registry import TRACKERS
from iris_sysid.types import TrackOptions
from tests._drawn import DrawnClip, disc, moving_disc, paint, swing
from trackers._detection.detect_frames import detection_setup
from trackers._detection.strong_windows import merged
from trackers._frames.ahead import ahead
from trackers._frames.working_image import view_of

SHAPE = (240, 2000)
N = 16


def clip_of(path, radius, entering=0):
    """A disc before a plain wall in a wide image; it is there from frame ``entering`` on."""
    rng, frames = np.random.default_rng(0), []
    for k, (x, y) in enumerate(path):
        image = np.clip(np.rint(rng.normal(80.0, 2.0, SHAPE)), 0, 255)
        if k >= entering:
            left, side = int(x) - radius - 2, 2 * radius + 6
            top = int(y) - radius - 2
            part = image[top : top + side, left : left + side]
            part[:] = np.rint(paint(part, disc((side, side), x - left, y - top, radius, 8), 180.0))
        frames.append(image.astype(np.uint8))
    return DrawnClip(frames)


def across(speed):
    return np.column_stack([150.3 + speed * np.arange(N), 120.7 + 30 * np.sin(np.arange(N) / 4)])


@pytest.mark.parametrize(("radius", "speed"), [(76, 90.0), (76, 25.0), (40, 25.0), (40, 90.0), (12, 25.0)])
def test_body_in_a_large_image_is_found_where_it_is_drawn_in_one_pass(radius, speed):
    path = across(speed)
    clip = clip_of(path, radius)
    (track,) = TRACKERS["median-background"].track(clip, TrackOptions())
    assert clip.decoded == N
    assert track.n_valid == N
    assert np.sqrt(np.mean((track.xy_px - path) ** 2)) < 0.1


@pytest.mark.parametrize(("radius", "step"), [(76, 6), (40, 3)])
def test_image_is_searched_at_half_the_usual_size_where_the_body_is_large(radius, step):
    clip = clip_of(across(90.0), radius)
    assert detection_setup(clip, view_of(clip, TrackOptions()), coarse=True).view.step == step


@pytest.mark.parametrize(("radius", "step"), [(30, 2), (12, 1)])
def test_small_image_is_searched_at_half_size_where_the_body_is_large(radius, step):
    clip = moving_disc(swing(30, (150, 90), (80, 30)), radius, (180, 300))
    setup = detection_setup(clip, view_of(clip, TrackOptions()), coarse=True)
    assert setup.view.step == step


def test_image_with_a_small_body_beside_a_large_one_is_searched_at_the_usual_size():
    path, small = across(90.0), disc((21, 21), 10, 10, 8, 8)
    images = [image.copy() for image in clip_of(path, 76).images]
    for (x, _), image in zip(path, images, strict=True):
        left = (int(x) + 300) % 1900
        image[10:31, left : left + 21] = np.rint(paint(image[10:31, left : left + 21].astype(float), small, 180.0))
    clip = DrawnClip(images)
    assert detection_setup(clip, view_of(clip, TrackOptions()), coarse=True).view.step == 3


def test_large_body_that_comes_in_later_is_seen_within_three_frames():
    path = across(25.0)
    (track,) = TRACKERS["median-background"].track(clip_of(path, 40, entering=5), TrackOptions())
    assert not track.valid[:5].any()
    assert track.valid[8:].all()


def test_merged_boxes_hold_all_that_were_given_and_do_not_overlap():
    rng = np.random.default_rng(5)
    corners = rng.integers(0, 90, (30, 2))
    boxes = [
        (int(x), int(y), int(x) + int(w), int(y) + int(h))
        for (x, y), (w, h) in zip(corners, rng.integers(1, 12, (30, 2)), strict=True)
    ]
    windows = merged(boxes)
    shown = np.zeros((110, 110), dtype=int)
    for left, top, right, bottom in windows:
        shown[top:bottom, left:right] += 1
    assert shown.max() == 1
    assert all(shown[top:bottom, left:right].all() for left, top, right, bottom in boxes)


def test_work_ahead_gives_results_in_order_and_raises_what_the_work_raises():
    taken = []

    def items():
        for k in range(20):
            taken.append(k)
            yield k

    results = ahead(lambda k: 10 // (15 - k), items())
    assert [next(results) for _ in range(3)] == [0, 0, 0]
    assert len(taken) < 12  # frames are large: few are held
    with pytest.raises(ZeroDivisionError):
        list(results)
