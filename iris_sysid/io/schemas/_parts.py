"""What the files are made of: numbers, estimates, quantities, segments."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from iris_sysid.types import (
    Completeness,
    Doubt,
    DoubtKind,
    Estimate,
    Quantity,
    Segment,
    SegmentLabel,
    Verdict,
    VerdictWord,
)

Number = float | None


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

    @classmethod
    def upgraded(cls, content: dict[str, Any]) -> dict[str, Any]:
        """The content of a file of an older version, as the present version has it; as it is where nothing changed."""
        return content


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


class SegmentEntry(Part):
    """Samples ``start`` to ``stop - 1``, counted from 0, and what happens in them."""

    label: SegmentLabel
    start: Annotated[int, Field(ge=0)]
    stop: Annotated[int, Field(ge=1)]
    reason: str = ""

    def segment(self) -> Segment:
        """The entry as a Segment."""
        return Segment(self.label, self.start, self.stop, self.reason)


class DoubtEntry(Part):
    """One reason to doubt a track or a result."""

    kind: DoubtKind
    finding: str
    remedy: str
    """The option that helps."""

    @classmethod
    def of(cls, doubt: Doubt) -> DoubtEntry:
        """The doubt as an entry."""
        return cls(kind=doubt.kind, finding=doubt.finding, remedy=doubt.remedy)

    def doubt(self) -> Doubt:
        """The entry as a Doubt."""
        return Doubt(**self.model_dump())


class CompletenessEntry(Part):
    """How much of the motion the equation explains."""

    explained: Number
    """Fraction of the motion's variance; null where it is not known."""
    complete: bool
    """Whether the data show no sign that the equation lacks something."""
    residual_over_noise: Number
    """Ratio of the root mean squares; null where the noise is not known."""
    rest: str = ""
    """What the residual is made of, in a clause."""

    @classmethod
    def of(cls, equation: Completeness) -> CompletenessEntry:
        """The completeness as an entry."""
        return cls(
            explained=known_number(equation.explained),
            complete=equation.complete,
            residual_over_noise=known_number(equation.residual_over_noise),
            rest=equation.rest,
        )

    def completeness(self) -> Completeness:
        """The entry as a Completeness."""
        return Completeness(number(self.explained), self.complete, number(self.residual_over_noise), self.rest)


class VerdictEntry(Part):
    """Whether the numbers of a result can be used, and whether its equation is complete."""

    word: VerdictWord
    """Whether the numbers can be used with their errors."""
    reasons: list[DoubtEntry]
    """Why the word is not good or the equation not complete, causes first."""
    accuracy: dict[str, float] = {}
    """Relative standard error of the values that matter, the main one first."""
    equation: CompletenessEntry | None = None
    """Whether the equation is complete; null where there is no fit, and in files from before 2026-11-24."""

    @model_validator(mode="before")
    @classmethod
    def _of_two_axes(cls, content: Any) -> Any:
        """Files from before 2026-11-24 had the word misfit for a motion that the equation does not explain."""
        if isinstance(content, dict) and content.get("word") == "misfit":
            return {**content, "word": "doubtful"}
        return content

    @classmethod
    def of(cls, verdict: Verdict) -> VerdictEntry:
        """The verdict as an entry."""
        return cls(
            word=verdict.word,
            reasons=[DoubtEntry.of(doubt) for doubt in verdict.reasons],
            accuracy={name: float(error) for name, error in verdict.accuracy.items()},
            equation=None if verdict.equation is None else CompletenessEntry.of(verdict.equation),
        )

    def verdict(self) -> Verdict:
        """The entry as a Verdict."""
        equation = None if self.equation is None else self.equation.completeness()
        return Verdict(self.word, tuple(entry.doubt() for entry in self.reasons), equation, self.accuracy)
