"""All tables of the benchmark, made from the flat rows alone."""

from __future__ import annotations

import pandas as pd

from iris_sysid.benchmark.sources.rows import OK, PARAMETERS, SELECTION, check_rows
from iris_sysid.benchmark.tables.headline import headline_table
from iris_sysid.benchmark.tables.selection_tables import accuracy_table, confusion_tables
from iris_sysid.benchmark.tables.study_tables import LAYOUTS, study_table
from iris_sysid.benchmark.tables.table import Table, frame_table, parameter_table


def tables_of(rows: pd.DataFrame) -> dict[str, Table]:
    """Make every table that has flat rows, by name, in the order of the page; DataError when they are not flat rows.

    ``headline``, ``parameters``, ``selection`` and its confusion matrices, one table for each further study,
    ``failures``.
    """
    present = set(check_rows(rows)["study"])
    tables: dict[str, Table] = {}
    if PARAMETERS in present:
        tables["headline"] = headline_table(rows)
        tables["parameters"] = parameter_table(rows, caption="Parameter errors, every reading")
    if SELECTION in present:
        tables["selection"] = accuracy_table(rows)
        tables |= dict(confusion_tables(rows))
    tables |= {study: study_table(rows, study) for study in LAYOUTS if study in present}
    if (rows["status"] != OK).any():
        tables["failures"] = failure_table(rows)
    return tables


def failure_table(rows: pd.DataFrame) -> Table:
    """How many rows have a status other than ok, by study, data set, phenomenon, method and status; flat ``rows``."""
    by = ["study", "dataset", "phenomenon", "method", "status"]
    bad = rows[rows["status"] != OK]
    counts = bad.groupby(by, sort=False).agg(rows=("value", "size"), values=("value", "count")).reset_index()
    note = (
        "misfit: the equation is incomplete, its values can be used with their errors. at-bound, singular: the values "
        "are doubtful. Failed rows have no value."
    )
    return frame_table(counts.rename(columns={"values": "with a value"}), "Failures and reservations", notes=(note,))
