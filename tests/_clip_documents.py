"""Measurements of clips as they stand on disk, made without any video."""

from pathlib import Path

from iris_sysid.benchmark.dataset import Clip
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.io.json_documents import entries_of
from iris_sysid.io.schemas.groundtruth import ClipDocument
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.types import Estimate


def clip_measured(name, estimates, budget=None, *, status="ok", class_name="Pendulum", setting="pendulum_45"):
    """One clip with these estimates, by name (value, standard error, unit, type)."""
    phenomenon = {"Pendulum": "pendulum", "Sliding_cone": "sliding-cone", "Falling_ball": "falling-ball"}[class_name]
    model = MODELS[PHENOMENA[phenomenon].model]
    document = ClipDocument(
        class_name=class_name,
        setting=setting,
        clip=name,
        phenomenon=phenomenon,
        model=model.name,
        equation=model.equation,
        status=status,
        message="" if status == "ok" else f"{status} for a reason",
        parameters=entries_of({key: Estimate(*row) for key, row in estimates.items()}),
        budget=budget or {},
        origin={"source": f"{name}.mp4", "sha256": "0" * 64},
    )
    folder = Path("work") / class_name / setting
    return ClipMeasurement(Clip(class_name, setting, name, Path(f"{name}.mp4"), phenomenon), document, folder)
