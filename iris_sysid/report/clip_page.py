"""One page a clip, pictures first: the track on the video, the trajectory with its fit, then the numbers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from iris_sysid.io.files import check_writable, write_atomic
from iris_sysid.report import text
from iris_sysid.report.budget import budget_sections, calibration_section
from iris_sysid.report.determined import determined_sections
from iris_sysid.report.figures import fit_figure, track_figure
from iris_sysid.report.page import Page, Picture, Section, estimates_section, html_of, png_of
from iris_sysid.types import FitResult, Trajectory

if TYPE_CHECKING:
    from iris_sysid.pipeline import Run


def write_report(run: Run, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write ``report.html`` and the pictures in it, as PNG files, into a folder.

    Parameters
    ----------
    run
        What :func:`iris_sysid.run` returned.
    folder
        Made when it does not exist.
    overwrite
        Replace files of an earlier report.

    Returns
    -------
    Path
        The page; it needs no other file.

    Raises
    ------
    OutputError
        When a file exists or cannot be written; nothing is left half-written.
    """
    return write_page(clip_page(run), folder, overwrite=overwrite)


def write_page(page: Page, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write a page's pictures and then ``report.html`` into a folder.

    Parameters
    ----------
    page
        What it says.
    folder
        Made when it does not exist.
    overwrite
        Replace files of an earlier report.

    Returns
    -------
    Path
        The page.
    """
    files = {f"{picture.name}.png": picture.png for picture in page.pictures} | {"report.html": html_of(page)}
    for name in files:
        check_writable(Path(folder) / name, overwrite=overwrite)
    for name, content in files.items():
        write_atomic(Path(folder) / name, content, overwrite=overwrite)
    return Path(folder) / "report.html"


def clip_page(run: Run) -> Page:
    """Say what one clip gave."""
    fit, trajectory = run.fit, run.trajectory
    pictures = [
        Picture(
            "track",
            png_of(track_figure(run.video, run.tracks, trajectory, run.calibration)),
            "The clip at several times in one picture, with the track over it",
        ),
        Picture("fit", png_of(fit_figure(trajectory, fit)), "Measured, fitted, and what is left; the motion is fitted"),
    ]
    return Page(
        title=f"{run.source.name}: {run.phenomenon.name}",
        headline=text.headline(fit),
        summary=fit.model.summary,
        pictures=pictures,
        sections=[
            estimates_section("Parameters", text.shown(fit), fit.model.equation),
            *budget_sections(fit),
            *determined_sections(fit),
            calibration_section(run.calibration, run.tracks),
            *_segment_sections(trajectory),
            *([estimates_section("Measured on the way", trajectory.geometry)] if trajectory.geometry else []),
            Section("Checks", lines=_checks(trajectory, fit)),
        ],
        origin=fit.origin,
        notes=[*run.notes, *([] if fit.ok else [fit.message])],
    )


def _segment_sections(trajectory: Trajectory) -> list[Section]:
    rows = [(part.label, text.frames_text(part, trajectory), part.reason) for part in trajectory.segments]
    return [Section("What happens when", ("what", "samples", "why"), rows)] if rows else []


def _checks(trajectory: Trajectory, fit: FitResult) -> list[str]:
    found = int(trajectory.valid.sum())
    checks = [
        f"{found} of {trajectory.n} samples measured, {fit.n} used for the fit.",
        f"{text.residual_text(fit)}.",
        f"The residual correlates by {fit.correlation:.2f} from one sample to the next; standard errors allow for it.",
    ]
    if fit.ok and fit.message:
        checks.append(f"{fit.message}.")
    if trajectory.smoothed is not None:
        nis = ", ".join(f"{value:.2f}" for value in trajectory.smoothed.nis)
        checks.append(f"Mean normalised innovation squared of the Kalman filter: {nis} (1 when it is consistent).")
    return checks
