"""A validation as part of fit.json and diagnosis.json."""

from __future__ import annotations

from dataclasses import asdict

from iris_sysid.io.schemas import LinearModelEntry, QuantityEntry, ValidationEntry, known_number, known_numbers
from iris_sysid.types import LinearModel, Validation


def validation_entry(validation: Validation, record: str) -> ValidationEntry:
    """The validation as it is written to a file; ``record`` says what was simulated."""
    return ValidationEntry(
        record=record,
        n=validation.simulated.n,
        quantities=[QuantityEntry(**asdict(quantity)) for quantity in validation.quantities],
        inputs=[QuantityEntry(**asdict(quantity)) for quantity in validation.inputs],
        rms=known_numbers(validation.rms),
        fit_percent=known_numbers(validation.fit_percent),
        autocorrelation=[known_numbers(row) for row in validation.autocorrelation],
        autocorrelation_band=known_number(validation.autocorrelation_band),
        input_correlation=[[known_numbers(row) for row in rows] for rows in validation.input_correlation],
        input_band=[known_numbers(row) for row in validation.input_band],
        linear=_linear(validation.linear),
    )


def _linear(linear: LinearModel | None) -> LinearModelEntry | None:
    if linear is None:
        return None
    return LinearModelEntry(
        order=linear.order, rms=known_numbers(linear.rms), fit_percent=known_numbers(linear.fit_percent)
    )
