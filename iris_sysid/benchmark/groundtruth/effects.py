"""Effects missing from the published equation on the clips of one setting, by diagnosis."""

from __future__ import annotations

from collections.abc import Sequence

from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.errors import IrisError
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.report.diagnosis_text import diagnosis_text
from iris_sysid.types import Estimate, Trajectory

MAX_CLIPS = 3  # of a setting; the diagnosis refits each of them for every effect it tries


def lacking_effects(clips: Sequence[ClipMeasurement]) -> list[str]:
    """Diagnose the first clips of a setting jointly: the text with its notes, or the reason why there is none."""
    usable = [clip for clip in clips if clip.document.usable][:MAX_CLIPS]
    trajectories: list[Trajectory] = [trajectory for clip in usable if (trajectory := clip.trajectory()) is not None]
    if not trajectories:
        return ["not diagnosed: no clip was fitted"]
    phenomenon = PHENOMENA[usable[0].clip.phenomenon]
    model = MODELS[phenomenon.model]
    fixed = _held(usable[0], {parameter.name for parameter in model.parameters})
    free = [name for name in phenomenon.free if name not in fixed]
    try:
        diagnosis = diagnose(trajectories, model, fixed=fixed, free=free)
    except IrisError as error:
        return [f"not diagnosed: {error}"]
    names = ", ".join(clip.clip.clip for clip in usable)
    return [f"clips {names}: {' '.join(diagnosis_text(diagnosis).splitlines())}"]


def _held(clip: ClipMeasurement, names: set[str]) -> dict[str, Estimate]:
    """The direct measurements that the fits of the setting held fixed."""
    estimates = clip.document.estimates()
    return {
        name: estimate
        for name, estimate in estimates.items()
        if name in names and estimate.measurement_type == "direct" and name not in clip.document.free
    }
