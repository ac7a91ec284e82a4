"""The uncertainty budget of a result (GUM) and its calibration, as sections of the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.calibration.plane import local_geometry
from iris_sysid.calibration.vertical import assumptions, fixed_by_data
from iris_sysid.errors import CalibrationError
from iris_sysid.report.page import Section, estimates_section, numbers, words
from iris_sysid.report.text import shown_unit, table_names, with_error
from iris_sysid.types import Calibration, Estimate, FitResult, Track

RANDOM, RANDOM_IN_WORDS = "random", "tracking noise and other random errors"
MIN_SHARE = 0.0005  # of the variance; a smaller part is "0.0 %"
NOTE = (
    "Standard errors in the unit of the total. The parts are independent and add in squares (GUM 5.1.2). Systematic "
    "parts are common to all samples of the clip: more samples do not reduce them."
)


def budget_sections(fit: FitResult) -> list[Section]:
    """One table: the standard error of each parameter of the ``fit`` by source, and its fraction of the variance.

    Out of sight are the parameters that nobody came for, and parts that round to 0.0 % of the variance.
    """
    rows: list[tuple[str, ...]] = []
    more: list[tuple[str, ...]] = []
    main = table_names(fit)
    for name, parts in fit.budget.items():
        if name in fit.estimates and all(map(math.isfinite, parts.values())):
            shown, small = _rows(name, fit.estimates[name], parts, fit.estimates)
            rows += shown if name in main else []
            more += small if name in main else [*shown, *small]
    if not rows and not more:
        return []
    columns = (*words("parameter", "source", "kind"), *numbers("standard error", "of the variance"))
    return [Section("Uncertainty budget", columns, rows, lines=[NOTE], more=more)]


def _rows(
    name: str, total: Estimate, parts: Mapping[str, float], known: Mapping[str, Estimate]
) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """The rows of one parameter, its total first; then those of parts that round to 0.0 %."""
    variance, (unit, factor) = sum(part**2 for part in parts.values()), shown_unit(total.unit)
    rows: list[tuple[str, ...]] = [(name, "total", "", f"{factor * math.sqrt(variance):.2g} {unit}".strip(), "")]
    small: list[tuple[str, ...]] = []
    for source, part in sorted(parts.items(), key=lambda item: -item[1]):
        if part > 0:
            kind, said = ("random", RANDOM_IN_WORDS) if source == RANDOM else ("systematic", source)
            said = f"{source} = {with_error(known[source])}" if source in known else said
            cells = (said, kind, f"{factor * part:.2g}", f"{100 * part**2 / variance:.1f} %")
            (rows if part**2 >= MIN_SHARE * variance else small).append((name, *cells))
    return rows, small


def calibration_section(calibration: Calibration, tracks: Sequence[Track]) -> Section:
    """The scale and its distortions at the position of the bodies, what the data determine, and what is assumed.

    ``tracks`` give that position in the image; ``calibration`` is that of the clip.
    """
    lines = [f"Source: {calibration.source}."] if calibration.source else []
    if fixed := fixed_by_data(calibration):
        lines.append(f"Determined by the data: {', '.join(fixed)}.")
    if assumed := assumptions(calibration):
        lines.append(f"Assumed: {'; '.join(assumed)}.")
    title = "Calibration"
    positions = np.concatenate([track.xy_px[track.valid] for track in tracks])
    if calibration.unit != "m" or not len(positions):
        return Section(title, lines=lines)
    x, y = np.median(positions, axis=0)
    try:
        geometry = local_geometry(calibration, (float(x), float(y)))
    except CalibrationError:  # the median position need not lie on the calibrated plane
        return Section(title, lines=lines)
    table = estimates_section(
        title, {f"{name} at ({x:.0f}, {y:.0f}) px": estimate for name, estimate in geometry.items()}
    )
    return Section(title, table.columns[:3], [row[:3] for row in table.rows], lines)
