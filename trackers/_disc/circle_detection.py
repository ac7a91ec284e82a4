"""Circles detected in single frames by the Hough transform and joined into one path; needs no background."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.types import Array, Frame, FrameSource
from trackers._disc.expected_position import ExpectedPath
from trackers._disc.fit import fit_disc, image_cutout, shows_disc
from trackers._disc.model import Disc, Form, Motion
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes
from trackers._frames.working_image import WorkingView

MAX_SEARCH_WIDTH = 480  # px
SMOOTHING = 1.5  # px, before the search
CELL, APART, CANNY_HIGH, ROUNDNESS, MIN_RADIUS = 1.5, 5, 150, 0.8, 4  # of HOUGH_GRADIENT_ALT, as OpenCV suggests
MAX_CIRCLES = 8  # a frame
MAX_GAP = 5  # frames between two circles of one path
CENTRE_CHANGE = 0.4  # of the radius: how far the centre may go from frame to frame
RADIUS_CHANGE = 0.25  # log ratio of two radii in successive frames
MIN_CHANGE = 4.0  # px, at the size searched, of centre or radius over a path: less is part of the background
COURSES_TRIED = 6
MAX_REFINED = 600  # frames
FORM = Form(interior=3, exterior=3, known_background=False)
MEMORY = 3  # discs from which the next one is predicted

Chain = list[int]


@dataclass(frozen=True, slots=True)
class Search:
    """The size at which circles are searched: ``step`` px of the image are one px there."""

    view: WorkingView

    @property
    def step(self) -> int:
        """How many pixels a side make one."""
        return -(-max(self.view.width, self.view.height) // MAX_SEARCH_WIDTH)

    def small(self, image: Bytes) -> Bytes:
        """The image (luma) at the size of the search."""
        luma = image if image.ndim == 2 else np.ascontiguousarray(image[..., 0])
        size = (-(-self.view.width // self.step), -(-self.view.height // self.step))
        return luma if self.step == 1 else np.asarray(cv2.resize(luma, size, interpolation=cv2.INTER_AREA))

    def enlarged(self, disc: Disc) -> Disc:
        """A disc of the small image in px of the frame."""
        shift = (self.step - 1) / 2
        x, y = disc.x * self.step + shift + self.view.left, disc.y * self.step + shift + self.view.top
        return Disc(x, y, disc.radius * self.step, blur=disc.blur * self.step**2)


def circles(image: Bytes) -> Array:
    """Circles (k, 3) x, y, radius in px of a grey image, by the Hough transform of its gradients.

    H. K. Yuen et al., "Comparative study of Hough transform methods for circle finding", 1990, as in OpenCV's
    HOUGH_GRADIENT_ALT: its result is already tested for a closed outline.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), SMOOTHING)
    detected = cv2.HoughCircles(
        smooth,
        cv2.HOUGH_GRADIENT_ALT,
        dp=CELL,
        minDist=APART,
        param1=CANNY_HIGH,
        param2=ROUNDNESS,
        minRadius=MIN_RADIUS,
        maxRadius=max(image.shape),
    )
    if detected is None:
        return np.empty((0, 3))
    return np.asarray(detected, dtype=np.float64).reshape(-1, detected.shape[-1])[:MAX_CIRCLES, :3]


def path_of_circles(video: FrameSource, view: WorkingView) -> ExpectedPath | None:
    """The path of the disc that moves or changes its size over most frames; None when there is none."""
    search = Search(view)
    times: dict[int, float] = {}
    nodes: list[tuple[int, Array]] = []
    images: dict[int, Bytes] = {}  # of a short clip, which is then read once

    def seen(frame: Frame) -> tuple[Frame, Bytes, Array]:
        small_image = search.small(view.image(frame))
        return frame, small_image, circles(small_image)

    for frame, small_image, found in ahead(seen, video.frames()):
        times[frame.index] = frame.t_s
        nodes += [(frame.index, circle) for circle in found]
        if len(images) < MAX_REFINED:
            images[frame.index] = small_image
    chain = best_chain(nodes)
    if chain is None:
        return None
    small = ExpectedPath(times, {nodes[k][0]: _disc(nodes[k][1]) for k in chain})
    wanted = _nearest(small)
    _refine(small, images if images.keys() >= set(wanted) else _images(video, search, wanted))
    return ExpectedPath(times, {frame: search.enlarged(disc) for frame, disc in small.discs.items()})


def best_chain(nodes: list[tuple[int, Array]]) -> Chain | None:
    """The longest chain of circles that follow each other and change over time."""
    left = set(range(len(nodes)))
    for _ in range(COURSES_TRIED):
        chain = _longest_chain(nodes, left)
        if not chain:
            return None
        change = np.ptp([nodes[k][1] for k in chain], axis=0)
        if change.max() >= MIN_CHANGE:
            return chain
        left -= set(chain)
    return None


def _longest_chain(nodes: list[tuple[int, Array]], allowed: Iterable[int]) -> Chain:
    """The chain with the most circles, less their differences from one to the next (dynamic programming)."""
    best: dict[int, float] = {}
    before: dict[int, int | None] = {}
    order = sorted(allowed)
    for index, k in enumerate(order):
        frame, circle = nodes[k]
        best[k], before[k] = 1.0, None
        for j in reversed(order[:index]):
            gap = frame - nodes[j][0]
            if gap > MAX_GAP:
                break
            cost = _cost(nodes[j][1], circle, gap) if gap > 0 else np.inf
            if best[j] + 1.0 - cost > best[k]:
                best[k], before[k] = best[j] + 1.0 - cost, j
    chain: Chain = []
    at = max(best, key=lambda k: best[k]) if best else None
    while at is not None:
        chain.append(at)
        at = before[at]
    return chain[::-1]


def _cost(circle: Array, other: Array, gap: int) -> float:
    """How unlike two circles are that are ``gap`` frames apart: infinite where they cannot be one disc."""
    moved = float(np.hypot(*(other[:2] - circle[:2]))) / (CENTRE_CHANGE * min(circle[2], other[2]) * gap + 1.0)
    grown = abs(float(np.log(other[2] / circle[2]))) / (RADIUS_CHANGE * gap)
    return max(moved, grown) if max(moved, grown) < 1.0 else np.inf


def _nearest(expected_path: ExpectedPath) -> list[int]:
    """The frames with a circle, or near to one that has it."""
    known = np.array(sorted(expected_path.discs))
    return sorted(expected_path.times, key=lambda frame: int(np.abs(known - frame).min()))[:MAX_REFINED]


def _images(video: FrameSource, search: Search, wanted: Iterable[int]) -> dict[int, Bytes]:
    """Small images of some frames."""
    numbers = set(wanted)
    if not numbers:
        return {}
    return {frame.index: search.small(search.view.image(frame)) for frame in video.frames() if frame.index in numbers}


def _refine(expected_path: ExpectedPath, images: Mapping[int, Bytes]) -> None:
    """Fit a disc to each circle, and to frames without one from where it is in the frames beside, on and back."""
    known = [frame for frame in expected_path.discs if frame in images]
    refined = ahead(lambda frame: _fitted(expected_path.discs[frame], images[frame]), known)
    expected_path.discs.update(zip(known, list(refined), strict=True))
    for frames in (sorted(expected_path.times), sorted(expected_path.times, reverse=True)):
        for index, frame in enumerate(frames):
            before = [earlier for earlier in frames[max(0, index - MEMORY) : index] if earlier in expected_path.discs]
            if frame in expected_path.discs or frame not in images or not before:
                continue
            expected = expected_path.extrapolated(frame, before)
            fitted = _fitted(expected, images[frame])
            if fitted is not expected:
                expected_path.discs[frame] = fitted


def _fitted(expected: Disc, image: Bytes) -> Disc:
    """The disc that a fit shows where one is expected; that one itself if it shows none."""
    fitted = fit_disc(image_cutout(image, expected), expected, FORM, Motion())
    return fitted.disc if fitted is not None and shows_disc(fitted, expected) else expected


def _disc(circle: Array) -> Disc:
    x, y, radius = (float(value) for value in circle)
    return Disc(x, y, radius)
