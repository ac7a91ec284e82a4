"""A quick fit of a long clip: every n-th frame, as far as these still show the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from iris_sysid.review.corrected_tracks import PER_FRAME
from iris_sysid.types import Track

MAX_FRAMES = 400  # a fit of these takes about half a second
POWER = 0.99  # of the motion, that lies below the highest frequency that has to be shown
PER_PERIOD = 8  # samples of the highest frequency


def thinned(tracks: Sequence[Track]) -> tuple[list[Track], int]:
    """At most MAX_FRAMES frames of the tracks, and of how many frames each is one.

    Every n-th frame is taken, with n so small that the highest frequency of the motion keeps eight samples a period
    (the frequency below which 99 % of the power of x and y lies); of a faster motion the frames in the middle of the
    clip. Short tracks come back as they are, with 1.
    """
    frames = tracks[0].t_s.size
    if frames <= MAX_FRAMES:
        return list(tracks), 1
    needed = -(-frames // MAX_FRAMES)
    step = max(1, min(needed, *(_largest_step(track) for track in tracks)))
    first = max(0, (frames - step * MAX_FRAMES) // 2)
    rows = slice(first, first + step * MAX_FRAMES, step)
    return [_rows(track, rows) for track in tracks], step


def _largest_step(track: Track) -> int:
    """The largest n for which every n-th frame shows the motion of the body."""
    found = np.flatnonzero(track.valid)
    if found.size < 2:
        return 1
    rows = np.arange(found[0], found[-1] + 1)
    power = np.zeros(rows.size // 2 + 1)
    for positions in track.xy_px.T:
        filled = np.interp(rows, found, positions[found])
        trend = np.linspace(filled[0], filled[-1], filled.size)  # else the two ends leap
        power += np.square(np.abs(np.fft.rfft((filled - trend) * np.hanning(filled.size))))
    below = np.cumsum(power) / max(float(power.sum()), np.finfo(float).tiny)
    highest = int(np.searchsorted(below, POWER)) / rows.size  # cycles a frame
    return max(1, int(1 / (PER_PERIOD * highest))) if highest > 0 else rows.size


def _rows(track: Track, rows: slice) -> Track:
    chosen: dict[str, Any] = {
        name: getattr(track, name)[rows]
        for name in (*PER_FRAME, "t_s", "frame", "camera_motion")
        if getattr(track, name) is not None
    }
    patterns = {source: pattern[:, rows] for source, pattern in track.intensity_patterns.items()}
    return replace(track, **chosen, intensity_patterns=patterns)
