"""The light of something that stays where it is, such as an LED: mean linear light of the region that changes.

The region is found by its change: its pixels share one time series. Cameras code light with a curve, about the power
1/2.2, so that light which decays as exp(-t/tau) decays in grey levels about as exp(-t/(2.2 tau)). The curve is undone
in each pixel and colour channel before the mean is taken: by the file's tag, or as the user says. Where neither is
given, sRGB's curve is assumed with a wide uncertainty: grey levels would be wrong by more, with a smaller error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import (
    Array,
    Doubt,
    Frame,
    FrameSource,
    Mask,
    Track,
    Tracker,
    TrackerExample,
    TrackOptions,
    TrackQuality,
    Transfer,
    assumed_transfer,
    check_count,
    transfer_tagged,
    with_progress,
)
from trackers._frames.working_image import WorkingView, view_of
from trackers._regions.compression_lag import Lag, lag_of
from trackers._regions.covarying_region import Region, region_that_changes
from trackers._regions.exposure import BackgroundLight, Exposure, background_of, exposure_of
from trackers._regions.lamp_brightness import MAX_CUT, Lamp, Reading, lamp_of, luma_of
from trackers._regions.linear_light import linear_light
from trackers._uncertainty.local_polynomial import excess_scatter, persistent, pooled

SAMPLES = 40  # frames in which the region is sought
MIN_EXPLAINED = 0.8  # of the changing pixels must follow the time series of the region
SLOW = 45  # frames on either side over which the lag of compression lasts, while the light fades smoothly
REPORT_EVERY = 10  # frames between two calls of the progress function
WHITE = 0.98  # of the range: brighter pixels may be cut off
TRANSFER, LAG, EXPOSURE = "transfer function", "compression lag", "exposure"


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Measure the light of the region that changes most, in every frame.

    Parameters
    ----------
    video
        The clip; its camera and its light sources do not move.
    options
        ``bodies`` is the number of regions, ``roi`` limits the image, ``colour`` limits the regions to one colour,
        ``transfer`` is the camera's curve, ``progress`` is called every ten frames.

    Returns
    -------
    list of Track
        ``intensity`` is the mean light of the region, 1 at white, by the curve ``transfer``; ``sigma_intensity`` its
        standard error: noise measured in each frame by how the pixels differ from what the common time series
        predicts, and how far that scatters about a smooth one (flicker, compression); ``origin["scatter"]`` is the
        factor that this adds. ``intensity_patterns`` holds the errors that all samples share: of the curve, of the
        lag of compression, which is measured at key frames and taken out, and of a changed exposure. The
        position is the middle of the change, the same in all frames, and ``area_px`` the size of the region.
        ``origin["clipped"]`` is the share of the region that is cut off at white in some frame: pixels that are cut
        off are used only when all are, and a frame that cuts them off is then a gap. ``quality`` has
        doubts where the curve is assumed, the region was cut off, or the exposure changed.

    Raises
    ------
    TrackingError
        When nothing changes its brightness, fewer regions than requested do, the changing region moves, or it is cut
        off at white throughout.
    VideoError
        When there are fewer than three frames.
    DataError, UnknownNameError
        When the options do not fit the clip, the file's tag names a curve that is not known, or a colour is unknown.
    """
    view = view_of(video, options)
    samples = video.sample(SAMPLES)
    check_count(len(samples), "a change of brightness")
    transfer = transfer_of(samples[0], options)
    curve = linear_light(transfer, samples[0].coding.span)
    regions = _regions(view, samples, options)
    lamps = [lamp_of(region, view, samples, curve) for region in regions]
    mask = np.any([region.mask for region in regions], axis=0)
    series = _read(video, options, lamps, background_of(view, samples, mask, curve))
    return [
        _track_of(str(number), series, number - 1, lamp, transfer, options)
        for number, lamp in enumerate(lamps, start=1)
    ]


def transfer_of(frame: Frame, options: TrackOptions) -> Transfer:
    """The curve to undo: as the user says, else by the file's tag, else assumed; DataError for an unknown tag."""
    if options.transfer is not None:
        return options.transfer
    tag = frame.coding.transfer
    tagged = transfer_tagged(tag)
    if tag and tagged is None:
        raise DataError(
            f"the file states a transfer function that is not known here ({tag}); state the camera's with --transfer"
        )
    return tagged or assumed_transfer()


@dataclass(frozen=True, eq=False, slots=True)
class _Series:
    """Times (n,), frame numbers (n,), key frames (n,), readings (n, lamps), light of the background (n,) or None.

    ``noise`` is the standard error of the background's light over itself.
    """

    t_s: Array
    index: NDArray[np.int64]
    key: Mask
    readings: Sequence[Sequence[Reading]]
    background: Array | None
    noise: float


def _read(
    video: FrameSource, options: TrackOptions, lamps: Sequence[Lamp], background: BackgroundLight | None
) -> _Series:
    stamps: list[tuple[int, float, bool]] = []
    readings: list[list[Reading]] = []
    still: list[float] = []
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        stamps.append((frame.index, frame.t_s, frame.key))
        readings.append([lamp.reading(frame) for lamp in lamps])
        if background is not None:
            still.append(background.light(frame))
    index, t_s, key = zip(*stamps, strict=True)
    noise = 0.0 if background is None else background.noise
    return _Series(np.array(t_s), np.array(index), np.array(key), readings, np.array(still) if still else None, noise)


def _regions(view: WorkingView, samples: Sequence[Frame], options: TrackOptions) -> list[Region]:
    """The requested number of regions, found at the size of the search, strongest change first."""
    stack = np.stack([view.small(luma_of(view, frame)) for frame in samples])
    free = np.ones(stack.shape[1:], dtype=np.bool_)
    if view.colour is not None:
        free = np.any(np.stack([np.asarray(view.colour_mask(frame)) for frame in samples]), axis=0)
    coding = samples[0].coding
    cut_off = (coding.black + 2.0, coding.black + WHITE * coding.span)
    regions: list[Region] = []
    while len(regions) < options.bodies:
        region = region_that_changes(stack, free, cut_off)
        if region is None:
            raise TrackingError(_too_few(len(regions), options.bodies))
        if region.explained_share < MIN_EXPLAINED:
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
    return f"{requested} regions were requested, but only {count} change(s) its brightness; request fewer bodies"


def _track_of(body: str, series: _Series, number: int, lamp: Lamp, transfer: Transfer, options: TrackOptions) -> Track:
    """The Track of one region."""
    readings = [row[number] for row in series.readings]
    light, sigma, slope, cut = np.array([(r.light, r.sigma, r.slope, r.cut) for r in readings]).T
    valid = cut <= MAX_CUT
    used = valid.nonzero()[0]
    background = None if series.background is None else series.background[used]
    corrected = _corrected(light[used], slope[used], series.key[used], background, series.noise)
    sigma_used, scatter = _sigma(series.t_s[used], corrected.light, pooled(sigma[used]), slope[used])
    patterns = {TRANSFER: _of_exponent(corrected.light, transfer), LAG: corrected.lag.patterns * slope[used]}
    patterns[EXPOSURE] = corrected.exposure.patterns
    n = series.t_s.size
    return Track(
        t_s=series.t_s,
        xy_px=np.where(valid[:, np.newaxis], lamp.centre, np.nan),
        sigma_px=np.where(valid[:, np.newaxis], lamp.sigma_centre, np.nan),
        valid=valid,
        frame=series.index,
        body=body,
        intensity=_spread(corrected.light, used, n, np.nan),
        sigma_intensity=_spread(sigma_used, used, n, np.nan),
        area_px=np.full(n, float(lamp.pixels.rows.size)),
        origin={
            "tracker": TRACKER.name,
            "bodies": options.bodies,
            "roi": options.roi,
            "colour": options.colour,
            "transfer": transfer.text,
            "clipped": lamp.clipped,
            "scatter": float(np.median(scatter)),
            "lag_grey": float(np.abs(corrected.lag.grey).max(initial=0.0)),
            "exposure": corrected.exposure.change,
        },
        transfer=transfer,
        intensity_patterns={name: _spread(rows, used, n, 0.0) for name, rows in patterns.items() if rows.any()},
        quality=TrackQuality(_doubts(transfer, 1 - used.size / n, corrected.exposure)),
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Corrected:
    """Light (m,) without lag and change of exposure, and what these were."""

    light: Array
    lag: Lag
    exposure: Exposure


def _corrected(light: Array, slope: Array, key: Mask, background: Array | None, noise: float) -> _Corrected:
    steps = np.diff(light) / ((slope[1:] + slope[:-1]) / 2)
    lag = lag_of(np.concatenate([[0.0], np.cumsum(steps)]), key)
    light = light - lag.grey * slope
    steady = Exposure("none", 0.0, light, np.zeros((0, light.size)))
    exposure = steady if background is None else exposure_of(light, background, noise)
    return _Corrected(exposure.light, lag, exposure)


def _sigma(t_s: Array, light: Array, sigma: Array, slope: Array) -> tuple[Array, Array]:
    """Standard errors (m,) with the scatter about a smooth time series, and by which factor (m,) that raised them.

    Compression errs by grey levels, whatever light they stand for: none is below the median in grey levels.
    """
    scatter = excess_scatter(t_s, light, sigma, SLOW)
    return persistent(sigma * scatter / slope) * slope, scatter


def _of_exponent(light: Array, transfer: Transfer) -> Array:
    """Pattern (1, m) of one standard error e of the exponent: light^(1 + e) is about light + e light ln(light)."""
    relative = np.maximum(light / light.max(), 1e-9)
    return transfer.stderr * (light * np.log(relative))[np.newaxis]


def _spread(values: Array, used: Array, n: int, gap: float) -> Array:
    """Values (..., m) of the frames that are used, over all frames (..., n)."""
    whole = np.full((*values.shape[:-1], n), gap)
    whole[..., used] = values
    return whole


def _doubts(transfer: Transfer, cut: float, exposure: Exposure) -> tuple[Doubt, ...]:
    doubts = []
    if transfer.source == "assumed":
        doubts.append(
            Doubt(
                "unknown-transfer",
                f"the file does not say how the camera codes light: sRGB's curve is assumed to {transfer.stderr:.0%}, "
                "which is in the error of a decay time; grey levels alone would make it about 2.2 times too long",
                "state the camera's curve with --transfer (srgb, bt709, linear, gamma=2.2)",
            )
        )
    if cut > 0:
        doubts.append(
            Doubt(
                "saturated",
                f"the region is cut off at white in {cut:.0%} of the frames, which are left out",
                "film it with a shorter exposure, or leave that part out with --start or --stop",
            )
        )
    if exposure.change in ("gain", "unclear"):
        done = "divided out by the light of the still background" if exposure.change == "gain" else "not taken out"
        doubts.append(
            Doubt(
                "exposure",
                f"the background's light changes by {exposure.size:.1%}, as when the exposure adapts: {done}",
                "film with locked exposure",
            )
        )
    return tuple(doubts)


TRACKER = Tracker(
    name="intensity",
    summary="light of the region that changes most, such as an LED",
    track=track,
    example=TrackerExample("fading-lamp"),
)
