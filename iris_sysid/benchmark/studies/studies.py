"""The studies of one measured clip: each turns a subject into flat rows; a failure is a row as well."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from fitters.ode.identifiability import identifiability
from fitters.sindy import discover
from iris_sysid.benchmark.sources.rows import COUPLING, EXTRAPOLATION, FAILED, IDENTIFIABILITY
from iris_sysid.benchmark.studies.coupling import coupling_rows
from iris_sysid.benchmark.studies.subjects import Records, Subject, simulated
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.errors import IrisError

Study = Callable[[Subject], Records]

ODE, EFFECTS, SINDY = "ode", "ode+effects", "sindy"
TRAINED, AHEAD = 100, (10, 25, 50)  # frames: fitted, and predicted beyond (eq:extrapolation)
TOO_SHORT = "too-short"
NEAREST = "nearest in the bank"  # status where the discovered equation is not in the bank
PENDULUM = "pendulum"


def ode_rows(subject: Subject) -> Records:
    """The parameters of the bank's model, from the measurement of the clip."""
    document = subject.measured.document
    return subject.records(document.estimates(), document.status, method=ODE)


def effect_rows(subject: Subject) -> Records:
    """The parameters of the bank's model after adding the effects that the clip shows; ``answer`` names them."""
    known, free = subject.known_and_free()
    diagnosis = diagnose(subject.trajectory(), subject.model, fixed=known, free=free)
    answer = ", ".join(effect.name for effect in diagnosis.added) or "none"
    return subject.records(diagnosis.final.estimates, diagnosis.final.status, method=EFFECTS, answer=answer)


def sindy_rows(subject: Subject) -> Records:
    """The parameters of the discovered equation, by the names of its model in the bank; ``answer`` names the model.

    Where the equation is not in the bank they are those of the nearest model, and the status is ``NEAREST``.
    """
    known, _ = subject.known_and_free()
    discovery = discover(subject.trajectory(), known=known, seed=0)
    match = discovery.matched or discovery.nearest
    if match is None:
        return subject.records({}, FAILED, method=SINDY, answer="no model of the bank is near", seed=0)
    status = discovery.status if discovery.matched else NEAREST
    return subject.records(match.parameters, status, method=SINDY, answer=match.model, seed=0)


def identifiability_rows(subject: Subject) -> Records:
    """Identifiability of the parameters from the clip: condition numbers, gradients, one-step residual."""
    trajectory = subject.trajectory()
    result = subject.refit(trajectory)
    analysis = identifiability(result, trajectory)
    noise = np.maximum(analysis.ode_residual_noise, 1e-300)
    numbers = {
        "condition": analysis.condition,
        "condition of the Hessian": analysis.hessian_condition,
        "gradient, first": analysis.gradients[0] if analysis.gradients else np.nan,
        "gradient, last": analysis.gradients[-1] if analysis.gradients else np.nan,
        "one-step residual over noise": float(np.mean(analysis.ode_residual / noise)),
    }
    return [subject.plain_record(IDENTIFIABILITY, ODE, name, value, "1") for name, value in numbers.items()]


def extrapolation_rows(subject: Subject) -> Records:
    """E_k, the squared error k frames beyond the first 100 of the motion, after a fit to these 100 frames."""
    trajectory = subject.trajectory()
    used = np.flatnonzero(trajectory.valid & trajectory.mask("motion"))
    unit = f"{trajectory.quantities[0].unit}^2"
    names = [f"E_{k}" for k in AHEAD]
    if used.size < TRAINED + AHEAD[0]:
        return [subject.plain_record(EXTRAPOLATION, ODE, name, np.nan, unit, TOO_SHORT) for name in names]
    known = trajectory.t_s <= trajectory.t_s[used[TRAINED - 1]]
    result = subject.refit(trajectory.with_(valid=trajectory.valid & known))
    if not result.usable:
        return [subject.plain_record(EXTRAPOLATION, ODE, name, np.nan, unit, result.status) for name in names]
    predicted = simulated(subject.model, result, trajectory.t_s[used])
    errors = np.sum((trajectory.position[used] - predicted) ** 2, axis=1)
    indices = [TRAINED + k - 1 for k in AHEAD]
    values = [float(errors[index]) if index < errors.size else np.nan for index in indices]
    return [
        subject.plain_record(EXTRAPOLATION, ODE, *pair, unit, TOO_SHORT) for pair in zip(names, values, strict=True)
    ]


# by name of the study: the function that makes its rows, and the study, method and parameter of the row of a failure
STUDY_OF: Mapping[str, tuple[Study, str, str, str]] = {
    EFFECTS: (effect_rows, "", EFFECTS, ""),
    SINDY: (sindy_rows, "", SINDY, ""),
    IDENTIFIABILITY: (identifiability_rows, IDENTIFIABILITY, ODE, "condition"),
    EXTRAPOLATION: (extrapolation_rows, EXTRAPOLATION, ODE, f"E_{AHEAD[0]}"),
    COUPLING: (coupling_rows, COUPLING, "impacts", "held-out rms"),
}


def studied(subject: Subject, name: str) -> Records:
    """The rows of one study of one clip, by its name in ``STUDY_OF``; a failure is rows as well, with its reason."""
    make, study, method, parameter = STUDY_OF[name]
    try:
        return make(subject)
    except Exception as error:  # one clip must not end the run of all
        row = {"method": method, "answer": why(error)}
        if not study:
            return subject.records({}, FAILED, **row)
        return [subject.plain_record(study, method, parameter, np.nan, "") | row]


def why(error: Exception) -> str:
    """The message of an error on one line, for a row without a value; an unexpected one with its type."""
    text = " ".join(str(error).split())[:200]
    return text if isinstance(error, IrisError) else f"unexpected {type(error).__name__}: {text}"
