"""Moments at which something sudden may have happened."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Parameter

MIN_SAMPLES, MAX_SAMPLES = 8, 40
SAMPLES_EACH = 10  # between two moments, unless that makes too many
WIDTH = 1.0  # frame intervals: sudden for the camera, smooth for the integrator
MIN_RETURNS = 1.5  # cycles in the clip: a parabola less its line has one
ASSUMED_CYCLES = 2.0  # in the clip, of a motion that does not come back
PADDED = 8  # times as long, so that a frequency is read to an eighth of what the clip resolves


def moments(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Times (s) spread evenly over the clip, its ends left out, and how sudden (s) it is.

    Parameters
    ----------
    t_s
        (n,) s.
    observed
        (n, d), not used.
    """
    count = int(np.clip(t_s.size // SAMPLES_EACH, MIN_SAMPLES, MAX_SAMPLES))
    return [(float(when), sudden(t_s)) for when in np.linspace(t_s[0], t_s[-1], count + 2)[1:-1]]


def sudden(t_s: Array) -> float:
    """How long (s) something sudden lasts in a clip with these times (n,)."""
    return WIDTH * frame_interval(t_s)


def frame_interval(t_s: Array) -> float:
    """The usual time (s) between two samples at these times (n,)."""
    return float(np.median(np.diff(t_s)))


def start_parameter(name: str) -> Parameter:
    """The time from which an effect counts: that of the first sample, so that no result depends on the clock's zero."""
    return Parameter(name, "s", "t_0", default=0.0, constant=True, source="a diagnosis takes the first sample used")


def first_time(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """The time (s) of the first of the samples (n,), as the only value to try; ``observed`` (n, d) is not used."""
    return [(float(t_s[0]),)]


def own_rate(t_s: Array, observed: Array) -> float:
    """The angular frequency (1/s) at which a motion is strongest; two cycles in the clip where it does not come back.

    Of the quantity that moves farthest, less its line. NaN samples are left out.

    Parameters
    ----------
    t_s
        (n,) s.
    observed
        (n, d), in the observed unit.
    """
    known = np.isfinite(observed).all(axis=1)
    times, span_s = t_s[known], float(t_s[-1] - t_s[0])
    if times.size < 8:
        return 2 * np.pi * ASSUMED_CYCLES / span_s
    farthest = observed[known][:, np.argmax(np.ptp(observed[known], axis=0))]
    grid = np.linspace(times[0], times[-1], times.size)
    even = np.interp(grid, times, farthest)
    line = np.polynomial.Polynomial.fit(grid, even, 1)
    power = np.abs(np.fft.rfft((even - line(grid)) * np.hanning(grid.size), PADDED * grid.size))
    cycles = float(np.argmax(power)) / PADDED * (span_s / float(grid[-1] - grid[0])) * (grid.size - 1) / grid.size
    return 2 * np.pi * (cycles if cycles >= MIN_RETURNS else ASSUMED_CYCLES) / span_s


def own_rates(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """That frequency (1/s) as the only value to try; arguments as for own_rate."""
    return [(own_rate(t_s, observed),)]


def own_rate_parameter(name: str) -> Parameter:
    """The motion's own angular frequency, to which something slower is compared."""
    return Parameter(
        name, "1/s", r"\omega_0", lower=1e-12, default=6.0, constant=True, role="shape",
        source="a diagnosis takes the frequency at which the motion is strongest",
    )  # fmt: skip
