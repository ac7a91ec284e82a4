"""From the detections of a body to its Track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Track
from trackers._detection.detection import Detection, FrameDetections
from trackers._disc.impact_frames import impact_exposure_error
from trackers._linking.select_bodies import held_frames
from trackers._tracklets.frame_to_frame import Tracklet
from trackers._uncertainty.changed_area import area_outliers, shifted_by_area
from trackers._uncertainty.changed_shape import changed_shape
from trackers._uncertainty.error_correlation import is_moving, outline_autocorrelation, outline_scatter
from trackers._uncertainty.excess_scatter import ErrorModel, with_scatter

EDGE_TO_CENTROID_NOISE_RATIO = (
    1.2  # lobes of the coverage over errors of the centroid, on drawn discs with noise, without loss
)
# times the lobes by noise: up to 1.35 on drawn discs without loss (plain and textured wall), 5 to 7 with H.264
BEYOND = 1.5
SHUTTER = 0.5  # exposure over the time between frames, where it is not measured: what cameras take by rule


def track_of(
    tracklet: Tracklet,
    all_detections: Sequence[FrameDetections],
    body: str,
    origin: dict[str, object],
    *,
    alone: bool = False,
) -> Track:
    """The Track of one tracklet over all frames; gaps are NaN.

    Parameters
    ----------
    tracklet
        The detections of the body.
    all_detections
        All frames of the clip, in order.
    body
        Name of the body.
    origin
        Where the track came from.
    alone
        Whether it is the only body: frames in which its area is too large, as with its shadow, are gaps then, or have
        a larger error. Bodies that touch share their area.
    """
    row_of = {frame_detections.frame: k for k, frame_detections in enumerate(all_detections)}
    table = np.full((len(all_detections), 8), np.nan)
    table[[row_of[detection.frame] for detection in tracklet.detections]] = [
        _row(detection) for detection in tracklet.detections
    ]
    table[alone & area_outliers(table[:, 4])] = np.nan
    hand = np.zeros(len(all_detections), dtype=np.bool_)
    hand[list(held_frames(tracklet, all_detections))] = True
    t_s = np.array([frame_detections.t_s for frame_detections in all_detections])
    radius = np.sqrt(table[:, 4] / np.pi)
    kept = [detection for detection in tracklet.detections if np.isfinite(radius[row_of[detection.frame]])]
    free = [detection for detection in kept if detection.centre.lobes and not detection.hand]
    rows = np.array([row_of[detection.frame] for detection in free], dtype=np.int64)
    lobes = np.array([detection.centre.lobes for detection in free])
    errors = error_model(rows, table[:, :2], radius, lobes)
    sigma = np.column_stack([with_scatter(t_s, table[:, axis], table[:, axis + 2], errors) for axis in (0, 1)])
    struck = impact_exposure_error(t_s, table[:, :2], sigma, SHUTTER)
    shifted = shifted_by_area(table[:, 4], radius) if alone else np.zeros(len(radius))
    if rows.size:
        shifted[rows] = np.hypot(shifted[rows], changed_shape(lobes, radius[rows], errors.moving[rows]))
    return Track(
        t_s=t_s,
        xy_px=table[:, 0:2],
        sigma_px=np.sqrt(sigma**2 + struck**2 + shifted[:, np.newaxis] ** 2),
        valid=np.isfinite(table[:, 0]),
        frame=np.array([frame_detections.frame for frame_detections in all_detections]),
        body=body,
        radius_px=radius,
        sigma_radius_px=table[:, 5] / np.sqrt(4 * np.pi * table[:, 4]),
        intensity=table[:, 6],
        sigma_intensity=table[:, 7],
        area_px=table[:, 4],
        hand=hand,
        origin=origin,
        error_autocorrelation=errors.autocorrelation,
    )


def error_model(
    rows: NDArray[np.int64],
    xy_px: Array,
    radius_px: Array,
    lobes: Array,
    reduction: float = 0.0,
    noise_px: float | None = None,
) -> ErrorModel:
    """Where a body moves, and the size and autocorrelation of its position errors by the lobes of its outline.

    Parameters
    ----------
    rows
        Numbers (k,) of the samples whose outline is measured, ascending.
    xy_px, radius_px
        Positions (n, 2) and radii (n,) of all samples, px; NaN in gaps.
    lobes
        Amplitudes (k, 4) of the outline's lobes in those samples, px.
    reduction
        By how much the partial autocorrelation of the position errors at lag 1 is below that of the lobes.
    noise_px
        Standard deviation of the lobes by white noise of the pixels, px; None where it is known only as a multiple of
        that of the position. Lobes that it explains do not count.
    """
    seen, number = np.isfinite(radius_px), np.arange(radius_px.size, dtype=np.float64)
    moving = np.zeros(radius_px.size, dtype=np.bool_)
    moving[seen] = is_moving(number[seen], xy_px[seen], radius_px[seen])
    if not rows.size:
        return ErrorModel(moving)
    outline = number[rows], xy_px[rows], lobes, radius_px[rows]
    measured, scatter = outline_autocorrelation(*outline), outline_scatter(*outline)
    ratio = EDGE_TO_CENTROID_NOISE_RATIO
    if noise_px is not None and scatter is not None:
        scatter, ratio = _beyond(scatter, noise_px), 1.0  # the position's own error holds the rest at its outline
    if measured is None:
        return ErrorModel(moving, None, scatter, ratio)
    partial = (max(measured.partial[0] - reduction, 0.0), *measured.partial[1:])
    return ErrorModel(moving, replace(measured, partial=partial), scatter, ratio)


def _beyond(scatter: float, noise: float) -> float:
    """The part of the scatter of lobes that white noise of that size does not explain, all in px."""
    return float(np.sqrt(scatter**2 - noise**2)) if scatter > BEYOND * noise else 0.0


def _row(detection: Detection) -> tuple[float, ...]:
    """Position and its errors, area and its error, intensity and its error."""
    centre = detection.centre
    errors = (centre.sigma_x, centre.sigma_y)
    return (detection.x, detection.y, *errors, centre.area, centre.sigma_area, centre.intensity, centre.sigma_intensity)
