"""Pool one parameter over the clips of a setting: mean, scatter between clips, and the errors that they share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitters.noise.random_effects import MIN_CLIPS, random_effects
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.calibration.pixel_scale import is_common_source
from iris_sysid.io.schemas.groundtruth import ClipDocument, ClipValue, RegeneratedValue
from iris_sysid.trajectory.systematic_errors import AXIS, EDGE, TIME_BASE
from iris_sysid.types import NORMAL_975, Estimate, Population, student_ppf

# sources of error that all clips of a setting have in common, beside the parts of their calibration
COMMON = frozenset({TIME_BASE, EDGE, AXIS, "angle", "gravity", "r0_f", "ball_radius", "h0"})
GEOMETRY = "geometry"  # source of error of an intermediate quantity without a budget: the board's angle
# share of the variance of a clip's random error that the clips of a setting have in common: same light, body, wall and
# codec. On 240 synthetic clips it is 0.5 to 0.6, over 60 settings and parameters.
ALIKE = 0.5
FILMED_ALIKE = "tracking errors of clips filmed alike"
DEGREES_PER_RADIAN = 180 / math.pi
METHOD = (
    "each clip fitted alone; mean over clips by restricted maximum likelihood (random effects), Hartung-Knapp error; "
    "errors common to all clips, and half the variance of tracking in clips filmed alike, added once"
)
ONE_CLIP = "one clip"


@dataclass(frozen=True, slots=True)
class _Value:
    """A clip's estimate in the unit of parameters.json, with the part of its error that other clips do not share."""

    clip: str
    estimate: Estimate
    random: float
    document: ClipDocument
    why_not: str

    @property
    def used(self) -> bool:
        return not self.why_not


def in_published_unit(estimate: Estimate) -> tuple[Estimate, float]:
    """The estimate with an angle in degrees, and the factor that was applied."""
    if estimate.unit != "rad":
        return estimate, 1.0
    factor = DEGREES_PER_RADIAN
    low, high = estimate.interval
    in_degrees = Estimate(
        estimate.value * factor,
        estimate.stderr * factor,
        "deg",
        estimate.measurement_type,
        estimate.source,
        (low * factor, high * factor),
    )
    return in_degrees, factor


def regenerate(clips: Sequence[ClipMeasurement], parameter: str) -> RegeneratedValue | None:
    """Pool the estimates of one parameter, by our name, over the clips of a setting; None when there is no clip.

    They are those of the clips that the equation fits to within the noise; where it fits none, of all clips with a
    value. ``measurement_type`` marks values that are assumed or measured by hand.
    """
    values = [_value_of(clip, parameter) for clip in clips]
    known = [value for value in values if value is not None]
    if not known:
        return None
    unit = next((value.estimate.unit for value in known if value.used), known[0].estimate.unit)
    used = [value for value in known if value.used and value.estimate.unit == unit]
    used = [value for value in used if value.document.status == "ok"] or used  # a misfit counts only where nothing fits
    shown = {value.clip: _shown(value, value in used) for value in known}
    if not used:
        first = next((value for value in known if value.document.status != "failed"), known[0])
        return _without_value(first, parameter, first.estimate.unit, shown)
    return _pooled(used, parameter, unit, shown)


def _value_of(clip: ClipMeasurement, parameter: str) -> _Value | None:
    document = clip.document
    if document.status == "failed":
        nothing = Estimate(math.nan, math.nan, "")
        return _Value(document.clip, nothing, math.nan, document, document.message)
    if parameter not in document.parameters:
        return None
    estimate, factor = in_published_unit(document.parameters[parameter].estimate())
    random = document.random(parameter, _common_sources(document, parameter)) * factor
    if not math.isfinite(random) and not document.budget.get(parameter):
        random = estimate.stderr  # e.g. the angle of a board, an intermediate quantity
    return _Value(document.clip, estimate, random, document, _why_not(document, estimate, random))


def _common_sources(document: ClipDocument, parameter: str) -> set[str]:
    """The sources of a parameter's error that all clips of a setting have in common."""
    return {source for source in document.budget.get(parameter, {}) if source in COMMON or is_common_source(source)}


def _why_not(document: ClipDocument, estimate: Estimate, random: float) -> str:
    """Why a clip's value is not in the mean; empty when it is."""
    if not document.usable:
        return f"{document.status}: {document.message}"
    if not math.isfinite(estimate.value):
        return "no value was found"
    if estimate.measurement_type == "assumed":
        return "assumed, not measured"
    return "" if math.isfinite(random) and random > 0 else "its standard error is not known"


def _shown(clip_value: _Value, used: bool) -> ClipValue:
    origin = clip_value.document.origin
    sha256 = origin.get("sha256")
    return ClipValue(
        value=clip_value.estimate.value,
        standard_uncertainty=clip_value.estimate.stderr,
        random=clip_value.random,
        interval=clip_value.estimate.interval,
        status=clip_value.document.status,
        message=clip_value.why_not or clip_value.document.message,
        used=used,
        source=str(origin.get("source") or clip_value.clip),
        sha256=sha256 if isinstance(sha256, str) else None,
    )


def _pooled(used: Sequence[_Value], parameter: str, unit: str, shown: Mapping[str, ClipValue]) -> RegeneratedValue:
    values = np.array([clip.estimate.value for clip in used])
    population = _population(used, unit)
    mean = used[0].estimate if population is None else population.mean
    own = used[0].random if population is None else mean.stderr
    common = _common(used, parameter)
    stderr = math.hypot(own, *common.values())
    factor = _coverage_factor(used, population, own, stderr)
    return RegeneratedValue(
        value=mean.value,
        standard_uncertainty=stderr,
        expanded_uncertainty=factor * stderr,
        coverage_factor=factor,
        interval=(mean.value - factor * stderr, mean.value + factor * stderr),
        unit=unit,
        measurement_type="direct" if used[0].estimate.measurement_type == "direct" else "fitted",
        **_labels(used[0], parameter),
        method=ONE_CLIP if population is None else METHOD,
        n=len(used),
        std=float(np.std(values, ddof=1)) if len(used) > 1 else 0.0,
        min=float(values.min()),
        max=float(values.max()),
        **_scatter(population),
        budget={"scatter and random errors of the clips": own, **common},
        clips=dict(shown),
    )


def _population(used: Sequence[_Value], unit: str) -> Population | None:
    if len(used) < MIN_CLIPS:
        return None
    return random_effects(
        np.array([clip.estimate.value for clip in used]), np.array([clip.random for clip in used]), unit
    )


def _common(used: Sequence[_Value], parameter: str) -> dict[str, float]:
    """Standard error of the mean from each source that the clips share: the mean over the clips.

    Clips of one setting are filmed alike, so part of the tracking error is the same in all of them.
    """
    if not used[0].document.budget.get(parameter):
        return {GEOMETRY: float(np.mean([clip.estimate.stderr for clip in used]))} if len(used) > 1 else {}
    parts = [clip.document.common(parameter, _common_sources(clip.document, parameter)) for clip in used]
    factor = DEGREES_PER_RADIAN if used[0].estimate.unit == "deg" else 1.0
    names = sorted({name for part in parts for name in part})
    shared = {name: factor * float(np.mean([part.get(name, 0.0) for part in parts])) for name in names}
    if len(used) < MIN_CLIPS:
        return shared
    return shared | {FILMED_ALIKE: math.sqrt(ALIKE) * float(np.mean([clip.random for clip in used]))}


def _coverage_factor(used: Sequence[_Value], population: Population | None, own: float, stderr: float) -> float:
    """Half width of the 95 % interval over its standard uncertainty, degrees of freedom by Welch and Satterthwaite."""
    if population is not None:
        degrees = population.degrees * (stderr / own) ** 4
        return student_ppf(0.975, degrees)
    low, high = used[0].estimate.interval
    half = (high - low) / 2 / used[0].estimate.stderr if used[0].estimate.stderr > 0 else math.nan
    return half if math.isfinite(half) else NORMAL_975


def _scatter(population: Population | None) -> dict[str, Any]:
    if population is None:
        return {"between": None, "between_interval": (None, None), "within": None, "p_value": None}
    return {
        "between": population.between.value,
        "between_interval": population.between.interval,
        "within": population.within,
        "p_value": population.p_value,
    }


def _labels(clip_value: _Value, parameter: str) -> dict[str, Any]:
    return {"parameter": parameter, "model": clip_value.document.model, "equation": clip_value.document.equation}


def _without_value(clip_value: _Value, parameter: str, unit: str, shown: Mapping[str, ClipValue]) -> RegeneratedValue:
    """No clip gives a value: the entry holds the assumed value where there is one, else null."""
    assumed = clip_value.estimate.measurement_type == "assumed" and math.isfinite(clip_value.estimate.value)
    return RegeneratedValue(
        value=clip_value.estimate.value if assumed else None,
        standard_uncertainty=None,
        expanded_uncertainty=None,
        coverage_factor=None,
        interval=(None, None),
        unit=unit,
        measurement_type="assumed" if assumed else "fitted",
        source=clip_value.estimate.source,
        **_labels(clip_value, parameter),
        method="assumed" if assumed else "no clip gave a value",
        n=0,
        std=None,
        min=None,
        max=None,
        **_scatter(None),
        budget={},
        clips=dict(shown),
    )
