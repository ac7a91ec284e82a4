"""Background recomputed without the samples in which a body covers it, where a body had become background."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackers._detection.detect_frames import ROUND_BODY, DetectionSetup
from trackers._frames.arrays import Flags
from trackers._linking.frame_to_frame import Tracklet


def refined_setup(setup: DetectionSetup, tracklets: Sequence[Tracklet]) -> DetectionSetup | None:
    """The setup with the background seen when the bodies are elsewhere; None when it shows nothing else.

    ``tracklets`` are the bodies as the first look gave them.
    """
    again = setup.behind(~_free(setup, tracklets))
    return again if again is not None and setup.differs_from(again) else None


def _free(setup: DetectionSetup, tracklets: Sequence[Tracklet]) -> Flags:
    """Where (k, h', w') no body is in each of the samples, at the size of the search."""
    view = setup.view
    width, height = view.search_size
    x = (np.arange(width) + 0.5) * view.width / width - 0.5 + view.left
    y = (np.arange(height) + 0.5) * view.height / height - 0.5 + view.top
    free = np.ones((len(setup.numbers), height, width), dtype=np.bool_)
    for tracklet in tracklets:
        seen = {shown.frame: shown for shown in tracklet.detections}
        for k, number in enumerate(setup.numbers):
            if number in seen:
                detection = seen[number]
                reach = ROUND_BODY * detection.radius / np.sqrt(detection.compactness) + view.step + 1
                free[k] &= (x - detection.x) ** 2 + (y[:, np.newaxis] - detection.y) ** 2 > reach**2
    return free
