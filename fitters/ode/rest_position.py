"""Where an oscillation rests: the zero of its scale is usually elsewhere, and a model that takes it for that is wrong.

A stiffness that is fitted to a motion about 0.25 m as if that were zero comes out below zero. The rest position is
estimated where the data call for it: where the motion swings without passing its zero, or where the fit with it is
better and the position differs from zero by more than its error.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from fitters.starting_values import samples
from iris_sysid.trajectory.consistency.path_shape import reversals
from iris_sysid.types import Array, FitResult, OdeModel, Trajectory

SWINGS = 2  # reversals of an oscillation that must pass its rest position between them
MIN_SIGMAS = 3.0  # standard errors by which a rest position differs from zero
SUSPECTED = 2.0  # standard errors of the residual's mean, as of white noise, beyond which the fit with it is tried


def held_zeros(trajectory: Trajectory, model: OdeModel, chosen: Collection[str]) -> tuple[str, ...]:
    """The rest positions of a model that are zero only because nobody stated them.

    Parameters
    ----------
    trajectory
        Its ``geometry`` and ``known`` may state them.
    model
        The governing equation.
    chosen
        Names that are held or estimated on request.
    """
    stated = {*chosen, *trajectory.geometry, *trajectory.known}
    rests = (parameter for parameter in model.with_role("offset") if parameter.constant and parameter.default == 0.0)
    return tuple(parameter.name for parameter in rests if parameter.name not in stated)


def off_zero(trajectory: Trajectory, model: OdeModel) -> bool:
    """Whether some observed quantity swings to and fro without passing zero, where a model has it rest.

    Parameters
    ----------
    trajectory
        What is to be fitted.
    model
        The governing equation.
    """
    names = {quantity.name for quantity in trajectory.quantities}
    seen = [samples(trajectory, quantity.name)[1] for quantity in model.observed if quantity.name in names]
    return any(_stays_on_one_side(values) for values in seen)


def _stays_on_one_side(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 0 and bool(np.min(known) * np.max(known) > 0) and reversals(known) >= SWINGS


def calls_for_rest(fitted: FitResult) -> bool:
    """Whether a fit with its rest position at zero may be better with another: a misfit, or a residual off zero."""
    if fitted.status in ("misfit", "not-converged", "diverged", "at-bound"):
        return True
    residual = fitted.residual[fitted.used]
    if not residual.size:
        return False
    with np.errstate(all="ignore"):
        return bool(np.any(np.abs(residual.mean(axis=0)) * np.sqrt(len(residual)) > SUSPECTED * fitted.rms))


def is_better(fitted: FitResult, held: FitResult, names: Sequence[str]) -> bool:
    """Whether a fit with its rest positions estimated is to be taken in place of that with zero.

    Parameters
    ----------
    fitted, held
        With them estimated, and with zero.
    names
        Of the rest positions.
    """
    rests = [fitted.estimates[name] for name in names]
    clear = any(abs(rest.value) > MIN_SIGMAS * rest.stderr for rest in rests)
    follows = bool(np.all(fitted.rms**2 < 0.5 * held.rms**2))  # most of what was left is the rest position, if unsure
    return fitted.usable and (clear or follows) and (not held.usable or fitted.bic < held.bic)
