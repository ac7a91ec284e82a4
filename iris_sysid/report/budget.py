"""Where a result's uncertainty comes from, and how its pixels became metres: the GUM's budget as tables of the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.calibration.plane import local_geometry
from iris_sysid.errors import CalibrationError
from iris_sysid.report import text
from iris_sysid.report.page import Section, estimates_section
from iris_sysid.types import Calibration, Estimate, FitResult, Track

RANDOM = "random"
SPELLED = {RANDOM: "tracking noise, and whatever else varies from sample to sample"}
NOTE = (
    "Standard errors in each parameter's unit; the parts are independent and add in squares (GUM 5.1.2). Systematic "
    "parts are common to all samples of the clip, so more samples do not shrink them."
)


def budget_sections(fit: FitResult) -> list[Section]:
    """One table: the standard error of each parameter of the ``fit`` by source, and its share of the variance."""
    rows: list[tuple[str, ...]] = []
    for name, parts in fit.budget.items():
        if name in fit.estimates and all(map(math.isfinite, parts.values())):
            rows += _rows(name, fit.estimates[name], parts, fit.estimates)
    if not rows:
        return []
    columns = ("parameter", "source", "kind", "#standard error", "#share")
    return [Section("Where the uncertainty comes from", columns, rows, lines=[NOTE])]


def _rows(
    name: str, total: Estimate, parts: Mapping[str, float], known: Mapping[str, Estimate]
) -> list[tuple[str, ...]]:
    variance = sum(part**2 for part in parts.values())
    rows: list[tuple[str, ...]] = [(name, "all together", "", f"{math.sqrt(variance):.2g} {total.unit}".strip(), "")]
    for source, part in sorted(parts.items(), key=lambda one: -one[1]):
        if part > 0:
            kind = "random" if source == RANDOM else "systematic"
            rows.append(("", _spelled(source, known), kind, f"{part:.2g}", f"{100 * part**2 / variance:.1f} %"))
    return rows


def _spelled(source: str, known: Mapping[str, Estimate]) -> str:
    """A source in words: what it is, and how well it is known where it is a constant."""
    if source in known:
        return f"{source} = {text.with_error(known[source])}"
    return SPELLED.get(source, source)


def calibration_section(calibration: Calibration, tracks: Sequence[Track]) -> Section:
    """The scale and its departures where the bodies are, what the data fixed, and what is assumed.

    ``tracks`` say where in the picture; ``calibration`` is that of the clip.
    """
    lines = [f"From: {calibration.source}."] if calibration.source else []
    if calibration.fixed:
        lines.append(f"Fixed by the data: {', '.join(calibration.fixed)}.")
    if calibration.assumed:
        lines.append(f"Assumed: {'; '.join(calibration.assumed)}.")
    title = "How pixels became metres"
    seen = np.concatenate([one.xy_px[one.valid] for one in tracks])
    if calibration.unit != "m" or not len(seen):
        return Section(title, lines=lines)
    x, y = np.median(seen, axis=0)
    try:
        geometry = local_geometry(calibration, (float(x), float(y)))
    except CalibrationError:  # the middle of a path need not lie on the plane
        return Section(title, lines=lines)
    table = estimates_section(title, {f"{name} at ({x:.0f}, {y:.0f}) px": one for name, one in geometry.items()})
    return Section(title, table.columns[:3], [row[:3] for row in table.rows], lines)
