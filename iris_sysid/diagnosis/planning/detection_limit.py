"""Before any clip: the smallest effect that a set-up can show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitters.compose_effects import check_applies, unit_in, with_effect
from fitters.effect_sensitivity import shaped
from fitters.effect_shapes import shapes_tried
from fitters.ode import sensitivity, simulate
from iris_sysid.diagnosis.score_test import critical_value
from iris_sysid.diagnosis.screening import SINGLE_LEVEL
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import FOCAL_PER_WIDTH, Array, Effect, OdeModel

IMITATED = 1e-4  # fraction of a sensitivity below which the fitted values imitate the effect
WIDTH_PX = 1920.0
RELEASES_DEG = (5.0, 10.0, 20.0, 40.0, 60.0, 80.0)
SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the example's start
SPANS = (0.25, 0.5, 1.0, 2.0, 4.0)  # of the example's length


@dataclass(frozen=True, eq=False, slots=True)
class DetectionLimits:
    """The size (a, b) of ``effect``, in ``unit``, that is found in half of the clips; infinite where it cannot be.

    For the a starting values ``starts`` of the state ``varied``, and clips of ``seconds`` (b,) s.
    """

    effect: str
    unit: str
    varied: str
    starts: Array
    seconds: Array
    sizes: Array


def detection_limits(
    model: str | OdeModel,
    effect: str | Effect,
    values: Mapping[str, float],
    *,
    noise: float,
    rate_hz: float,
    starts: Sequence[float],
    seconds: Sequence[float],
) -> DetectionLimits:
    """The smallest size of an effect that clips of several starts and lengths can show.

    The effect's sensitivity, less what the fitted values imitate, against white noise; the limit is that of the
    diagnosis over its whole library.

    Parameters
    ----------
    model
        The governing equation, or its name.
    effect
        What it may lack, or its name.
    values
        Parameters and initial values by name; the first initial value is varied.
    noise
        Standard deviation of one sample, in the observed unit.
    rate_hz
        Frames a second.
    starts
        a values of the first state at the start, in its unit.
    seconds
        b lengths of the clip.

    Returns
    -------
    DetectionLimits
        ``sizes`` (a, b).

    Raises
    ------
    FitError
        When the effect does not apply to the model, or a value is missing.
    """
    described, lacking = MODELS.resolved(model), EFFECTS.all_resolved([effect])[0]
    check_applies(lacking, described)
    varied = described.initial_names[0]
    sizes = [
        [
            _limit(described, lacking, {**values, varied: start}, noise, np.arange(round(span * rate_hz)) / rate_hz)
            for span in seconds
        ]
        for start in starts
    ]
    unit = unit_in(described, lacking, lacking.parameters[0].unit)
    return DetectionLimits(lacking.name, unit, varied, np.array(starts), np.array(seconds), np.array(sizes))


def camera_limits(
    model: OdeModel, effect: Effect, known: Mapping[str, float], distance_m: float, rate_hz: float, noise_px: float
) -> DetectionLimits:
    """The limits for clips of a phone's main camera, about the example of a model.

    Parameters
    ----------
    model
        With an example, whose values hold where none are known.
    effect
        What it may lack.
    known
        Values by name that are to be.
    distance_m
        From the camera to the plane of motion.
    rate_hz
        Frames a second.
    noise_px
        Standard deviation of a tracked coordinate.

    Raises
    ------
    FitError
        Where the model has no example or is driven, or observes what a camera does not see in m or rad.
    """
    unit = model.observed[0].unit
    if model.example is None or model.inputs or unit not in ("m", "rad"):
        raise FitError(f"the noise of a camera in what {model.name!r} observes ({unit}) is not known")
    values = {**model.example.values, **known}
    noise = camera_noise(distance_m, noise_px) / (values.get("length", 1.0) if unit == "rad" else 1.0)
    first = values[model.initial_names[0]]
    starts = np.radians(RELEASES_DEG) if unit == "rad" else first * np.array(SHARES)
    span = model.example.samples / model.example.rate_hz
    return detection_limits(
        model, effect, values, noise=noise, rate_hz=rate_hz, starts=list(starts), seconds=[f * span for f in SPANS]
    )


def camera_noise(distance_m: float, noise_px: float, width_px: float = WIDTH_PX) -> float:
    """The noise in m of a sample that a phone's main camera sees with ``noise_px`` from a distance."""
    return noise_px * distance_m / (FOCAL_PER_WIDTH * width_px)


def _limit(model: OdeModel, effect: Effect, values: Mapping[str, float], noise: float, t_s: Array) -> float:
    """The size that is found in half of the clips at these times (n,) s."""
    seen = simulate(model, t_s, values).observed
    composed = with_effect(model, shaped(effect, shapes_tried(effect, model, t_s, seen)[0]))
    size = effect.parameters[0].name
    fitted = [each.name for each in model.parameters if not each.constant] + list(model.initial_names)
    slopes = sensitivity(composed, t_s, {**values, size: 0.0}, [size, *fitted]) / noise
    along, columns = slopes[:, :, 0].ravel(), slopes[:, :, 1:].reshape(-1, len(fitted))
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    rest = along - columns @ np.linalg.lstsq(columns, along, rcond=1e-9)[0]
    length = float(np.linalg.norm(rest))
    if not length > IMITATED * float(np.linalg.norm(along)):
        return float("inf")
    return critical_value(SINGLE_LEVEL / len(EFFECTS), 1) / length
