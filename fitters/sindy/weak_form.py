"""The weak form of candidate equations, with the noise of its rows known: what proposes a first structure.

Both sides of y'' = sum_j c_j f_j(y, y') are multiplied by a bump phi on a window and integrated by parts, so that phi
is differentiated and the data are not (Messenger and Bortz 2021, Multiscale Model. Simul. 19, 1474). White noise e of
the samples enters a row as sum_n h phi''(t_n) e_n; rows of overlapping windows share samples, and are whitened by the
Cholesky factor of that covariance. No window holds an impact or a gap.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from fitters.noise.measurement_noise import noise_from_differences, outliers_in_motion
from fitters.ode.known_inputs import bridged
from fitters.sindy.library import RATE, Library, evaluated, value_of
from iris_sysid.errors import DataError
from iris_sysid.types import Array, Mask, Trajectory

BRIDGED = 2  # missing samples in a row that the smoother fills; more end a piece
MIN_SAMPLES = 8  # samples in a piece: fewer say nothing about the noise
NARROWEST = 4  # samples in half a window
WIDTHS = (1.5, 2.5, 4.0)  # half a window, in times rms value / rms rate; a period of an oscillation is 6.3 of them
STEP = 0.4  # of half a window from one window to the next: rows nearer than that add little information
MAX_ROWS = 120  # in one block of rows, which are whitened together
NUGGET = 1e-6  # of the rows' variance: rounding, and the rule of integration
SAME = 1e-9  # of the range of the samples: nearer ones differ by rounding in arithmetic only
OFF_GRID = 1e-3  # of a step


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """A stretch without gap or impact.

    ``t_s`` (m,), ``values`` (m, d) of the variables, as measured, with the smoother's ``rates`` (m, d), ``inputs``
    (m, u), and ``noise`` (d,), the standard deviation of the values.
    """

    t_s: Array
    values: Array
    rates: Array
    inputs: Array | None
    noise: Array


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """Whitened rows of one equation: ``left`` (w,), ``right`` (w, k) for the library's terms of that equation."""

    left: Array
    right: Array


def pieces_of(trajectory: Trajectory, library: Library) -> list[Piece]:
    """Cut a trajectory at its gaps and events; DataError when nothing in it moves or too little is left."""
    from iris_sysid.trajectory.smoothing import smooth  # half a second to import

    names = [variable.quantity.name for variable in library.variables]
    columns = [trajectory.column(name) for name in names]
    inside = trajectory.valid & trajectory.mask("motion")
    clean = inside.copy()
    if inside.sum() >= MIN_SAMPLES:
        clean[inside] = ~outliers_in_motion(trajectory.t_s[inside], trajectory.position[inside][:, columns])
    _check(trajectory, clean, columns)
    smoothed = smooth(trajectory.with_(valid=clean)).smoothed
    assert smoothed is not None
    runs = [run for run in _runs(trajectory, clean) if np.all(np.isfinite(smoothed.velocity[run]))]
    filled = np.where(clean[:, None], trajectory.position, smoothed.position)[:, columns]
    return [_piece(trajectory, library, run, filled[run], smoothed.velocity[run][:, columns]) for run in runs]


def _check(trajectory: Trajectory, clean: Mask, columns: list[int]) -> None:
    n = int(clean.sum())
    if n < 2 * MIN_SAMPLES:
        raise DataError(
            f"{n} of {trajectory.n} samples are valid and in motion, at least {2 * MIN_SAMPLES} are needed to discover "
            "an equation: give a longer clip or a higher frame rate"
        )
    for column in columns:
        values = trajectory.position[clean, column]
        if np.ptp(values) <= 1e-12 * max(1.0, float(np.max(np.abs(values)))):
            name = trajectory.quantities[column].name
            raise DataError(f"{name} is {values[0]:g} in all {n} samples: what does not move has no equation to find")


def _runs(trajectory: Trajectory, clean: Mask) -> Iterator[slice]:
    """Stretches of motion with no more than BRIDGED samples missing in a row, each from a valid sample to one."""
    moving = trajectory.mask("motion")
    edges = {cut for segment in trajectory.segments for cut in (segment.start, segment.stop)}
    index = np.flatnonzero(clean & moving)
    step_s = float(np.median(np.diff(trajectory.t_s)))
    first = 0
    for k in range(1, index.size + 1):
        ends = k == index.size or index[k] - index[k - 1] > BRIDGED + 1
        if not ends:
            late = trajectory.t_s[index[k]] - trajectory.t_s[index[k - 1]] > (BRIDGED + 1.5) * step_s
            ends = bool(late) or any(index[k - 1] < edge <= index[k] for edge in edges)
        if ends:
            if k - first >= MIN_SAMPLES:
                yield slice(int(index[first]), int(index[k - 1]) + 1)
            first = k


def _piece(trajectory: Trajectory, library: Library, run: slice, observed: Array, velocity: Array) -> Piece:
    t_s = trajectory.t_s[run]
    values, rates, noise = observed.copy(), velocity.copy(), np.empty(observed.shape[1])
    for k, variable in enumerate(library.variables):
        noise[k] = noise_from_differences(t_s, observed[:, k])
        values[:, k] = value_of(variable, observed[:, k])
        if variable.kind == "size":
            rates[:, k] = -velocity[:, k] * values[:, k] ** 2
            noise[k] *= float(np.median(values[:, k] ** 2))
    # exact data have a noise too: that of their digits
    floor = 1e-7 * np.maximum(np.ptp(values, axis=0), 1e-300)
    return Piece(t_s, values, rates, inputs_of(trajectory, library, run), np.maximum(noise, floor))


def inputs_of(trajectory: Trajectory, library: Library, run: slice) -> Array | None:
    """The library's inputs (m, u) in a run of samples, bridged where not known; DataError when one is nowhere known."""
    if not library.inputs or trajectory.inputs is None:
        return None
    columns = []
    for quantity, values in zip(trajectory.input_quantities, trajectory.inputs.T, strict=True):
        if not np.isfinite(values).any():
            raise DataError(f"the input {quantity.name} has no known value; leave the column out or fill it in")
        columns.append(bridged(trajectory.t_s, values, trajectory.hold)[run])
    return np.column_stack(columns)


def grid_step(values: Array) -> float:
    """The largest step that divides all differences of values (n,); 0 where there is none.

    In the unit of the values.
    """
    different = np.unique(values)
    apart = np.diff(different)[np.diff(different) > SAME * max(float(np.ptp(values)), 1e-300)]
    if apart.size < 2:
        return 0.0
    steps = apart / np.min(apart)
    return float(np.min(apart)) if np.all(np.abs(steps - np.round(steps)) < OFF_GRID) else 0.0


def rows_of(pieces: list[Piece], library: Library) -> list[Rows]:
    """Whitened rows of every equation, with the width of window that determines its terms best."""
    return [_best_rows(pieces, library, equation) for equation in range(len(library.variables))]


def _best_rows(pieces: list[Piece], library: Library, equation: int) -> Rows:
    longest_s = max(float(piece.t_s[-1] - piece.t_s[0]) for piece in pieces)
    count, candidates = len(library.of_equation(equation)), []
    for half_s in _half_widths(pieces, equation, longest_s):
        blocks = _blocks(pieces, library, equation, half_s)
        if sum(block.left.size for block in blocks) > count:
            rows = _noise_aware(blocks)
            candidates.append((_information(rows), rows))
    if not candidates:
        raise DataError(
            f"the longest stretch without a gap lasts {longest_s:.3g} s: too few windows for {count} terms; "
            "give a longer clip or fill the gaps"
        )
    return max(candidates, key=lambda candidate: candidate[0])[1]


def _half_widths(pieces: list[Piece], equation: int, longest_s: float) -> list[float]:
    """Half widths of windows to try, about the time in which the variable changes by itself."""
    step_s = float(np.median(np.concatenate([np.diff(piece.t_s) for piece in pieces])))
    values = np.concatenate([piece.values[:, equation] - piece.values[:, equation].mean() for piece in pieces])
    rates = np.concatenate([piece.rates[:, equation] for piece in pieces])
    own_s = float(np.sqrt(np.mean(values**2) / max(float(np.mean(rates**2)), 1e-300)))
    widest_s = longest_s / 2.5
    half_widths = np.clip([factor * own_s for factor in WIDTHS], min(NARROWEST * step_s, widest_s), widest_s)
    return sorted(set(half_widths.tolist()))


def _information(rows: Rows) -> float:
    """How well the rows determine their terms: the logarithm of the information's determinant, misfit counted."""
    coefficients = np.linalg.lstsq(rows.right, rows.left, rcond=None)[0]
    misfit = float(np.mean((rows.left - rows.right @ coefficients) ** 2))
    size = np.linalg.norm(rows.right, axis=0)
    information = rows.right.T @ rows.right / max(misfit, 1.0)
    return float(np.linalg.slogdet(information + np.diag(1e-12 * size**2 + 1e-300))[1])


@dataclass(frozen=True, eq=False, slots=True)
class _Block:
    """Windows not yet whitened.

    ``operator`` (w, m) makes the left side of samples, ``bump`` and ``slope`` (w, m) the right side; ``gradient``
    (m, k) says how an error of a sample moves each term, ``rate`` which of them is the rate.
    """

    left: Array
    right: Array
    operator: Array
    bump: Array
    slope: Array
    gradient: Array
    rate: int | None
    noise: float

    def whitened(self, coefficients: Array) -> Rows:
        """Rows with independent errors of unit variance, if the coefficients (k,) are right."""
        operator = self.operator - self.bump * (self.gradient @ coefficients)
        if self.rate is not None:
            operator = operator + coefficients[self.rate] * self.slope
        covariance = operator @ operator.T
        covariance[np.diag_indices_from(covariance)] *= 1 + NUGGET
        factor = np.linalg.cholesky(covariance * self.noise**2)
        solved = solve_triangular(factor, np.column_stack([self.left, self.right]), lower=True)
        return Rows(solved[:, 0], solved[:, 1:])


def _noise_aware(blocks: list[_Block]) -> Rows:
    """Whiten with the coefficients that the rows give, twice."""
    coefficients: Array = np.zeros(blocks[0].right.shape[1])
    for _ in range(3):
        parts = [block.whitened(coefficients) for block in blocks]
        rows = Rows(np.concatenate([part.left for part in parts]), np.concatenate([part.right for part in parts]))
        coefficients = np.asarray(np.linalg.lstsq(rows.right, rows.left, rcond=1e-8)[0], dtype=np.float64)
    return rows


def _blocks(pieces: list[Piece], library: Library, equation: int, half_s: float) -> list[_Block]:
    fewest = 3 * len(library.of_equation(equation))
    return [
        _block(piece, part, library, equation, half_s) for piece in pieces for part in _parts(piece, half_s, fewest)
    ]


def _parts(piece: Piece, half_s: float, fewest: int) -> Iterator[Array]:
    """Centres of windows, at most MAX_ROWS together; in a short piece they are closer, to have enough of them."""
    free_s = float(piece.t_s[-1] - piece.t_s[0]) - 2 * half_s
    if free_s < 0:
        return
    inside = int(np.searchsorted(piece.t_s, piece.t_s[0] + free_s))
    count = max(1 + int(free_s / (STEP * half_s)), min(fewest, inside))
    centres_s = piece.t_s[0] + half_s + np.linspace(0, free_s, count)
    yield from np.array_split(centres_s, 1 + centres_s.size // MAX_ROWS)


def _block(piece: Piece, centres_s: Array, library: Library, equation: int, half_s: float) -> _Block:
    order = library.variables[equation].order
    first = int(np.searchsorted(piece.t_s, centres_s[0] - half_s))
    last = int(np.searchsorted(piece.t_s, centres_s[-1] + half_s, side="right"))
    t_s, values, rates = piece.t_s[first:last], piece.values[first:last], piece.rates[first:last]
    inputs = None if piece.inputs is None else piece.inputs[first:last]
    weight_s = np.gradient(t_s)  # of the trapezoidal rule; the bump is zero at the ends
    bump, slope, curve = (kernel * weight_s for kernel in _bumps((t_s - centres_s[:, None]) / half_s, half_s))
    operator = curve if order == 2 else -slope
    terms = library.of_equation(equation)
    codes = [library.terms[k].code for k in terms]
    right = bump @ evaluated(library, values, rates, inputs)[:, terms]
    rate = codes.index(RATE) if RATE in codes else None
    if rate is not None:
        right[:, rate] = -slope @ values[:, equation]
    gradient = _gradient(library, values, rates, inputs, equation)[:, terms]
    left = operator @ values[:, equation]
    return _Block(left, right, operator, bump, slope, gradient, rate, float(piece.noise[equation]))


def _gradient(library: Library, values: Array, rates: Array, inputs: Array | None, equation: int) -> Array:
    """Derivative of every term by the equation's own variable (n, k)."""
    step = np.zeros(values.shape[1])
    step[equation] = 1e-5 * max(float(np.ptp(values[:, equation])), 1e-12)
    above, below = (evaluated(library, values + sign * step, rates, inputs) for sign in (1.0, -1.0))
    return np.asarray((above - below) / (2 * step[equation]))


def _bumps(u: Array, half_s: float) -> tuple[Array, Array, Array]:
    """(1 - u^2)^4 inside |u| < 1, with its first and second derivative in time, zero outside."""
    inner = np.maximum(1.0 - u * u, 0.0)
    cube = inner**3
    return cube * inner, -8.0 / half_s * u * cube, 8.0 / half_s**2 * (6.0 * u * u * inner * inner - cube)
