"""What the files are made of: numbers, estimates, quantities, segments."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, ValidationInfo, model_validator

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


def _finite(value: Any, info: ValidationInfo) -> Any:
    """Null for NaN and infinity in an object; a file with NaN is refused."""
    return None if info.mode == "python" and isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def number(value: Number) -> float:
    """The value; NaN where it is None."""
    return math.nan if value is None else value


class Part(BaseModel):
    """A piece of a document: no unknown key, no text for a number, no NaN, nothing changed afterwards."""

    model_config = ConfigDict(
        strict=True,
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
        defer_build=True,  # when it is first used: a command uses few of all kinds
    )

    @classmethod
    def of(cls, value: Any) -> Self:
        """The part out of an object or mapping that has its fields by the same names; arrays become lists."""
        names = [name for name in cls.model_fields if hasattr(value, name)]
        fields = value if isinstance(value, Mapping) else {name: getattr(value, name) for name in names}
        return cls.model_validate(_plain(fields), strict=False, from_attributes=True)


class Document(Part):
    """A whole file; each kind states its ``document`` name and the ``version`` of its layout."""


class EstimateEntry(Part):
    """A number with its standard error, interval and unit."""

    value: Number
    """Value in the unit; null when there is none."""
    stderr: Number
    """Standard error; null when the data do not determine it."""
    ci95: Annotated[tuple[Number, Number], Strict(False)]  # a list where the entry went through _of_estimate
    """Lower and upper end of the 95 % interval; null where there is none."""
    unit: str
    measurement_type: Literal["fitted", "direct", "assumed", "derived", "metadata"]
    source: str = ""
    """Where the value comes from, in words."""
    note: str = ""
    """Why a number is null."""

    @model_validator(mode="before")
    @classmethod
    def _of_estimate(cls, value: Any) -> Any:
        """An Estimate can stand for its entry."""
        if not isinstance(value, Estimate):
            return value
        return {**asdict(value), "ci95": value.interval, "note": why_null(value)}

    def estimate(self) -> Estimate:
        """The entry as an Estimate; null becomes NaN, and an open end of the interval infinity."""
        value, stderr = number(self.value), number(self.stderr)
        plain = Estimate(value, stderr, self.unit, self.measurement_type, self.source)
        if tuple(end if math.isfinite(end) else None for end in plain.interval) == self.ci95:
            return plain
        low, high = self.ci95
        interval = (-math.inf if low is None else low, math.inf if high is None else high)
        return Estimate(value, stderr, self.unit, self.measurement_type, self.source, interval)


def why_null(estimate: Estimate, because: str = "") -> str:
    """Why a number of an estimate is null, and ``because`` of what; empty where both are known."""
    if not math.isfinite(estimate.value):
        return f"no value was found{because}"
    if not math.isfinite(estimate.stderr):
        return f"the data do not determine its standard error{because}"
    return ""


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
    """Whether the equation is complete; null where there is no fit."""

    def verdict(self) -> Verdict:
        """The entry as a Verdict."""
        equation = None if self.equation is None else self.equation.completeness()
        return Verdict(self.word, tuple(entry.doubt() for entry in self.reasons), equation, self.accuracy)
