"""Colliding bodies: the published continuous coupling, at 0 and fitted, compared with our model with impacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitters.ode import fit
from iris_sysid.benchmark.sources.rows import COUPLING
from iris_sysid.benchmark.studies.subjects import Records, Subject, simulated
from iris_sysid.errors import DataError
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.trajectory.observables import measured
from iris_sysid.types import Array, Estimate, Mask, OdeModel, Quantity, Trajectory

KNOWN_SHARE = 0.7  # of the samples; the others are held out
PILE = "hitting-cones"
BEFORE_S, AFTER_S = 0.1, 0.4  # around the first impact: later the cups strike those behind
LEVEL = 0.25  # of the cups' range in height, above the lowest: these count as the bottom row


@dataclass(frozen=True, eq=False, slots=True)
class _Kind:
    """One model of the contact: its name, the equation, and the options of its fit."""

    name: str
    model: OdeModel
    options: Mapping[str, Any]


def coupling_rows(subject: Subject) -> Records:
    """Compare coupling = 0, a fitted coupling and impacts, for two pendulums or a ball and the first two cups.

    Gives the error over the fitted samples, and over the last 30 % of the samples, predicted from the others.
    """
    if subject.clip.phenomenon == PILE:
        calibration, phenomenon = subject.measured.calibration(), PHENOMENA[PILE]
        bodies = [measured(track, calibration, phenomenon) for track in subject.measured.tracks()]
        struck = first_struck(bodies, subject.trajectory())
        return _compared(subject, struck, _kinds("contact-chain", MODELS["impact-chain"], {}, {}))
    if len(subject.model.observed) != 2 or subject.model.observed[0].unit != "rad":
        return []
    known, free = subject.known_and_free()
    accepted = {parameter.name for parameter in MODELS["coupled-pendulums"].parameters}
    gravity = {name: estimate for name, estimate in known.items() if name in accepted}
    impacts = {"fixed": known, "free": free}
    return _compared(subject, subject.trajectory(), _kinds("coupled-pendulums", subject.model, gravity, impacts))


def first_struck(bodies: Sequence[Trajectory], run_up: Trajectory) -> Trajectory:
    """Horizontal positions ``z1`` to ``z3`` of the ball and the first two cups in its path, around the first impact.

    ``bodies`` are x and z of the ball and the cups, in any order, at the same times; the motion in ``run_up``, the
    trajectory of the ball, ends when it strikes the first cup. DataError when there is no ball, or no two cups of the
    bottom row in its path.
    """
    rolls = np.flatnonzero(run_up.mask("motion") & run_up.valid)
    tracked = [body for body in bodies if body.valid[rolls].all()]
    if rolls.size == 0 or len(tracked) < 3:
        raise DataError(
            f"of {len(bodies)} bodies {len(tracked)} are seen while the ball rolls; it and two cups are needed"
        )
    positions = np.array([body.position[rolls][:, :2] for body in tracked])
    travel = positions[:, -1, 0] - positions[:, 0, 0]
    ball, direction = int(np.argmax(np.abs(travel))), float(np.sign(travel[np.argmax(np.abs(travel))]))
    cups, heights = [k for k in range(len(tracked)) if k != ball], positions[:, 0, 1]
    lowest = heights[cups].min() + LEVEL * float(np.ptp(heights[cups]))
    first = sorted((k for k in cups if heights[k] <= lowest), key=lambda k: direction * positions[k, 0, 0])[:2]
    if len(first) < 2:
        raise DataError("the ball's path has no two cups of the bottom row")
    return _horizontal([tracked[ball], *(tracked[k] for k in first)], direction, float(run_up.t_s[rolls[-1]]))


def _horizontal(bodies: list[Trajectory], direction: float, hit_s: float) -> Trajectory:
    t_s = bodies[0].t_s
    valid = np.logical_and.reduce([body.valid for body in bodies])
    window = (t_s > hit_s - BEFORE_S) & (t_s < hit_s + AFTER_S)
    return bodies[0].with_(
        quantities=tuple(Quantity(f"z{k}", bodies[0].quantities[0].unit) for k in (1, 2, 3)),
        position=np.column_stack([direction * body.position[:, 0] for body in bodies]),
        sigma=np.column_stack([body.sigma[:, 0] for body in bodies]),
        valid=valid & window,
        segments=(),
        systematic={},
    )


def _kinds(
    coupled: str, impacts: OdeModel, known: Mapping[str, Estimate], options: Mapping[str, Any]
) -> tuple[_Kind, ...]:
    spring = MODELS[coupled]
    return (
        _Kind("coupling = 0", spring, {"fixed": {**known, "coupling": 0.0}}),
        _Kind("coupling fitted", spring, {"fixed": known}),
        _Kind("impacts", impacts, options),
    )


def _compared(subject: Subject, trajectory: Trajectory, kinds: tuple[_Kind, ...]) -> Records:
    return [row for kind in kinds for row in _held_out(subject, trajectory, kind)]


def _held_out(subject: Subject, trajectory: Trajectory, kind: _Kind) -> Iterator[dict[str, Any]]:
    inside: Mask = trajectory.valid & trajectory.mask("motion") if trajectory.segments else trajectory.valid
    used = np.flatnonzero(inside)
    last = trajectory.t_s[used[int(KNOWN_SHARE * used.size)]]
    part = trajectory.with_(valid=trajectory.valid & (trajectory.t_s < last))
    result = fit(part, kind.model, **kind.options)
    values = {"fitted rms": np.nan, "held-out rms": np.nan}
    if result.usable:
        error = trajectory.position[used] - simulated(kind.model, result, trajectory.t_s[used])
        later = trajectory.t_s[used] >= last
        values = {"fitted rms": _rms(error[~later]), "held-out rms": _rms(error[later])}
    for name, value in values.items():
        yield subject.plain_record(COUPLING, kind.name, name, value, trajectory.quantities[0].unit, result.status)


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))
