"""The page of a group that gave a table: the motion with its fit, the numbers, what was left out."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.report.clip_page import fit_charts, headline, key_values, write_page
from iris_sysid.report.figures import fit_figure
from iris_sysid.report.page import Page, PageImage, Section, estimates_section, fit_section, png_of
from iris_sysid.report.residual_budget import residual_budget
from iris_sysid.report.text import as_sentence, main_names, residual_text
from iris_sysid.types import FitResult, Trajectory


def write_table_page(group: str, source: str, trajectory: Trajectory, fit: FitResult, folder: Path) -> Path:
    """Write ``report.html`` and its picture into the folder of a group; files of an earlier run are replaced.

    Parameters
    ----------
    group
        Its name.
    source
        Name of the table.
    trajectory
        What was fitted.
    fit
        The model fitted to it.
    folder
        Of the group's results.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    OutputError
        When a file cannot be written.
    """
    caption = "Measured motion and fit, with the residual below"
    statements, bars = residual_budget(trajectory, fit)
    page = Page(
        title=f"{group}: {source}",
        headline=headline(fit),
        summary=fit.model.summary,
        values=key_values(fit, main_names(fit)),
        statements=statements,
        bars=bars,
        charts=fit_charts(trajectory, fit),
        images=[PageImage("fit", png_of(fit_figure(trajectory, fit)), caption)] if fit.usable else [],
        sections=[
            fit_section("Parameters", fit),
            *([estimates_section("Intermediate quantities", trajectory.geometry)] if trajectory.geometry else []),
            Section("Checks", lines=_checks(trajectory, fit)),
        ],
        origin=fit.origin or trajectory.origin,
        verdict=fit.verdict,
    )
    return write_page(page, folder, overwrite=True)


def _checks(trajectory: Trajectory, fit: FitResult) -> list[str]:
    return [
        f"{int(trajectory.valid.sum())} of {trajectory.n} samples are measured, {fit.n} are used for the fit.",
        f"Residual: {residual_text(fit)}.",
        *map(as_sentence, fit.notes),
    ]
