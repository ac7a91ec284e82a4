"""The frames of a clip with the motion of its camera taken out, where it moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.types import CameraMotion, FrameSource, Progress, mapped
from iris_sysid.video.camera_motion.registration import registered
from iris_sysid.video.camera_motion.steady_video import MAX_SAMPLES, SteadyCanvas, SteadyVideo
from iris_sysid.video.camera_motion.survey import CameraState, survey

SAMPLES = 40  # frames: as many as the trackers sample, so that they are decoded once
MIN_SAMPLES = 3
MAX_LOST = 0.5  # of the frames: with more, the motion is not known
CLEAR = 3.0  # standard errors: a camera that moves less stands still


@dataclass(frozen=True, eq=False, slots=True)
class CameraReport:
    """What is known of a clip's camera; ``steady`` is None where it stands still or its motion is not measured."""

    state: CameraState
    steady: SteadyVideo | None = None


def examined(video: FrameSource, progress: Progress | None = None) -> CameraReport:
    """Whether the camera of a clip moves, and the clip as a camera that stands still would show it where it does.

    Sampled frames tell whether the camera moves. Where it does, one pass over the clip registers every frame to
    the first by points of the background (Lucas and Kanade 1981), whose coordinates all positions then have.

    Parameters
    ----------
    video
        The clip.
    progress
        Called with (frames done, frames expected) while the motion is estimated.

    Returns
    -------
    CameraReport
        Without a steady clip where the camera stands still, or where the background has too little texture to say; else
        px are those of the first frame but for the corner of its ``canvas``.
    """
    samples = video.sample(SAMPLES)
    if len(samples) < MIN_SAMPLES:
        return CameraReport(CameraState.UNKNOWN)
    state = survey(samples).state
    if state is not CameraState.MOVING:
        return CameraReport(state)
    registration = registered(video.frames(), video.n_expected, progress)
    if registration is None or registration.lost_share > MAX_LOST:
        return CameraReport(CameraState.MOVING)
    motion = registration.motion()
    if not _clear(motion):
        return CameraReport(CameraState.STILL)
    few = [samples[k] for k in np.unique(np.linspace(0, len(samples) - 1, MAX_SAMPLES).astype(int))]
    return CameraReport(state, SteadyVideo(video, motion, SteadyCanvas.of(motion, video.width, video.height), few))


def _clear(motion: CameraMotion) -> bool:
    """Whether the image moves by more than the standard error of its motion."""
    centre = np.tile(motion.centre_px, (motion.frame.size, 1))
    moved = mapped(motion.to_frame, centre) - centre
    away = np.hypot(*(moved - np.median(moved, axis=0)).T)
    sigma = np.hypot(*motion.sigma(motion.frame, centre).T)
    return bool(np.sqrt(np.mean(away**2)) > CLEAR * np.median(sigma))
