"""A model fitted to a trajectory."""

from __future__ import annotations

from typing import Literal

from pydantic import JsonValue

from iris_sysid.io.schemas._parts import (
    Document,
    EstimateEntry,
    Number,
    Part,
    QuantityEntry,
    SegmentEntry,
    VerdictEntry,
)
from iris_sysid.io.schemas._validation import ValidationEntry
from iris_sysid.types import Estimate, FitReason, FitStatus


class FittedQuantity(QuantityEntry):
    """How well one observed quantity is fitted, in its unit."""

    noise: Number
    """Standard deviation of the measurement, estimated without the model."""
    rms: Number
    """Root mean square of the residual, observed - predicted."""


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


class ProblemEntry(Part):
    """Why a fit gave no estimates, or why they need care."""

    reason: FitReason
    finding: str
    detail: str
    """The numbers; empty where there are none."""
    remedy: str
    """What to do."""


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
    """Chance of such a ``q`` when all clips have one value."""


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
    observable: str
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


class FitDocument(Document):
    """A model fitted to a trajectory (fit.json)."""

    document: Literal["fit"] = "fit"
    version: Literal[2] = 2
    model: str
    equation: str
    """The governing equation, LaTeX."""
    status: FitStatus
    message: str
    """What to make of the status, with the remedy."""
    verdict: VerdictEntry | None = None
    """How far the result can be used."""
    problems: list[ProblemEntry] = []
    """Why the status is not ok, the most serious first."""
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
    """95 % intervals of the random error by method (robust, profile, bootstrap) and name, where they were requested."""
    identifiability: IdentifiabilityEntry | None = None
    clips: ClipsEntry | None = None
    """Where several clips were fitted."""
    selection: SelectionEntry | None = None
    """Where the model was chosen from the bank."""
    validation: ValidationEntry | None = None
    """Where a record that was not fitted was given."""
    origin: dict[str, JsonValue]

    def estimates(self) -> dict[str, Estimate]:
        """The parameters as Estimates by name."""
        return {name: entry.estimate() for name, entry in self.parameters.items()}
