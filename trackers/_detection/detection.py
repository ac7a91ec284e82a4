"""Detections of one frame: candidate bodies with sub-pixel centroids, and objects that reach in from the edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.types import Frame
from trackers._background.median import Background
from trackers._detection.depth import depth_of
from trackers._detection.foreground import MIN_AREA, Blob
from trackers._detection.motion_blur import streak_centre
from trackers._detection.strong_windows import grown
from trackers._detection.subpixel_centroid import Centre, Window, coverage_centre
from trackers._detection.window_setup import looks_of, made_ready, seen_roughly
from trackers._frames.arrays import Bytes, Image
from trackers._frames.working_image import WorkingView

MIN_INSCRIBED = 1.3  # px, inscribed radius
HAND_SHARE = 0.35  # of the body's inscribed radius: a hand or arm is at least as thick
HAND_GAP = 0.5  # of the body's inscribed radius: a hand so near is taken to touch it
MARGIN = 10  # px round a body that its outline and the ring about it need
STILL = 0.4  # of the radius: a body that moved less since the frame before is not a streak
LARGE_RADIUS = 24.0  # px, inscribed: larger bodies are measured in larger pixels, which give the centre as accurately

Box = tuple[float, float, float, float]  # left, top, right, bottom, px


@dataclass(frozen=True, slots=True)
class EdgeObject:
    """An object at the edge of the image, e.g. a hand: box (px), area (px^2) and inscribed radius (px)."""

    box: Box
    area: float
    inscribed: float


@dataclass(frozen=True, slots=True)
class Detection:
    """One candidate body in one frame.

    ``centre`` is that in the window whose corner is (left, top), px of the frame; ``brightening`` is
    the mean signed difference in luma, grey levels; ``sharpness`` that of the outline in grey levels a
    px; ``compactness`` is 1 for a disc, less for a long shape; ``hand`` says that something that reaches
    in from the edge touches it. One that is not ``measured`` is rough: by its pixels of the search.
    """

    frame: int
    t_s: float
    centre: Centre
    left: int
    top: int
    brightening: float
    sharpness: float
    compactness: float
    hand: bool
    measured: bool = True

    @property
    def x(self) -> float:
        """Position to the right, px of the frame."""
        return self.left + self.centre.x

    @property
    def y(self) -> float:
        """Position downwards, px of the frame."""
        return self.top + self.centre.y

    @property
    def area(self) -> float:
        """Area, px."""
        return self.centre.area

    @property
    def contrast(self) -> float:
        """Mean difference from the background, grey levels."""
        return self.centre.contrast

    @property
    def radius(self) -> float:
        """Radius of the disc of the same area, px."""
        return float(np.sqrt(self.area / np.pi))


@dataclass(frozen=True, eq=False, slots=True)
class FrameDetections:
    """Detections of one frame: candidate bodies, and objects that reach in from the edge."""

    frame: int
    t_s: float
    detections: tuple[Detection, ...]
    edge_objects: tuple[EdgeObject, ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Outline:
    """One body by its outline: its window in pixels of ``size`` px a side, its centre there, and its detection."""

    window: Window
    centre: Centre
    size: int
    seen: Detection


@dataclass(frozen=True, eq=False, slots=True)
class FrameCandidates:
    """Candidate bodies of a frame: its blobs with a rough detection each; all bodies, and objects that reach in."""

    frame: Frame
    blobs: list[Blob]
    detections: tuple[Detection, ...]
    bodies: list[Blob]
    edge_objects: tuple[EdgeObject, ...]


@dataclass(frozen=True, eq=False, slots=True)
class BlobDetector:
    """Measures blobs: background, region of interest, reduction for the search, inflation of the noise.

    ``streaks`` says that a body that moves far during an exposure is fitted as a swept disc, ``refined`` that outline
    and background are estimated again from the first result.
    """

    background: Background
    view: WorkingView
    inflation: float
    streaks: bool = True
    refined: bool = True

    def detect(
        self, frame: Frame, bodies: list[Blob], foreground: list[Blob], before: Sequence[Detection] = ()
    ) -> FrameDetections:
        """Measure the centroid of each body.

        ``foreground`` are the blobs of all bodies and hands; ``before`` are the detections of the frame before.
        """
        candidates = self.candidates(frame, bodies, foreground)
        return self.measured(candidates, [True] * len(candidates.blobs), before)

    def candidates(self, frame: Frame, bodies: list[Blob], foreground: list[Blob]) -> FrameCandidates:
        """The candidate bodies of a frame: see :meth:`detect`."""
        reaching = [blob for blob in foreground if blob.held and blob.inscribed > MIN_INSCRIBED]
        inside = [blob for blob in bodies if not blob.at_edge and blob.inscribed > MIN_INSCRIBED]
        rough = tuple(self._rough(frame, blob, reaching) for blob in inside)
        return FrameCandidates(frame, inside, rough, bodies, tuple(self.edge_object(blob) for blob in reaching))

    def measured(
        self, candidates: FrameCandidates, which: Sequence[bool], before: Sequence[Detection]
    ) -> FrameDetections:
        """The detections of a frame, rough but those that are to be measured; see :meth:`each_measured`."""
        seen = self.each_measured(candidates, which, before)
        found = tuple(detection for detection in seen if detection is not None)
        return FrameDetections(candidates.frame.index, candidates.frame.t_s, found, candidates.edge_objects)

    def each_measured(
        self, candidates: FrameCandidates, which: Sequence[bool], before: Sequence[Detection]
    ) -> list[Detection | None]:
        """The detection of each candidate, rough or measured; None for one that is too small, or cut by the edge.

        Parameters
        ----------
        candidates
            Candidate bodies.
        which
            Of the candidates are measured.
        before
            Detections of the frame before, rough or not: a body that rests since then is not a streak.
        """
        seen: list[Detection | None] = list(candidates.detections)
        for k in np.flatnonzero(which):
            rough = candidates.detections[k]
            outline = self._outline(candidates.frame, candidates.blobs[k], candidates.bodies, rough.hand)
            seen[k] = None if outline is None else self._detection(outline, before)
        return seen

    def _rough(self, frame: Frame, blob: Blob, reaching: list[Blob]) -> Detection:
        """A body by its pixels of the search."""
        view, step = self.view, self.view.step
        left, top, right, bottom = grown(blob.box, 1, view.search_size)
        image = _as_planes(view.part(frame, (left, top, right, bottom), step))
        background = _as_planes(self.background.reduced(step).patch(top, bottom, left, right).background)
        mask = np.zeros(image.shape[1:], dtype=np.uint8)
        rows, columns = slice(blob.top - top, blob.box[3] - top), slice(blob.left - left, blob.box[2] - left)
        mask[rows, columns] = blob.mask
        area, x, y, contrast, brightening, intensity, sharpness = seen_roughly(image, background, mask)
        x, y = view.in_frame(left + x, top + y)
        unknown = (np.inf,) * 2
        centre = Centre(x, y, *unknown, area * step**2, np.inf, contrast, intensity, np.inf, cut=False)
        hand = blob.held or any(touches(blob, other) for other in reaching)
        compactness = min(1.0, np.pi * blob.inscribed**2 / blob.area)
        stated = (brightening, sharpness / step, compactness, hand)
        return Detection(frame.index, frame.t_s, centre, 0, 0, *stated, measured=False)

    def edge_object(self, blob: Blob) -> EdgeObject:
        """An object that reaches in from the edge, in px of the frame."""
        step, view = self.view.step, self.view
        left, top, right, bottom = (side * step for side in blob.box)
        box = (left + view.left, top + view.top, right + view.left, bottom + view.top)
        return EdgeObject(box, float(blob.area * step**2), blob.inscribed * step)

    def detect_body(self, frame: Frame, blob: Blob, bodies: list[Blob], reaching: list[Blob]) -> Detection | None:
        """Measure the centroid of one body; None when it is too small, or cut by the edge.

        Parameters
        ----------
        frame
            The frame.
        blob
            The body, at the size of the search.
        bodies
            All bodies of the frame: pixels of the others do not count.
        reaching
            Objects that reach in from the edge and may be a hand.
        """
        hand = blob.held or any(touches(blob, other) for other in reaching)
        outline = self._outline(frame, blob, bodies, hand)
        return None if outline is None else self._detection(outline, ())

    def _outline(self, frame: Frame, blob: Blob, bodies: list[Blob], hand: bool) -> _Outline | None:
        """What the outline of one body shows, which a ``hand`` may touch; None when it is too small."""
        size = self._pixel(blob)
        window, left, top = self._window(frame, blob, bodies, size)
        if np.count_nonzero(window.mask) < MIN_AREA:
            return None
        centre = coverage_centre(window, refined=self.refined)
        left, top = left * size + self.view.left, top * size + self.view.top
        brightening, sharpness = looks_of(window.planes, window.mask)
        seen = Detection(
            frame.index,
            frame.t_s,
            _in_pixels(centre, size),
            left,
            top,
            brightening=brightening,
            sharpness=sharpness / size,
            compactness=min(1.0, np.pi * blob.inscribed**2 / blob.area),
            hand=hand,
        )
        return _Outline(window, centre, size, seen)

    def _detection(self, outline: _Outline, before: Sequence[Detection]) -> Detection | None:
        """The body by its outline, or as a streak; None when it is cut by the edge.

        ``before`` are the detections of the frame before: a body that rests since then is not a streak.
        """
        centre, seen = outline.centre, outline.seen
        if self.streaks and not _is_still(seen.centre, seen.left, seen.top, before):
            centre = streak_centre(outline.window, centre)
        if centre.cut:
            return None
        return seen if centre is outline.centre else replace(seen, centre=_in_pixels(centre, outline.size))

    def _pixel(self, blob: Blob) -> int:
        """The side, px, of the squares whose means are measured: 1, or more for a large body."""
        step = self.view.step
        largest = max(1, int(blob.inscribed * step / LARGE_RADIUS))
        return max(size for size in range(1, step + 1) if step % size == 0 and size <= largest)

    def _window(self, frame: Frame, blob: Blob, bodies: list[Blob], size: int) -> tuple[Window, int, int]:
        """The pixels round a blob, each the mean of ``size`` x ``size``, and where they begin."""
        finer = self.view.step // size
        margin = MARGIN + 2 * finer
        x0, y0, x1, y1 = (side * finer for side in blob.box)
        left, top = max(0, x0 - margin), max(0, y0 - margin)
        right, bottom = min(self.view.width // size, x1 + margin), min(self.view.height // size, y1 + margin)
        estimate = self.background.reduced(size).patch(top, bottom, left, right)
        image = self.view.part(frame, (left, top, right, bottom), size)
        planes = _as_planes(image), _as_planes(estimate.background), _as_planes(estimate.noise)
        mask = pasted([blob], (top, bottom, left, right), finer)
        other = pasted([body for body in bodies if body is not blob], (top, bottom, left, right), finer)
        background, mask, other = made_ready(planes, mask, other, finer)
        return Window(planes[0], background, planes[2], mask, other, self.inflation), left, top


def _as_planes(image: Image | Bytes) -> Image:
    """An image (h, w) or (h, w, channels) as (channels, h, w) grey levels."""
    return np.array([image] if image.ndim == 2 else cv2.split(image), dtype=np.float32)


def _is_still(centre: Centre, left: int, top: int, before: Sequence[Detection]) -> bool:
    """Whether a detection of the frame before is at about the position of a centre in the window at (left, top).

    An exposure is no longer than the time between two frames, which bounds the distance moved in it.
    """
    least = STILL * np.sqrt(centre.area / np.pi)
    return any(np.hypot(left + centre.x - detection.x, top + centre.y - detection.y) < least for detection in before)


def _in_pixels(centre: Centre, size: int) -> Centre:
    """Convert a centre from pixels of ``size`` px a side to px."""
    if size == 1:
        return centre
    return replace(
        centre,
        x=centre.x * size + (size - 1) / 2,
        y=centre.y * size + (size - 1) / 2,
        sigma_x=centre.sigma_x * size,
        sigma_y=centre.sigma_y * size,
        area=centre.area * size**2,
        sigma_area=centre.sigma_area * size**2,
        lobes=tuple(lobe * size for lobe in centre.lobes),
    )


def pasted(blobs: list[Blob], within: tuple[int, int, int, int], finer: int) -> Bytes:
    """The masks of blobs in a window (top, bottom, left, right) whose pixels are ``finer`` times smaller."""
    top, bottom, left, right = within
    pasted = np.zeros((bottom - top, right - left), dtype=np.uint8)
    for blob in blobs:
        x0, y0, x1, y1 = (side * finer for side in blob.box)
        rows, columns = slice(max(top, y0), min(bottom, y1)), slice(max(left, x0), min(right, x1))
        if rows.start < rows.stop and columns.start < columns.stop:
            mask = cv2.resize(blob.mask, (x1 - x0, y1 - y0), interpolation=cv2.INTER_NEAREST)
            into = pasted[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
            into |= mask[rows.start - y0 : rows.stop - y0, columns.start - x0 : columns.stop - x0]
    return pasted


def touches(blob: Blob, reaching: Blob) -> bool:
    """Whether something reaching in from the edge, thick enough for a hand or an arm, is at the body."""
    if reaching is blob or reaching.inscribed < HAND_SHARE * blob.inscribed:
        return False
    reach = max(2.0, HAND_GAP * blob.inscribed)
    x0, y0, x1, y1 = blob.box
    a0, b0, a1, b1 = reaching.box
    if a0 > x1 + reach or a1 < x0 - reach or b0 > y1 + reach or b1 < y0 - reach:
        return False
    left, top = min(x0, a0), min(y0, b0)
    canvas = np.ones((max(y1, b1) - top, max(x1, a1) - left), dtype=np.uint8)
    canvas[b0 - top : b1 - top, a0 - left : a1 - left] -= reaching.mask
    away = depth_of(canvas, outside=False)
    distance = away[y0 - top : y1 - top, x0 - left : x1 - left]
    return bool(distance[blob.mask > 0].min() <= reach)
