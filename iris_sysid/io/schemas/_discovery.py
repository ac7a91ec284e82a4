"""The equation that a trajectory obeys."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, JsonValue

from iris_sysid.io.schemas._parts import Document, EstimateEntry, Number, Part, VerdictEntry
from iris_sysid.types import FitStatus


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
    verdict: VerdictEntry | None = None
    """How far the result can be used."""
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
    """Standard deviation of the measurement, one per quantity and clip."""
    rms: list[Number]
    """Root mean square of the residual, one per quantity and clip."""
    n: list[int]
    """Samples used of each clip."""
    origin: dict[str, JsonValue]
