"""Make ``parameters.json``: direct measurements beside the values from the clips; neither replaces the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from iris_sysid.benchmark.groundtruth.discrepancies import notes_on
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement, Measurements
from iris_sysid.benchmark.groundtruth.pool import in_published_unit, regenerate
from iris_sysid.errors import DataError
from iris_sysid.io.files import origin_of
from iris_sysid.io.json_documents import plain_origin
from iris_sysid.io.schemas import Number, number
from iris_sysid.io.schemas.groundtruth import (
    MeasuredDocument,
    ParameterEntry,
    ParametersDocument,
    RegeneratedValue,
    ValueEntry,
)
from iris_sysid.pipeline.clip_folders import benchmark_classes
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.types import NORMAL_975, BenchmarkClass, Estimate

Clips = Sequence[ClipMeasurement]
Finder = Callable[[Clips], list[str]]


def parameters_document(
    measurements: Measurements, measured: MeasuredDocument | None = None, effects: Finder | None = None
) -> ParametersDocument:
    """Pool the clips of each setting, with the values ``measured`` by hand beside them; the same input gives the same.

    ``effects`` gives sentences on the effects missing from the published equation on the clips of one setting.
    DataError when two classes would have the same name, or a direct value has another unit than the fitted one.
    """
    measured = measured or MeasuredDocument()
    classes = dict.fromkeys(clip.clip.class_name for clip in measurements.clips)
    lower = [name.lower() for name in classes]
    if len(set(lower)) < len(lower):
        raise DataError(
            f"{', '.join(classes)}: two of these have one name in parameters.json; keep the data sets apart"
        )
    known = benchmark_classes()
    document = {
        name.lower(): {
            setting.lower(): _setting(clips, known[name][1], measured, effects)
            for setting, clips in _settings(measurements.clips, name).items()
        }
        for name in classes
    }
    origin = plain_origin(origin_of(None, {"clips": len(measurements.clips), "diagnosed": effects is not None}))
    return ParametersDocument.model_validate({"gaps": dict(measurements.gaps), "origin": origin, **document})


def _settings(clips: Clips, class_name: str) -> dict[str, list[ClipMeasurement]]:
    settings: dict[str, list[ClipMeasurement]] = {}
    for clip in clips:
        if clip.clip.class_name == class_name:
            settings.setdefault(clip.clip.setting, []).append(clip)
    return settings


def _setting(
    clips: Clips, described: BenchmarkClass, measured: MeasuredDocument, effects: Finder | None
) -> dict[str, ParameterEntry]:
    """Every parameter of one setting: those of the class, then other direct measurements."""
    by_hand = measured.values_of(described.folder, clips[0].clip.setting)
    direct = {name: in_published_unit(estimate)[0] for name, estimate in by_hand.items()}
    effect_notes = effects(clips) if effects is not None else []
    entries = {}
    for name, published_name in described.parameters.items():
        regenerated = regenerate(clips, name)
        stated = direct.get(published_name, direct.get(name))
        if regenerated is None and stated is None:
            continue
        equation = MODELS[PHENOMENA[clips[0].clip.phenomenon].model].equation
        entry = _entry(published_name, stated, regenerated, equation)
        notes = notes_on(published_name, regenerated, entry.difference, by_hand)
        entries[published_name] = entry.model_copy(update={"effects": effect_notes, "notes": notes})
    names = {*described.parameters, *described.parameters.values()}
    others = {name: _entry(name, estimate, None, "") for name, estimate in direct.items() if name not in names}
    return entries | others


def _entry(name: str, direct: Estimate | None, regenerated: RegeneratedValue | None, equation: str) -> ParameterEntry:
    """The entry of one parameter; its summary is the direct value where there is one, else the regenerated one."""
    difference = _difference(name, direct, regenerated)
    stated = None if direct is None else _stated(direct)
    if stated is not None:
        low, high = stated.interval
        summary = _summary(stated, stated.standard_uncertainty, low, high, 1, "measured by hand")
    elif regenerated is not None:
        spread = (regenerated.std, regenerated.min, regenerated.max, regenerated.n, regenerated.method)
        summary = _summary(regenerated, *spread)
    else:
        raise DataError(f"{name} has neither a direct nor a regenerated value")
    return ParameterEntry(**summary, equation=equation, direct=stated, regenerated=regenerated, difference=difference)


def _summary(entry: ValueEntry, std: Number, low: Number, high: Number, n: int, method: str) -> dict[str, Any]:
    return {
        "mean": entry.value,
        "std": std,
        "min": low,
        "max": high,
        "n": n,
        "unit": entry.unit,
        "measurement_type": entry.measurement_type,
        "standard_uncertainty": entry.standard_uncertainty,
        "expanded_uncertainty": entry.expanded_uncertainty,
        "method": method,
    }


def _stated(estimate: Estimate) -> ValueEntry:
    low, high = estimate.interval
    half = (high - low) / 2
    return ValueEntry(
        value=estimate.value,
        standard_uncertainty=estimate.stderr,
        expanded_uncertainty=half,
        coverage_factor=half / estimate.stderr if estimate.stderr > 0 else None,
        interval=estimate.interval,
        unit=estimate.unit,
        measurement_type=estimate.measurement_type,  # type: ignore[arg-type]  # checked here
        source=estimate.source,
    )


def _difference(name: str, direct: Estimate | None, regenerated: RegeneratedValue | None) -> ValueEntry | None:
    """Regenerated minus direct value, where both exist."""
    if direct is None or regenerated is None or regenerated.n == 0:
        return None
    if direct.unit != regenerated.unit:
        raise DataError(
            f"{name} was measured in {direct.unit}, but the clips give it in {regenerated.unit}; "
            "give the direct value in that unit, or a scale (checkerboard) for the clips"
        )
    value = number(regenerated.value) - direct.value
    stderr = math.hypot(number(regenerated.standard_uncertainty), direct.stderr)
    low, high = direct.interval
    half = math.hypot(number(regenerated.expanded_uncertainty), (high - low) / 2)
    return ValueEntry(
        value=value,
        standard_uncertainty=stderr,
        expanded_uncertainty=half,
        coverage_factor=half / stderr if stderr > 0 else NORMAL_975,
        interval=(value - half, value + half),
        unit=direct.unit,
        measurement_type="fitted",
        source="regenerated less direct",
    )
