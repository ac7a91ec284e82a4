"""Kalman filter and Rauch-Tung-Striebel smoother, its process noise chosen from the data.

The model is a coordinate driven by white jerk, not by white acceleration: the forces here (gravity, a cord, drag, a
board) make accelerations that are continuous and mostly slow. Free fall and a slide then are the limit of no process
noise, and the acceleration itself is a state of the filter. The smoother is the quintic spline of the data where one
driven by white acceleration would be the cubic one (Wahba 1978, J. R. Stat. Soc. B 40, 364): its velocity of a pendulum
at 30 to 240 frames a second is 2.5 to 5 times as accurate, and the likelihood prefers it. A motion smoother still than
white jerk makes it, as a pendulum's is, has standard errors of the velocity that are 1.4 to 2.3 times too large.

Where an impact or a release breaks the motion the filter stops and starts again.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.optimize import minimize_scalar

from iris_sysid.errors import DataError
from iris_sysid.trajectory.white_jerk_model import (
    ORDER,
    SmootherStart,
    diffuse_start,
    innovations,
    process_noise,
    transition,
)
from iris_sysid.types import Array, Mask, Smoothed, Trajectory

GRID_DECADES = 1.0  # step of the search for the process noise; its likelihood is smooth over several decades


def smooth(trajectory: Trajectory, *, psd: float | Sequence[float] | None = None) -> Trajectory:
    """Estimate position and velocity at each sample by a Kalman filter and RTS smoother; gaps are bridged.

    Each quantity moves under white jerk of power spectral density ``psd`` (see this module). Uneven times are exact,
    the start is exactly diffuse. The standard errors of the samples are ``trajectory.sigma``; where they are not known
    one common value is estimated with the process noise. Both are chosen by maximum likelihood of the innovations
    ``Σ log S + ν²/S`` (Harvey 1989, Forecasting, Structural Time Series Models and the Kalman Filter, eq. 3.4.5), over
    the motion only where the trajectory is segmented. The filter restarts at the ends of each segment of motion or
    contact, so that no impact is smoothed away.

    Parameters
    ----------
    trajectory
        Any quantities; a gap is not valid.
    psd
        Power spectral density of the jerk, one or one per quantity, in unit^2/s^5. Chosen from the data when not given.

    Returns
    -------
    Trajectory
        With ``smoothed``: NaN before the first and after the last valid sample of a segment, and where fewer than three
        samples leave velocities unknown. ``smoothed.nis`` is the mean of ν²/S over the n innovations
        that ``origin["nis_samples"]`` counts: chi-squared with n degrees of freedom, over n, when motion and noise are
        as assumed, and 1 by construction where sigma was estimated.

    Raises
    ------
    DataError
        When no sample is valid, a standard error is not above zero, or psd is negative.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import Quantity, Trajectory, smooth
    >>> t_s = np.arange(60) / 60
    >>> z = (1.5 - 4.9 * t_s**2)[:, None]
    >>> fall = Trajectory(t_s, (Quantity("z", "m", "z"),), z, np.full_like(z, 1e-3), np.ones(60, bool))
    >>> smoothed = smooth(fall).smoothed
    >>> float(smoothed.velocity[30, 0].round(1))
    -4.9
    """
    if not trajectory.valid.any():
        raise DataError(
            f"none of the {trajectory.n} samples is valid: there is nothing to smooth; was the body found in the clip?"
        )
    pieces = _pieces(trajectory)
    judged = _judged(trajectory, pieces)
    stated_psd = _stated_psd(psd, len(trajectory.quantities))
    fitted = [_choose(_Column.of(trajectory, column, judged), value) for column, value in enumerate(stated_psd)]
    smoothed = _smoothed(trajectory, pieces, fitted)
    counted = sum(max(int(trajectory.valid[piece].sum()) - ORDER, 0) for piece in judged)
    return trajectory.with_(smoothed=smoothed, origin={**trajectory.origin, "nis_samples": counted})


# --------------------------------------------------------------------------- which samples belong together


def _pieces(trajectory: Trajectory) -> list[slice]:
    """Stretches that the filter runs through, each from its first to its last valid sample."""
    broken = [segment for segment in trajectory.segments if segment.label in ("motion", "contact")]
    cuts = {0, trajectory.n} | {cut for segment in broken for cut in (segment.start, segment.stop)}
    edges = sorted(cuts)
    pieces = []
    for start, stop in itertools.pairwise(edges):
        valid = np.flatnonzero(trajectory.valid[start:stop])
        if valid.size:
            pieces.append(slice(start + int(valid[0]), start + int(valid[-1]) + 1))
    return pieces


def _judged(trajectory: Trajectory, pieces: list[slice]) -> list[slice]:
    """The pieces whose likelihood chooses the noise: those in motion, or all where no motion is long enough."""
    enough = [piece for piece in pieces if trajectory.valid[piece].sum() > ORDER]
    motion = trajectory.mask("motion")
    return [piece for piece in enough if motion[piece.start]] or enough


def _stated_psd(psd: float | Sequence[float] | None, count: int) -> list[float | None]:
    if psd is None:
        return [None] * count
    values = np.atleast_1d(np.asarray(psd, dtype=np.float64))
    if values.size not in (1, count):
        raise DataError(f"psd has {values.size} values for {count} quantities; give one, or one per quantity")
    if not np.all(np.isfinite(values) & (values >= 0)):
        raise DataError(f"psd = {values.tolist()}: the process noise must be finite and at least zero")
    return [float(value) for value in np.broadcast_to(values, count)]


def _variance(trajectory: Trajectory, column: int) -> tuple[Array, bool]:
    """Variance of each sample (n,), and whether it is known; 1 everywhere where it is not."""
    sigma = np.where(trajectory.valid, trajectory.sigma[:, column], np.nan)
    if np.any(sigma <= 0) or np.any(np.isinf(sigma)):
        wrong = int(np.argmax((sigma <= 0) | np.isinf(sigma)))
        raise DataError(
            f"sigma[{wrong}] of {trajectory.quantities[column].name} is {sigma[wrong]:g}: a standard error must be "
            "above zero and finite; leave it blank (NaN) where it is not known"
        )
    if np.all(np.isnan(sigma)):
        return np.ones(trajectory.n), False
    return np.square(np.where(np.isnan(sigma), np.nanmedian(sigma), sigma)), True


# --------------------------------------------------------------------------- choosing the noise


@dataclass(frozen=True, eq=False, slots=True)
class _Column:
    """One quantity: times, values and relative variances of the valid samples of each piece that is judged."""

    pieces: list[tuple[Array, Array, Array]]
    variance: Array
    known: bool
    unit: float
    step_s: float
    span_s: float
    resolution: float

    @classmethod
    def of(cls, trajectory: Trajectory, column: int, judged: list[slice]) -> _Column:
        variance, known = _variance(trajectory, column)
        values = trajectory.position[:, column]
        keep = [np.flatnonzero(trajectory.valid[piece]) + piece.start for piece in judged]
        times = trajectory.t_s[trajectory.valid]
        return cls(
            pieces=[(trajectory.t_s[samples], values[samples], variance[samples]) for samples in keep],
            variance=variance,
            known=known,
            unit=float(np.sqrt(np.median(variance[trajectory.valid]))),
            step_s=float(np.median(np.diff(times))) if times.size > 1 else 1.0,
            span_s=float(times[-1] - times[0]) if times.size > 1 else 1.0,
            # noise below the rounding of the numbers themselves means nothing
            resolution=4 * np.finfo(float).eps * float(np.max(np.abs(values[trajectory.valid]))),
        )

    def time_unit_s(self, ratio: float) -> float:
        """The smoother's own time constant: in this unit all elements of the covariance are of order 1."""
        if ratio <= 0:
            return self.span_s
        return float(np.clip((self.unit**2 * self.step_s / ratio) ** (1 / 6), self.step_s, self.span_s))

    def innovations(self, ratio: float) -> tuple[Array, Array]:
        """Innovations of all pieces, and their variances divided by the noise scale, at psd = ratio * scale."""
        tau = self.time_unit_s(ratio)
        parts = [_innovations(t / tau, z, variance, ratio * tau**5) for t, z, variance in self.pieces]
        if not parts:
            return np.empty(0), np.empty(0)
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _innovations(t: Array, z: Array, variance: Array, psd: float) -> tuple[Array, Array]:
    start = diffuse_start(t, z, variance, psd)
    return innovations(t, z, variance, psd, start.state, start.covariance)


@dataclass(frozen=True, eq=False, slots=True)
class _ProcessNoise:
    """The noise chosen for one quantity: variances are ``scale * column.variance``, the psd ``ratio * scale``."""

    column: _Column
    ratio: float
    scale: float
    nis: float


def _choose(column: _Column, psd: float | None) -> _ProcessNoise:
    """The process noise, and the measurement noise where it is not known, of maximum likelihood."""
    scale_of = _scale_of(column, psd)
    ratio = _best_ratio(column, scale_of) if psd is None or (psd > 0 and not column.known) else psd
    innovation, variance = column.innovations(ratio)
    scale = scale_of(ratio, innovation, variance)
    nis = float(np.mean(innovation**2 / variance) / scale) if innovation.size else np.nan
    return _ProcessNoise(column, ratio, scale, nis)


def _scale_of(column: _Column, psd: float | None) -> Callable[[float, Array, Array], float]:
    """How the noise scale follows from the ratio: it is 1, or psd / ratio, or the one of maximum likelihood."""

    def estimated(ratio: float, innovation: Array, variance: Array) -> float:
        if not innovation.size:
            return np.nan
        return max(float(np.mean(innovation**2 / variance)), column.resolution**2, np.finfo(float).tiny)

    if column.known:
        return lambda ratio, innovation, variance: 1.0
    if psd:
        return lambda ratio, innovation, variance: psd / ratio
    return estimated


def log_likelihood(innovation: Array, innovation_variance: Array) -> float:
    """``-½ Σ (log 2πS + ν²/S)`` of innovations ν (n,) and their variances S (n,).

    Innovations have the unit of the measurement, variances its square.
    """
    return float(-0.5 * np.sum(np.log(2 * np.pi * innovation_variance) + innovation**2 / innovation_variance))


def _best_ratio(column: _Column, scale_of: Callable[[float, Array, Array], float]) -> float:
    def cost(exponent: float) -> float:
        innovation, variance = column.innovations(10.0**exponent)
        scale = scale_of(10.0**exponent, innovation, variance)
        return -log_likelihood(innovation, variance * scale) if innovation.size else 0.0

    # From a jerk that moves nothing by a hundredth of the noise in the whole clip, to one that forgets in one step.
    low = np.log10(column.unit**2 * 2e-3 / column.span_s**5)
    high = np.log10(column.unit**2 * 2e5 / column.step_s**5)
    grid = np.append(np.arange(low, high, GRID_DECADES), high)
    costs = [cost(exponent) for exponent in grid]
    best = int(np.argmin(costs))
    if best == 0:
        return float(10.0 ** grid[0])
    bounds = (grid[best - 1], grid[min(best + 1, grid.size - 1)])
    optimum = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.01})
    return float(10.0**optimum.x)


# --------------------------------------------------------------------------- smoothing


def _smoothed(trajectory: Trajectory, pieces: list[slice], fitted: list[_ProcessNoise]) -> Smoothed:
    n, d = trajectory.position.shape
    position, velocity = np.full((n, d), np.nan), np.full((n, d), np.nan)
    covariance = np.full((n, 2 * d, 2 * d), np.nan)
    for piece in pieces:
        valid = trajectory.valid[piece]
        if valid.sum() < ORDER:
            _keep_measured(trajectory, piece, fitted, position, covariance)
            continue
        state, spread = _smooth_piece(trajectory, piece, fitted)
        position[piece], velocity[piece] = state[:, :, 0], state[:, :, 1]
        covariance[piece] = spread
    return Smoothed(
        position=position,
        velocity=velocity,
        covariance=covariance,
        psd=np.array([noise.ratio * noise.scale for noise in fitted]),
        nis=np.array([noise.nis for noise in fitted]),
    )


def _keep_measured(
    trajectory: Trajectory, piece: slice, fitted: list[_ProcessNoise], position: Array, covariance: Array
) -> None:
    """Too few samples for a velocity: the measurements are all that is known."""
    for k in np.flatnonzero(trajectory.valid[piece]) + piece.start:
        position[k] = trajectory.position[k]
        for column, noise in enumerate(fitted):
            covariance[k, column, column] = noise.scale * noise.column.variance[k]


def _smooth_piece(trajectory: Trajectory, piece: slice, fitted: list[_ProcessNoise]) -> tuple[Array, Array]:
    """States (m, d, 3) and covariance of positions and velocities (m, 2d, 2d) of one piece."""
    valid = trajectory.valid[piece]
    third = int(np.flatnonzero(valid)[ORDER - 1])
    scaled = [_Scaled.of(trajectory, piece, column, noise) for column, noise in enumerate(fitted)]
    state, covariance = _filterpy(scaled, valid, third)
    states = np.empty((valid.size, len(fitted), ORDER))
    spread = np.zeros((valid.size, 2 * len(fitted), 2 * len(fitted)))
    for column, part in enumerate(scaled):
        block = slice(ORDER * column, ORDER * (column + 1))
        x, p = part.with_start(state[:, block], covariance[:, block, block], third)
        units = part.unit / part.tau ** np.arange(ORDER)
        states[:, column] = x * units
        p = (p + p.transpose(0, 2, 1)) / 2 * np.outer(units, units) * fitted[column].scale
        rows = np.array([column, len(fitted) + column])
        spread[:, rows[:, None], rows] = p[:, :2, :2]
    return states, spread


@dataclass(frozen=True, eq=False, slots=True)
class _Scaled:
    """One quantity of one piece in units of its noise and of the smoother's time constant."""

    t: Array
    z: Array
    variance: Array
    psd: float
    unit: float
    tau: float
    start: SmootherStart

    @classmethod
    def of(cls, trajectory: Trajectory, piece: slice, column: int, noise: _ProcessNoise) -> _Scaled:
        unit, tau = noise.column.unit, noise.column.time_unit_s(noise.ratio)
        valid: Mask = trajectory.valid[piece]
        t = (trajectory.t_s[piece] - trajectory.t_s[piece][0]) / tau
        z = trajectory.position[piece, column] / unit
        variance = noise.column.variance[piece] / unit**2
        psd = noise.ratio * tau**5 / unit**2
        return cls(t, z, variance, psd, unit, tau, diffuse_start(t[valid], z[valid], variance[valid], psd))

    def with_start(self, state: Array, covariance: Array, third: int) -> tuple[Array, Array]:
        """Put the samples before the third measurement in front of the smoothed ones."""
        before = [self.start.earlier(t, state[0], covariance[0]) for t in self.t[:third]]
        states = np.array([x for x, _ in before] + list(state))
        return states, np.array([p for _, p in before] + list(covariance))


def _filterpy(scaled: list[_Scaled], valid: Mask, third: int) -> tuple[Array, Array]:
    """Filter and smooth from the third measurement on: states (m, 3d), covariance (m, 3d, 3d).

    All quantities share one filter, whose blocks do not couple. ``rts_smoother`` of the class takes the transition
    *into* each step; a gap is a measurement None.
    """
    size = ORDER * len(scaled)
    kalman = KalmanFilter(dim_x=size, dim_z=len(scaled))
    kalman.H = np.zeros((len(scaled), size))
    kalman.H[np.arange(len(scaled)), ORDER * np.arange(len(scaled))] = 1.0
    kalman.x = np.concatenate([part.start.state for part in scaled])
    kalman.P = _block_diagonal([part.start.covariance[None] for part in scaled])[0]
    steps = [np.diff(part.t[third:], prepend=part.t[third]) for part in scaled]
    transitions = _block_diagonal([transition(dt) for dt in steps])
    noises = _block_diagonal([process_noise(dt, part.psd) for dt, part in zip(steps, scaled, strict=True)])
    variances = _block_diagonal([part.variance[third:, None, None] for part in scaled])
    values = np.stack([part.z[third:] for part in scaled], axis=1)
    measured = [value if seen else None for value, seen in zip(values, valid[third:], strict=True)]
    first_x, first_p = kalman.x.copy(), kalman.P.copy()
    later = slice(1, None)
    means, covariances, _, _ = kalman.batch_filter(
        measured[later], Fs=transitions[later], Qs=noises[later], Rs=variances[later]
    )
    means, covariances = np.concatenate([[first_x], means]), np.concatenate([[first_p], covariances])
    state, covariance, _, _ = kalman.rts_smoother(means, covariances, Fs=transitions, Qs=noises)
    return state, covariance


def _block_diagonal(blocks: list[Array]) -> Array:
    """Stack matrices (m, k, k) into (m, k d, k d), one block per quantity."""
    size = blocks[0].shape[1]
    whole = np.zeros((blocks[0].shape[0], size * len(blocks), size * len(blocks)))
    for k, block in enumerate(blocks):
        part = slice(size * k, size * (k + 1))
        whole[:, part, part] = block
    return whole
