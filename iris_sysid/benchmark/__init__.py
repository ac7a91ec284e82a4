"""The benchmark's tables: published results read as they are, re-scored, audited, and written in four forms."""

from iris_sysid.benchmark.audit import audit, verdicts
from iris_sysid.benchmark.evidence import Finding
from iris_sysid.benchmark.findings import findings
from iris_sysid.benchmark.latent import latent_rows, read_latent_runs
from iris_sysid.benchmark.nulls import null_rows
from iris_sysid.benchmark.published import published_values, truth_of, truths
from iris_sysid.benchmark.rows import COLUMNS, check_rows, flat_rows
from iris_sysid.benchmark.selection import SelectionScore, read_predictions, rescored_selection, score_selection
from iris_sysid.benchmark.summary import parameter_summary
from iris_sysid.benchmark.tables import parameter_table, render, render_rows
from iris_sysid.benchmark.write import write_audit

__all__ = [
    "COLUMNS",
    "Finding",
    "SelectionScore",
    "audit",
    "check_rows",
    "findings",
    "flat_rows",
    "latent_rows",
    "null_rows",
    "parameter_summary",
    "parameter_table",
    "published_values",
    "read_latent_runs",
    "read_predictions",
    "render",
    "render_rows",
    "rescored_selection",
    "score_selection",
    "truth_of",
    "truths",
    "verdicts",
    "write_audit",
]
