"""The motion of the background in every frame of a clip, in one pass.

Points are taken from the first frame, and from later ones (key frames) where too few of them are left in view. Each
frame finds the points of one key frame again. Afterwards positions of the points and maps of the frames are fitted in
turns: so the noise of a key frame's own image, and depth, are not taken for motion, and points that follow badly,
as those on a moving body, lose their weight.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import comb

import cv2
import numpy as np

from iris_sysid.types import Array, CameraMotion, Frame, Mask, Progress, mapped, with_progress
from iris_sysid.video.camera_motion.affine import (
    CUTOFF,
    MAD_TO_SD,
    MIN_POINTS,
    MIN_SD,
    Fit,
    first_guess,
    fitted,
)
from iris_sysid.video.camera_motion.texture import Bytes, Texture, corners, found_again, inside, texture_of

WIDEST = 960  # px: a larger image is followed at reduced size
POINTS = 300  # of a key frame
MIN_CORNERS = 2 * MIN_POINTS
LEFT = 0.6  # of a key frame's points: with fewer in view, the frame becomes a key frame
CATCH_PX = 2.0  # of the reduced image: tolerance of the first fit
PASSES = 3  # of fitting points and frames in turns
MIN_FRAMES = 5  # in which a point must be seen to be given its own place
# of the scatter of the points that all of them have in common at least: an encoder moves the whole image by quarters of
# a pixel, and interpolation shifts all points alike; on drawn walls (validation/independent/shaken_scene.py) 0.2
# without loss, 0.35 at 0.1 bits a pixel, 0.5 at 0.03. Where the camera drifts slowly these quarters last for some
# frames, and the scatter in time does not show them
COMMON = 0.35
# differences of the shift from frame to frame: such high ones do not show a hand's motion (up to 8 Hz at 30 frames/s)
ORDERS = (8, 12)
REPORT_EVERY = 10  # frames between two calls of the progress function
NEAR_PX = 30.0  # of the reduced image: how far a point may be from where the last frame had it


@dataclass(frozen=True, eq=False, slots=True)
class _KeyFrame:
    """Its image, its points (n, 2) px in it, and their numbers among all points."""

    image: Bytes
    points: Array
    numbers: slice


@dataclass(eq=False)
class Registration:
    """Points of all key frames, and where each frame has them; px of the reduced image, about its centre.

    A frame in which too few points are found keeps the motion of the one before, and ``lost`` says so.
    """

    texture: Texture
    centre: Array
    key_frames: list[_KeyFrame] = field(default_factory=list)
    reference: list[Array] = field(default_factory=list)
    used: list[int] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)
    motions: list[Array] = field(default_factory=list)
    lost: list[bool] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    before: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, first: Frame) -> Registration | None:
        """A registration to this frame; None where it has too little texture."""
        texture = texture_of(first.luma, WIDEST)
        image = texture.image(first.luma)
        height, width = image.shape
        registration = cls(texture, np.array([(width - 1) / 2, (height - 1) / 2]))
        registration._add_key_frame(image, np.eye(2, 3))
        return registration if len(registration.reference[0]) >= MIN_CORNERS else None

    def add(self, frame: Frame) -> None:
        """Follow the points into the next frame."""
        image = self.texture.image(frame.luma)
        last = self.motions[-1] if self.motions else np.eye(2, 3)
        key = self._best_key_frame(last, image)
        places, fit = self._followed(key, image, last)
        if fit is None and key != len(self.key_frames) - 1:
            key = len(self.key_frames) - 1
            places, fit = self._followed(key, image, last)
        motion = last if fit is None else fit.motion
        self.numbers.append(frame.index)
        self.used.append(key)
        self.places.append(places)
        self.motions.append(motion)
        self.lost.append(fit is None)
        if fit is not None and self._in_view(key, motion, image).mean() < LEFT:
            self._add_key_frame(image, motion)

    def _followed(self, key: int, image: Bytes, last: Array) -> tuple[Array, Fit | None]:
        """Where the points of a key frame lie in an image, and the map from the reference to it."""
        key_frame, reference = self.key_frames[key], self.reference[key]
        guess = mapped(last, reference)
        found = found_again(key_frame.image, image, key_frame.points, guess + self.centre)
        places = found - self.centre
        places[np.hypot(*(places - guess).T) > NEAR_PX] = np.nan
        places[~inside(found, image.shape)] = np.nan
        seen = np.isfinite(places).all(axis=1)
        start = first_guess(reference[seen], places[seen], CATCH_PX)
        return places, None if start is None else fitted(reference, places, start)

    def _best_key_frame(self, last: Array, image: Bytes) -> int:
        shares = [self._in_view(key, last, image).mean() for key in range(len(self.key_frames))]
        # the earliest that shows nearly as much as the best: no error adds up
        return int(np.argmax(np.array(shares) > min(LEFT, 0.9 * max(shares))))

    def _in_view(self, key: int, motion: Array, image: Bytes) -> Mask:
        return inside(mapped(motion, self.reference[key]) + self.centre, image.shape)

    def _add_key_frame(self, image: Bytes, motion: Array) -> None:
        points = corners(image, POINTS)
        start = sum(len(reference) for reference in self.reference)
        self.key_frames.append(_KeyFrame(image, points, slice(start, start + len(points))))
        self.reference.append(mapped(_inverse(motion), points - self.centre))

    def motion(self) -> CameraMotion:
        """The motion of the background, points and frames fitted in turns; px of the frames as they are."""
        weights = [np.ones(len(reference)) for reference in self.reference]
        fits: list[Fit | None] = [None] * len(self.places)
        for _ in range(PASSES):
            for k, places in enumerate(self.places):
                key = self.used[k]
                fits[k] = (
                    None if self.lost[k] else fitted(self.reference[key], places, self.motions[k], prior=weights[key])
                )
                self.motions[k] = self.motions[k] if fits[k] is None else fits[k].motion  # type: ignore[union-attr]
            for key in range(len(self.key_frames)):
                weights[key] = self._settle_points(key, fits)
        return self._to_full_size(fits)

    def _settle_points(self, key: int, fits: list[Fit | None]) -> Array:
        """Move the points of a key frame to where the frames have them on average; their weights (n,)."""
        frames = [k for k, fit in enumerate(fits) if fit is not None and self.used[k] == key]
        if len(frames) < MIN_FRAMES:
            return np.ones(len(self.reference[key]))
        away = np.array([mapped(_inverse(self.motions[k]), self.places[k]) - self.reference[key] for k in frames])
        counted = np.isfinite(away).all(axis=2).sum(axis=0) >= MIN_FRAMES
        middle, spread = np.zeros_like(self.reference[key]), np.full(len(counted), np.inf)
        middle[counted] = np.nanmedian(away[:, counted], axis=0)
        distance = np.hypot(*np.moveaxis(away[:, counted] - middle[counted], 2, 0))
        spread[counted] = np.maximum(np.nanmedian(distance, axis=0) / 1.1774, MIN_SD)
        typical = float(np.median(spread[counted])) if counted.any() else np.inf
        steady = spread < CUTOFF * typical
        if np.count_nonzero(steady) < MIN_POINTS:
            return np.ones(len(self.reference[key]))
        near = steady & (np.hypot(*middle.T) < CATCH_PX)
        self.reference[key][near] += middle[near]
        return np.where(near, (typical / np.maximum(spread, typical / 2)) ** 2, 0.0)

    def _to_full_size(self, fits: list[Fit | None]) -> CameraMotion:
        step = self.texture.step
        # the centre of the reduced image, in px of the frame
        centre = self.centre * step + (step - 1) / 2
        motions, covariances = [], []
        known = [fit.covariance for fit in fits if fit is not None]
        shifts = np.array([motion[:, 2] for motion, fit in zip(self.motions, fits, strict=True) if fit is not None])
        in_time = scatter_in_time(shifts.reshape(-1, 2))
        unknown = 100.0 * np.median(known, axis=0) if known else np.eye(6)
        for motion, fit in zip(self.motions, fits, strict=True):
            full = motion.copy()
            full[:, 2] = motion[:, 2] * step + centre - motion[:, :2] @ centre
            motions.append(full)
            covariances.append(_scaled(unknown if fit is None else _with_common(fit, in_time), step))
        early = len(self.before)
        motions = [np.eye(2, 3)] * early + motions
        covariances = [_scaled(unknown, step)] * early + covariances
        return CameraMotion(np.array(self.before + self.numbers), np.array(motions), np.array(covariances), centre)

    @property
    def lost_share(self) -> float:
        """Share of the frames in which the background was not found again."""
        return (sum(self.lost) + len(self.before)) / max(len(self.lost) + len(self.before), 1)


def scatter_in_time(shifts: Array) -> Array:
    """Standard deviation (2,) of errors of shifts (n, 2) px that are independent from frame to frame.

    By differences of high order, where a smooth motion vanishes: an error of each frame shows in one of order m
    with the variance of the sum of the squares of its binomial coefficients. Zero where there are too few frames.
    """
    if len(shifts) < 2 * ORDERS[-1]:
        return np.zeros(2)
    of_orders = [
        MAD_TO_SD * np.median(np.abs(np.diff(shifts, order, axis=0)), axis=0) / np.sqrt(comb(2 * order, order))
        for order in ORDERS
    ]
    return np.asarray(np.min(of_orders, axis=0))


def _with_common(fit: Fit, in_time: Array) -> Array:
    """Covariance (6, 6) of a frame's map with a shift of the whole image that all of its points have in common.

    Their scatter within the frame does not show that; the scatter of the frames in time, px, does.
    """
    shown = np.diag(fit.covariance)[[2, 5]]
    common = np.zeros(6)
    common[[2, 5]] = np.maximum((COMMON * fit.spread) ** 2, in_time**2 - shown)
    return np.asarray(fit.covariance + np.diag(common))


def _scaled(covariance: Array, step: int) -> Array:
    """A covariance (6, 6) of px of the reduced image in those of the frame: shifts grow, slopes do not."""
    grown = np.array([1.0, 1.0, step, 1.0, 1.0, step])
    return covariance * np.outer(grown, grown)


def _inverse(motion: Array) -> Array:
    return np.asarray(cv2.invertAffineTransform(motion))


def registered(frames: Iterable[Frame], expected: int, progress: Progress | None = None) -> Registration | None:
    """Follow the background through all frames of a clip; None where no frame has enough texture.

    Frames before the first that has (a black lead-in) count as not moved.
    """
    registration: Registration | None = None
    before: list[int] = []
    for frame in with_progress(frames, progress, expected, every=REPORT_EVERY):
        if registration is None:
            registration = Registration.of(frame)
        if registration is None:
            before.append(frame.index)
        else:
            registration.add(frame)
    if registration is not None:
        registration.before = before
    return registration
