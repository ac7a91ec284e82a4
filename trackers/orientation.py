"""Orientation of a body that turns about an axis that stands still: an arm with a cup, a disc with a mark.

A first pass follows the angle roughly, by the foreground in polar coordinates. Frames sampled over the clip then give
the template of the body and the position of the axis, in turn; a second pass finds the angle at which the template
matches each frame. All is done at the size of the search, at most 960 px wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import (
    Array,
    FrameSource,
    Track,
    Tracker,
    TrackerExample,
    TrackOptions,
    part_of_progress,
    with_progress,
)
from trackers._detection.detect_frames import DetectionSetup, detection_setup
from trackers._frames.arrays import Image
from trackers._frames.working_image import view_of
from trackers._regions.rotation_axis import Axis, Middle, RotationFollower, activity, axis_of, middle_of
from trackers._regions.rotation_template import Pattern, centred, learn_pattern, luma_of, match_rotation
from trackers._uncertainty.local_polynomial import excess_scatter, persistent, pooled

BLURS = (6.0, 3.0, 1.5, 0.7, 0.7)  # px, from rough to fine: how far off the angles may be before each
MIN_TURN = 0.03  # rad: a smaller rotation cannot be distinguished from shaking
EXPLAINED = 0.5  # of the changing pixels must turn with the body
SHOWN = 0.4  # of the points of the body must show it in a frame
MAX_ERROR = 0.1  # rad
REPORT_EVERY = 10  # frames between two calls of the progress function


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the orientation of the body that turns, over full turns, in every frame.

    Parameters
    ----------
    video
        The clip; its camera and the axis stand still, and the body turns by less than a quarter between two frames.
    options
        ``bodies`` must be 1, ``roi`` limits the image, ``colour`` makes colour count where bodies are searched,
        ``progress`` is called every ten frames.

    Returns
    -------
    list of Track
        ``angle_rad`` is the direction from the axis to the middle of the body, anticlockwise from the right, counted
        on through full turns, and ``sigma_angle_rad`` its standard error without that of the zero, which all frames
        share. The position is that middle. ``origin["axis_px"]`` is the axis.

    Raises
    ------
    TrackingError
        When nothing turns, or the moving body does not turn about a point in the image.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    view = view_of(video, options)
    if options.bodies != 1:
        raise DataError(f"bodies = {options.bodies}: the tracker orientation follows one body; choose it with --roi")
    setup = detection_setup(video, view)
    shown = [activity(setup.background_range, image) for image in setup.search_images]
    axis = axis_of(shown)
    clip = _roughly(video, setup, axis, options)
    if np.ptp(clip.angle) < MIN_TURN:
        raise TrackingError(
            f"the moving body does not rotate: its angle varies by {np.degrees(np.ptp(clip.angle)):.2g} degrees over "
            "the clip; choose another tracker, or another part of the clip"
        )
    learned = _learn_template(setup, axis, clip.angle[clip.places(setup)])
    better = clip.angle + np.interp(clip.number, setup.numbers, learned.angles - clip.angle[clip.places(setup)])
    measured = _finely(video, setup, learned.pattern, better, options)
    return [_track_of(clip, measured, learned, middle_of(shown, learned.pattern.axis, learned.angles), setup, options)]


@dataclass(frozen=True, eq=False, slots=True)
class _Clip:
    """Numbers (n,) and times (n,) s of the frames of a clip, and the angle (n,) rad in each to a few degrees."""

    number: NDArray[np.int64]
    t_s: Array
    angle: Array

    def places(self, setup: DetectionSetup) -> NDArray[np.intp]:
        """Where among the frames those are that were sampled."""
        return np.searchsorted(self.number, np.array(setup.numbers))


@dataclass(frozen=True, eq=False, slots=True)
class _LearnedTemplate:
    """The appearance of the body, and the angles (k,) rad of the sampled frames from which it was learned."""

    pattern: Pattern
    angles: Array


def _roughly(video: FrameSource, setup: DetectionSetup, axis: Axis, options: TrackOptions) -> _Clip:
    turns, numbers, times, spokes = RotationFollower(axis), list[int](), list[float](), list[float]()
    first_half = part_of_progress(options.progress, 0, 2)
    for frame in with_progress(video.frames(), first_half, video.n_expected, every=REPORT_EVERY):
        numbers.append(frame.index)
        times.append(frame.t_s)
        spokes.append(turns.follow(activity(setup.background_range, setup.view.search_image(frame))))
    return _Clip(np.array(numbers), np.array(times), np.radians(spokes))


def _learn_template(setup: DetectionSetup, axis: Axis, angles: Array) -> _LearnedTemplate:
    """Learn appearance, angles and axis from the sampled frames, from rough to fine."""
    small = [luma_of(image) for image in setup.search_images]
    for blur in BLURS:
        images = [_blurred(image, blur) for image in small]
        pattern = learn_pattern(images, angles, axis).telling()
        fits = [match_rotation(pattern, image, angle, loose=True) for image, angle in zip(images, angles, strict=True)]
        angles = np.array([fit.angle for fit in fits])
        axis = centred(axis, angles, np.array([fit.shift for fit in fits]))
    pattern = learn_pattern(images, angles, axis)
    _check_turns(pattern, images)
    return _LearnedTemplate(pattern.telling(), angles)


def _blurred(image: Image, sigma: float) -> Image:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), dtype=np.float32)


def _check_turns(pattern: Pattern, images: Sequence[Image]) -> None:
    """TrackingError when the changing pixels do not turn with the pattern."""
    axis = pattern.axis
    rows = np.clip(np.rint(pattern.offset[:, 1] + axis.y), 0, images[0].shape[0] - 1).astype(int)
    columns = np.clip(np.rint(pattern.offset[:, 0] + axis.x), 0, images[0].shape[1] - 1).astype(int)
    standing = np.stack([image[rows, columns] for image in images]).var(axis=0)
    explained = 1 - float((pattern.spread**2).sum() / max(float(standing.sum()), 1e-9))
    if explained < EXPLAINED:
        raise TrackingError(
            f"the moving body does not rotate about a point in the image: rotation explains {max(explained, 0.0):.0%} "
            "of the change; restrict the region with --roi, or use the tracker median-background"
        )


def _finely(video: FrameSource, setup: DetectionSetup, pattern: Pattern, start: Array, options: TrackOptions) -> Array:
    """Angle and standard error (n, 2), rad, in every frame; NaN where the body does not show."""
    rows: list[tuple[float, float]] = []
    frames = with_progress(video.frames(), part_of_progress(options.progress, 1, 2), len(start), every=REPORT_EVERY)
    for frame, angle in zip(frames, start, strict=True):
        fit = match_rotation(pattern, _blurred(luma_of(setup.view.search_image(frame)), BLURS[-1]), float(angle))
        seen = fit.share > SHOWN and fit.sigma < MAX_ERROR
        rows.append((fit.angle, fit.sigma) if seen else (np.nan, np.nan))
    return np.array(rows)


def _track_of(
    clip: _Clip,
    measured: Array,
    learned: _LearnedTemplate,
    middle: Middle,
    setup: DetectionSetup,
    options: TrackOptions,
) -> Track:
    angle, sigma = measured.T
    valid = np.isfinite(angle)
    if not valid.any():
        raise TrackingError("no frame shows the rotating body as it was learned; restrict the region with --roi")
    sigma[valid] = pooled(sigma[valid])
    sigma[valid] = persistent(sigma[valid] * excess_scatter(clip.t_s[valid], angle[valid], sigma[valid]))
    view, axis = setup.view, learned.pattern.axis
    axis_px = (np.array([axis.x, axis.y]) + 0.5) * view.step - 0.5 + np.array([view.left, view.top])
    way = view.step * middle.radius
    along = np.column_stack([np.cos(angle + middle.direction), -np.sin(angle + middle.direction)])
    return Track(
        t_s=clip.t_s,
        xy_px=axis_px + way * along,
        sigma_px=np.repeat(np.hypot(way * sigma, view.step * middle.sigma)[:, np.newaxis], 2, axis=1),
        valid=valid,
        frame=clip.number,
        angle_rad=angle + middle.direction,
        sigma_angle_rad=sigma,
        origin={
            "tracker": TRACKER.name,
            "bodies": options.bodies,
            "roi": options.roi,
            "colour": options.colour,
            "axis_px": [float(coordinate) for coordinate in axis_px],
            "reach_px": view.step * axis.reach,
        },
    )


TRACKER = Tracker(
    name="orientation",
    summary="orientation of a body that turns about a fixed axis, such as an arm or a marked disc",
    track=track,
    example=TrackerExample("turning-arm", tolerance_px=4.0),
)
