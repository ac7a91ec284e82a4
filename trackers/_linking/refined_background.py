"""Background recomputed without the samples in which a body covers it, where a body had become background."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from trackers._detection.detect_frames import DetectionSetup
from trackers._detection.detection import Detection
from trackers._detection.foreground import WEAK_FLOOR, WEAK_SIGMAS, Blob, blobs
from trackers._frames.arrays import Flags
from trackers._tracklets.frame_to_frame import Tracklet

MAX_SHARE = 0.4  # of the samples: a body that covers a pixel in more of them may have become background
ROUND_BODY = 1.1  # times the radius of the disc of the same area, for a disc; more for a long shape
MIN_SAMPLES = 3  # that must show the background


def behind_resting_body(setup: DetectionSetup) -> DetectionSetup:
    """The setup with the background behind a body that rests in most samples, as far as it reaches.

    Where it leaves, the samples show a hole, which ends where the body differs little from the background. Of what is
    at a hole in a sample the largest object is the body, others its shadow.
    """
    usable = setup.detector.background.usable
    if usable is None or setup.rest is None:
        return setup
    bodies: list[Detection] = []
    for frame, image, shown in zip(setup.stack.frames, setup.search_images, usable | ~setup.rest, strict=True):
        found = blobs(setup.background_range, image)
        seen = setup.detector.candidates(frame, found, found)
        at_hole = [_covers_any(blob, ~shown) for blob in seen.blobs]
        measured = [body for body in setup.detector.each_measured(seen, at_hole, ()) if body and body.measured]
        bodies += sorted(measured, key=lambda body: body.area)[-1:]
    return _from_free(setup, _free(setup, bodies))


def _covers_any(blob: Blob, flags: Flags) -> bool:
    """Whether a blob covers any of the pixels (h, w) that a flag is set for."""
    left, top, right, bottom = blob.box
    return bool((flags[top:bottom, left:right] & (blob.mask > 0)).any())


def refined_setup(setup: DetectionSetup, tracklets: Sequence[Tracklet]) -> DetectionSetup | None:
    """The setup with the background seen when the bodies are elsewhere; None when it shows nothing else.

    ``tracklets`` are the bodies of the first pass.
    """
    bodies = [body for tracklet in tracklets for body in tracklet.detections]
    free = _free(setup, _not_left_out(setup, bodies) if len(tracklets) == 1 else bodies)
    if free.mean(axis=0).min() > 1 - MAX_SHARE:
        return None
    again = _from_free(setup, free)
    return again if _shows_another(setup, again) else None


def _not_left_out(setup: DetectionSetup, bodies: Sequence[Detection]) -> Iterator[Detection]:
    """The bodies but those at whose middle their sample is left out of the background already."""
    usable, sample = setup.detector.background.usable, {number: k for k, number in enumerate(setup.numbers)}
    for body in bodies:
        if usable is not None and body.frame in sample:
            column, row = setup.view.in_search(body.x, body.y)
            if not usable[sample[body.frame], round(row), round(column)]:
                continue
        yield body


def _from_free(setup: DetectionSetup, free: Flags) -> DetectionSetup:
    """The setup with the background from those samples (k, h', w') that are free of bodies, where there are enough."""
    known = setup.detector.background.usable
    usable = free if known is None else free & known
    too_few = usable.sum(axis=0) < MIN_SAMPLES
    return setup.with_background_from(usable | (too_few if known is None else too_few & known))


def _shows_another(setup: DetectionSetup, again: DetectionSetup) -> bool:
    """Whether the background changed enough for the first one to take a part of it for a body."""
    before, after = (model.detector.background.reduced(model.view.step).whole for model in (setup, again))
    if before is None or after is None:
        return True
    off = np.abs(after.background - before.background)
    return bool((off > np.maximum(WEAK_SIGMAS * before.noise, WEAK_FLOOR)).any())


def _free(setup: DetectionSetup, bodies: Iterable[Detection]) -> Flags:
    """Where (k, h', w') none of the bodies is in each of the samples, at the size of the search."""
    view = setup.view
    width, height = view.search_size
    x = (np.arange(width) + 0.5) * view.width / width - 0.5 + view.left
    y = (np.arange(height) + 0.5) * view.height / height - 0.5 + view.top
    sample = {number: k for k, number in enumerate(setup.numbers)}
    free = np.ones((len(sample), height, width), dtype=np.bool_)
    for body in bodies:
        if body.frame in sample:
            reach = ROUND_BODY * body.radius / np.sqrt(body.compactness) + view.step + 1
            free[sample[body.frame]] &= (x - body.x) ** 2 + (y[:, np.newaxis] - body.y) ** 2 > reach**2
    return free
