"""The brightness of something that stays where it is, such as an LED: mean grey level of the region that changes.

The region is found by its change: its pixels share one time series. Grey levels are reported as the video codes
them. Cameras code them with a gamma curve, so that light which decays as exp(-t/tau) decays in grey levels about as
exp(-t/(2.2 tau)): :func:`linear_light` undoes sRGB's curve where the camera is known to use it. Video of limited range
(16 to 235) is left as it is; subtract 16 and divide by 219 before undoing the curve.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Frame, FrameSource, Track, Tracker, TrackerExample, TrackOptions, with_progress
from trackers._frames.working_image import View, view_of
from trackers._regions.covarying_region import Region, region_that_changes
from trackers._regions.lamp_brightness import Lamp, lamp_of, luma_of
from trackers._uncertainty.local_polynomial import excess_scatter, persistent, pooled

SAMPLES = 40  # frames in which the region is sought
FEWEST_FRAMES = 3
LEAST_EXPLAINED = 0.8  # of the changing pixels must follow the time series of the region
SLOW = 45  # frames on either side: compression is late over so many, while the light fades smoothly
REPORT_EVERY = 10  # frames between two calls of the progress function


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Measure the brightness of the region that changes most, in every frame.

    Parameters
    ----------
    video
        The clip; its camera and its light sources do not move.
    options
        ``bodies`` is the number of regions, ``roi`` limits the image, ``colour`` limits the regions to one colour,
        ``progress`` is called now and then.

    Returns
    -------
    list of Track
        ``intensity`` is the mean grey level of the region and ``sigma_intensity`` its standard error: noise measured
        in each frame by how the pixels differ from what the common time series predicts, and how far that
        scatters about a smooth one (flicker, compression); ``origin["scatter"]`` is the factor that this adds. The
        position is the middle of the change, the same in all frames, and ``area_px`` the size of the region.
        ``origin["clipped"]`` is the share of the region that is cut off at black or white in some frame: pixels that
        are cut off are used only when there are no others.

    Raises
    ------
    TrackingError
        When nothing changes its brightness, fewer regions than requested do, or the changing region moves.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    view = view_of(video, options)
    samples = video.sample(SAMPLES)
    if len(samples) < FEWEST_FRAMES:
        raise TrackingError(f"the clip has {len(samples)} frame(s); a change of brightness takes at least 3")
    lamps = [lamp_of(region, view, samples) for region in _regions(view, samples, options)]
    times: list[tuple[int, float]] = []
    readings: list[list[tuple[float, float]]] = [[] for _ in lamps]
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        times.append((frame.index, frame.t_s))
        for lamp, values in zip(lamps, readings, strict=True):
            values.append(lamp.reading(luma_of(view, frame)))
    return [
        _track_of(str(number), times, np.array(values), lamp, options)
        for number, (lamp, values) in enumerate(zip(lamps, readings, strict=True), start=1)
    ]


def linear_light(grey: Array) -> Array:
    """Light, 0 to 1, of sRGB ``grey`` levels of full range (0 to 255), element by element.

    Any shape, such as (h, w); light is dimensionless.

    IEC 61966-2-1: c/12.92 up to c = 0.04045, else ((c + 0.055)/1.055)^2.4, with c = grey/255.
    """
    c = np.asarray(grey, dtype=np.float64) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((np.maximum(c, 0.0) + 0.055) / 1.055) ** 2.4)


def _regions(view: View, samples: Sequence[Frame], options: TrackOptions) -> list[Region]:
    """The requested number of regions, found at the size of the search, strongest change first."""
    stack = np.stack([view.small(luma_of(view, frame)) for frame in samples])
    free = np.ones(stack.shape[1:], dtype=np.bool_)
    if view.colour is not None:
        free = np.any(np.stack([np.asarray(view.colour_mask(frame)) for frame in samples]), axis=0)
    regions: list[Region] = []
    while len(regions) < options.bodies:
        region = region_that_changes(stack, free)
        if region is None:
            raise TrackingError(_too_few(len(regions), options.bodies))
        if region.explained_share < LEAST_EXPLAINED:
            raise TrackingError(
                f"the region does not change as a whole: only {region.explained_share:.0%} of the change follows "
                "the region that changes most, as when something moves; restrict the region with --roi, or use "
                "another tracker"
            )
        regions.append(region)
        free = free & ~region.mask
    return regions


def _too_few(count: int, requested: int) -> str:
    if count == 0:
        return (
            "nothing in the clip changes its brightness beyond the noise of the image; "
            "check --start and --stop, and --roi and --colour if given"
        )
    return f"{requested} regions were asked for, but only {count} change(s) its brightness; ask for fewer bodies"


def _track_of(
    body: str, times: Sequence[tuple[int, float]], readings: Array, lamp: Lamp, options: TrackOptions
) -> Track:
    """The Track of one region; ``readings`` (n, 2) are its intensity and standard error."""
    intensity, sigma = readings.T
    n, t_s = len(times), np.array([t_s for _, t_s in times])
    sigma = pooled(sigma)
    scatter = excess_scatter(t_s, intensity, sigma, SLOW)
    return Track(
        t_s=t_s,
        xy_px=np.tile(lamp.centre, (n, 1)),
        sigma_px=np.tile(lamp.sigma_centre, (n, 1)),
        valid=np.ones(n, dtype=np.bool_),
        frame=np.array([index for index, _ in times]),
        body=body,
        intensity=intensity,
        sigma_intensity=persistent(sigma * scatter),
        area_px=np.full(n, float(np.count_nonzero(lamp.mask))),
        origin={
            "tracker": TRACKER.name,
            "bodies": options.bodies,
            "roi": options.roi,
            "colour": options.colour,
            "clipped": lamp.clipped,
            "scatter": float(np.median(scatter)),
            "encoding": "grey levels as coded; gamma not undone",
        },
    )


TRACKER = Tracker(
    name="intensity",
    summary="brightness of the region that changes most, such as an LED",
    track=track,
    example=TrackerExample("fading-lamp"),
)
