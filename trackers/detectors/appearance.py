"""Objects with the colours of those that move in sampled frames; also such that have come to rest."""

from __future__ import annotations

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Detections, Detector, FrameSource, TrackOptions, with_progress
from trackers._auto.appearance import learn, search_image
from trackers._auto.candidates import sightings_of
from trackers._auto.scene import SampledScene
from trackers._detection.detect_frames import REPORT_EVERY, SAMPLES
from trackers._frames.working_image import view_of
from trackers.detectors._rows import DetectionRows

ROUGH = 0.35  # of the radius: standard error of a position by appearance alone
MAX_KINDS = 2  # of objects that are searched in addition to as many kinds as there are bodies
SPREAD = 0.3  # of the score of a body from frame to frame


def detect(video: FrameSource, options: TrackOptions) -> Detections:
    """Detect places whose colours are those of objects that move (Swain and Ballard 1991), in one pass over the clip.

    Parameters
    ----------
    video
        The clip.
    options
        ``roi`` limits the image; ``bodies`` are meant; ``progress`` is called every ten frames.

    Raises
    ------
    TrackingError
        When nothing moves in sampled frames whose appearance could be learnt.
    DataError
        When the options do not fit the clip.
    """
    scene = SampledScene(view_of(video, options), video.sample(SAMPLES))
    appearances = [learn(*sightings_of(kind, scene)) for kind in scene.kinds[: options.bodies + MAX_KINDS]]
    if not appearances:
        raise TrackingError("nothing moves in sampled frames whose appearance could be learnt; try the detector disc")
    table = DetectionRows(DETECTOR.name, (video.width, video.height))
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        table.begin(frame.index, frame.t_s)
        image = search_image(scene.view, frame)
        for number, appearance in enumerate(appearances):
            found = appearance.peaks(image)
            radius = appearance.radius * scene.view.step
            for (x, y), score in zip(found.xy, found.score, strict=True):
                evidence = {
                    "likeness": float(score),
                    "beside": float(found.score[0] - score),
                    "rank": float(number),
                    "smallness": float(np.log(table.diagonal / radius)),
                }
                place = (*scene.view.in_frame(float(x), float(y)), max(ROUGH * radius, 0.5), radius)
                table.add(place, (float(score) / SPREAD, 10.0 * number), evidence)
    return table.detections()


DETECTOR = Detector(
    name="appearance",
    summary="objects with the colours of those that move, also at rest",
    detect=detect,
)
