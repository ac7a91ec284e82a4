"""Starting values from data alone: local polynomials, and regression in weak form (no derivative of noisy data)."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Trajectory

WINDOWS = 60  # at most, for each width


def samples(trajectory: Trajectory, name: str) -> tuple[Array, Array]:
    """Times (n,) and values (n,) of one quantity at the valid samples in motion."""
    used = trajectory.valid & trajectory.mask("motion")
    if used.sum() < 3:
        used = np.asarray(trajectory.valid)
    return trajectory.t_s[used], trajectory.position[used, trajectory.column(name)]


def start_of(t_s: Array, values: Array, span_s: float, degree: int = 3) -> Array:
    """Value and derivatives at the first sample (degree + 1,), from a polynomial over the first seconds.

    Parameters
    ----------
    t_s
        (n,) s, increasing.
    values
        (n,) in any unit; a derivative of order k is in that unit per s^k.
    span_s
        Length of the part that the polynomial is fitted to, s.
    degree
        Of the polynomial.
    """
    n = int(np.clip(np.searchsorted(t_s, t_s[0] + span_s), min(2 * degree + 2, t_s.size), t_s.size))
    scale_s = max(float(t_s[n - 1] - t_s[0]), 1e-12)
    powers = np.arange(degree + 1)
    coefficients = np.linalg.lstsq(((t_s[:n] - t_s[0]) / scale_s)[:, None] ** powers, values[:n], rcond=None)[0]
    factorial = np.cumprod(np.maximum(powers, 1)).astype(float)
    return np.asarray(coefficients * factorial / scale_s**powers, dtype=np.float64)


def line(t_s: Array, values: Array) -> tuple[float, float]:
    """Value and slope (per s) at the first sample of the straight line nearest to all values (n,) at ``t_s`` (n,) s."""
    start = start_of(t_s, values, np.inf, degree=1)
    return float(start[0]), float(start[1])


def parabola(t_s: Array, values: Array) -> tuple[float, float, float]:
    """Value, slope and second derivative at the first of the times (n,) in s of the parabola nearest to values (n,)."""
    start = start_of(t_s, values, np.inf, degree=2)
    return float(start[0]), float(start[1]), float(start[2])


def weak_regression(t_s: Array, values: Array, terms: Array, order: int = 2) -> tuple[Array, float]:
    """Coefficients c of ``y'' = c[0] f_0(y) + ... + c[-1] y'`` (order 2), or of ``y' = c[0] f_0(y) + ...`` (order 1).

    Both sides are multiplied by a bump phi = (1 - u^2)^4 on a window and integrated by parts, so that only
    phi is differentiated (weak form: Messenger and Bortz 2021, Multiscale Model. Simul. 19, 1474). Of
    several window widths the one that determines c[0] best is taken.

    Parameters
    ----------
    t_s
        (n,) s, uneven times allowed; windows with a gap in them are left out.
    values
        (n,) the observed y.
    terms
        (n, k) the functions f at the samples.
    order
        Order of the derivative on the left side.

    Returns
    -------
    coefficients : (k + 1,) for order 2, the last being that of y'; (k,) for order 1
        NaN where no window determines them.
    half_width_s : float
        Half the width of the windows taken.
    """
    duration_s = float(t_s[-1] - t_s[0])
    smallest_s = 4.0 * float(np.median(np.diff(t_s)))
    count = terms.shape[1] + order - 1
    best = (np.inf, np.full(count, np.nan), duration_s / 2)
    half_width_s = duration_s / 2
    while half_width_s >= min(smallest_s, duration_s / 2):
        left, right = weak_system(t_s, values, terms, order, half_width_s)
        if left.size > count:
            coefficients, relative_error = solved(left, right)
            if relative_error < best[0]:
                best = (relative_error, coefficients, half_width_s)
        half_width_s /= 1.7
    return best[1], best[2]


def weak_system(t_s: Array, values: Array, terms: Array, order: int, half_width_s: float) -> tuple[Array, Array]:
    """Left side (w,) and right side (w, k) of the weak form, one row a window.

    Parameters
    ----------
    t_s
        (n,) s, increasing.
    values
        (n,) samples of the function whose derivative is on the left side, in any unit.
    terms
        (n, k) samples of the terms on the right side.
    order
        Of the derivative, 1 or 2: the left side is in the unit of the values per s or s^2.
    half_width_s
        Of a window, s.
    """
    count = int(np.clip((t_s[-1] - t_s[0] - 2 * half_width_s) / (half_width_s / 4), 1, WINDOWS))
    centres_s = np.linspace(t_s[0] + half_width_s, t_s[-1] - half_width_s, count)
    firsts, lasts = np.searchsorted(t_s, [centres_s - half_width_s, centres_s + half_width_s])
    weight_s = np.gradient(t_s)  # of the trapezoidal rule; the bump is zero at the ends
    columns = np.column_stack([terms, values])
    rows = []
    for centre_s, first, last in zip(centres_s, firsts, lasts, strict=True):
        u = (t_s[first:last] - centre_s) / half_width_s
        if u.size < 5 or np.max(u[1:] - u[:-1]) > 0.6:
            continue
        weight, slope, curve = bump(u, half_width_s)
        measured = weight_s[first:last, None] * columns[first:last]
        right = weight @ measured
        right[-1] = -slope @ measured[:, -1]
        rows.append([curve @ measured[:, -1] if order == 2 else right[-1], *right])
    table = np.array(rows).reshape(-1, columns.shape[1] + 1)
    return table[:, 0], table[:, 1:] if order == 2 else table[:, 1:-1]


def bump(u: Array, half_width_s: float) -> tuple[Array, Array, Array]:
    """(1 - u^2)^4 with its first and second derivative in time."""
    square = u * u
    inner = 1.0 - square
    cube = inner * inner * inner
    slope = -8.0 / half_width_s * u * cube
    curve = 8.0 / half_width_s**2 * (6.0 * square * inner * inner - cube)
    return cube * inner, slope, curve


def solved(left: Array, right: Array) -> tuple[Array, float]:
    """Least squares, and the standard error of the first coefficient relative to it."""
    size = np.sqrt(np.sum(right**2, axis=0))
    if not np.all(size > 0):
        return np.full(right.shape[1], np.nan), np.inf
    scaled, _, rank, _ = np.linalg.lstsq(right / size, left, rcond=1e-10)
    if rank < right.shape[1] or scaled[0] == 0:
        return np.full(right.shape[1], np.nan), np.inf
    residual = left - right / size @ scaled
    variance = residual @ residual / (left.size - right.shape[1])
    inverse = np.linalg.inv((right / size).T @ (right / size))
    return scaled / size, float(np.sqrt(variance * inverse[0, 0]) / abs(scaled[0]))
