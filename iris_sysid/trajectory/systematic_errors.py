"""Systematic errors of an observed quantity, common to all samples: errors of calibration and clock, propagated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from iris_sysid.calibration.pixel_scale import common_source
from iris_sysid.calibration.plane import changed, common_errors
from iris_sysid.calibration.vertical import turned, vertical_stderr
from iris_sysid.errors import IrisError
from iris_sysid.types import Array, Calibration, Phenomenon, Track, Trajectory

TIME_BASE = "time base"
EDGE, AXIS, PIVOTS = "edge of the ball", "axis of the turn", "pivots"
SURFACE = "surface"
# of the standard error of a sample: what texture and blocks of a coder do to a surface that passes these rows; on
# nine synthetic clips, compressed and not, the means over 16 rows are off by 0.15 to 0.6 of it, 0.35 rms
SURFACE_SHARE, SURFACE_ROWS_PX = 0.35, 16
EDGE_PX = 0.1  # what blur, shading and compression do to a radius in all frames alike; on synthetic clips 0.02 to 0.16
# rad: errors of an angle that come back once, twice, ... a turn, as cosine and as sine: the axis beside where it is
# (0.08 px of an arm of 101), light from one side, what a coder hands on. On 12 synthetic clips (640x360 seed 7360, 5 s;
# 960x540 seed 5521 and 1280x720 seed 0, 4 s) they are 5, 3, 1.5 and 0.6e-4 rms
TURN_HARMONICS = (1e-3, 3e-4, 1.5e-4, 8e-5)
# of the range of the positions: below it a pattern is rounding, as that of a scale's error in an angle
ROUNDING = 1e-9
VERTICALS = ("vertical", "assumed vertical")


def from_calibration(
    trajectory: Trajectory, observe: Callable[[Calibration], Array], calibration: Calibration, seen_px: Array
) -> dict[str, Array]:
    """Patterns that the calibration's errors leave in what is observed, by differences of the whole way.

    Parameters
    ----------
    trajectory
        What is observed with the calibration as it is.
    observe
        Positions (n, d) observed with another calibration.
    calibration
        With its budget.
    seen_px
        Pixels (m, 2) that matter: of all bodies and marks.

    Returns
    -------
    dict
        By source, ``calibration: corners`` and so on, patterns (r, n, d) of one standard error each; zero in gaps.
        That of the vertical has one of second order too, ``f'' u^2 / sqrt(2)`` (GUM, 5.1.2, note): a vertical that
        is off shortens a fall whichever way it leans.
    """
    by_source = {}
    for name, changes in common_errors(calibration, seen_px).items():
        patterns = [
            (_tried(observe, calibration, change) - _tried(observe, calibration, -change)) / 2 for change in changes
        ]
        if name in VERTICALS:
            angle = vertical_stderr(calibration, name)
            more, less = (observe(turned(calibration, turn)) for turn in (angle, -angle))
            patterns.append((more + less - 2 * observe(calibration)) / np.sqrt(2))
        stacked = np.nan_to_num(np.array(patterns))
        if np.abs(stacked).max() > ROUNDING * np.ptp(trajectory.position[trajectory.valid]):
            by_source[common_source(name)] = stacked
    return by_source


def _tried(observe: Callable[[Calibration], Array], calibration: Calibration, change: Array) -> Array:
    try:
        return observe(changed(calibration, change))
    except IrisError as error:
        raise type(error)(
            f"within the calibration's own error the motion cannot be observed: {error}; calibrate better"
        ) from error


def from_clock(trajectory: Trajectory, relative_stderr: float) -> dict[str, Array]:
    """The pattern (1, n, d) of a clock that runs fast: velocity times the time, s, since the first sample.

    It is under ``time base``; nothing for a relative standard error of the frame rate of zero.
    """
    if relative_stderr == 0 or trajectory.smoothed is None:
        return {}
    late_s = relative_stderr * (trajectory.t_s - trajectory.t_s[0])
    return {TIME_BASE: np.nan_to_num(trajectory.smoothed.velocity * late_s[:, None])[None]}


def from_edge(trajectory: Trajectory, phenomenon: Phenomenon) -> dict[str, Array]:
    """The pattern (1, n, d) of an edge that is seen too far out in all frames: a radius in px, too large by the same.

    It is under ``edge of the ball``; nothing for anything but a radius.
    """
    if phenomenon.measures != "radius":
        return {}
    return {EDGE: np.where(trajectory.valid[:, None], EDGE_PX, 0.0)[None]}


def from_axis(trajectory: Trajectory, phenomenon: Phenomenon) -> dict[str, Array]:
    """The patterns (8, n, d) of errors of an angle that come back with every turn, one to four times in each.

    An axis that is taken beside where it is leaves the first, uneven light and a body that is learned under it those of
    higher order. Over a short arc they look like the motion itself. They are in the observed units, under ``axis of the
    turn``; nothing for anything but the angle of something that turns.
    """
    if phenomenon.measures != "angle":
        return {}
    angle = np.where(trajectory.valid[:, None], trajectory.position, np.nan)
    parts = [
        size * wave(order * angle) for order, size in enumerate(TURN_HARMONICS, start=1) for wave in (np.cos, np.sin)
    ]
    return {AXIS: np.nan_to_num(np.stack(parts))}


def from_pivots(trajectory: Trajectory) -> dict[str, Array]:
    """The patterns (r, n, d), rad, of pivots that are taken beside where they are, for two bodies about their own.

    They are under ``pivots``, one sideways and one upwards for each body; nothing where the geometry does not hold
    ``pivot_across_1`` and so on, errors over the radius of each arc.
    """
    angle = np.where(trajectory.valid[:, None], trajectory.position, np.nan)
    ways = (("across", np.cos), ("along", np.sin))
    patterns = []
    for body in range(angle.shape[1]):
        for name, shape in ways:
            error = trajectory.geometry.get(f"pivot_{name}_{body + 1}")
            if error is not None:
                pattern = np.zeros(angle.shape)
                pattern[:, body] = error.stderr * np.nan_to_num(shape(angle[:, body]))
                patterns.append(pattern)
    return {PIVOTS: np.stack(patterns)} if patterns else {}


def from_brightness(track: Track, phenomenon: Phenomenon) -> dict[str, Array]:
    """The patterns (r, n, 1), by source, of errors that all intensities of a track have in common, in their unit.

    They are those of transfer function, compression, exposure; nothing for anything but an intensity.
    """
    if phenomenon.measures != "intensity":
        return {}
    return {source: patterns[..., np.newaxis] for source, patterns in track.intensity_patterns.items()}


def from_surface(trajectory: Trajectory, track: Track, phenomenon: Phenomenon) -> dict[str, Array]:
    """The patterns (r, n, 1) of a liquid's surface that is seen too high while it passes some rows, e.g. of texture.

    They are in the observed unit, under ``surface``, one for every 16 rows, which fade towards the next; nothing for
    anything but a height.
    """
    seen = trajectory.valid & track.valid
    if phenomenon.measures != "height" or not seen.any():
        return {}
    rows, sigma = track.xy_px[:, 1], np.where(seen, np.nan_to_num(trajectory.sigma[:, 0]), 0.0)
    first, last = np.min(rows[seen]), np.max(rows[seen])
    knots = np.linspace(first, last, max(2, 1 + round((last - first) / SURFACE_ROWS_PX)))
    hats = np.stack([np.interp(np.where(seen, rows, first), knots, hat) for hat in np.eye(knots.size)])
    return {SURFACE: SURFACE_SHARE * (hats * sigma)[..., np.newaxis]}
