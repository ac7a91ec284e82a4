"""Kernels on small windows: exact, and the same as a search of the whole image."""

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.ndimage import distance_transform_edt

from iris_sysid.types import Frame
from trackers._background.median import BackgroundEstimate
from trackers._detection.coded_planes import plane_limits_of
from trackers._detection.connected import connected_parts, filled_round
from trackers._detection.cut_components import BLOB_SHARE, INSCRIBED, MIN_INSCRIBED, cut_at, peak_of
from trackers._detection.depth import depth_of
from trackers._detection.detection import pasted
from trackers._detection.foreground import MIN_SUPPORT, SQUARE, Blob, background_range_of, components
from trackers._detection.image_operations import blurred, quantile, rough_depth
from trackers._detection.outline import FARTHER, MIN_HALF_WIDTH, QUARTER, STEPS_APART, TAIL, _reaches
from trackers._detection.shading import MIN_A_TERM, shading
from trackers._detection.window_setup import looks_of, made_ready, moments_of_difference, seen_roughly
from trackers._frames.working_image import WorkingView


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


@pytest.mark.parametrize("outside", [True, False])
def test_rough_depth_is_within_two_percent(outside):
    for seed in range(5):
        mask = blotches(seed, (41, 30))
        assert rough_depth(mask, outside=outside) == pytest.approx(depth_of(mask, outside=outside), rel=0.025)


def test_a_wide_blur_at_a_reduced_size_is_that_of_the_whole_image_of_something_wide():
    rows, columns = np.indices((90, 80))
    hill = np.exp(-((rows - 40) ** 2 + (columns - 45) ** 2) / (2 * 7.0**2)).astype(np.float32)
    for sigma in (2.0, 7.0, 10.0):
        known = cv2.GaussianBlur(hill, (0, 0), sigma)
        assert blurred(hill, sigma) == pytest.approx(known, abs=0.01)


@pytest.mark.parametrize("count", [1, 2, 9, 100])
def test_quantile_is_that_of_numpy(count):
    values = np.random.default_rng(count).normal(size=count).astype(np.float32)
    for share in (0.0, 0.3, 0.5, 0.9, 1.0):
        assert quantile(values, share) == pytest.approx(np.quantile(values, share), rel=1e-5, abs=1e-6)


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


@pytest.mark.parametrize("seed", range(10))
def test_parts_that_overlap_a_seed_are_filled_as_by_scipy(seed):
    mask = blotches(seed, (60, 81 - 4 * seed))
    some = mask & (np.random.default_rng(seed).random(mask.shape) < 0.02).astype(np.uint8)
    parts, _ = ndimage.label(mask)
    known = ndimage.binary_fill_holes(np.isin(parts, np.unique(parts[some > 0])) & (mask > 0))
    assert np.array_equal(filled_round(mask, some), known)
    assert known.any()


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
    known = [label for label in range(1, count) if support[label] >= MIN_SUPPORT]
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
    view = WorkingView(*region, chroma=True)
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
        WorkingView(3, 2, 150, 110, True),
    )
    whole = view.image(frame)
    for left, top, right, bottom in [(0, 0, 150, 110), (5, 7, 40, 31), (100, 90, 150, 110), (14, 20, 15, 21)]:
        assert np.array_equal(view.part(frame, (left, top, right, bottom)), whole[top:bottom, left:right])


def parts_by_scipy(mask, level, faintest, smallest):
    """Parts of a mask cut where it is thin, as flags, and the inscribed radius of each."""
    square = np.ones((3, 3))
    wholes, count = ndimage.label(ndimage.binary_fill_holes((mask > 0) & (level >= faintest)), square)
    parts = []
    for whole in (wholes == number for number in range(1, count + 1)):
        depth = distance_transform_edt(np.pad(whole, 1))[1:-1, 1:-1].astype(np.float32)
        if np.count_nonzero(whole) < smallest:
            continue
        if depth.max() < MIN_INSCRIBED:
            parts.append((whole, depth.max()))
            continue
        cut = BLOB_SHARE * depth.max()
        seeds, seed_count = ndimage.label(depth > cut, square)
        away = np.stack([distance_transform_edt(seeds != number) for number in range(1, seed_count + 1)])
        owner = np.where(whole & (away.min(axis=0) <= cut + 1), away.argmin(axis=0), -1)
        parts += [(owner == k, depth[seeds == k + 1].max()) for k in range(seed_count)]
    return parts


@pytest.mark.parametrize("seed", range(12))
def test_blobs_are_cut_where_they_are_thin_as_by_scipy(seed):
    rng = np.random.default_rng(seed)
    mask = cv2.dilate(blotches(seed, (50, 70)), SQUARE)
    level = cv2.blur(rng.integers(0, 255, mask.shape).astype(np.uint8), (5, 5))
    faintest = float(np.percentile(level, 10))
    owner, _, table, clearness = cut_at(mask, level, faintest, 6)
    known = parts_by_scipy(mask, level, faintest, 6)
    assert len(table) == len(known) > 0
    rims, slopes = [], np.hypot(*(cv2.Sobel(level, cv2.CV_64F, *along, scale=1 / 8) for along in ((1, 0), (0, 1))))
    for number, row in enumerate(table, start=1):
        y, x = np.argwhere(owner == number)[0]
        (part, inscribed) = next(known_part for known_part in known if known_part[0][y, x])
        assert np.array_equal(owner == number, part)
        assert row[INSCRIBED] == inscribed
        left, top, width, height = cv2.boundingRect(part.astype(np.uint8))
        assert row[:4].tolist() == [left, top, left + width, top + height]
        rims.append(slopes[part & (cv2.erode(np.pad(part.astype(np.uint8), 1), SQUARE)[1:-1, 1:-1] == 0)])
    compactness = (table[:, INSCRIBED] ** 2).sum() / np.count_nonzero(owner)
    assert clearness == pytest.approx(compactness * np.concatenate(rims).mean())
    assert peak_of(mask, level) == cv2.blur(level, (3, 3))[mask > 0].max()


@pytest.mark.parametrize("channels", [1, 3])
def test_looks_and_moments_of_a_body_are_those_of_numpy_and_opencv(channels):
    rng = np.random.default_rng(channels)
    mask = cv2.ellipse(np.zeros((40, 50), np.uint8), (22, 19), (12, 7), 30, 0, 360, 1, -1)
    planes = [
        rng.uniform(low, high, (channels, 40, 50)).astype(np.float32) for low, high in [(0, 255), (90, 99), (1, 2)]
    ]
    other = np.zeros_like(mask)
    other[10:30, 30:] = 1
    difference = np.abs(planes[0] - planes[1]).max(axis=0)
    brightening, sharpness = looks_of(tuple(planes), mask)
    slopes = np.hypot(*(cv2.Sobel(difference, cv2.CV_32F, *along, scale=1 / 8) for along in ((1, 0), (0, 1))))
    assert sharpness == pytest.approx(np.percentile(slopes[cv2.dilate(mask, SQUARE) > 0], 90), rel=1e-5)
    assert brightening == pytest.approx((planes[0] - planes[1])[0][mask > 0].mean(), rel=1e-5)
    level = np.abs((planes[0] - planes[1]) / planes[2]).max(axis=0)
    near = (cv2.dilate(mask, np.ones((7, 7), np.uint8)) > 0) & (other == 0)
    places, weight = np.argwhere(near).T[::-1], np.minimum(level[near] / np.median(level[mask > 0]), 1.0)
    (xx, xy), (_, yy) = np.cov(places, aweights=weight)
    known = [*np.average(places, axis=1, weights=weight), xx, yy, xy]
    assert moments_of_difference(tuple(planes), mask, other, 3) == pytest.approx(known, rel=1e-4)


@pytest.mark.parametrize("corner", [(0, 0), (13, 8), (29, 22)])
def test_a_mask_of_larger_pixels_is_pasted_where_it_covers_a_window(corner):
    mask, finer = blotches(3, (9, 11)), 3
    whole = np.zeros((60, 70), np.uint8)
    whole[5 * finer : 14 * finer, 4 * finer : 15 * finer] = np.kron(mask, np.ones((finer, finer), np.uint8))
    blob = Blob(mask, 4, 5, 1.0, at_edge=False, held=False)
    into = pasted([blob], (corner[1], corner[1] + 25, corner[0], corner[0] + 30), finer)
    assert np.array_equal(into, whole[corner[1] :, corner[0] :][:25, :30])
    assert into.any()


def test_rough_look_is_that_of_the_pixels_of_a_mask():
    rows, columns = np.indices((20, 30)).astype(np.float32)
    mask = cv2.circle(np.zeros((20, 30), np.uint8), (14, 9), 6, 1, -1)
    image, background = np.array([100 + 3 * columns + 4 * rows]), np.full((1, 20, 30), 90, np.float32)
    area, x, y, contrast, brightening, intensity, steepness = seen_roughly(image, background, mask)
    assert (area, x, y) == (np.count_nonzero(mask), 14, 9)
    assert contrast == brightening == pytest.approx(intensity - 90) == pytest.approx(100 + 3 * 14 + 4 * 9 - 90)
    assert steepness == pytest.approx(5)


@pytest.mark.parametrize(("slope", "curvature", "follows"), [(0.0, 0.0, 0), (2.0, 0.0, 1), (2.0, 0.15, 2)])
def test_shading_is_a_polynomial_of_the_degree_that_fits_the_pixels_inside(slope, curvature, follows):
    rng = np.random.default_rng(0)
    rows, columns = np.indices((60, 60)).astype(np.float32)
    inside = np.hypot(rows - 28, columns - 31) < 20
    assert np.count_nonzero(inside) > 6 * MIN_A_TERM
    known = 120 + slope * (columns - 31) + curvature * (rows - 28) ** 2
    image = np.where(inside, known + rng.normal(0, 1, known.shape), 0)[np.newaxis].astype(np.float32)
    shade = shading(image, depth_of(inside))[0]
    assert np.abs(shade - known)[inside].max() < 1.5
    outside = shade[28, 31 + 24]  # continued, within the levels of the pixels inside
    assert outside == pytest.approx(min(120 + slope * 24, image[0][inside].max()), abs=1.5)
    assert (np.abs(shade[inside] - shade[28, 31]).max() > 1) == (follows > 0)


def test_shading_of_a_few_pixels_is_their_mean():
    image = np.arange(100, dtype=np.float32).reshape(1, 10, 10)
    inside = np.zeros((10, 10), bool)
    inside[4:6, 4:6] = True
    assert shading(image, depth_of(inside)) == pytest.approx(image[0][inside].mean())
    assert not shading(image, np.zeros((10, 10), np.float32)).any()


@pytest.mark.parametrize("channels", [1, 3])
def test_a_thin_part_on_a_small_body_is_not_of_its_mask(channels):
    body = cv2.circle(np.zeros((40, 40), np.uint8), (20, 24), 5, 1, -1)
    mask = body.copy()
    mask[2:20, 20] = 1
    planes = np.full((3, channels, 40, 40), 90, np.float32)
    planes[0][:, mask > 0], planes[2] = 160, 1
    _, found, other = made_ready(tuple(planes), mask, np.zeros_like(mask), 1)
    assert not found[2:18].any()
    assert np.count_nonzero(found != body) <= 4
    assert not other.any()


def test_clearness_of_a_single_row_without_a_gradient_is_0():
    assert cut_at(np.ones((1, 9), np.uint8), np.full((1, 9), 80, np.uint8), 50.0, 6)[3] == 0.0


@pytest.mark.parametrize("axes", [1, 4])
def test_outline_has_ended_where_the_mean_coverage_of_rings_falls_no_more(axes):
    rng = np.random.default_rng(axes)
    y, x = np.indices((60, 60)) - 29.6
    distance = (15 - np.hypot(x, y)).astype(np.float32)
    width = 2.0 if axes == 1 else 2.0 + 3.0 * np.abs(x) / np.hypot(x, y)  # of the outline: wider to the sides
    share = (np.clip(0.5 + distance / (2 * width), 0, 1) + rng.normal(0, 0.01, x.shape)).astype(np.float32)
    turn = np.arctan2(y, x) * (axes / np.pi) % axes
    widest, axis = 9.0, np.rint(turn).astype(int) % axes
    found = _reaches(distance, share, turn, widest, None if axes == 1 else axes)
    for number, reach in enumerate(found):
        levels = []
        for half_width in np.arange(MIN_HALF_WIDTH, widest + 1, QUARTER):
            off = -distance - half_width
            ring = np.sort(share[(off > 0) & (off < 3 * QUARTER) & (axis == number) & (distance > -widest - FARTHER)])
            cut = ring.size // 10 if axes == 1 else max(0, ring.size - 1) // 2
            levels.append(ring[cut : ring.size - cut].mean())
        falls = (k for k, level in enumerate(levels) if level < TAIL)
        rests = (k for k in range(STEPS_APART, len(levels)) if levels[k - STEPS_APART] - levels[k] < TAIL)
        fallen, resting = next(falls, len(levels)), next(rests, len(levels))
        steps = fallen if fallen <= resting else resting - STEPS_APART
        assert reach == MIN_HALF_WIDTH + QUARTER * steps
