"""What the JSON files hold: one class each, from which the published JSON Schemas are made.

A new kind of file is one class with its own ``document`` and ``version``, entered in ``DOCUMENTS``. In every
file ``null`` stands for a number that is not known or not finite.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from iris_sysid.types import Estimate, FitStatus, Quantity, Segment, SegmentLabel

Number = float | None
Triple = tuple[float, float, float]
PixelCount = Annotated[int, Field(ge=1, le=100_000)]


def known_number(value: Any) -> Number:
    """The value as a float; None where it is NaN or infinite."""
    finite = float(value)
    return finite if math.isfinite(finite) else None


def known_numbers(values: Iterable[Any]) -> Any:
    """Numbers with null for what is not finite: a tuple of a tuple, a list of anything else."""
    known = [known_number(value) for value in values]
    return tuple(known) if isinstance(values, tuple) else known


def number(value: Number) -> float:
    """The value; NaN where it is None."""
    return math.nan if value is None else value


class Part(BaseModel):
    """A piece of a document: no unknown key, no text for a number, no NaN, nothing changed afterwards."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class Document(Part):
    """A whole file; each kind states its ``document`` name and the ``version`` of its layout."""


# --------------------------------------------------------------------------- pieces


class EstimateEntry(Part):
    """A number with its standard error, interval and unit."""

    value: Number
    """Value in the unit; null when there is none."""
    stderr: Number
    """Standard error; null when the data do not determine it."""
    ci95: tuple[Number, Number]
    """Lower and upper end of the 95 % interval; null where there is none."""
    unit: str
    measurement_type: Literal["fitted", "direct", "assumed", "derived", "metadata"]
    source: str = ""
    """Where the value comes from, in words."""
    note: str = ""
    """Why a number is null."""

    def estimate(self) -> Estimate:
        """The entry as an Estimate; null becomes NaN, and an open end of the interval infinity."""
        value, stderr = number(self.value), number(self.stderr)
        plain = Estimate(value, stderr, self.unit, self.measurement_type, self.source)
        if known_numbers(plain.interval) == self.ci95:
            return plain
        low, high = self.ci95
        interval = (-math.inf if low is None else low, math.inf if high is None else high)
        return Estimate(value, stderr, self.unit, self.measurement_type, self.source, interval)


class QuantityEntry(Part):
    """A quantity's name, unit and LaTeX symbol."""

    name: str
    unit: str
    symbol: str = ""

    def quantity(self) -> Quantity:
        """The entry as a Quantity."""
        return Quantity(self.name, self.unit, self.symbol)


class FittedQuantity(QuantityEntry):
    """How well one observed quantity is fitted, in its unit."""

    noise: Number
    """Standard deviation of the measurement, estimated without the model."""
    rms: Number
    """Root mean square of the residual, observed - predicted."""


class SegmentEntry(Part):
    """Samples ``start`` to ``stop - 1``, counted from 0, and what happens in them."""

    label: SegmentLabel
    start: Annotated[int, Field(ge=0)]
    stop: Annotated[int, Field(ge=1)]
    reason: str = ""

    def segment(self) -> Segment:
        """The entry as a Segment."""
        return Segment(self.label, self.start, self.stop, self.reason)


class FittedSegment(SegmentEntry):
    """A segment with its times and how much of it the fit used."""

    start_s: float
    """Time of the first sample."""
    stop_s: float
    """Time of the last sample."""
    n_used: int


class IdentifiabilityEntry(Part):
    """What the data can tell of the fitted values."""

    names: list[str]
    fisher: list[list[Number]]
    """Fisher information of these values for white noise."""
    condition: Number
    """Its condition number after scaling each value to unit information; null when infinite."""
    undetermined: list[str]
    """Directions in which nothing changes, in words."""
    weakest: str
    """Values that the data tell apart least, in words; empty for fewer than two."""
    hessian: list[list[Number]] | None
    """Second derivatives of minus the log likelihood at the optimum, white noise assumed."""
    hessian_condition: Number
    """Its condition number after the same scaling; null when it is not positive definite, or not computed."""
    gradients: list[Number]
    """Norm of the gradient of the mean squared residual in units of the noise, by relative values, each iteration."""
    ode_residual: list[Number]
    """Mean squared error of one step of the equation from sample to sample, squared unit of each quantity."""
    ode_residual_noise: list[Number]
    """What the noise alone makes of it."""


class PopulationEntry(Part):
    """How one value is spread over clips, beyond the error in each."""

    mean: EstimateEntry
    between: EstimateEntry
    """Standard deviation from clip to clip."""
    within: Number
    """Typical random standard error in one clip."""
    q: Number
    """Squared distances from the weighted mean in standard errors, summed."""
    degrees: int
    p_value: Number
    """Chance of so much when all clips have one value."""


class ClipEntry(Part):
    """One clip of a fit to several."""

    table: str
    """Name of the CSV file."""
    status: FitStatus
    message: str
    parameters: dict[str, EstimateEntry]
    noise: Number
    rms: Number
    n: int


class ClipsEntry(Part):
    """A fit to several clips: the parameters of the document are the shared values and the means over clips."""

    shared: list[str]
    scatter: dict[str, PopulationEntry]
    """For each shared value, how far those of each clip alone are spread."""
    population: dict[str, PopulationEntry]
    """Values that differ from clip to clip."""
    clips: list[ClipEntry]


class CandidateEntry(Part):
    """One model that was tried on a trajectory."""

    model: str
    reading: str
    """What the track was taken for, e.g. an angle about a pivot."""
    heldout: Number
    """Error of the prediction of the last samples from the first ones, in units of the noise; null when it failed."""
    residual: Number
    """Residual over all samples, in units of the noise."""
    bic: Number
    adequate: bool
    """Whether the residual is near the noise."""
    note: str = ""


class SelectionEntry(Part):
    """How the model was chosen from the bank."""

    message: str
    chosen: str | None
    """null when none of them fits; the document then holds the nearest."""
    heldout_margin: Number
    """Held-out error of the next model over that of the first; null when there is no other."""
    bic_margin: Number
    ranking: list[CandidateEntry]


class UsedSamples(Part):
    """Which samples of the trajectory the fit used; first and last included, null when none was."""

    total: int
    """Samples in the trajectory, gaps included."""
    first_sample: int | None = None
    last_sample: int | None = None
    first_frame: int | None = None
    """Number of the frame in the video file; null when it is not known."""
    last_frame: int | None = None
    first_s: Number = None
    last_s: Number = None


class Smoothing(Part):
    """How a trajectory was smoothed, one number a quantity."""

    psd: list[Number]
    """Process noise, unit^2/s^5."""
    nis: list[Number]
    """Mean normalised innovation squared; 1 when the filter is consistent."""


# --------------------------------------------------------------------------- documents


class FitDocument(Document):
    """A model fitted to a trajectory (fit.json)."""

    document: Literal["fit"] = "fit"
    version: Literal[1] = 1
    model: str
    equation: str
    """The governing equation, LaTeX."""
    status: FitStatus
    message: str
    """What to make of the status, with the remedy."""
    parameters: dict[str, EstimateEntry]
    """Fitted parameters, constants, initial states and derived quantities, by name."""
    free: list[str]
    """Names of the fitted ones, in the order of the covariance."""
    covariance: list[list[Number]]
    """Random part of the covariance of the free parameters; it allows for autocorrelated residuals."""
    budget: dict[str, dict[str, Number]]
    """Standard error of each parameter from each source."""
    noise: Number
    """Standard deviation of the measurement, all quantities together; null when their units differ."""
    rms: Number
    """Root mean square of the residual, all quantities together; null when their units differ."""
    n: int
    """Number of samples used."""
    aic: Number
    bic: Number
    condition: Number
    """Condition number of the Fisher information, each parameter scaled to unit information; null when infinite."""
    correlation: Number
    """Correlation of neighbouring residuals."""
    t0_s: Number
    """Time at which the initial states hold."""
    quantities: list[FittedQuantity]
    """The observed quantities."""
    samples: UsedSamples
    segments: list[FittedSegment]
    geometry: dict[str, EstimateEntry]
    """What was measured on the way to the trajectory, e.g. pivot and scale."""
    intervals: dict[str, dict[str, tuple[Number, Number]]] = {}
    """95 % intervals of the random error by method (robust, profile, bootstrap) and name, where they were asked for."""
    identifiability: IdentifiabilityEntry | None = None
    clips: ClipsEntry | None = None
    """Where several clips were fitted."""
    selection: SelectionEntry | None = None
    """Where the model was chosen from the bank."""
    origin: dict[str, JsonValue]

    def estimates(self) -> dict[str, Estimate]:
        """The parameters as Estimates by name."""
        return {name: entry.estimate() for name, entry in self.parameters.items()}


class AddedEffect(Part):
    """An effect that was added to the model."""

    effect: str
    parameters: dict[str, EstimateEntry]


class Excluded(Part):
    """The largest size of an effect that the data allow; null where they say nothing about it."""

    effect: str
    parameter: str
    upper_95: Number
    unit: str


class FitError(Part):
    """Root mean square of the residual over the samples fitted, and over later ones that were held out."""

    fitted: Number
    heldout: Number


class ErrorTable(Part):
    """The error before and after, against the noise of the measurement."""

    before: FitError
    after: FitError
    noise_floor: Number
    unit: str


class FurtherClip(Part):
    """A clip after the first: its fits without and with the effects, and where it comes from."""

    base: FitDocument
    final: FitDocument
    origin: dict[str, JsonValue]


class DiagnosisDocument(Document):
    """What a model lacks, if anything (diagnosis.json)."""

    document: Literal["diagnosis"] = "diagnosis"
    version: Literal[1] = 1
    sentence: str
    """The result as a person would write it."""
    base: FitDocument
    """Of the first clip, as ``final``."""
    final: FitDocument
    added: list[AddedEffect]
    """In the order in which they were found; of several clips, their size over all."""
    indistinguishable: dict[str, list[str]]
    """For each effect added, those that explain the data as well."""
    ruled_out: list[Excluded]
    error: ErrorTable
    proposed: list[TermEntry] = []
    """Terms without a named effect, for what is left above the noise floor; coefficients to first order."""
    notes: list[str] = []
    """What could not be asked or answered, and why."""
    further_clips: list[FurtherClip] = []
    origin: dict[str, JsonValue]


class EquationEntry(Part):
    """One equation as plain text and as LaTeX, with its numbers."""

    lhs: str
    rhs: str
    latex: str


class TermEntry(Part):
    """One candidate term; ``coefficient`` and ``ci95`` of one that is not selected are what adding it would give."""

    equation: str
    """Left side of the equation that it belongs to."""
    term: str
    coefficient: Number
    ci95: tuple[Number, Number]
    inclusion: Annotated[float, Field(ge=0, le=1)]
    """Share of resampled data sets in which the term is selected."""
    selected: bool
    stderr: Number
    unit: str
    latex: str
    parameter: str
    """Its name in the discovered model."""
    effect: str = ""
    """The effect that adds such a term, empty where none does."""


class MatchEntry(Part):
    """A model of the bank with the discovered structure."""

    model: str
    parameters: dict[str, EstimateEntry]
    same: list[str] = []
    """Other models of the bank with the same equation."""
    note: str = ""


class NearestEntry(Part):
    """The model of the bank that comes nearest, and what it has that was not found, and the other way about."""

    model: str
    missing: list[str]
    extra: list[str]
    parameters: dict[str, EstimateEntry] = {}
    """What they would be if the model were true."""
    note: str = ""


class DiscoveryDocument(Document):
    """A governing equation found in the data (discovery.json)."""

    document: Literal["discovery"] = "discovery"
    version: Literal[1] = 1
    sentence: str
    """The result as a person would write it."""
    status: FitStatus
    message: str
    equations: list[EquationEntry]
    terms: list[TermEntry]
    """Every candidate of every equation."""
    matched: MatchEntry | None
    nearest: NearestEntry | None
    alternatives: list[str]
    """Exchanges of one term for another that the data cannot tell from what was selected."""
    proposed: list[str]
    """Parameters of the terms that the sparse regression proposed, before trajectory fitting."""
    noise: list[Number]
    """Standard deviation of the measurement, one a quantity and clip."""
    rms: list[Number]
    """Root mean square of the residual, one a quantity and clip."""
    n: list[int]
    """Samples used of each clip."""
    origin: dict[str, JsonValue]


class CalibrationDocument(Document):
    """How pixels become metres in the plane of motion (calibration.json)."""

    document: Literal["calibration"] = "calibration"
    version: Literal[1] = 1
    unit: Literal["m", "px"]
    """Unit of the world; px when no scale is known."""
    homography: tuple[Triple, Triple, Triple]
    """Maps (x, y, 1), undistorted px, y down, to the world, z up; rows."""
    scale: EstimateEntry
    """px per unit where the calibration was made; its standard error is common to all samples."""
    source: str = ""
    camera_matrix: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """fx, fy, cx, cy, px; rows. With the distortion it takes pixels to undistorted px."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 as OpenCV defines them."""
    budget: Annotated[dict[str, list[list[float]]], Field(max_length=100)] = {}
    """By source: part of the covariance (18, 18) of the homography's nine entries, row by row, and fx, fy, cx, cy, k1,
    k2, p1, p2, k3; independent parts that add up."""
    image_size: tuple[PixelCount, PixelCount] | None = None
    """Width and height of the pictures it is valid for, px; null where it was not made from pictures."""
    centre_px: tuple[float, float] = (0.0, 0.0)
    """Where in the picture it was made."""
    fixed: list[str] = []
    """What the data fixed."""
    assumed: list[str] = []
    """What was taken for granted."""
    notes: list[str] = []
    rms_px: Number = None
    """Root mean square distance of the board's corners from where they should be; null without a board."""
    origin: dict[str, JsonValue] = {}


class OriginDocument(Document):
    """What a CSV file cannot say (the .origin.json file beside it)."""

    document: Literal["origin"] = "origin"
    version: Literal[1] = 1
    table: str
    """Name of the CSV file."""
    table_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    quantities: list[QuantityEntry] = []
    inputs: list[QuantityEntry] = []
    segments: list[SegmentEntry] = []
    geometry: dict[str, EstimateEntry] = {}
    systematic: dict[str, list[list[list[float]]]] = {}
    """By source, what errors of the positions have in common: patterns of one standard error, each a row a sample."""
    smoothing: Smoothing | None = None
    origin: dict[str, JsonValue] = {}
    bodies: dict[str, dict[str, JsonValue]] = {}
    """Origin by body, where the bodies of a track differ."""


class TensorDocument(Document):
    """What a tensor of pictures cannot say (the .npy.json file beside it)."""

    document: Literal["tensor"] = "tensor"
    version: Literal[1] = 1
    shape: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=5, max_length=5)]
    """Windows, frames a window, channels, height and width in px."""
    time_step_s: Annotated[float, Field(gt=0)] | None
    """True time between two frames of a window, the median; null where a window has one frame."""
    time_step_spread_s: Annotated[float, Field(ge=0)] | None
    """Largest difference from it."""
    step: Annotated[int, Field(ge=1, le=10_000)]
    """Frames of the clip from one frame of a window to the next."""
    stride: Annotated[int, Field(ge=1, le=10_000)]
    """Frames of the clip from the start of a window to that of the next."""
    t_s: Annotated[list[float], Field(min_length=1)]
    """True time of each frame of the clip that is in the tensor, in order."""
    origin: dict[str, JsonValue] = {}


DOCUMENTS: dict[str, type[Document]] = {
    "fit": FitDocument,
    "diagnosis": DiagnosisDocument,
    "discovery": DiscoveryDocument,
    "calibration": CalibrationDocument,
    "origin": OriginDocument,
    "tensor": TensorDocument,
}
