"""A missing force as a part of diagnosis.json."""

from __future__ import annotations

from iris_sysid.io.json_documents import entry_of
from iris_sysid.io.schemas import ForceFormEntry, MissingForceEntry, QuantityEntry, known_number, known_numbers
from iris_sysid.types import Array, ForceForm, MissingForce


def force_entry(force: MissingForce | None) -> MissingForceEntry | None:
    """A missing force as it is written to a file."""
    if force is None:
        return None
    return MissingForceEntry(
        t_s=force.t_s.tolist(),
        quantities=[
            QuantityEntry(name=quantity.name, unit=quantity.unit, symbol=quantity.symbol)
            for quantity in force.quantities
        ],
        units=list(force.units),
        position=_rows(force.position),
        velocity=_rows(force.velocity),
        force=_rows(force.force),
        stderr=_rows(force.stderr),
        by_effects=None if force.by_effects is None else _rows(force.by_effects),
        log_odds=known_number(force.log_odds),
        whole=force.whole,
        form=None if force.form is None else _form(force.form),
    )


def _form(form: ForceForm) -> ForceFormEntry:
    return ForceFormEntry(
        kind=form.kind,
        size=known_number(form.size),
        shape=None if form.shape is None else entry_of(form.shape),
        share=form.share,
        similar=list(form.similar),
    )


def _rows(table: Array) -> list[list[float | None]]:
    return [known_numbers(row) for row in table]
