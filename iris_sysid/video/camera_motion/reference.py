"""Options and tracks, between frames of a moving camera, the canvas of its steady clip and the frame of reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import TrackingError
from iris_sysid.types import (
    Doubt,
    Frame,
    FrameSource,
    Track,
    TrackCandidate,
    Tracker,
    TrackOptions,
    TrackQuality,
    mapped,
    part_of_progress,
)
from iris_sysid.video.camera_motion.frame_edge import completed, is_whole
from iris_sysid.video.camera_motion.steady import examined
from iris_sysid.video.camera_motion.steady_video import OnCanvas, SteadyVideo
from iris_sysid.video.camera_motion.survey import CameraState

TAKEN_OUT = "taken out; positions are in px of the first frame"
NOT_MEASURED = "not measured: the background has too little texture; the camera is taken to stand still"
ALL_ALIKE = "all that has texture moves alike: taken for bodies before a plain wall, not for a camera that moves"
MIN_WHOLE = 0.6  # of the frames in which it was followed: a point that is cut more often may be the image's edge
CHECK = "check the overlay, and mark the body: --mark 1=x,y@frame"
LARGE_PX = 0.5  # of standard error: a motion known no better makes a track doubtful
REMEDY = "film with the camera on a tripod, or with a textured background in view"


@dataclass(eq=False)
class SteadyMasks(OnCanvas):
    """Masks of a clip's frames, on the canvas of its steady clip: 0 where a frame does not reach."""

    def _steady(self, frame: Frame) -> Frame:
        moved = self.canvas.map_to(self.motion.of(np.array([frame.index]))[0])
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        luma = np.asarray(cv2.warpAffine(frame.luma, moved, (self.width, self.height), flags=flags), dtype=np.uint8)
        return replace(frame, luma=luma, bgr=lambda: np.repeat(luma[..., None], 3, axis=2), chroma=lambda: None)


def tracked(video: FrameSource, tracker: Tracker, options: TrackOptions) -> list[Track]:
    """The tracks of a clip by a tracker that takes the camera to stand still; in px of the first frame where it moves.

    ``origin["camera_motion"]`` says what was done, and a motion that is not known makes the tracks doubtful.
    """
    camera = examined(video, part_of_progress(options.progress, 0, 2))
    second_half = replace(options, progress=part_of_progress(options.progress, 1, 2))
    if camera.steady is not None:
        steady = camera.steady
        with suppress(TrackingError):  # nothing moves any more: what was taken for the background are the bodies
            return [in_reference(body, steady) for body in tracker.track(steady, on_canvas(second_half, steady))]
        return [_doubted(body, ALL_ALIKE) for body in tracker.track(video, second_half)]
    tracks = tracker.track(video, options)
    if camera.state is CameraState.MOVING:
        return [_doubted(body, "the camera moves, and its motion could not be measured") for body in tracks]
    if camera.state is CameraState.UNKNOWN:
        return [replace(body, origin={**body.origin, "camera_motion": NOT_MEASURED}) for body in tracks]
    return tracks


def _doubted(track: Track, finding: str, remedy: str = REMEDY) -> Track:
    quality = track.quality or TrackQuality()
    return replace(track, quality=quality.with_doubts(Doubt("moving-camera", finding, remedy)))


def on_canvas(options: TrackOptions, steady: SteadyVideo) -> TrackOptions:
    """The options of a clip for its steady clip; the region is one of the first frame, a mark one of its own frame."""
    canvas, roi = steady.canvas, options.roi
    marks = []
    for mark in options.marks:
        back = cv2.invertAffineTransform(canvas.map_to(steady.motion.of(np.array([mark.frame]))[0]))
        x_px, y_px = mapped(back, np.array([[mark.x_px, mark.y_px]]))[0]
        marks.append(replace(mark, x_px=float(x_px), y_px=float(y_px)))
    return replace(
        options,
        roi=None if roi is None else (roi[0] - canvas.left, roi[1] - canvas.top, roi[2], roi[3]),
        mask=None if options.mask is None else SteadyMasks(options.mask, steady.motion, canvas),
        marks=tuple(marks),
        explain=None if options.explain is None else partial(_explained, options.explain, steady),
    )


def _explained(
    explain: Callable[[Sequence[TrackCandidate]], None], steady: SteadyVideo, candidates: Sequence[TrackCandidate]
) -> None:
    """Hand candidates on with their tracks in px of the first frame."""
    explain([replace(one, tracks=tuple(in_reference(body, steady) for body in one.tracks)) for one in candidates])


def in_reference(track: Track, steady: SteadyVideo) -> Track:
    """A track of the steady clip in px of the first frame, with the motion and its error.

    Where the edge of its own frame cuts the body, the pixels beyond were put there: the part that is seen gives its
    position, or the sample is a gap.
    """
    canvas, size, to_frame = steady.canvas, (steady.video.width, steady.video.height), steady.motion.of(track.frame)
    seen_px = track.xy_px + np.array([canvas.left, canvas.top])
    whole = is_whole(seen_px, track, to_frame, size)
    xy_px, of_cut, known = completed(seen_px, track, to_frame, size, whole)
    of_motion = steady.motion.sigma(track.frame, xy_px)
    gap = ~known[:, np.newaxis]
    moved = replace(
        track,
        xy_px=np.where(gap, np.nan, xy_px),
        sigma_px=np.where(gap, np.nan, np.hypot(np.hypot(track.sigma_px, of_motion), of_cut[:, np.newaxis])),
        valid=track.valid & known,
        camera_motion=to_frame,
        origin={**track.origin, "camera_motion": TAKEN_OUT},
    )
    kept = float(np.mean(whole[track.valid])) if track.n_valid else 0.0
    if kept < MIN_WHOLE:
        return _doubted(moved, f"the edge of the image cuts what is followed in {1 - kept:.0%} of its frames", CHECK)
    typical = float(np.median(of_motion[moved.valid])) if moved.n_valid else 0.0
    if typical > LARGE_PX:
        return _doubted(moved, f"the motion of the camera is known to {typical:.1f} px only")
    return moved


def seen_from_first(frame: Frame, body: Track) -> NDArray[np.uint8]:
    """A frame (h, w, 3) uint8 BGR as the first frame's view shows it, by the camera motion of a track of its clip."""
    image = frame.bgr()
    if body.camera_motion is None:
        return image
    row = int(np.clip(np.searchsorted(body.frame, frame.index, side="right") - 1, 0, body.frame.size - 1))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    size = (image.shape[1], image.shape[0])
    moved = cv2.warpAffine(image, body.camera_motion[row], size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.uint8)
