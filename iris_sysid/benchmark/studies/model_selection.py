"""Equation selection by our model bank: the equation that a clip's track obeys, scored like the classifiers.

Tracker and segmentation are those of the clip's class; the equation and its observable are chosen from the whole bank.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fitters.selection.select import select_model
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.benchmark.sources.predictions import EQUATION
from iris_sysid.benchmark.sources.rows import FAILED, OK, SELECTION
from iris_sysid.benchmark.sources.selection import NO_ANSWER
from iris_sysid.benchmark.studies.studies import why
from iris_sysid.benchmark.studies.subjects import Subject
from iris_sysid.calibration.pixel_scale import to_world
from iris_sysid.errors import DataError
from iris_sysid.registry import PHENOMENA
from iris_sysid.trajectory.observables import measured
from iris_sysid.types import Calibration, ModelChoice, Phenomenon, Track, Trajectory

BANK, NEAREST = "bank", "bank, nearest"
NONE_FITS = "none of these"
# other correct answers for a phenomenon's model (key): the same equation without, or with, its events
SAME_EQUATION: Mapping[str, tuple[str, ...]] = {
    "bouncing-ball": ("free-fall",),
    "pendulum-impact": ("coupled-pendulums",),
    "coasting-ball": ("contact-chain", "impact-chain"),
}


def selection_rows(subject: Subject) -> list[dict[str, Any]]:
    """Two rows: the chosen equation, or that none fits; and the nearest equation, whether it fits or not.

    The value is 1 where the answer is an equation that the class obeys, else 0; a track without a choice is a failed
    row with the reason.
    """
    try:
        choice = choice_for(subject.measured)
    except Exception as error:  # one clip must not end the run of all
        return [_row(subject, method, NO_ANSWER, FAILED) | {"truth_source": why(error)} for method in (BANK, NEAREST)]
    chosen = NONE_FITS if choice.chosen is None else choice.chosen.model
    return [_row(subject, BANK, chosen, OK), _row(subject, NEAREST, choice.nearest.model, OK)]


def choice_for(clip: ClipMeasurement) -> ModelChoice:
    """The choice from the whole bank for a measured clip, from the positions of its bodies during the motion.

    DataError when the clip could not be tracked, FitError when it has too few samples.
    """
    phenomenon = PHENOMENA[clip.clip.phenomenon]
    fitted = clip.trajectory()
    if fitted is None:
        raise DataError(f"{clip.clip.place} has no trajectory: {clip.document.message}")
    in_motion = fitted.valid & fitted.mask("motion")
    bodies = [_observed(track, clip.calibration(), phenomenon) for track in clip.tracks()]
    return select_model([body.with_(valid=body.valid & in_motion) for body in bodies])


def _observed(track: Track, calibration: Calibration, phenomenon: Phenomenon) -> Trajectory:
    """The observable of the phenomenon; for a body whose apparent size changes, its position as well."""
    body = measured(track, calibration, phenomenon)
    if phenomenon.measures != "radius":
        return body
    world = to_world(track, calibration)
    return world.with_(
        quantities=(*world.quantities, *body.quantities),
        position=np.column_stack([world.position, body.position]),
        sigma=np.column_stack([world.sigma, body.sigma]),
        valid=world.valid & body.valid,
        systematic={},
    )


def _row(subject: Subject, method: str, answer: str, status: str) -> dict[str, Any]:
    true_model = PHENOMENA[subject.clip.phenomenon].model
    correct = answer in (true_model, *SAME_EQUATION.get(true_model, ()))
    return subject.record(
        study=SELECTION,
        method=method,
        parameter=EQUATION,
        value=None if status == FAILED else float(correct),
        unit="1",
        truth=1.0,
        truth_source=f"class folder: {true_model}",
        status=status,
        answer=answer,
    )
