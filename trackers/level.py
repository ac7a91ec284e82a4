"""Height of a liquid's surface in a vessel that drains or fills: the row between two appearances of the image.

The region that the surface sweeps is found by its change over frames sampled from the clip. They show each part
of it above the surface and below it, marks and reflections included. In every frame, the surface is where the one
appearance gives way to the other, to a fraction of a pixel, in strips side by side. A line is fitted through the
strips: the meniscus at the walls does not count, and the surface may be tilted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import (
    Array,
    Frame,
    FrameSource,
    Track,
    Tracker,
    TrackerExample,
    TrackOptions,
    check_count,
    with_progress,
)
from trackers._frames.working_image import WorkingView, view_of
from trackers._regions.liquid_surface import STRIPS, WALL, WINDOW, Vessel, rough_levels, surface_of, vessel_of
from trackers._uncertainty.local_polynomial import excess_scatter, pooled

SAMPLES = 40  # frames from which both appearances are learned
ROUNDS = 2  # in which levels and appearances are found in turn
REPORT_EVERY = 10  # frames between two calls of the progress function


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Find the surface in every frame.

    Parameters
    ----------
    video
        The clip; its camera and the vessel stand still, and the surface rises or falls.
    options
        ``bodies`` must be 1, ``roi`` limits the image, ``progress`` is called every ten frames; no ``colour`` is taken.

    Returns
    -------
    list of Track
        The position is the point of the surface midway between the walls: its y is the level. Its x is the same in
        all frames. A frame in which the surface has left the image is a gap.

    Raises
    ------
    TrackingError
        When no surface moves, or it is in the image in no frame.
    VideoError
        When there are fewer than three frames.
    DataError
        When the options do not fit the clip.
    """
    view = view_of(video, options)
    if options.bodies != 1 or options.colour is not None:
        raise DataError("the tracker level follows one surface and takes no colour; choose the vessel with --roi")
    samples = video.sample(SAMPLES)
    check_count(len(samples), "a moving surface")
    strips = _strips_of(view, vessel_of(np.stack([view.search_image(frame) for frame in samples])))
    stack = np.stack([strips.means(frame) for frame in samples])
    levels = strips.swept.start + rough_levels(stack[:, strips.swept].mean(axis=2))
    for _ in range(ROUNDS):
        surface = surface_of(stack, levels, strips.x)
        rows_found = np.array([surface.level(sample)[0] for sample in stack])
        levels = np.where(np.isfinite(rows_found), rows_found, levels)
    times, rows = list[tuple[int, float]](), list[tuple[float, float]]()
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        times.append((frame.index, frame.t_s))
        rows.append(surface.level(strips.means(frame)))
    return [_track_of(times, np.array(rows), strips, options)]


@dataclass(frozen=True, eq=False, slots=True)
class _Strips:
    """A part of the frame divided into strips: its rows, the edges (strips + 1,) of its columns, px of the frame.

    ``swept`` are the rows, from the first, that the surface sweeps; ``middle`` is midway between the walls.
    """

    rows: slice
    edges: Array
    swept: slice
    middle: float

    @property
    def x(self) -> Array:
        """Middles (strips,) of the strips, px from midway between the walls."""
        return np.asarray((self.edges[:-1] + self.edges[1:] - 1) / 2 - self.middle)

    def means(self, frame: Frame) -> Array:
        """Mean grey level of each row of each strip (rows, strips)."""
        edges = self.edges.astype(np.intp)
        part = frame.luma[self.rows, edges[0] : edges[-1]].astype(np.float32)
        sums = np.add.reduceat(part, edges[:-1] - edges[0], axis=1)
        return np.asarray(sums / np.diff(edges), dtype=np.float64)


def _strips_of(view: WorkingView, vessel: Vessel) -> _Strips:
    """The strips of a vessel found at the size of the search, with room above and below."""
    step = view.step
    left, right = view.left + vessel.left * step, view.left + vessel.right * step
    top, bottom = view.top + vessel.top * step, view.top + vessel.bottom * step
    first, last = max(view.top, top - 2 * WINDOW), min(view.top + view.height, bottom + 2 * WINDOW)
    wall = WALL * (right - left)
    count = min(STRIPS, int(right - left - 2 * wall))
    return _Strips(
        rows=slice(first, last),
        edges=np.rint(np.linspace(left + wall, right - wall, count + 1)),
        swept=slice(top - first, bottom - first),
        middle=(left + right - 1) / 2,
    )


def _track_of(times: list[tuple[int, float]], measured: Array, strips: _Strips, options: TrackOptions) -> Track:
    row, sigma = measured.T
    t_s, valid = np.array([time for _, time in times]), np.isfinite(row)
    if not valid.any():
        raise TrackingError("the surface is in the image in no frame; give a taller region with --roi")
    sigma[valid] = pooled(sigma[valid])
    sigma[valid] *= excess_scatter(t_s[valid], row[valid], sigma[valid])
    across = float(np.diff(strips.edges).mean() / np.sqrt(12))  # the walls are known to a strip or so
    return Track(
        t_s=t_s,
        xy_px=np.column_stack([np.where(valid, strips.middle, np.nan), row + strips.rows.start]),
        sigma_px=np.column_stack([np.where(valid, across, np.nan), sigma]),
        valid=valid,
        frame=np.array([index for index, _ in times]),
        origin={
            "tracker": TRACKER.name,
            "bodies": options.bodies,
            "roi": options.roi,
            "colour": options.colour,
            "walls_px": [float(strips.edges[0]), float(strips.edges[-1])],
        },
    )


TRACKER = Tracker(
    name="level",
    summary="height of a liquid's surface in a vessel that drains or fills",
    track=track,
    example=TrackerExample("draining-vessel", tolerance_px=2.0),
)
