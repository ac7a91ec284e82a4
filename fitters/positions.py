"""Fit the model of a phenomenon to a table of positions: x and z become the angle, height or distance it observes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitters.ode.fit_problem import select
from fitters.refined_geometry import fit_in_turns, with_constants
from fitters.selection.observables import as_trajectory, observables_of, raw_of, suits
from iris_sysid.registry import PHENOMENA
from iris_sysid.trajectory.consistency.path_shape import phenomenon_doubt
from iris_sysid.trajectory.observables import observed
from iris_sysid.trajectory.segmentation import segment
from iris_sysid.trajectory.smoothing import smooth
from iris_sysid.types import Estimate, FitResult, OdeModel, Phenomenon, Trajectory

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


def along_path(model: OdeModel, trajectory: Trajectory) -> Trajectory | None:
    """What a model without a phenomenon observes of positions: the distance along their line, or the angle on a circle.

    Parameters
    ----------
    model
        Observes one quantity, a length or an angle.
    trajectory
        Holds x and z (n, 2), m or px, and what is known.

    Returns
    -------
    Trajectory or None
        The samples that are used; None where the model observes nothing that positions show, or what is there already.
    """
    names = {quantity.name for quantity in trajectory.quantities}
    if {quantity.name for quantity in model.observed} <= names or not names >= PLANE or len(model.observed) != 1:
        return None
    used = select(trajectory, ("motion",)).used
    raw = raw_of(trajectory, used)
    suited = (seen for seen in observables_of(raw, np.ones(raw.t_s.size, np.bool_)) if suits(model, seen))
    seen = next(suited, None)
    if seen is None:
        return None
    across = trajectory.sigma[used][:, [trajectory.column("x"), trajectory.column("z")]]
    sigma = np.sqrt(np.mean(across**2, axis=1, keepdims=True)) / (seen.lever * raw.sigma("x", "z"))
    return as_trajectory(raw.t_s, seen, model).with_(sigma=sigma, known=trajectory.known, sensor=trajectory.sensor)


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
    seen = smooth(observed(phenomenon, [in_plane(trajectory, phenomenon)], known)).with_(known=trajectory.known)
    return with_constants(seen, phenomenon, known, free)


def fit_positions(
    trajectory: Trajectory, phenomenon: Phenomenon, known: Mapping[str, Estimate], free: Sequence[str] = ()
) -> tuple[Trajectory, Trajectory, FitResult]:
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
    plane : Trajectory
        x and z (n, 2), with segments.
    observed : Trajectory
        The quantity that the model observes.
    fit : FitResult
        The model fitted to it, with a doubt where the path is that of another phenomenon.

    Raises
    ------
    DataError
        When the positions do not show what the phenomenon observes.
    """
    plane = in_plane(trajectory, phenomenon)
    _, seen, result = fit_in_turns(
        phenomenon, known, lambda settings: ([plane], observed_positions(plane, phenomenon, settings, free))
    )
    another = phenomenon_doubt(plane, phenomenon)
    doubts = (*trajectory.doubts, *([another] if another is not None else []))
    return plane, seen.with_(doubts=doubts), replace(result, doubts=tuple(dict.fromkeys((*result.doubts, *doubts))))
