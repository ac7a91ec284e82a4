"""The parts of a residual, and what is said of each, as parts of diagnosis.json."""

from __future__ import annotations

from iris_sysid.io.json_documents import entry_of
from iris_sysid.io.schemas import (
    ComponentEntry,
    ComponentsEntry,
    CurveEntry,
    ExplanationEntry,
    FindingEntry,
    QuantityEntry,
    known_number,
    known_numbers,
)
from iris_sysid.types import Component, ComponentCurve, Components, Finding


def components_entry(components: Components | None) -> ComponentsEntry | None:
    """The ``components`` of a residual as they are written to a file."""
    if components is None:
        return None
    sizes = ("residual_rms", "noise_rms", "motion_rms", "noise_share", "correlation", "motion_explained")
    return ComponentsEntry(
        **{name: known_number(getattr(components, name)) for name in sizes},
        unit=components.unit,
        parts=[_part(part) for part in components.parts],
        explanations=[
            ExplanationEntry(kinds=list(kinds), probability=known_number(probability))
            for kinds, probability in components.explanations
        ],
    )


def finding_entry(finding: Finding) -> FindingEntry:
    """A ``finding`` as it is written to a file."""
    return FindingEntry(
        word=finding.word,
        component=finding.component,
        effects=list(finding.effects),
        share=known_number(finding.share),
        reason=finding.reason,
    )


def _part(part: Component) -> ComponentEntry:
    low, high = part.share_range
    return ComponentEntry(
        kind=part.kind,
        side=part.side,
        share=known_number(part.share),
        share_range=(known_number(low), known_number(high)),
        rms=known_number(part.rms),
        probability=known_number(part.probability),
        at=None if part.at is None else entry_of(part.at),
        similar=list(part.similar),
        curve=None if part.curve is None else _curve(part.curve),
    )


def _curve(curve: ComponentCurve) -> CurveEntry:
    return CurveEntry(
        argument=curve.argument.name,
        unit=curve.argument.unit,
        at=[float(value) for value in curve.at],
        quantities=[
            QuantityEntry(name=quantity.name, unit=quantity.unit, symbol=quantity.symbol)
            for quantity in curve.quantities
        ],
        values=[known_numbers(row) for row in curve.values],
        stderr=[known_numbers(row) for row in curve.stderr],
    )
