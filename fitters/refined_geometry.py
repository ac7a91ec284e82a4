"""Fit what a phenomenon observes, in turns with the part of its geometry that the fit determines better."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from fitters.ode.single_clip import fit
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate, FitResult, Phenomenon, Trajectory

PASSES = 4  # of geometry and fit; each reduces the error by about theta_0^2 / 4

# the positions of each body and the observable, by the values that are known
Observing = Callable[[Mapping[str, Estimate]], tuple[list[Trajectory], Trajectory]]


def with_constants(
    trajectory: Trajectory, phenomenon: Phenomenon, known: Mapping[str, Estimate], free: Sequence[str]
) -> Trajectory:
    """The observable with the constants of its model that are known, beside its own, and those to estimate.

    Parameters
    ----------
    trajectory
        What the phenomenon observes.
    phenomenon
        Has the model, and constants that are always estimated.
    known
        Values of the model and of the scene, by name; the latter are left out.
    free
        Further constants to estimate. Gravity is one of a flight in px, as its value is not known in them.
    """
    model = MODELS.named(phenomenon.model)
    names = {parameter.name for parameter in model.parameters}
    if phenomenon.free_flight and any(quantity.unit == "px" for quantity in trajectory.quantities):
        free = [*free, *(parameter.name for parameter in model.with_role("gravity"))]
    fixed = {**trajectory.known, **{name: value for name, value in known.items() if name in names}}
    wanted = [name for name in dict.fromkeys((*phenomenon.free, *free)) if name not in fixed]
    return trajectory.with_(known=fixed, free=wanted)


def fit_in_turns(
    phenomenon: Phenomenon, settings: Mapping[str, Estimate], observing: Observing
) -> tuple[list[Trajectory], Trajectory, FitResult]:
    """Observe and fit, repeatedly where the fit determines part of the geometry better than the path does.

    Parameters
    ----------
    phenomenon
        What to fit, and what a fit tells of the geometry.
    settings
        What is known beforehand, by name.
    observing
        Gives the positions and the observable, with its constants, from what is known.

    Returns
    -------
    world : list of Trajectory
        The positions of each body.
    trajectory : Trajectory
        The observable.
    fit : FitResult
        The model fitted to it.
    """
    model, known = MODELS.named(phenomenon.model), dict(settings)
    for _ in range(PASSES):
        world, trajectory = observing(known)
        result = fit(trajectory, model)
        better = phenomenon.refine(result, trajectory) if phenomenon.refine is not None else {}
        if all(_settled(known.get(name), value) for name, value in better.items()):
            break
        known.update(better)
    return world, trajectory, result


def _settled(before: Estimate | None, now: Estimate) -> bool:
    return before is not None and abs(now.value - before.value) < 0.1 * now.stderr
