"""The subject of a study: a measured clip with its model, the values that its fit used, and the truth."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitters.ode import fit, simulate
from iris_sysid.benchmark.dataset import Clip
from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.benchmark.sources.conversions import READINGS
from iris_sysid.benchmark.sources.latent import NOT_ESTIMATED
from iris_sysid.benchmark.sources.published import truth_of
from iris_sysid.benchmark.sources.rows import FAILED, OK
from iris_sysid.errors import DataError
from iris_sysid.pipeline.clip_folders import benchmark_classes
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.types import Array, Estimate, FitResult, OdeModel, Trajectory

Records = list[dict[str, Any]]

DEGREES = 180.0 / math.pi  # an angle is published in degrees
ESTIMATED = ("fitted", "derived")  # types of a parameter that the clip gives; the others were given to the fit
UNDETERMINED, NO_SCALE = "undetermined", "no scale"  # statuses of a parameter without a value


@dataclass(frozen=True, slots=True)
class TrueValue:
    """A true value in the unit of the tables, and its source."""

    value: float
    source: str


@dataclass(frozen=True, eq=False, slots=True)
class Subject:
    """One measured clip of a data set; ``truth`` by our names of the parameters.

    ``wanted`` are the parameters that get a row, also where the clip failed, with their units in the tables.
    """

    dataset: str
    measured: ClipMeasurement
    truth: Mapping[str, TrueValue]
    wanted: Mapping[str, str]

    @property
    def clip(self) -> Clip:
        """The clip in the data set."""
        return self.measured.clip

    @property
    def model(self) -> OdeModel:
        """The model that was fitted."""
        return MODELS[self.measured.document.model]

    def trajectory(self) -> Trajectory:
        """The fitted observable; DataError for a clip that failed."""
        trajectory = self.measured.trajectory()
        if trajectory is None:
            raise DataError(f"{self.clip.place} has no trajectory: {self.measured.document.message}")
        return trajectory

    def known_and_free(self) -> tuple[dict[str, Estimate], list[str]]:
        """The known values that the fit used, by name, and the constants that it estimated.

        Values measured in the image are part of the trajectory, and a fit takes them from there.
        """
        document = self.measured.document
        known = {
            parameter.name: document.parameters[parameter.name].estimate()
            for parameter in self.model.parameters
            if parameter.name in document.parameters and parameter.name not in document.free
            if parameter.name not in document.geometry
        }
        constants = [parameter.name for parameter in self.model.parameters if parameter.constant]
        finite = {name: estimate for name, estimate in known.items() if math.isfinite(estimate.value)}
        return finite, [name for name in document.free if name in constants]

    def refit(self, trajectory: Trajectory | None = None, **more: Any) -> FitResult:
        """The same fit again, or of another trajectory, or with other arguments of :func:`fitters.ode.fit`."""
        known, free = self.known_and_free()
        chosen = self.trajectory() if trajectory is None else trajectory
        return fit(chosen, self.model, **({"fixed": known, "free": free} | more))

    def record(self, **more: Any) -> dict[str, Any]:
        """A flat row of this clip, with the other columns from the keywords."""
        own = {"dataset": self.dataset, "phenomenon": self.clip.class_name, "setting": self.clip.setting}
        return own | {"clip": self.clip.clip, "source": self.clip.path.name} | more

    def records(self, estimates: Mapping[str, Estimate], status: str, **more: Any) -> list[dict[str, Any]]:
        """A flat row of each wanted parameter, from ``estimates`` by name (angles in rad), and the fit's ``status``.

        A parameter without a value gives a failed row. Further keywords are other columns of each row, e.g. ``method``.
        """
        return [self._record(name, unit, estimates.get(name), status) | more for name, unit in self.wanted.items()]

    def plain_record(
        self, study: str, method: str, parameter: str, value: float, unit: str, otherwise: str = FAILED
    ) -> dict[str, Any]:
        """A flat row without a truth.

        Parameters
        ----------
        study, method, parameter, unit
            Columns of the row.
        value
            NaN where there is none.
        otherwise
            The status of a row without a value.
        """
        finite = bool(math.isfinite(value))
        status = OK if finite else otherwise if otherwise != OK else FAILED
        return self.record(
            study=study,
            method=method,
            parameter=parameter,
            value=value if finite else math.nan,
            unit=unit,
            status=status,
        )

    def _lacks_scale(self, name: str) -> bool:
        """Whether the measurement is in px, so that this parameter, which needs metres, has no value."""
        entry = self.measured.document.parameters.get(name)
        units = [parameter.unit for parameter in self.measured.document.parameters.values()]
        return entry is not None and entry.value is None and any(unit.startswith("px") for unit in units)

    def _record(self, name: str, unit: str, estimate: Estimate | None, status: str) -> dict[str, Any]:
        factor = DEGREES if unit == "deg" else 1.0
        given = estimate is not None and estimate.measurement_type not in ESTIMATED
        scaled = estimate is None or (_unit(estimate.unit) == unit and not self._lacks_scale(name))
        value = math.nan if estimate is None or given or not scaled else estimate.value * factor
        true = self.truth.get(name)
        otherwise = NO_SCALE if not scaled else NOT_ESTIMATED if given else UNDETERMINED if status == OK else status
        return self.record(
            parameter=name,
            unit=unit,
            value=value,
            stderr=math.nan if estimate is None or math.isnan(value) else estimate.stderr * factor,
            truth=math.nan if true is None else true.value,
            truth_source="" if true is None else true.source,
            status=status if math.isfinite(value) and status != FAILED else otherwise,
        )


def simulated(model: OdeModel, result: FitResult, t_s: Array) -> Array:
    """The observables (n, d) that a fit predicts at times (n,), which begin at its first sample.

    Times are in s, observables in the units of the model.
    """
    values = {name: estimate.value for name, estimate in result.estimates.items() if math.isfinite(estimate.value)}
    return simulate(model, t_s, values).observed


def subjects_of(clips: Iterable[ClipMeasurement], folder: Path, dataset: str) -> list[Subject]:
    """The measured clips of a data set with their truth and the parameters that each setting should give.

    The data set's ``parameters.json`` is read where the folder holds one; ``dataset`` is its name in the tables.
    """
    beside = folder / "parameters.json"
    stated = _json(beside) if beside.is_file() else {}
    subjects = []
    for clip in clips:
        # of the clip itself, else of parameters.json, else published
        true = _published(clip.clip) | _of_setting(clip.clip, stated) | _of_clip(clip.clip)
        subjects.append(Subject(dataset, clip, true, _wanted(clip.clip, true)))
    return subjects


def _unit(unit: str) -> str:
    """A unit as the tables have it: angles in degrees, 1 for none."""
    return "deg" if unit == "rad" else unit or "1"


def _wanted(clip: Clip, truth: Mapping[str, TrueValue]) -> dict[str, str]:
    """What the publication has for the class, and what else the model estimates where the truth is known; units."""
    phenomenon, described = benchmark_classes()[clip.class_name]
    model = MODELS[PHENOMENA[phenomenon].model]
    units = {parameter.name: parameter.unit for parameter in model.parameters} | {
        quantity.name: quantity.unit for quantity in model.derived
    }
    units |= {reading.parameter: reading.unit for reading in READINGS.get(clip.class_name, ())}
    estimated = [parameter.name for parameter in model.parameters if not parameter.constant] + [
        quantity.name for quantity in model.derived
    ]
    names = dict.fromkeys([*described.parameters, *(name for name in estimated if name in truth)])
    return {name: "deg" if name == "angle" else _unit(units.get(name, "1")) for name in names}


# --------------------------------------------------------------------------- truth


def _of_clip(clip: Clip) -> dict[str, TrueValue]:
    path = clip.path.with_name(f"{clip.path.stem}.truth.json")
    entries = _json(path).get("parameters", {}) if path.is_file() else {}
    return {
        str(name): TrueValue(_in_degrees(_number(entry, "value"), str(entry.get("unit"))), path.name)
        for name, entry in entries.items()
        if isinstance(entry, dict) and math.isfinite(_number(entry, "value"))
    }


def _in_degrees(value: float, unit: str) -> float:
    """An angle in degrees, rounded to 12 digits against conversion noise; any other value unchanged."""
    return float(f"{value * DEGREES:.12g}") if unit == "rad" else value


def _of_setting(clip: Clip, document: Mapping[str, Any]) -> dict[str, TrueValue]:
    _, described = benchmark_classes()[clip.class_name]
    settings = document.get(clip.class_name) or document.get(clip.class_name.lower()) or {}
    entries = settings.get(clip.setting, {}) if isinstance(settings, dict) else {}
    values = {}
    for name, published_name in described.parameters.items():
        entry = entries.get(published_name) if isinstance(entries, dict) else None
        if isinstance(entry, dict) and math.isfinite(_number(entry, "mean")):
            values[name] = TrueValue(_number(entry, "mean"), "parameters.json")
    return values


def _published(clip: Clip) -> dict[str, TrueValue]:
    _, described = benchmark_classes()[clip.class_name]
    key = (described.dataset, clip.class_name, clip.setting)
    known = {name: truth_of(*key, name) for name in described.parameters}
    return {
        name: TrueValue(truth.value, f"published: {truth.source}") for name, truth in known.items() if truth is not None
    }


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"cannot read {path.name}: {error}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path.name} holds no names; it should hold values by name")
    return content


def _number(entry: Mapping[str, Any], name: str) -> float:
    value = entry.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
