"""Fit the model of a phenomenon to a table of positions: x and z become the angle, height or distance it observes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fitters.ode.single_clip import fit
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.trajectory.consistency.path_shape import phenomenon_doubt
from iris_sysid.trajectory.observables import observed
from iris_sysid.trajectory.segmentation import segment
from iris_sysid.trajectory.smoothing import smooth
from iris_sysid.types import Estimate, FitResult, OdeModel, Phenomenon, Trajectory

PASSES = 4  # of geometry and fit; each reduces the error by about theta_0^2 / 4
PLANE = {"x", "z"}


def phenomenon_of(model: OdeModel, trajectory: Trajectory) -> Phenomenon | None:
    """The phenomenon by which positions x and z become what a model observes.

    Parameters
    ----------
    model
        The equation that is to be fitted.
    trajectory
        What was measured.

    Returns
    -------
    Phenomenon or None
        None where the model observes what the trajectory holds, or no phenomenon of one body has that model.
    """
    names = {quantity.name for quantity in trajectory.quantities}
    if {quantity.name for quantity in model.observed} <= names or not names >= PLANE:
        return None
    alike = (
        phenomenon
        for phenomenon in PHENOMENA.values()
        if phenomenon.model == model.name and phenomenon.measures == "position" and phenomenon.bodies == 1
    )
    return next(alike, None)


def in_plane(trajectory: Trajectory, phenomenon: Phenomenon) -> Trajectory:
    """The columns x and z of a trajectory, in that order, segmented by what the phenomenon does.

    Parameters
    ----------
    trajectory
        Holds x and z among others; its segments are kept where it has any.
    phenomenon
        Says which motion to look for.
    """
    columns = [trajectory.column("x"), trajectory.column("z")]
    plane = trajectory.with_(
        quantities=tuple(trajectory.quantities[k] for k in columns),
        position=trajectory.position[:, columns],
        sigma=trajectory.sigma[:, columns],
        systematic={source: patterns[..., columns] for source, patterns in trajectory.systematic.items()},
        smoothed=None,
    )
    return plane if plane.segments else segment(plane, kind=phenomenon.motion)


def observed_positions(
    trajectory: Trajectory, phenomenon: Phenomenon, known: Mapping[str, Estimate], free: Sequence[str] = ()
) -> Trajectory:
    """What a phenomenon observes of a table of positions, smoothed, with what is known and what is to be estimated.

    Parameters
    ----------
    trajectory
        x and z (n, 2), m or px.
    phenomenon
        Turns them into what its model observes.
    known
        Values of the model and of the scene, by name.
    free
        Constants to estimate beside those of the phenomenon.

    Raises
    ------
    DataError
        When the positions do not show what the phenomenon observes.
    """
    names = {parameter.name for parameter in MODELS[phenomenon.model].parameters}
    fixed = {**trajectory.known, **{name: value for name, value in known.items() if name in names}}
    wanted = [name for name in dict.fromkeys((*phenomenon.free, *free)) if name not in fixed]
    seen = smooth(observed(phenomenon, [in_plane(trajectory, phenomenon)], known))
    return seen.with_(known=fixed, free=wanted)


def fit_positions(
    trajectory: Trajectory, phenomenon: Phenomenon, known: Mapping[str, Estimate], free: Sequence[str] = ()
) -> tuple[Trajectory, FitResult]:
    """Observe and fit, repeatedly where the fit determines part of the geometry better than the path does.

    Parameters
    ----------
    trajectory
        x and z (n, 2), m or px.
    phenomenon
        Turns them into what its model observes.
    known, free
        As for :func:`observed_positions`.

    Returns
    -------
    observed : Trajectory
        The quantity that the model observes.
    fit : FitResult
        The model fitted to it, with a doubt where the path is that of another phenomenon.

    Raises
    ------
    DataError
        When the positions do not show what the phenomenon observes.
    """
    settings = dict(known)
    for _ in range(PASSES):
        seen = observed_positions(trajectory, phenomenon, settings, free)
        result = fit(seen, phenomenon.model)
        better = phenomenon.refine(result, seen) if phenomenon.refine is not None else {}
        if all(_settled(settings.get(name), value) for name, value in better.items()):
            break
        settings.update(better)
    another = phenomenon_doubt(in_plane(trajectory, phenomenon), phenomenon)
    doubts = (*trajectory.doubts, *([another] if another is not None else []))
    return seen.with_(doubts=doubts), replace(result, doubts=tuple(dict.fromkeys((*result.doubts, *doubts))))


def _settled(before: Estimate | None, now: Estimate) -> bool:
    return before is not None and abs(now.value - before.value) < 0.1 * now.stderr
