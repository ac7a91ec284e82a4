"""What differs from the still background of a clip: compact blobs, without cords and hands."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Detections, Detector, FrameSource, TrackOptions, with_progress
from trackers._detection.detect_frames import REPORT_EVERY, detection_setup
from trackers._detection.detection import Detection
from trackers._frames.working_image import view_of
from trackers.detectors._rows import DetectionRows

ROUGH = 0.1  # of the radius: standard error of the mean position of a blob's pixels
SPREAD = np.array([0.25, 0.4, 0.4])  # of the logarithms of radius, contrast and sharpness in one body


def detect(video: FrameSource, options: TrackOptions) -> Detections:
    """Detect what differs from the median of sampled frames, in one pass over the clip.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        ``roi`` limits the image, ``colour`` the bodies; ``progress`` is called every ten frames.

    Raises
    ------
    VideoError
        When there are fewer than three frames.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    setup = detection_setup(video, view_of(video, options), coarse=True)
    table = DetectionRows(DETECTOR.name, (video.width, video.height))
    frames = with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY)
    for found in setup.search_windows().candidates(setup.detector, frames):
        table.begin(found.frame.index, found.frame.t_s)
        for seen in found.detections:
            error = max(ROUGH * seen.radius, 0.5 * setup.view.step)
            table.add((seen.x, seen.y, error, seen.radius), _looks(seen), evidence_of(seen, table.diagonal))
    return table.detections()


def evidence_of(seen: Detection, diagonal: float) -> dict[str, float]:
    """Evidence for or against a detection being a body, in an image of that diagonal, px.

    ``softness`` is the width of its outline in radii, ``darker`` and ``held`` are 0 or 1; the others are logarithms.
    """
    return {
        "elongation": -float(np.log(max(seen.compactness, 1e-3))),
        "contrast": float(np.log(max(seen.contrast, 1.0))),
        "softness": min(seen.contrast / max(seen.sharpness * seen.radius, 1e-9), 3.0),
        "darker": float(seen.brightening < 0),
        "held": float(seen.hand),
        "smallness": float(np.log(diagonal / max(seen.radius, 0.1))),
    }


def _looks(seen: Detection) -> tuple[float, ...]:
    sizes = np.log(np.maximum([seen.radius, seen.contrast, seen.sharpness], 1e-3)) / SPREAD
    return (*sizes.tolist(), 2.0 * seen.brightening / max(seen.contrast, 1e-9))


DETECTOR = Detector(
    name="motion",
    summary="what differs from the still background",
    detect=detect,
)
