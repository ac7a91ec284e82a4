"""Kernels on small windows: exact, and the same as a search of the whole image."""

import cv2
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from iris_sysid.types import Frame
from trackers._background.median import BackgroundEstimate
from trackers._detection.coded_planes import plane_limits_of
from trackers._detection.connected import connected_parts
from trackers._detection.depth import depth_of
from trackers._detection.foreground import SMALLEST_SUPPORT, SQUARE, background_range_of, components
from trackers._frames.working_image import View


def blotches(seed, shape):
    """A mask of random blotches."""
    rng = np.random.default_rng(seed)
    return (cv2.blur(rng.random(shape), (5, 5)) > rng.uniform(0.4, 0.6)).astype(np.uint8)


@pytest.mark.parametrize("seed", range(20))
def test_depth_is_exact(seed):
    mask = blotches(seed, (seed + 1, 40))
    assert np.array_equal(depth_of(mask), distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1].astype(np.float32))
    mask[0, 0] = 0
    assert np.array_equal(depth_of(mask, outside=False), distance_transform_edt(mask).astype(np.float32))


def test_depth_of_a_full_mask_is_that_to_its_sides():
    assert depth_of(np.ones((5, 9), np.uint8)).max() == 3


@pytest.mark.parametrize("seed", range(5))
def test_connected_parts_are_those_of_opencv_that_hold_seeds(seed):
    mask = blotches(seed, (60, 80))
    seeds = mask & (np.random.default_rng(seed).random(mask.shape) < 0.005).astype(np.uint8)
    labels, boxes = connected_parts(mask, seeds)
    count, known, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    support = np.bincount(known[seeds > 0], minlength=count)
    assert len(boxes) == np.count_nonzero(support) > 0
    for number, (left, top, right, bottom, seen) in enumerate(boxes, start=1):
        same = known[labels == number]
        assert np.array_equal(labels == number, known == same[0])
        assert [left, top, right - left, bottom - top] == stats[same[0]][:4].tolist()
        assert seen == support[same[0]]


@pytest.mark.parametrize("channels", [1, 3])
def test_components_in_windows_are_those_of_the_whole_image(channels):
    shape = (200, 320, channels)[: 2 if channels == 1 else 3]
    rng = np.random.default_rng(channels)
    still = BackgroundEstimate(np.full(shape, 90, np.float32), np.ones(shape, np.float32))
    background_range = background_range_of(still)
    image = rng.normal(90, 1.5, shape).clip(0, 255).astype(np.uint8)
    cv2.line(image, (5, 190), (300, 20), (97,) * channels, 3)  # weak over most of the image, strong at its end
    cv2.circle(image, (300, 20), 9, (150,) * channels, -1)
    cv2.circle(image, (60, 30), 1, (150,) * channels, -1)
    excess = background_range.excess(image).reshape(200, 320, -1)
    weak, strong = (
        (excess > limit.reshape(excess.shape)).any(axis=-1)
        for limit in (background_range.weak, background_range.strong)
    )
    closed = cv2.morphologyEx(weak.astype(np.uint8), cv2.MORPH_CLOSE, SQUARE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    support = np.bincount(labels[strong], minlength=count)
    known = [label for label in range(1, count) if support[label] >= SMALLEST_SUPPORT]
    found = list(components(background_range, image))
    assert len(known) >= 2
    assert [(part.left, part.top) for part in found] == [tuple(stats[label][:2].tolist()) for label in known]
    for part, label in zip(found, known, strict=True):
        left, top, right, bottom = part.box
        assert np.array_equal(part.mask, labels[top:bottom, left:right] == label)
        assert np.array_equal(part.level, excess[top:bottom, left:right].max(axis=-1))


def coded_frame(rng, shape, changes):
    """A frame whose planes are noise about 90, with some rectangles of other levels in one of its planes each."""
    planes = [rng.normal(90, 1.5, size).clip(0, 255) for size in (shape, *[[-(-side // 2) for side in shape]] * 2)]
    for plane, left, top, right, bottom, level in changes:
        planes[plane][top:bottom, left:right] += level
    luma, blue, red = (plane.round().clip(0, 255).astype(np.uint8) for plane in planes)
    return Frame(0, 0.0, luma, lambda: None, lambda: (blue, red))


@pytest.mark.parametrize("region", [(0, 0, 161, 121), (6, 4, 140, 100)])
def test_windows_by_planes_as_coded_hold_all_that_differs_strongly(region):
    rng = np.random.default_rng(0)
    view = View(*region, chroma=True)
    still = rng.normal(90, 5, (*view.search_size[::-1], 3)).astype(np.float32)
    background_range = background_range_of(BackgroundEstimate(still, np.ones_like(still)))
    frames = [
        coded_frame(rng, (121, 161), [(plane, x, y, x + 1 + k % 4, y + 1 + k % 3, 9 + 2 * k)])
        for k, (plane, x, y) in enumerate(rng.integers(0, (3, 75, 55), (60, 3)))
    ]
    differing = 0
    for frame in frames:
        strong = background_range.strongly(view.search_image(frame))
        differing += strong.any()
        for left, top, right, bottom in plane_limits_of(view, frame, background_range).windows(frame):
            strong[top:bottom, left:right] = 0
        assert not strong.any()
    assert differing > 20


def test_part_of_a_coloured_frame_is_that_of_the_whole():
    frame, view = (
        coded_frame(np.random.default_rng(1), (121, 161), [(1, 10, 10, 30, 30, 60)]),
        View(3, 2, 150, 110, True),
    )
    whole = view.image(frame)
    for left, top, right, bottom in [(0, 0, 150, 110), (5, 7, 40, 31), (100, 90, 150, 110), (14, 20, 15, 21)]:
        assert np.array_equal(view.part(frame, (left, top, right, bottom)), whole[top:bottom, left:right])
