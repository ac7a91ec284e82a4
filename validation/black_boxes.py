"""Models of a record without physics, for comparison: a polynomial NARX, SINDy with inputs, a linear model.

Each is a function of a record and of the number of its first samples that may be used; it gives the free simulation
(n,) of the output, NaN from where it diverges.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from itertools import combinations_with_replacement

import numpy as np

from fitters.linear_model import output_error_model
from iris_sysid import Trajectory
from iris_sysid.types import Array

BlackBox = Callable[[Trajectory, int], Array]
MAX_TERMS = 20  # of the NARX
RUNAWAY = 10.0  # times the largest reading at which a simulation has diverged
THRESHOLDS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)  # of the sparse regression, on columns of size one


def narx(estimation: Trajectory, order: int, degree: int = 2) -> BlackBox:
    """A polynomial NARX of this order, terms taken by forward orthogonal least squares (Chen et al. 1989, IJC 50).

    Candidates are the products of up to ``degree`` of the last ``order`` outputs and inputs and the present input; the
    term that reduces the error most is added while the Bayesian information criterion falls. ``sysidentpy`` has the
    same method; it is not installed here, so this is the project's own.
    """
    u, y = _series(estimation)
    rows = np.arange(order, y.size)
    lagged = np.column_stack([*(y[rows - k] for k in range(1, order + 1)), *(u[rows - k] for k in range(order + 1))])
    powers = _powers(lagged.shape[1], degree)
    features, target = _products(lagged, powers), y[rows]
    chosen, best = [0], np.inf
    while len(chosen) < MAX_TERMS:
        basis = np.linalg.qr(features[:, chosen])[0]
        left = features - basis @ (basis.T @ features)
        size = np.sum(left**2, axis=0)
        gain = np.where(size > 1e-9 * np.sum(features**2, axis=0), (left.T @ target) ** 2 / np.maximum(size, 1e-300), 0)
        trial = [*chosen, int(np.argmax(gain))]
        error = np.sum((target - features[:, trial] @ np.linalg.lstsq(features[:, trial], target)[0]) ** 2)
        criterion = rows.size * np.log(error / rows.size) + len(trial) * np.log(rows.size)
        if criterion >= best:
            break
        chosen, best = trial, criterion
    kept, weights = powers[chosen], np.linalg.lstsq(features[:, chosen], target)[0]

    def simulated(record: Trajectory, first: int) -> Array:
        given, seen = _series(record)
        made, limit = seen.copy(), RUNAWAY * np.max(np.abs(y))
        for k in range(max(first, order), seen.size):
            past = np.concatenate([made[k - order : k][::-1], given[k - order : k + 1][::-1]])
            made[k] = float(_products(past[None], kept)[0] @ weights)
            if not abs(made[k]) < limit:
                made[k:] = np.nan
                break
        return made

    return simulated


def linear(estimation: Trajectory, order: int) -> BlackBox:
    """The linear model of this order with the smallest simulation error; see :mod:`fitters.linear_model`."""
    u, y = _series(estimation)
    model = output_error_model(u[:, None], y, np.ones(y.size, dtype=np.bool_), order)

    def simulated(record: Trajectory, first: int) -> Array:
        given, seen = _series(record)
        if model is None:
            return np.full(seen.size, np.nan)
        return model.simulated(given[:, None], seen, np.arange(seen.size) < max(first, order))

    return simulated


def sindy_with_inputs(estimation: Trajectory, degree: int = 2) -> BlackBox:
    """PySINDy's sparse regression on the output, its derivative and the input; of all thresholds the best simulation.

    States are y and y', by pysindy's smoothed finite differences; the threshold is that whose free simulation of the
    estimation record has the smallest error.
    """
    import pysindy

    u, y = _series(estimation)
    step_s = float(np.median(np.diff(estimation.t_s)))
    rate = np.asarray(pysindy.SmoothedFiniteDifference()._differentiate(y[:, None], step_s))[:, 0]
    states, scale = np.column_stack([y, rate]), np.array([np.std(y), np.std(rate)])
    models = []
    for threshold in THRESHOLDS:
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold, normalize_columns=True),
            feature_library=pysindy.PolynomialLibrary(degree=degree),
            differentiation_method=pysindy.SmoothedFiniteDifference(),
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a threshold that leaves nothing is one that is not taken
            model.fit(states / scale, t=step_s, u=u[:, None])
        models.append(np.asarray(model.coefficients()))
    powers = np.asarray(model.feature_library.powers_)

    def with_weights(weights: Array) -> BlackBox:
        def simulated(record: Trajectory, first: int) -> Array:
            given, seen = _series(record)
            first = max(first, 3)
            state = np.array([seen[first - 1], (1.5 * seen[first - 1] - 2 * seen[first - 2] + 0.5 * seen[first - 3])])
            state = state / scale / np.array([1.0, step_s])
            made, limit = seen.copy(), RUNAWAY * np.max(np.abs(y))
            for k in range(first, seen.size):
                state = _step(
                    lambda x, now=given[k - 1]: weights @ np.prod(np.append(x, now) ** powers, axis=1), state, step_s
                )
                made[k] = state[0] * scale[0]
                if not abs(made[k]) < limit:
                    made[k:] = np.nan
                    break
            return made

        return simulated

    def error(box: BlackBox) -> float:
        difference = box(estimation, 3) - y
        return float(np.mean(difference**2)) if np.all(np.isfinite(difference)) else np.inf

    with np.errstate(all="ignore"):
        return min(map(with_weights, models), key=error)


def _series(record: Trajectory) -> tuple[Array, Array]:
    """The input (n,) and the output (n,)."""
    assert record.inputs is not None
    return record.inputs[:, 0], record.position[:, 0]


def _powers(count: int, degree: int) -> Array:
    """Exponents (t, count) of all products of up to ``degree`` factors; the constant first."""
    rows = [each for size in range(degree + 1) for each in combinations_with_replacement(range(count), size)]
    return np.array([np.bincount(np.array(each, dtype=np.intp), minlength=count) for each in rows])


def _products(values: Array, powers: Array) -> Array:
    """Products (n, t) of values (n, c)."""
    return np.asarray(np.prod(values[:, None, :] ** powers[None], axis=2))


def _step(slope: Callable[[Array], Array], state: Array, step_s: float, parts: int = 4) -> Array:
    """One sample by the classical method of Runge and Kutta, in a few parts."""
    h = step_s / parts
    for _ in range(parts):
        a = slope(state)
        b = slope(state + h / 2 * a)
        c = slope(state + h / 2 * b)
        state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c))
    return state
