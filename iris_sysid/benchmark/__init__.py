"""The benchmark's tables: published results read as they are, re-scored, audited, and written in four forms."""

from iris_sysid.benchmark.all_tables import tables_of
from iris_sysid.benchmark.audit import audit, verdicts
from iris_sysid.benchmark.build import Inputs, build
from iris_sysid.benchmark.evidence import Finding
from iris_sysid.benchmark.findings import findings
from iris_sysid.benchmark.latent import latent_rows, read_latent_runs
from iris_sysid.benchmark.nulls import null_rows
from iris_sysid.benchmark.page_files import write_pages
from iris_sysid.benchmark.predictions import prediction_rows
from iris_sysid.benchmark.published import published_values, truth_of, truths
from iris_sysid.benchmark.rows import COLUMNS, check_rows, flat_rows, read_rows, rows_text
from iris_sysid.benchmark.selection import SelectionScore, read_predictions, rescored_selection, score_selection
from iris_sysid.benchmark.summary import parameter_summary
from iris_sysid.benchmark.tables import parameter_table, render, render_rows
from iris_sysid.benchmark.write import write_audit

__all__ = [
    "COLUMNS",
    "Finding",
    "Inputs",
    "SelectionScore",
    "audit",
    "build",
    "check_rows",
    "findings",
    "flat_rows",
    "latent_rows",
    "null_rows",
    "parameter_summary",
    "parameter_table",
    "prediction_rows",
    "published_values",
    "read_latent_runs",
    "read_predictions",
    "read_rows",
    "render",
    "render_rows",
    "rescored_selection",
    "rows_text",
    "score_selection",
    "tables_of",
    "truth_of",
    "truths",
    "verdicts",
    "write_audit",
    "write_pages",
]
