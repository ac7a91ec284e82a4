"""Background recomputed without the samples in which a body covers it, where a body had become background."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackers._detection.detect_frames import DetectionSetup
from trackers._detection.foreground import WEAK_FLOOR, WEAK_SIGMAS
from trackers._frames.arrays import Flags
from trackers._linking.frame_to_frame import Tracklet

MAX_SHARE = 0.4  # of the samples: a body that covers a pixel in more of them may have become background
ROUND_BODY = 1.1  # times the radius of the disc of the same area, for a disc; more for a long shape
MIN_SAMPLES = 3  # that must show the background


def refined_setup(setup: DetectionSetup, tracklets: Sequence[Tracklet]) -> DetectionSetup | None:
    """The setup with the background seen when the bodies are elsewhere; None when it shows nothing else.

    ``tracklets`` are the bodies of the first pass.
    """
    free = _free(setup, tracklets)
    if free.mean(axis=0).min() > 1 - MAX_SHARE:
        return None
    known = setup.detector.background.usable
    usable = free if known is None else free & known
    too_few = usable.sum(axis=0) < MIN_SAMPLES
    again = setup.with_background_from(usable | (too_few if known is None else too_few & known))
    return again if _shows_another(setup, again) else None


def _shows_another(setup: DetectionSetup, again: DetectionSetup) -> bool:
    """Whether the background changed enough for the first one to take a part of it for a body."""
    before, after = (model.detector.background.reduced(model.view.step).whole for model in (setup, again))
    if before is None or after is None:
        return True
    off = np.abs(after.background - before.background)
    return bool((off > np.maximum(WEAK_SIGMAS * before.noise, WEAK_FLOOR)).any())


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
