"""A validation as part of fit.json and diagnosis.json."""

from __future__ import annotations

from iris_sysid.io.schemas import LinearModelEntry, ValidationEntry
from iris_sysid.types import Validation


def validation_entry(validation: Validation, record: str) -> ValidationEntry:
    """The validation as it is written to a file; ``record`` says what was simulated."""
    named = ValidationEntry.model_fields.keys() - {"linear", "record", "n"}
    values = {name: getattr(validation, name) for name in named}
    linear = None if validation.linear is None else LinearModelEntry.of(validation.linear)
    return ValidationEntry.of({**values, "linear": linear, "record": record, "n": validation.simulated.n})
