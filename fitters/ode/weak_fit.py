"""Fit a model in weak form: nothing is integrated, so a poor or unstable free run does no harm.

Both sides of y'' = f(t, y, y', u; p), or of y' = f for states of first order, are multiplied by a bump on a window and
integrated; by parts, the derivatives of the data go over to the bump (Messenger and Bortz 2021, Multiscale Model.
Simul. 19, 1474). The right side is evaluated along the smoothed motion. What the equation lacks errs each window by
itself, where a free run adds it up: the values are good starts for one, and effects can be ranked, even where the free
run of the model without them leaves the data at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares
from scipy.sparse import csr_array

from fitters.integrator.initial_value_problem import InitialValueProblem, value_names
from fitters.kept_answers import keeping_answers
from fitters.ode.fit_problem import PreparedFit, guesses, starting_values
from fitters.ode.prepared_request import NoMinimumError, task_of
from fitters.ode.request import FitRequest
from fitters.starting_values import bump
from iris_sysid.types import Array, OdeModel, Smoothed

MIN_HALF_WINDOW = 6.0  # samples in half a window
MAX_HALF_WINDOW = 0.05  # of the record
GROWTH = 1.5  # of half a window, until the noise is negligible in it
NOISE_SHARE = 0.1  # of the left side's size, up to which noise is negligible: a hundredth of its variance
EVALUATIONS = 50
SETTLED = 1e-8  # relative change of squares or values with which a fit ends: 1e-6 ends early in a flat valley
BLOCKS = 20  # of windows, by which errors are judged
FIRST_WINDOWS = 300  # windows, spread over the record, that a fit of three times as many begins with
STEP = 1e-5  # by which a value is changed for a derivative, relative to it
NOT_IMITATED = 1e-3  # of a force that the free values must not be able to imitate
MAX_RESIDUAL = 1e6  # of a residual, in standard deviations of the left side


@dataclass(frozen=True, eq=False, slots=True)
class WeakFit:
    """Values of a model in weak form.

    ``values`` by name, initial states among them, and ``stderr`` of those fitted, each in its own unit; ``residual``
    (w, q) of w windows and q equations, in standard deviations of the left side, and ``left_out`` (w, q) the same by a
    fit without each of BLOCKS blocks of windows, to first order. Standard errors are those of BLOCKS of
    windows (:func:`clustered_errors`): what the equation lacks lasts longer than a window.
    """

    values: Mapping[str, float]
    stderr: Mapping[str, float]
    residual: Array
    left_out: Array

    @property
    def squares(self) -> float:
        """Sum of squares of the residual."""
        return float(np.sum(self.residual**2))

    def block_squares(self) -> tuple[Array, Array]:
        """Mean square (b,) of each block of windows that is left out, dimensionless, and the windows of each (b,)."""
        parts = np.array_split(self.left_out, BLOCKS)
        return np.array([np.mean(part**2) for part in parts]), np.array([len(part) for part in parts])


def weak_fit(request: FitRequest) -> WeakFit | None:
    """Fit a request in weak form, along the smoothed motion of its trajectory.

    Parameters
    ----------
    request
        Its ``start`` goes before the model's guess. The trajectory must be smoothed.

    Returns
    -------
    WeakFit or None
        None where the form does not apply: states that are not observed, events, effects on the reading, no smoothed
        motion, or too few samples.

    Examples
    --------
    >>> import numpy as np
    >>> from fitters.ode import FitRequest
    >>> from fitters.ode.weak_fit import weak_fit
    >>> from iris_sysid import Quantity, Trajectory, model_from_equation, simulate, smooth
    >>> fall, t_s = model_from_equation("z'' = -g - c*z'"), np.arange(600) / 100
    >>> z = simulate(fall, t_s, {"g": 9.81, "c": 0.5, "z_0": 0.0, "z_rate_0": 5.0}).observed
    >>> clip = smooth(Trajectory(t_s, fall.observed, z, np.full_like(z, np.nan), np.ones(600, bool)))
    >>> values = weak_fit(FitRequest(clip, fall, start={"g": 5.0, "c": 0.0})).values
    >>> f"{values['g']:.2f} {values['c']:.2f}"
    '9.81 0.50'
    """
    smoothed = request.trajectory.smoothed
    if smoothed is None or not is_observed(request.model):
        return None
    try:
        task = task_of(request)
    except NoMinimumError:
        return None
    form = _WeakForm.of(task, smoothed)
    return None if form is None else form.fitted(request.start)


def weak_gains(
    request: FitRequest, values: Mapping[str, float], forces: Callable[[Array, Array, Array], Array]
) -> Array | None:
    """What each of k small forces would explain of the residual in weak form, to first order, as a share (k,) of it.

    Parameters
    ----------
    request
        Of a model without these forces, whose trajectory is smoothed.
    values
        Of its parameters by name; all that are not known may change with a force.
    forces
        ``forces(t_s (n,), states (n, s), slopes (n, s))``, a unit of each on the highest derivatives (k, n, f).

    Returns
    -------
    ndarray or None
        None where the form does not apply.
    """
    smoothed = request.trajectory.smoothed
    task = task_of(request)
    form = None if smoothed is None or not is_observed(request.model) else _WeakForm.of(task, smoothed)
    return None if form is None else form.gains(values, forces)


def is_observed(model: OdeModel) -> bool:
    """Whether the weak form applies to a model: every own state is observed, or is the velocity of one that is."""
    names = {quantity.name for quantity in model.observed}
    positions = {state.name for state in model.states[: model.degrees_of_freedom]}
    return model.observe is None and model.warp is None and not model.events and positions <= names


@dataclass(frozen=True, eq=False, slots=True)
class _WeakForm:
    """The smoothed own ``states`` (n, o), the ``left`` side (w, q), and the ``windows`` (w, n) that average the right.

    The inputs of ``problem`` are those at the samples: of one that is held, the mean of before and after.
    """

    task: PreparedFit
    problem: InitialValueProblem
    states: Array
    left: Array
    windows: csr_array

    @classmethod
    def of(cls, task: PreparedFit, smoothed: Smoothed) -> _WeakForm | None:
        model, span = task.model, task.selection.span
        names = [quantity.name for quantity in model.observed]
        which = [names.index(state.name) for state in model.states[: model.degrees_of_freedom]]
        columns = [task.trajectory.column(names[k]) for k in which]
        position, velocity = smoothed.position[span][:, columns], smoothed.velocity[span][:, columns]
        if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
            return None
        values = np.where(task.target.used[:, None], task.target.observed[:, which], position)
        states = np.hstack([position, velocity]) if model.second_order else position
        t_s, order = task.problem.t_s, 2 if model.second_order else 1
        half_s, longest_s = MIN_HALF_WINDOW * float(np.median(np.diff(t_s))), MAX_HALF_WINDOW * float(t_s[-1] - t_s[0])
        while half_s <= longest_s:
            mean, derivative = weak_windows(t_s, half_s, order)
            left = derivative @ values
            noise = np.sqrt(np.asarray((derivative.power(2)).sum(axis=1)).mean()) * task.noise[which]
            if left.shape[0] > 2 * max(len(task.free), BLOCKS) and np.all(noise <= NOISE_SHARE * np.std(left, axis=0)):
                return cls(task, _at_samples(task.problem), np.ascontiguousarray(states), left, mean)
            half_s *= GROWTH
        return None

    def _first(self) -> list[float]:
        """The initial states (s,) in the units of the states: hidden ones are zero."""
        return [*self.states[0].tolist(), *[0.0] * self.task.model.hidden]

    def residual(self, params: Array) -> Array:
        """Residual (w, q) of the parameters (p,), in units of the left side."""
        return self.residuals(params[:, None])[:, :, 0]

    def residuals(self, columns: Array) -> Array:
        """Residuals (w, q, c) of c columns of parameters (p, c), in units of the left side."""
        if self.task.model.hidden and columns.shape[1] > 1:
            each = [self.residuals(columns[:, c : c + 1]) for c in range(columns.shape[1])]
            return np.concatenate(each, axis=2)
        with np.errstate(all="ignore"):
            states = self.problem.with_hidden(self.states, columns[:, 0])
            slopes = self.problem.slopes_of(states, columns)[:, self.task.model.forced_states]
            mean = self.windows @ slopes.reshape(len(slopes), -1)
            return np.asarray(self.left[:, :, None] - mean.reshape(*self.left.shape, -1))

    def bounded(self, columns: Array) -> Array:
        """Residuals (w, q, c) of columns (p, c), in units of the left side's scatter, where no value is infinite.

        A motion may run away for a trial value.
        """
        scaled = self.residuals(columns) / np.std(self.left, axis=0)[:, None]
        return np.clip(np.nan_to_num(scaled, nan=MAX_RESIDUAL), -MAX_RESIDUAL, MAX_RESIDUAL)

    def moved(self, params: Array, which: Sequence[int] | NDArray[np.intp], most: Array) -> Array:
        """Derivatives (w, q, k) of the bounded residual, in units of the left side's scatter, by k parameters.

        ``params`` (p,); those in ``which`` (k,) are moved, and may be at ``most`` (k,).
        """
        columns = np.repeat(params[:, None], len(which) + 1, axis=1)
        steps = STEP * np.maximum(np.abs(params[which]), STEP)
        steps = np.where(params[which] + steps > most, -steps, steps)
        columns[which, np.arange(1, len(which) + 1)] += steps
        found = self.bounded(columns)
        return np.asarray((found[:, :, 1:] - found[:, :, :1]) / steps)

    def gains(self, values: Mapping[str, float], forces: Callable[[Array, Array, Array], Array]) -> Array:
        """What each of some forces explains (k,) beside the free values; see :func:`weak_gains`."""
        names, model = value_names(self.task.model), self.task.model
        params = np.array([values[parameter.name] for parameter in model.parameters])
        free = [names.index(name) for name in self.task.unknowns.names if name not in model.initial_names]
        residual, size = self.residual(params), np.std(self.left, axis=0)
        moved = self.moved(params, free, np.full(len(free), np.inf))
        basis = np.linalg.qr(_unit_columns(moved.reshape(residual.size, len(free))))[0]
        states = self.problem.with_hidden(self.states, params)
        given = np.nan_to_num(forces(self.problem.t_s, states, self.problem.slopes(states, params)))
        acting = np.stack([(self.windows @ force) / size for force in given]).reshape(len(given), -1).T
        rest = acting - basis @ (basis.T @ acting)
        seen = np.linalg.norm(rest, axis=0) > NOT_IMITATED * np.linalg.norm(acting, axis=0)
        left = (residual / size).ravel()
        left = left - basis @ (basis.T @ left)
        return np.where(seen, (left @ _unit_columns(rest)) ** 2 / max(float(left @ left), 1e-300), 0.0)

    def fitted(self, start: Mapping[str, float]) -> WeakFit:
        """Least squares from a start, which goes before the model's guess."""
        task, names = self.task, value_names(self.task.model)
        vector = next(starting_values(task, start, guesses(task, start)))
        vector[len(task.model.parameters) :] = [
            task.known[name].value if name in task.known else value
            for name, value in zip(task.model.initial_names, self._first(), strict=True)
        ]
        free = [k for k, name in enumerate(task.unknowns.names) if name not in task.model.initial_names]
        which = task.unknowns.which[free]
        bounds = task.unknowns.lower[free], task.unknowns.upper[free]

        def whole(now: Array) -> Array:
            params = vector[: len(task.model.parameters)].copy()
            params[which] = now
            return params

        errors: dict[str, float] = {}
        jacobian = np.zeros((self.left.size, 0))
        if which.size:
            found = self._minimised(whole, task.unknowns.inside(vector)[which], which, bounds)
            slopes = np.asarray(found.jac, dtype=np.float64)
            vector[which], jacobian = found.x, slopes / np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
            parts = zip(np.array_split(slopes, BLOCKS), np.array_split(found.fun, BLOCKS), strict=True)
            errors = dict(zip([task.unknowns.names[k] for k in free], clustered_errors(parts), strict=True))
        residual = self.bounded(whole(vector[which])[:, None])[:, :, 0]
        left_out = _left_out(jacobian.reshape(*self.left.shape, -1), residual)
        return WeakFit(dict(zip(names, vector.tolist(), strict=True)), errors, residual, left_out)

    def _minimised(
        self, whole: Callable[[Array], Array], start: Array, which: NDArray[np.intp], bounds: tuple[Array, Array]
    ) -> OptimizeResult:
        """Least squares of the free values (k,); where there are many windows, from the values of few of them."""
        few = self._few()
        begin = start if few is None else few._minimised(whole, start, which, bounds).x

        def flat(now: Array) -> Array:
            return self.bounded(whole(now)[:, None]).ravel()

        def slopes_of(now: Array) -> Array:
            return self.moved(whole(now), which, bounds[1]).reshape(self.left.size, -1)

        return least_squares(
            flat, begin, slopes_of, bounds=bounds, x_scale="jac", ftol=SETTLED, xtol=SETTLED, max_nfev=EVALUATIONS
        )

    def _few(self) -> _WeakForm | None:
        """The first windows of each of BLOCKS parts, FIRST_WINDOWS in all; None where that saves little.

        Hidden states are followed from sample to sample.
        """
        if self.task.model.hidden or len(self.left) < 3 * FIRST_WINDOWS:
            return None
        parts = np.array_split(np.arange(len(self.left)), BLOCKS)
        rows = np.concatenate([part[: FIRST_WINDOWS // BLOCKS] for part in parts])
        windows = csr_array(self.windows[rows])
        kept = np.unique(windows.indices)
        problem = replace(self.problem, t_s=self.problem.t_s[kept], inputs=self.problem.inputs[kept])
        states, windows = np.ascontiguousarray(self.states[kept]), csr_array(windows[:, kept])
        return replace(self, problem=problem, states=states, left=self.left[rows], windows=windows)


def _unit_columns(columns: Array) -> Array:
    return np.asarray(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))


def _left_out(jacobian: Array, residual: Array) -> Array:
    """Residual (w, q) of each block of windows by a fit without it, to first order in the values.

    (1 - J A^-1 J')^-1 r = r + J (A - J'J)^-1 J' r for the rows J of a block and the information A of all.
    """
    flat = jacobian.reshape(residual.size, -1)
    information = flat.T @ flat
    parts = []
    for rows, values in zip(np.array_split(jacobian, BLOCKS), np.array_split(residual, BLOCKS), strict=True):
        block = rows.reshape(values.size, -1)
        step = np.linalg.pinv(information - block.T @ block, hermitian=True) @ (block.T @ values.ravel())
        parts.append(values + (block @ step).reshape(values.shape))
    return np.concatenate(parts)


def clustered_errors(clusters: Iterable[tuple[Array, Array]]) -> list[float]:
    """Standard errors (k,) of least squares that allow for any correlation of the residual within a cluster.

    They have the units of the values. The sandwich estimator: Cameron and Miller 2015, J. Human Resources 50, 317,
    eq. 11.

    Parameters
    ----------
    clusters
        Jacobian (n, k) and residual (n,) of each.
    """
    parts = list(clusters)
    scale = np.maximum(np.linalg.norm(np.vstack([jacobian for jacobian, _ in parts]), axis=0), 1e-300)
    inverse = np.linalg.pinv(sum((jacobian / scale).T @ (jacobian / scale) for jacobian, _ in parts))
    sums = np.array([(jacobian / scale).T @ residual for jacobian, residual in parts])
    covariance = inverse @ (sums.T @ sums) @ inverse * len(parts) / (len(parts) - 1)
    return [float(error) for error in np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale]


def _at_samples(problem: InitialValueProblem) -> InitialValueProblem:
    if problem.hold == "linear" or not problem.inputs.size:
        return problem
    before = np.concatenate([problem.inputs[:1], problem.inputs[:-1]])
    return replace(problem, inputs=np.ascontiguousarray((before + problem.inputs) / 2))


@keeping_answers
def weak_windows(t_s: Array, half_s: float, order: int) -> tuple[csr_array, csr_array]:
    """Weights (w, n) of the mean over each window, and those of the derivative in s^-order; half a window apart.

    Those of the derivative are exact for polynomials of that order, as the integrals are, whatever the sampling. A
    window in a gap, which has fewer than half of the usual samples, is left out.
    """
    centres_s = np.arange(t_s[0] + half_s, t_s[-1] - half_s, half_s)
    firsts, lasts = np.searchsorted(t_s, [centres_s - half_s, centres_s + half_s])
    full = lasts - firsts >= np.median(lasts - firsts) / 2
    centres_s, firsts, counts = centres_s[full], firsts[full], (lasts - firsts)[full]
    rows = np.repeat(np.arange(centres_s.size), counts)
    columns = np.arange(rows.size) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(firsts, counts)
    u = (t_s[columns] - centres_s[rows]) / half_s
    value, slope, curve = bump(u, 1.0) * np.gradient(t_s)[columns]  # the trapezoidal rule; the bump is zero at the ends

    def total(each: Array) -> Array:
        return np.asarray(np.bincount(rows, each, minlength=centres_s.size), dtype=np.float64)

    moments = np.array([total(value * u**k) for k in range(2 * order)])
    gram = np.moveaxis(moments[np.add.outer(np.arange(order), np.arange(order))], 2, 0)
    derivative = curve if order == 2 else -slope
    wrong = np.stack([total(derivative * u**k) for k in range(order)], axis=1)
    taken = np.linalg.solve(gram, wrong[:, :, None])[:, :, 0]
    derivative = derivative - value * sum(taken[rows, k] * u**k for k in range(order))
    scale = total(derivative * u**order) * half_s**order / order
    shape = centres_s.size, t_s.size
    mean = csr_array((value / moments[0][rows], (rows, columns)), shape=shape)
    return mean, csr_array((derivative / scale[rows], (rows, columns)), shape=shape)
