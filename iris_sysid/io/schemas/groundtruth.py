"""What the files of the ground truth hold: what was measured by hand, what one clip gave, and ``parameters.json``."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, JsonValue

from iris_sysid.io.schemas import Document, EstimateEntry, Number, Part, VerdictEntry, number
from iris_sysid.types import NORMAL_975, Estimate, FitStatus

ANY = "*"  # every class, or every setting
RECTANGLE = math.sqrt(3.0)  # half width over standard deviation of a rectangular distribution (GUM, 4.3.7)
EXPANDED = 2.0  # coverage factor of an expanded uncertainty that is stated without one
Positive = Annotated[float, Field(gt=0)]
Type = Literal["direct", "fitted", "assumed", "metadata"]

# --------------------------------------------------------------------------- measured by hand


class MeasuredValue(Part):
    """One quantity that was measured by hand, or is known, for some setting of some class."""

    class_name: Annotated[str, Field(alias="class")] = ANY
    """Folder of the class, or * for all."""
    setting: str = ANY
    parameter: str
    """As in parameters.json: rope_length, angle, ball_radius, gravity, ..."""
    value: float
    uncertainty: Annotated[float, Field(ge=0)]
    """Same unit as the value."""
    kind: Literal["limits", "standard", "expanded"] = "limits"
    """limits: surely within value +- uncertainty; standard: one standard deviation; expanded: two of them."""
    unit: str
    measurement_type: Literal["direct", "assumed", "metadata"] = "direct"
    instrument: str = ""
    source: str = ""

    def estimate(self) -> Estimate:
        """The value with its standard uncertainty and its 95 % interval."""
        factor = {"limits": RECTANGLE, "standard": 1.0, "expanded": EXPANDED}[self.kind]
        half = self.uncertainty * {"limits": 0.95, "standard": NORMAL_975, "expanded": 1.0}[self.kind]
        source = "; ".join(filter(None, (self.instrument, self.source)))
        interval = (self.value - half, self.value + half)
        return Estimate(self.value, self.uncertainty / factor, self.unit, self.measurement_type, source, interval)


class BoardEntry(Part):
    """The checkerboard of a class."""

    class_name: Annotated[str, Field(alias="class")] = ANY
    inner_corners: tuple[Annotated[int, Field(ge=2, le=100)], Annotated[int, Field(ge=2, le=100)]]
    """Columns and rows: 9, 6 for 10 x 7 squares."""
    square_m: Positive
    """Side of a square."""
    stderr_m: Annotated[float, Field(ge=0)] = 0.0


class ScaleEntry(Part):
    """The scale of a class that has no checkerboard, as --scale or --scale-bar takes it."""

    class_name: Annotated[str, Field(alias="class")] = ANY
    scale: str
    """640px=1m, or the ends of a length in the image: x1,y1,x2,y2=0.84m."""


class MeasuredDocument(Document):
    """What was measured by hand (the file for --measured)."""

    document: Literal["measured"] = "measured"
    version: Literal[1] = 1
    boards: list[BoardEntry] = Field(default_factory=list)
    scales: list[ScaleEntry] = Field(default_factory=list)
    values: list[MeasuredValue] = Field(default_factory=list)

    def board(self, class_name: str) -> BoardEntry | None:
        """The board of a class: its own, else the one of all classes."""
        return next((entry for name in (class_name, ANY) for entry in self.boards if entry.class_name == name), None)

    def scale(self, class_name: str) -> ScaleEntry | None:
        """The scale of a class: its own, else the one of all classes."""
        return next((entry for name in (class_name, ANY) for entry in self.scales if entry.class_name == name), None)

    def values_of(self, class_name: str, setting: str) -> dict[str, Estimate]:
        """Known values of a setting by parameter; a value for this setting replaces one for all settings."""
        ranks = ((ANY, ANY), (class_name, ANY), (class_name, setting))
        return {
            entry.parameter: entry.estimate()
            for rank in ranks
            for entry in self.values
            if (entry.class_name, entry.setting) == rank
        }


# --------------------------------------------------------------------------- one clip


class ClipDocument(Document):
    """What one clip of a data set gave; its track and trajectory are beside it."""

    document: Literal["clip"] = "clip"
    version: Literal[1] = 1
    class_name: str
    setting: str
    clip: str
    phenomenon: str
    model: str
    equation: str
    """The governing equation, LaTeX."""
    status: FitStatus | Literal["failed"]
    """Of the fit; failed where there is none."""
    message: str
    """What the status means, with the remedy."""
    verdict: VerdictEntry | None = None
    """How far the result can be used; null where the clip failed, and in files from before 2026-11-24."""
    parameters: dict[str, EstimateEntry] = Field(default_factory=dict)
    """Fitted parameters, constants, initial states and derived quantities; angles in rad."""
    free: list[str] = Field(default_factory=list)
    budget: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """Standard error of each parameter from each source."""
    geometry: dict[str, EstimateEntry] = Field(default_factory=dict)
    """Intermediate quantities of the trajectory, e.g. pivot and scale."""
    noise: list[Number] = Field(default_factory=list)
    """Standard deviation of the measurement, one an observed quantity."""
    rms: list[Number] = Field(default_factory=list)
    """Root mean square of the residual."""
    n: int = 0
    """Samples used."""
    frames: int = 0
    """Frames tracked."""
    track: str | None = None
    """Name of the track's CSV file."""
    trajectory: str | None = None
    """Name of the trajectory's CSV file."""
    origin: dict[str, JsonValue]

    @property
    def usable(self) -> bool:
        """Whether there are estimates that can be pooled."""
        return self.status in ("ok", "misfit")

    def estimates(self) -> dict[str, Estimate]:
        """The parameters as Estimates by name."""
        return {name: entry.estimate() for name, entry in self.parameters.items()}

    def random(self, name: str, common: Collection[str]) -> float:
        """Standard error of a parameter without the parts from the sources ``common``; NaN where no part remains."""
        parts = [number(part) for source, part in self.budget.get(name, {}).items() if source not in common]
        return math.hypot(*parts) if parts else math.nan

    def common(self, name: str, common: Collection[str]) -> dict[str, float]:
        """The parts from the sources ``common``, by source; unknown parts are left out."""
        row = self.budget.get(name, {})
        return {source: number(part) for source, part in row.items() if source in common and part is not None}


# --------------------------------------------------------------------------- parameters.json


class ValueEntry(Part):
    """A value with its uncertainty as the GUM states it."""

    value: Number
    standard_uncertainty: Number
    expanded_uncertainty: Number
    """Half width of the 95 % interval."""
    coverage_factor: Number
    """Expanded over standard uncertainty."""
    interval: tuple[Number, Number]
    """95 %."""
    unit: str
    measurement_type: Type
    source: str = ""


class ClipValue(Part):
    """What one clip says of a parameter."""

    value: Number
    standard_uncertainty: Number
    """Random and systematic."""
    random: Number
    """The part that the other clips do not share."""
    interval: tuple[Number, Number]
    """95 %."""
    status: str
    message: str = ""
    used: bool
    """Whether it is in the mean."""
    source: str
    sha256: str | None


class RegeneratedValue(ValueEntry):
    """A parameter from the clips of one setting."""

    parameter: str
    """Its name in the fits."""
    model: str
    equation: str
    method: str
    n: int
    """Clips in the mean."""
    std: Number
    min: Number
    max: Number
    between: Number
    """Standard deviation from clip to clip beyond their errors."""
    between_interval: tuple[Number, Number]
    within: Number
    """Typical random standard error in one clip."""
    p_value: Number
    """Chance of such a scatter when all clips have one value."""
    budget: dict[str, Number]
    """Standard uncertainty from each source."""
    clips: dict[str, ClipValue]


class ParameterEntry(Part):
    """One parameter of one setting; ``mean, std, min, max`` are what the benchmark's scripts read.

    They are those of the direct measurement where there is one, and of the clips otherwise: of a direct value
    ``std`` is its standard uncertainty, and min and max the ends of its 95 % interval.
    """

    mean: Number
    std: Number
    min: Number
    max: Number
    n: int
    """Clips, or 1 for a direct measurement."""
    unit: str
    measurement_type: Type
    standard_uncertainty: Number
    expanded_uncertainty: Number
    equation: str
    method: str
    direct: ValueEntry | None
    """Measured by hand."""
    regenerated: RegeneratedValue | None
    """From the clips."""
    difference: ValueEntry | None
    """Regenerated less direct."""
    effects: list[str] = Field(default_factory=list)
    """What the published equation lacks on these clips, in words."""
    notes: list[str] = Field(default_factory=list)


class ParametersDocument(Document):
    """Ground truth of a data set (parameters.json): by class in lower case, then setting, then parameter."""

    model_config = ConfigDict(extra="allow")

    document: Literal["parameters"] = "parameters"
    version: Literal[2] = 2
    gaps: dict[str, str]
    """What is missing or was left out, and why."""
    origin: dict[str, JsonValue]
    __pydantic_extra__: dict[str, dict[str, dict[str, ParameterEntry]]] = Field(init=False)

    @property
    def classes(self) -> dict[str, dict[str, dict[str, ParameterEntry]]]:
        """Entries by class, setting and parameter."""
        extra: dict[str, Any] = self.__pydantic_extra__ or {}
        return extra


GROUND_TRUTH: dict[str, type[Document]] = {
    "measured": MeasuredDocument,
    "clip": ClipDocument,
    "parameters": ParametersDocument,
}
