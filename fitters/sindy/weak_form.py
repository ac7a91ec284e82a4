"""The weak form of candidate equations, which proposes a first structure; no window holds an impact or a gap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fitters.noise.measurement_noise import outliers_in_motion
from fitters.ode.known_inputs import bridged
from fitters.sindy.library import RATE, Library, evaluated, value_of
from fitters.starting_values import weak_system
from iris_sysid.errors import DataError
from iris_sysid.types import Array, Mask, Trajectory

BRIDGED = 2  # missing samples in a row that the smoother fills; more end a piece
MIN_SAMPLES = 8  # samples in a piece: fewer say nothing about the noise
NARROWEST = 4  # samples in half a window
WIDTH = 2.5  # half a window, in times rms value / rms rate; a period of an oscillation is 6.3 of them
SAME = 1e-9  # of the range of the samples: nearer ones differ by rounding in arithmetic only
OFF_GRID = 1e-3  # of a step


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """A stretch without gap or impact.

    ``t_s`` (m,), ``values`` (m, d) of the variables, as measured, with the smoother's ``rates`` (m, d), ``inputs``
    (m, u).
    """

    t_s: Array
    values: Array
    rates: Array
    inputs: Array | None


@dataclass(frozen=True, eq=False, slots=True)
class Rows:
    """Rows of one equation, a window each: ``left`` (w,), ``right`` (w, k) for its terms in the library."""

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
    values, rates = observed.copy(), velocity.copy()
    for k, variable in enumerate(library.variables):
        values[:, k] = value_of(variable, observed[:, k])
        if variable.kind == "size":
            rates[:, k] = -velocity[:, k] * values[:, k] ** 2
    return Piece(t_s, values, rates, inputs_of(trajectory, library, run))


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
    """Rows of every equation; DataError where the longest stretch has too few windows for the terms."""
    return [_rows(pieces, library, equation) for equation in range(len(library.variables))]


def _rows(pieces: list[Piece], library: Library, equation: int) -> Rows:
    terms, order = library.of_equation(equation), library.variables[equation].order
    others = [k for k in terms if library.terms[k].code != RATE]
    half_s, longest_s = _half_width(pieces, equation)
    parts = []
    for piece in pieces:
        columns = evaluated(library, piece.values, piece.rates, piece.inputs)[:, others]
        parts.append(weak_system(piece.t_s, piece.values[:, equation], columns, order, half_s))
    left, right = np.concatenate([part[0] for part in parts]), np.vstack([part[1] for part in parts])
    if left.size <= len(terms):
        raise DataError(
            f"the longest stretch without a gap lasts {longest_s:.3g} s: too few windows for {len(terms)} terms; "
            "give a longer clip or fill the gaps"
        )
    # the rate comes last there
    order_of = [others.index(k) if k in others else right.shape[1] - 1 for k in terms]
    return Rows(left, right[:, order_of])


def _half_width(pieces: list[Piece], equation: int) -> tuple[float, float]:
    """Half the width of a window, about the time in which the variable changes by itself; and the longest stretch."""
    longest_s = max(float(piece.t_s[-1] - piece.t_s[0]) for piece in pieces)
    step_s = float(np.median(np.concatenate([np.diff(piece.t_s) for piece in pieces])))
    values = np.concatenate([piece.values[:, equation] - piece.values[:, equation].mean() for piece in pieces])
    rates = np.concatenate([piece.rates[:, equation] for piece in pieces])
    own_s = float(np.sqrt(np.mean(values**2) / max(float(np.mean(rates**2)), 1e-300)))
    widest_s = longest_s / 5
    return float(np.clip(WIDTH * own_s, min(NARROWEST * step_s, widest_s), widest_s)), longest_s
