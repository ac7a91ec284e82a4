"""Multiple shooting: fit a motion whose free run leaves the data whatever its start, as a chaotic or unstable one does.

The record is cut into pieces, each with an initial state of its own, and where a piece ends the next must begin: the
jump is a residual whose standard deviation falls from step to step (Bock 1983, Recent Advances in Parameter
Identification Techniques for ODE; Voss, Timmer and Kurths 2004, Int. J. Bifurcation Chaos 14, 1905). The linearised
problem is solved with the jumps' multipliers as unknowns, in sparse form, which stays regular as they become exact. The
last allowed jump is far below the noise, so the pieces are one motion: an effect that the equation lacks leaves its
residual.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array, diags_array, eye_array, hstack, vstack
from scipy.sparse.linalg import splu

from fitters.integrator.initial_value_problem import InitialValueProblem, first_steps, value_names
from fitters.ode.fit_problem import PreparedFit
from fitters.ode.global_search import explains
from fitters.ode.least_squares import FINE, Solution, Target
from fitters.ode.prepared_request import NoMinimumError, task_of
from fitters.ode.request import FitRequest
from fitters.ode.result import Linearised, linearised_by, uncertain_values
from fitters.ode.weak_fit import is_observed, weak_fit
from iris_sysid.types import Array, Smoothed

SAMPLES, PIECES, MIN_PIECES = 20, 400, 10  # least samples in a piece, largest and least number of pieces
FIRST, TIGHTER, LAST = 0.1, 0.1, 1e-3  # allowed jump: at first of the motion's size, then less, at last of the noise
EVALUATIONS, SETTLED = 12, 1e-4  # for one allowed jump, and the last relative change of the sum of squares
DONE = 1e-9  # the same for the last allowed jump
DAMPING = 1e-3, 1e8, 1e-12  # of Levenberg and Marquardt: the first, the largest, the least
MAX_LOSS = 3.0  # F ratio: below 1.5 on white noise, 27 where a pendulum under feedback lacks its damping
WEAK = 0.3  # residual in weak form, as a share of the left side, above which the equation lacks something
STEP = 1e-6  # by which a value is changed for a derivative, relative to its size


@dataclass(frozen=True, eq=False, slots=True)
class Pieces:
    """A record in m pieces that each begin at a sample of ``starts`` (m + 1,); the last one ends with the record.

    ``values`` (p + s,) are the parameters and the state at the first sample, ``nodes`` (m - 1, s) the states at the
    other starts. ``size`` (s,) of each state over the record is the unit of a jump.
    """

    task: PreparedFit
    starts: NDArray[np.intp]
    values: Array
    nodes: Array
    size: Array

    @property
    def initial(self) -> Array:
        """The states (m, s) at which the pieces begin."""
        return np.vstack([self.values[len(self.task.model.parameters) :], self.nodes])

    def moved(self, step: Array) -> Pieces:
        """The pieces with a step (k + (m - 1) s,) of the free values, then of the nodes; values stay in bounds."""
        unknowns, k = self.task.unknowns, self.task.unknowns.which.size
        values = self.values.copy()
        values[unknowns.which] += step[:k]
        return replace(self, values=unknowns.inside(values), nodes=self.nodes + step[k:].reshape(self.nodes.shape))

    def problem(self, piece: int) -> tuple[InitialValueProblem, Array]:
        """A piece up to the sample at which the next begins, with steps short enough, and its values (p + s,)."""
        first, last = self.starts[piece], min(self.starts[piece + 1], self.task.problem.t_s.size - 1)
        values = np.concatenate([self.values[: len(self.task.model.parameters)], self.initial[piece]])
        plain = self.task.problem.part(int(first), int(last))
        return plain.planned(values, FINE.time_step, self.task.target.negligible), values

    def linear(self) -> _LinearPieces:
        """The residual and the jumps, with their derivatives by the free values and the nodes."""
        with np.errstate(all="ignore"):
            return _linear(self, [_shot(self, piece) for piece in range(len(self.starts) - 1)])

    def run(self) -> tuple[Array, Array]:
        """The prediction (n, d), and the jumps (m - 1, s) from where a piece ends to where the next one begins."""
        predicted, ends = [], []
        with np.errstate(all="ignore"):
            for piece, count in enumerate(np.diff(self.starts)):
                problem, values = self.problem(piece)
                states = np.ascontiguousarray(problem.states(values[:, None])[:, :, 0])
                predicted.append(problem.observe(states, values)[:count])
                ends.append(states[-1])
        return np.concatenate(predicted), np.array(ends[:-1]) - self.nodes

    def cost(self, allowed: float) -> float:
        """Sum of squares of the residual in sigma, and of the jumps in units of ``allowed`` times the size."""
        target = self.task.target
        predicted, jumps = self.run()
        with np.errstate(all="ignore"):
            residual = target.weighted(target.observed - predicted)
            return float(np.sum(residual**2) + np.sum((jumps / self.size / allowed) ** 2))


@dataclass(frozen=True, eq=False, slots=True)
class _Shot:
    """One piece: prediction (l, d) and its derivatives (l, d, c), the last state (s,) and its own (s, c)."""

    predicted: Array
    slopes: Array
    end: Array
    end_slopes: Array


@dataclass(frozen=True, eq=False, slots=True)
class _LinearPieces:
    """Residual (r,) predicted - observed in sigma, jumps (j,) in units of size, and their derivatives by all unknowns.

    ``predicted`` is (n, d); the unknowns are the free values, then the nodes.
    """

    predicted: Array
    residual: Array
    jumps: Array
    slopes: csr_array
    jump_slopes: csr_array

    def step(self, allowed: float, damping: float) -> Array:
        """The damped Gauss-Newton step of all unknowns."""
        scale = np.sqrt(np.maximum((self.slopes**2).sum(axis=0) + (self.jump_slopes**2).sum(axis=0), 1e-300))
        by = diags_array(1.0 / scale)
        slopes, jumps = self.slopes @ by, self.jump_slopes @ by
        square = slopes.T @ slopes
        damped = square + damping * diags_array(np.maximum(square.diagonal(), 1e-12))
        target = np.concatenate([-(slopes.T @ self.residual), -self.jumps])
        return np.asarray(_solved(damped, jumps, allowed, target)[: scale.size] / scale)

    def without_nodes(self, own: int, allowed: float) -> tuple[Array, Array]:
        """Derivatives of the residual (r, k) and of the jumps over the allowed one (j, k), with the nodes following."""
        mine, theirs = self.slopes[:, :own], self.slopes[:, own:]
        mine_jump, theirs_jump = self.jump_slopes[:, :own], self.jump_slopes[:, own:]
        scale = np.sqrt(np.maximum((theirs**2).sum(axis=0) + (theirs_jump**2).sum(axis=0), 1e-300))
        by = diags_array(1.0 / scale)
        target = -np.concatenate([(by @ theirs.T @ mine).toarray(), mine_jump.toarray()])
        follow = by @ _solved((theirs @ by).T @ (theirs @ by), theirs_jump @ by, allowed, target)[: scale.size]
        return mine.toarray() + theirs @ follow, (mine_jump.toarray() + theirs_jump @ follow) / allowed


def _solved(square: csr_array, jumps: csr_array, allowed: float, target: Array) -> Array:
    """Unknowns and multipliers of [[square, jumps'], [jumps, -allowed^2]] x = target."""
    count = jumps.shape[0]
    upper = hstack([square, jumps.T])
    lower = hstack([jumps, -(allowed**2) * eye_array(count)])
    return np.asarray(splu(csc_array(vstack([upper, lower]))).solve(target))


def _shot(pieces: Pieces, piece: int) -> _Shot:
    """Integrate a piece and its derivatives by the free parameters and all states at its start."""
    problem, values = pieces.problem(piece)
    p = len(pieces.task.model.parameters)
    own = pieces.task.unknowns.which
    which = np.concatenate([own[own < p], np.arange(p, values.size)])
    sizes = np.concatenate([np.maximum(np.abs(values[own[own < p]]), 1e-3), pieces.size])
    columns = np.repeat(values[:, None], which.size + 1, axis=1)
    columns[which, np.arange(1, which.size + 1)] += STEP * sizes
    states = problem.states(columns)
    each = [problem.observe(np.ascontiguousarray(states[:, :, c]), column) for c, column in enumerate(columns.T)]
    seen = np.stack(each, axis=2)[: pieces.starts[piece + 1] - pieces.starts[piece]]
    return _Shot(
        seen[:, :, 0],
        (seen[:, :, 1:] - seen[:, :, :1]) / (STEP * sizes),
        states[-1, :, 0],
        (states[-1, :, 1:] - states[-1, :, :1]) / (STEP * sizes),
    )


def _linear(pieces: Pieces, shots: list[_Shot]) -> _LinearPieces:
    target, p = pieces.task.target, len(pieces.task.model.parameters)
    own = pieces.task.unknowns.which
    k, s = own.size, pieces.size.size
    total = k + pieces.nodes.size
    first_states = np.flatnonzero(own >= p)
    rows, jump_rows = [], []
    for piece, shot in enumerate(shots):
        columns = np.full(shot.end_slopes.shape[1], -1)
        columns[: np.sum(own < p)] = np.flatnonzero(own < p)
        if piece:
            columns[np.sum(own < p) :] = k + (piece - 1) * s + np.arange(s)
        else:
            columns[np.sum(own < p) + own[first_states] - p] = first_states
        span = slice(pieces.starts[piece], pieces.starts[piece + 1])
        part = Target(target.observed[span], target.sigma[span], target.used[span])
        rows.append(_placed(part.weighted(shot.slopes), columns, total))
        jump_rows.append(_placed(shot.end_slopes / pieces.size[:, None], columns, total))
    predicted = np.concatenate([shot.predicted for shot in shots])
    count = pieces.nodes.size
    places = np.arange(count), k + np.arange(count)
    nodes = coo_array((-1.0 / np.tile(pieces.size, count // s), places), shape=(count, total))
    ends = np.array([shot.end for shot in shots[:-1]])
    return _LinearPieces(
        predicted,
        target.weighted(predicted - target.observed),
        ((ends - pieces.nodes) / pieces.size).ravel(),
        csr_array(vstack(rows)),
        csr_array(vstack(jump_rows[:-1]) + nodes),
    )


def _placed(block: Array, columns: NDArray[np.intp], total: int) -> csr_array:
    """A block (r, c) in the columns (c,) of a wide matrix (r, total); those of column -1 are left out."""
    kept = columns >= 0
    part = block[:, kept]
    row, column = np.meshgrid(np.arange(len(part)), columns[kept], indexing="ij")
    return csr_array((part.ravel(), (row.ravel(), column.ravel())), shape=(len(part), total))


@dataclass(frozen=True, eq=False, slots=True)
class PiecewiseFit:
    """A fit by multiple shooting: its ``pieces``, the ``solution`` they make, and the fit ``near`` it.

    The sensitivities near it are those to the free values with the pieces' initial states following.
    """

    pieces: Pieces
    solution: Solution
    near: Linearised

    @property
    def note(self) -> str:
        """What a reader should know."""
        times, starts = self.pieces.task.problem.t_s, self.pieces.starts
        piece_s = (times[-1] - times[0]) / (starts.size - 1)
        return (
            f"a free run leaves the data whatever its start: fitted by multiple shooting in {starts.size - 1} pieces "
            f"of {piece_s:.3g} s, which meet to a thousandth of the noise"
        )

    @property
    def start(self) -> Mapping[str, float]:
        """The parameters and the state at the first sample by name."""
        return dict(zip(value_names(self.pieces.task.model), self.pieces.values.tolist(), strict=True))


def shot_in_pieces(request: FitRequest) -> PiecewiseFit | None:
    """Fit by multiple shooting from the values of the weak form.

    Parameters
    ----------
    request
        Its ``start`` goes before the model's guess.

    Returns
    -------
    PiecewiseFit or None
        None where it does not apply (states that are not observed, events, effects on the clock or on the input,
        values with priors, too few samples), or where the pieces do not follow the data to the noise.
    """
    pieces = _first(request)
    if pieces is None:
        return None
    allowed, last, freest = FIRST, LAST * _noise(pieces.task), None
    while True:
        pieces = _minimised(pieces, allowed, SETTLED if allowed > last else DONE)
        solution = _solution(pieces)
        freest = solution if freest is None else freest
        if not (explains(solution, pieces.task.target, motion_share=0.0) and _meets(pieces, freest, solution)):
            return None
        if allowed <= last:
            return PiecewiseFit(pieces, solution, _near(pieces, solution, allowed))
        allowed = max(allowed * TIGHTER, last)


def _meets(pieces: Pieces, freest: Solution, solution: Solution) -> bool:
    """Whether the pieces lose no more of the data by meeting than noise accounts for: an F ratio, 1 on white noise."""
    samples, freed = int(pieces.task.target.used.sum()) * solution.predicted.shape[1], pieces.nodes.size
    lost = samples * (solution.rms**2 - freest.rms**2) / freed
    return bool(lost < MAX_LOSS * samples * freest.rms**2 / (samples - freed))


def _noise(task: PreparedFit) -> float:
    """The noise over the motion's size."""
    size = np.where(task.target.size > 0, task.target.size, 1.0)
    return max(float(np.median(np.nan_to_num(task.noise) / size)), FINE.time_step)


def _minimised(pieces: Pieces, allowed: float, settled: float) -> Pieces:
    """The pieces at the least sum of squares of residual and jumps, by Levenberg and Marquardt."""
    damping, cost = DAMPING[0], pieces.cost(allowed)
    for _ in range(EVALUATIONS):
        linear, before = pieces.linear(), cost
        while damping < DAMPING[1] and np.isfinite(before):
            tried = pieces.moved(linear.step(allowed, damping))
            found = tried.cost(allowed)
            if found < cost:
                pieces, cost, damping = tried, found, max(damping / 10, DAMPING[2])
                break
            damping *= 10
        if not before - cost > settled * before:
            break
    return pieces


def _first(request: FitRequest) -> Pieces | None:
    """Pieces that begin on the smoothed motion, with the values of the weak form."""
    from iris_sysid.trajectory.smoothing import smooth  # half a second to import

    model = request.model
    moved = model.events or model.warp is not None or model.drive is not None
    if moved or not is_observed(model):
        return None
    try:
        task = task_of(request)
    except NoMinimumError:
        return None
    count = min(task.problem.t_s.size // SAMPLES, PIECES)
    if count < MIN_PIECES or task.priors:
        return None
    clean = np.zeros(task.trajectory.n, dtype=np.bool_)
    clean[task.selection.span] = task.target.used
    trajectory = task.trajectory if task.trajectory.smoothed else smooth(task.trajectory.with_(valid=clean))
    weak = weak_fit(request.with_(trajectory=trajectory))
    if weak is None or trajectory.smoothed is None or weak.squares > WEAK**2 * weak.residual.size:
        return None
    names = value_names(model)
    values = np.array([weak.values[name] for name in names])
    states = _states(task, trajectory.smoothed, values)
    starts = np.linspace(0, len(states), count + 1).astype(np.intp)
    size = np.std(states, axis=0)
    return Pieces(task, starts, values, states[starts[1:-1]], np.where(size > 0, size, 1.0))


def _states(task: PreparedFit, smoothed: Smoothed, values: Array) -> Array:
    """The states (n, s) along the smoothed motion; hidden ones of effects follow it from zero."""
    model, span = task.model, task.selection.span
    columns = [task.trajectory.column(state.name) for state in model.states[: model.degrees_of_freedom]]
    own = smoothed.position[span][:, columns]
    if model.second_order:
        own = np.hstack([own, smoothed.velocity[span][:, columns]])
    return task.problem.with_hidden(np.ascontiguousarray(own), values[: len(model.parameters)])


def _solution(pieces: Pieces) -> Solution:
    """The prediction of the pieces as the solution of a fit."""
    task, predicted = pieces.task, pieces.run()[0]
    residual = task.target.weighted(task.target.observed - predicted)
    rms = float(np.sqrt(np.mean(residual**2)))
    steps = first_steps(pieces.values, task.unknowns.which)
    return Solution(task.problem, pieces.values, predicted, steps, rms, bool(np.isfinite(rms)), True, "")


def _near(pieces: Pieces, solution: Solution, allowed: float) -> Linearised:
    """The fit near its solution, with the nodes following the free values and the uncertain ones."""
    task, k = pieces.task, pieces.task.unknowns.which.size
    every = np.concatenate([task.unknowns.which, uncertain_values(task)])
    nothing = np.full(every.size, np.inf)
    wide = replace(task.unknowns, which=every, lower=-nothing, upper=nothing)
    slopes, jumps = replace(pieces, task=replace(task, unknowns=wide)).linear().without_nodes(every.size, allowed)
    shape = int(task.target.used.sum()), task.target.observed.shape[1], every.size
    return linearised_by(task, task.target, solution, slopes.reshape(shape), jumps[:, :k])
