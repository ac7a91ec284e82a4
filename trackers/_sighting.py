"""What one frame shows: candidate bodies with their sub-pixel centres, and what reaches in from the edge."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from trackers._background import Background, Bytes, Image
from trackers._centroid import Centre, Window, coverage_centre, filled_round
from trackers._foreground import CONTRAST_SHARES, SMALLEST_AREA, WEAK_SIGMAS, Core

THINNEST_BODY = 1.3  # px, inscribed radius
HAND_SHARE = 0.35  # of the body's inscribed radius: a hand or arm is at least as thick
HAND_GAP = 0.5  # of the body's inscribed radius: a hand so near is taken to touch it
MARGIN = 10  # px round a body that its outline and the ring about it need
RING = 4  # px from the body to the ring in which the background's level is compared

Box = tuple[float, float, float, float]  # left, top, right, bottom, px


@dataclass(frozen=True, slots=True)
class Intruder:
    """Something that reaches in from the edge of the picture: its box (px), area (px) and inscribed radius (px)."""

    box: Box
    area: float
    inscribed: float


@dataclass(frozen=True, slots=True)
class Sighting:
    """One candidate body in one frame.

    ``centre`` is that in the window whose corner is (left, top), px of the frame; ``brightening`` is
    the mean signed difference in luma, grey levels; ``sharpness`` that of the outline in grey levels a
    px; ``compactness`` is 1 for a disc, less for what is long; ``hand`` says that something that reaches
    in from the edge touches it.
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
class Glimpse:
    """One frame: its candidates, and what reaches in from the edge."""

    frame: int
    t_s: float
    sightings: tuple[Sighting, ...]
    intruders: tuple[Intruder, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Lens:
    """What turns a core into a sighting: the background, the reduction of the search, where the region lies."""

    background: Background
    step: int
    left: int
    top: int
    inflation: float

    def glimpse(self, frame: int, t_s: float, picture: Bytes, bodies: list[Core], things: list[Core]) -> Glimpse:
        """Look at each body at full size; ``things`` are the cores of whatever moves, bodies and hands.

        ``frame`` and ``t_s`` are the frame's number and time in s, ``picture`` its region at full size.
        """
        reaching = [core for core in things if core.held and core.inscribed > THINNEST_BODY]
        inside = [core for core in bodies if not core.at_edge and core.inscribed > THINNEST_BODY]
        sightings = [self._sighting(frame, t_s, picture, core, bodies, reaching) for core in inside]
        intruders = tuple(self._intruder(core) for core in reaching)
        return Glimpse(frame, t_s, tuple(one for one in sightings if one is not None), intruders)

    def _intruder(self, core: Core) -> Intruder:
        left, top, right, bottom = (side * self.step for side in core.box)
        box = (left + self.left, top + self.top, right + self.left, bottom + self.top)
        return Intruder(box, float(core.area * self.step**2), core.inscribed * self.step)

    def _sighting(
        self, frame: int, t_s: float, picture: Bytes, core: Core, bodies: list[Core], reaching: list[Core]
    ) -> Sighting | None:
        window, left, top = self._window(picture, core, bodies)
        if np.count_nonzero(window.core) < SMALLEST_AREA:
            return None
        centre = coverage_centre(window)
        if centre.cut:
            return None
        inside = window.core > 0
        luma = (window.image - window.background)[..., 0]
        return Sighting(
            frame,
            t_s,
            centre,
            left + self.left,
            top + self.top,
            brightening=float(luma[inside].mean()),
            sharpness=_sharpness(window),
            compactness=min(1.0, np.pi * core.inscribed**2 / core.area),
            hand=core.held or any(touches(core, thing) for thing in reaching),
        )

    def _window(self, picture: Bytes, core: Core, bodies: list[Core]) -> tuple[Window, int, int]:
        """The pixels round a core at full size, and where they begin."""
        margin = MARGIN + 2 * self.step
        x0, y0, x1, y1 = (side * self.step for side in core.box)
        left, top = max(0, x0 - margin), max(0, y0 - margin)
        bottom, right = min(picture.shape[0], y1 + margin), min(picture.shape[1], x1 + margin)
        frame = (top, bottom, left, right)
        image = picture[top:bottom, left:right].astype(np.float32)
        still = self.background.patch(*frame)
        mask = self._pasted([core], frame)
        other = self._pasted([one for one in bodies if one is not core], frame)
        image, background, noise = (np.atleast_3d(part) for part in (image, still.background, still.noise))
        background = background + _level(image - background, mask, other)
        if self.step > 1:
            mask = _sharpened(mask, image - background, noise, self.step)
        return Window(image, background, noise, mask, other & ~mask, self.inflation), left, top

    def _pasted(self, cores: list[Core], frame: tuple[int, int, int, int]) -> Bytes:
        """The masks of cores in a window of the picture at full size."""
        top, bottom, left, right = frame
        rows, columns = np.arange(top, bottom) // self.step, np.arange(left, right) // self.step
        pasted = np.zeros((rows.size, columns.size), dtype=np.uint8)
        for core in cores:
            x0, y0, x1, y1 = core.box
            in_rows = np.flatnonzero((rows >= y0) & (rows < y1))
            in_columns = np.flatnonzero((columns >= x0) & (columns < x1))
            if in_rows.size and in_columns.size:
                part = core.mask[(rows[in_rows] - y0)[:, np.newaxis], columns[in_columns] - x0]
                pasted[in_rows[0] : in_rows[-1] + 1, in_columns[0] : in_columns[-1] + 1] |= part
        return pasted


def _level(difference: Image, mask: Bytes, other: Bytes) -> Image:
    """By how much the background round a body is brighter now than in the mean: flicker, soft shade."""
    near = cv2.dilate(mask | other, np.ones((2 * RING + 1, 2 * RING + 1), np.uint8))
    ring = difference[near == 0]
    return np.median(ring, axis=0) if len(ring) else np.zeros(difference.shape[-1], dtype=np.float32)


def _sharpened(mask: Bytes, difference: Image, noise: Image, step: int) -> Bytes:
    """A mask found at reduced size, made right to the pixel."""
    near = cv2.dilate(mask, np.ones((2 * step + 1, 2 * step + 1), np.uint8))
    level = np.abs(difference).max(axis=-1)
    faint = CONTRAST_SHARES[0] * float(np.percentile(level[mask > 0], 90))
    body = (near > 0) & (level > np.maximum(faint, WEAK_SIGMAS * noise.max(axis=-1)))
    return filled_round(body.astype(np.uint8), mask)


def _sharpness(window: Window) -> float:
    """Steepness of the outline: 90th percentile of the gradient of the difference, grey levels a px."""
    level = np.abs(window.image - window.background).max(axis=-1)
    across = cv2.Sobel(level, cv2.CV_32F, 1, 0, scale=1 / 8)
    down = cv2.Sobel(level, cv2.CV_32F, 0, 1, scale=1 / 8)
    near = cv2.dilate(window.core, np.ones((3, 3), np.uint8)) > 0
    return float(np.percentile(np.hypot(across, down)[near], 90))


def touches(core: Core, thing: Core) -> bool:
    """Whether something reaching in from the edge, thick enough for a hand or an arm, is at the body."""
    if thing is core or thing.inscribed < HAND_SHARE * core.inscribed:
        return False
    reach = max(2.0, HAND_GAP * core.inscribed)
    x0, y0, x1, y1 = core.box
    a0, b0, a1, b1 = thing.box
    if a0 > x1 + reach or a1 < x0 - reach or b0 > y1 + reach or b1 < y0 - reach:
        return False
    left, top = min(x0, a0), min(y0, b0)
    canvas = np.ones((max(y1, b1) - top, max(x1, a1) - left), dtype=np.uint8)
    canvas[b0 - top : b1 - top, a0 - left : a1 - left] -= thing.mask
    away = cv2.distanceTransform(canvas, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    there = away[y0 - top : y1 - top, x0 - left : x1 - left]
    return bool(there[core.mask > 0].min() <= reach)
