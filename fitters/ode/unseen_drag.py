"""Drag that a short fall cannot show, as an error of what is fitted to it.

Drag k v^2 makes a fall slower almost as a smaller gravity does: only what a change of the fitted values cannot imitate
shows in the residual. Of k, its prior and the likelihood of that residual leave a mean square E(k^2), from zero, the k
of the equation. A fitted value then has the further error shift E(k^2)^(1/2), where shift is how far a unit of drag
moves it: shift = (J'J)^-1 J's, with s the response of the motion to a unit of k.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from fitters.integrator.initial_value_problem import value_names
from fitters.noise.sandwich_covariance import inverse_normal
from fitters.ode.fit_problem import PreparedFit
from fitters.ode.least_squares import Solution, Target
from fitters.ode.model_discrepancy import response_to_force
from iris_sysid.types import Array, Estimate, Mask, OdeModel, Trajectory

STANDARD_GRAVITY = 9.80665  # m/s^2
UNSEEN_DRAG = "drag that the data cannot rule out"
AIR = 1.2  # kg/m^3, at sea level and 20 degrees
COEFFICIENTS = 0.1, 2.0  # of drag: a streamlined body, and a plate across the wind (Hoerner 1965, Fluid-Dynamic Drag)
# Drag over mass, 1/m: a steel ball of 2 cm has 0.002, a table tennis ball 0.12, a balloon 2.
MIN_DRAG, MAX_DRAG = 0.002, 2.0
NEGLIGIBLE = 0.2  # probability, before the data, that there is no drag to speak of: a heavy body, or a slow one
GRID = 200


def unseen_drag(
    task: PreparedFit, target: Target, solution: Solution, sensitivity: Array, usable: Mask
) -> Array | None:
    """Change (k,) of the free values for one standard error of a drag that is not in the equation.

    None for a motion other than a free fall with gravity estimated; NaN for values at a bound.

    Parameters
    ----------
    task, target, solution
        The prepared fit, the samples used with their weights, and the solution.
    sensitivity
        (n * d, k) of the used samples to the free values, in units of sigma.
    usable
        (k,) false for values at a bound: they are held there.
    """
    response = drag_response(task, target, solution, task.free)
    if response is None or not usable.any():
        return None
    jacobian = sensitivity[:, usable]
    residual = ((target.observed - solution.predicted) / target.sigma)[target.used].ravel()
    moves = inverse_normal(jacobian, 1e-6) @ (jacobian.T @ response)
    shift = np.full(usable.size, np.nan)
    shift[usable] = moves * root_mean_square(
        residual, response - jacobian @ moves, jacobian.shape[1], *prior_of(task.trajectory, gravity_of(task, solution))
    )
    return shift if np.all(np.isfinite(shift[usable])) else None


def drag_response(task: PreparedFit, target: Target, solution: Solution, estimated: Collection[str]) -> Array | None:
    """What a unit of drag adds to the used samples (n * d,), in units of sigma.

    None for a motion other than a free fall with gravity estimated.

    Parameters
    ----------
    task, target, solution
        The prepared fit, the samples used with their weights, and the solution.
    estimated
        Names of the values that are not given, those shared by several clips among them.
    """
    if not (solution.converged and _falls_freely(task, estimated)):
        return None
    response = response_to_force(solution, _drag)
    return None if response is None else np.asarray((response / target.sigma)[target.used].ravel())


def _falls_freely(task: PreparedFit, estimated: Collection[str]) -> bool:
    """Whether nothing but an estimated gravity acts on the body: a fall or a throw."""
    model = task.model
    return (
        any(parameter.name in estimated for parameter in model.with_role("gravity"))
        and not any(parameter.name in task.priors for parameter in model.with_role("gravity"))
        and model.second_order
        and not (model.events or model.inputs or _has_drag(model, estimated))
        and all(quantity.unit in ("m", "px") for quantity in model.observed)
    )


def _has_drag(model: OdeModel, free: Collection[str]) -> bool:
    names = {parameter.name for parameter in model.parameters}
    damped = any(parameter.name in free for parameter in model.with_role("damping"))
    return damped or any("drag" in name for name in names)


def _drag(velocity: Array) -> Array:
    """Deceleration (n, f) of a unit of drag, at velocities (n, f)."""
    return np.asarray(-np.linalg.norm(velocity, axis=1, keepdims=True) * velocity)


def gravity_of(task: PreparedFit, solution: Solution) -> float:
    """The fitted gravity, in the unit of length of the trajectory per s^2."""
    (name, *_) = (parameter.name for parameter in task.model.with_role("gravity"))
    return float(solution.values[value_names(task.model).index(name)])


def prior_of(trajectory: Trajectory, gravity: float) -> tuple[float, float, float]:
    """The least and the most drag over mass, of equal probability per factor, and the probability of none.

    Parameters
    ----------
    trajectory
        Its ``geometry`` may hold the ``mass`` and the ``ball_radius`` of the body.
    gravity
        As fitted: that of the Earth tells how long the unit of length is, e.g. where it is a pixel. Drag over mass is
        in one per that unit.
    """
    stated: Mapping[str, Estimate] = {**trajectory.geometry, **trajectory.known}
    mass, radius = stated.get("mass"), stated.get("ball_radius")
    metres = STANDARD_GRAVITY / max(abs(gravity), 1e-9)
    if mass is None or radius is None or not (mass.value > 0 and radius.value > 0):
        return MIN_DRAG * metres, MAX_DRAG * metres, NEGLIGIBLE
    area = np.pi * radius.value**2
    least, most = (float(0.5 * AIR * coefficient * area / mass.value * metres) for coefficient in COEFFICIENTS)
    return least, most, 0.0


def root_mean_square(
    residual: Array,
    unseen: Array,
    count: int,
    least: float = MIN_DRAG,
    most: float = MAX_DRAG,
    negligible: float = NEGLIGIBLE,
) -> float:
    """Root of the mean square of k, from its prior and what a residual says of it, in noise of unknown size.

    The likelihood of k with the noise and the ``count`` fitted values integrated out is |r - k u|^-(m - count).

    Parameters
    ----------
    residual
        (m,) of the fit without drag.
    unseen
        (m,) what the fitted values leave of the response to a unit of k, in the same unit.
    count
        Number of fitted values.
    least, most, negligible
        k is zero with the last of these as its probability, else of equal probability per factor from least to most.
    """
    slope, curvature = float(unseen @ residual), float(unseen @ unseen)
    degrees, none = max(residual.size - count, 1), max(float(residual @ residual), 1e-300)
    sizes = np.geomspace(least, most, GRID)
    if curvature > 0:  # where the data tell k well, its likelihood may lie between two of these
        best = slope / curvature
        spread = np.sqrt(max(none - slope * best, 1e-30 * none) / degrees / curvature)
        near = np.clip(best + spread * np.linspace(-6.0, 6.0, GRID), least, most)
        sizes = np.unique(np.concatenate([sizes, near]))
    squares = np.maximum(none - 2 * sizes * slope + sizes**2 * curvature, 1e-30 * none)
    logs = -0.5 * degrees * np.log(squares / none)
    highest = max(float(logs.max()), 0.0)
    shares = np.gradient(np.log(sizes)) * np.exp(logs - highest) * (1.0 - negligible) / np.log(most / least)
    total = float(shares.sum()) + negligible * float(np.exp(-highest))
    return float(np.sqrt(shares @ sizes**2 / total))
