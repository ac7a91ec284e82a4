"""The benchmark's tables: published results read as they are, re-scored, audited, and written in four forms."""

from iris_sysid.benchmark.build import Inputs, build
from iris_sysid.benchmark.sources.latent import latent_rows, read_latent_runs
from iris_sysid.benchmark.sources.null_baselines import null_rows
from iris_sysid.benchmark.sources.predictions import prediction_rows
from iris_sysid.benchmark.sources.published import published_values, truth_of, truths
from iris_sysid.benchmark.sources.rows import COLUMNS, check_rows, flat_rows, read_rows, rows_text
from iris_sysid.benchmark.sources.selection import SelectionScore, read_predictions, rescored_selection, score_selection
from iris_sysid.benchmark.tables.all_tables import tables_of
from iris_sysid.benchmark.tables.pages import write_pages
from iris_sysid.benchmark.tables.summary import parameter_summary
from iris_sysid.benchmark.tables.table import parameter_table, render, render_rows
from validation.audit.evidence import Finding
from validation.audit.findings import findings
from validation.audit.reproduce import audit, verdicts
from validation.audit.write import write_audit

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
