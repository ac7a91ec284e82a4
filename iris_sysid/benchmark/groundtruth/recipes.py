"""The published recipes on the clips of a setting, with their bias against the regenerated value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fitters.published_estimators import ALL, INTERVAL, RECIPES, PublishedRecipe
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.benchmark.groundtruth.pool import in_published_unit
from iris_sysid.errors import IrisError
from iris_sysid.io.schemas import known_number, number
from iris_sysid.io.schemas.groundtruth import Recipe, RegeneratedValue
from iris_sysid.types import Array, Estimate, student_ppf

KNOWN = ("gravity", "angle")


def recipes_of(
    clips: Sequence[ClipMeasurement],
    parameter: str,
    regenerated: RegeneratedValue | None,
    by_hand: Mapping[str, Estimate],
) -> list[Recipe]:
    """The estimates of the published recipes for a parameter of one setting.

    Parameters
    ----------
    clips
        Of the setting.
    parameter
        Our name.
    regenerated
        The value for the bias.
    by_hand
        Direct measurements: the measured angle of a board replaces that of the motion.

    Returns
    -------
    list of Recipe
        Empty where the publication has no recipe; a clip on which a recipe fails has null.
    """
    model = clips[0].document.model
    results = []
    for recipe in (candidate for candidate in RECIPES.get(model, ()) if parameter in candidate.gives):
        values, notes = _values(clips, recipe, parameter, by_hand)
        if values:
            results.append(_recipe(recipe, values, regenerated, notes))
    return results


def _values(
    clips: Sequence[ClipMeasurement], recipe: PublishedRecipe, parameter: str, by_hand: Mapping[str, Estimate]
) -> tuple[dict[str, float], str]:
    """The recipe's value of each clip, NaN where it fails, and the errors; empty where it has no such parameter."""
    values: dict[str, float] = {}
    notes = []
    for clip in clips:
        trajectory = clip.trajectory()
        if trajectory is None:
            continue
        known = {name: estimate for name, estimate in clip.document.estimates().items() if name in KNOWN}
        if "angle" in by_hand:
            known["angle"] = _in_radians(by_hand["angle"])
        try:
            estimates = recipe.estimator(trajectory, known)
        except IrisError as error:
            values[clip.document.clip] = math.nan
            notes.append(f"{clip.document.clip}: {error}")
            continue
        if parameter in estimates:
            values[clip.document.clip] = in_published_unit(estimates[parameter])[0].value
    return values, "; ".join(notes)


def _in_radians(angle: Estimate) -> Estimate:
    factor = math.pi / 180 if angle.unit == "deg" else 1.0
    return Estimate(angle.value * factor, angle.stderr * factor, "rad", angle.measurement_type, angle.source)


def _recipe(
    recipe: PublishedRecipe, values: Mapping[str, float], regenerated: RegeneratedValue | None, notes: str
) -> Recipe:
    finite = np.array([value for value in values.values() if math.isfinite(value)])
    of_all = recipe.of == ALL
    value = math.nan if not finite.size else float(np.mean(finite) if of_all else finite[0])
    reference = math.nan if regenerated is None else number(regenerated.value)
    own = math.nan if regenerated is None else number(regenerated.standard_uncertainty)
    scatter = float(np.std(finite, ddof=1)) if finite.size > 1 else math.nan
    error = scatter / math.sqrt(finite.size) if of_all and finite.size else scatter
    return Recipe(
        recipe=f"{recipe.name}, of {recipe.of}",
        value=known_number(value),
        uncertainty=known_number(_uncertainty(recipe, finite)),
        uncertainty_of=recipe.uncertainty,
        clips={name: known_number(value) for name, value in values.items()},
        bias=known_number(value - reference),
        bias_uncertainty=known_number(math.hypot(own, error)),
        note=notes,
    )


def _uncertainty(recipe: PublishedRecipe, values: Array) -> float:
    if values.size < 2:
        return math.nan
    deviation = float(np.std(values, ddof=1))
    if recipe.uncertainty != INTERVAL:
        return deviation
    return student_ppf(0.975, values.size - 1) * deviation / math.sqrt(values.size)
