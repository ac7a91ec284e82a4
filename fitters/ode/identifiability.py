"""Identifiability of a fit: the Hessian at the optimum, to compare with the Fisher information."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitters.integrator.initial_value_problem import (
    BATCH_NUMBERS,
    InitialValueProblem,
    difference_steps,
    initial_value_problem,
    value_names,
)
from fitters.ode.known_inputs import known_inputs
from fitters.ode.least_squares import FINE
from iris_sysid.errors import FitError
from iris_sysid.types import Array, FitResult, Hold, Identifiability, Trajectory

WIDER = 10.0  # second differences lose twice the digits of first ones: steps this much longer


def identifiability(result: FitResult, trajectory: Trajectory | None = None) -> Identifiability:
    """Identifiability of the free values of a fit, with the Hessian at its optimum.

    The Hessian of minus the log likelihood differs from the Fisher information by the curvature of the model along
    the residual. Where the two disagree, the fit is not a minimum, or the error bars cannot be ellipses.

    Parameters
    ----------
    result
        A fit with estimates.
    trajectory
        The fitted trajectory; needed for a model with inputs.

    Raises
    ------
    FitError
        When the fit failed, or the model has inputs and no trajectory is given.
    """
    if result.identifiability is None:
        raise FitError(f"a fit that failed ({result.status}) has nothing to identify: {result.message}")
    problem, values, which = _at_solution(result, trajectory)
    curvature = _curvature(problem, values, which, _pull(result, problem))
    hessian = result.fisher - curvature
    return replace(result.identifiability, hessian=hessian, hessian_condition=scaled_condition(hessian))


def scaled_condition(matrix: Array) -> float:
    """Condition number of a symmetric matrix (k, k) scaled to a unit diagonal; infinite when not positive definite."""
    size = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), np.nan))
    if size.size == 0 or not np.all(np.isfinite(size)):
        return float("inf") if size.size else 1.0
    eigenvalues = np.linalg.eigvalsh(matrix / np.outer(size, size))
    return float(eigenvalues[-1] / eigenvalues[0]) if eigenvalues[0] > 0 else float("inf")


def _at_solution(result: FitResult, trajectory: Trajectory | None) -> tuple[InitialValueProblem, Array, Array]:
    """The problem at the samples between the first and the last used, the solution, the indices of the free values."""
    model, names = result.model, value_names(result.model)
    if model.inputs and trajectory is None:
        raise FitError(f"model {model.name!r} has inputs: give the trajectory as well")
    used = np.flatnonzero(result.used)
    span = slice(int(np.searchsorted(result.t_s, result.t0_s)), int(used[-1]) + 1)
    inputs = None if trajectory is None else known_inputs(trajectory, model, span)
    hold: Hold = "linear" if trajectory is None else trajectory.hold
    values = np.array([result.estimates[name].value for name in names])
    problem = initial_value_problem(model, result.t_s[span], inputs, hold).planned(values, FINE.time_step)
    return problem, values, np.array([names.index(name) for name in result.free], dtype=np.intp)


def _pull(result: FitResult, problem: InitialValueProblem) -> Array:
    """Residual over the variance (n, d) at the samples of the problem, zero where a sample is not used."""
    start = int(np.searchsorted(result.t_s, problem.t_s[0]))
    residual = result.residual[start : start + problem.t_s.size] / np.maximum(result.rms**2, 1e-300)
    return np.asarray(np.nan_to_num(residual))


def _curvature(problem: InitialValueProblem, values: Array, which: Array, pull: Array) -> Array:
    """Second derivatives (k, k) of sum pull * prediction by the free values, by central differences."""
    k = which.size
    steps = WIDER * difference_steps(problem, values, which.astype(np.intp))
    pairs = [(i, j) for i in range(k) for j in range(i, k)]
    moves = np.array([np.zeros(k), *(np.eye(k)[[*{i, j}]].sum(axis=0) for i, j in pairs)]) * steps
    columns = np.repeat(values[:, None], 2 * len(moves), axis=1)
    columns[which] += np.concatenate([moves, -moves]).T
    batches = np.array_split(columns, -(-columns.shape[1] * problem.t_s.size // BATCH_NUMBERS), axis=1)
    parts = [np.einsum("nd,ndc->c", pull, np.nan_to_num(problem.predictions(batch))) for batch in batches]
    still, *moved = np.concatenate(parts).reshape(2, -1).sum(axis=0)
    change = np.zeros((k, k))  # with one value moved, on the diagonal, or two
    for pair, total in zip(pairs, moved, strict=True):
        change[pair] = total - still
    alone = np.diag(change)
    curvature = np.triu(change - alone[:, None] - alone, 1) / 2
    curvature = np.diag(alone) + curvature + curvature.T
    return np.asarray(curvature / np.outer(steps, steps))
