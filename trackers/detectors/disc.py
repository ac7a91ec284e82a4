"""Circular outlines in single frames, by the Hough transform: needs no background, and finds what is at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Array, Detections, Detector, Frame, FrameSource, TrackOptions, with_progress
from trackers._detection.detect_frames import REPORT_EVERY
from trackers._disc.circle_detection import Search, circles
from trackers._disc.model import Disc
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes
from trackers._frames.working_image import view_of
from trackers.detectors._rows import DetectionRows

SAMPLES = 20  # frames that tell which circles stand still
ROUGH = 0.05  # of the radius: standard error of a circle's centre, at least half a pixel of the search
SPREAD = 0.1  # of the logarithm of the radius from frame to frame
SAME = 0.25  # of the radius: a circle nearer than that, in place and radius, is the same
INSIDE, AROUND = 0.8, 1.3  # radii, between which the outline lies


def detect(video: FrameSource, options: TrackOptions) -> Detections:
    """Detect circles (Yuen et al. 1990, as in OpenCV's HOUGH_GRADIENT_ALT) in every frame, in one pass over the clip.

    Parameters
    ----------
    video
        The clip.
    options
        ``roi`` limits the image; ``progress`` is called every ten frames.

    Raises
    ------
    TrackingError
        When the clip has no frame.
    DataError
        When the options do not fit the clip.
    """
    view = view_of(video, options)
    search, table = Search(view), DetectionRows(DETECTOR.name, (video.width, video.height))
    samples = [circles(search.small(view.image(frame))) for frame in video.sample(SAMPLES)]

    def seen(frame: Frame) -> tuple[Frame, Bytes, Array]:
        image = search.small(view.image(frame))
        return frame, image, circles(image)

    frames = with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY)
    for frame, image, found in ahead(seen, frames):
        table.begin(frame.index, frame.t_s)
        for circle in found:
            x, y, radius = (float(value) for value in circle)
            disc = search.enlarged(Disc(x, y, radius))
            inside, around = _levels(image, circle)
            evidence = {
                "still": still_share(circle, samples),
                "contrast": float(np.log(1 + abs(inside - around))),
                "smallness": float(np.log(table.diagonal / disc.radius)),
            }
            error = max(ROUGH * disc.radius, 0.5 * search.step)
            looks = (float(np.log(disc.radius)) / SPREAD, inside / (1 + abs(inside - around)))
            table.add((disc.x, disc.y, error, disc.radius), looks, evidence)
    return table.detections()


def still_share(circle: Array, samples: Sequence[Array]) -> float:
    """Share of some sampled frames that show a circle (3,) x, y, radius in px again; each sample is circles (k, 3)."""
    near = [bool(np.any(np.abs(found - circle).max(axis=1) < SAME * circle[2])) for found in samples if len(found)]
    return sum(near) / max(1, len(samples))


def _levels(image: Bytes, circle: Array) -> tuple[float, float]:
    """Median grey level inside of a circle (3,), px, and just around it."""
    x, y, radius = circle
    reach = AROUND * radius + 2
    top, left = max(0, int(y - reach)), max(0, int(x - reach))
    part = image[top : int(y + reach) + 2, left : int(x + reach) + 2]
    rows, columns = np.ogrid[: part.shape[0], : part.shape[1]]
    away = np.hypot(columns + left - x, rows + top - y) / radius
    inside, around = part[away < INSIDE], part[(away > 1 / INSIDE) & (away < AROUND + 1 / radius)]
    return _median(inside), _median(around)


def _median(values: Bytes) -> float:
    return float(np.median(values)) if values.size else 0.0


DETECTOR = Detector(
    name="disc",
    summary="circular outlines, also of what is at rest or comes nearer",
    detect=detect,
)
