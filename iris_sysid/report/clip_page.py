"""One page a clip: the track on the video, the trajectory with its fit, then the numbers."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.io.files import check_writable, write_atomic
from iris_sysid.report.budget import budget_sections, calibration_section
from iris_sysid.report.figures import fit_figure, track_figure
from iris_sysid.report.identifiability import identifiability_sections
from iris_sysid.report.page import Page, PageImage, Section, estimates_section, html_of, png_of, words
from iris_sysid.report.text import (
    as_sentence,
    fit_headline,
    residual_text,
    samples_text,
    shown_estimates,
)
from iris_sysid.types import FitResult, Run, Trajectory


def write_report(run: Run, folder: str | Path, *, overwrite: bool = False) -> Path:
    """Write ``report.html`` and its images, as PNG files, into a folder.

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
    """Write a page's images and then ``report.html`` into a folder.

    Parameters
    ----------
    page
        The content of the page.
    folder
        Created when it does not exist.
    overwrite
        Replace files of an earlier report.

    Returns
    -------
    Path
        The page.
    """
    files = {f"{image.name}.png": image.png for image in page.every_image} | {"report.html": html_of(page)}
    for name in files:
        check_writable(Path(folder) / name, overwrite=overwrite)
    for name, content in files.items():
        write_atomic(Path(folder) / name, content, overwrite=overwrite)
    return Path(folder) / "report.html"


def clip_page(run: Run) -> Page:
    """The page of one clip."""
    fit, trajectory = run.fit, run.trajectory
    track = track_figure(run.video, run.tracks, trajectory, run.calibration)
    images = [
        PageImage("track", png_of(track), "Multiple exposure of the clip with the track, coloured by segment"),
        PageImage("fit", png_of(fit_figure(trajectory, fit)), "Measured motion and fit, with the residual below"),
    ]
    return Page(
        title=f"{run.source.name}: {run.phenomenon.name}",
        headline=fit_headline(fit),
        summary=fit.model.summary,
        images=images,
        sections=[
            estimates_section("Parameters", shown_estimates(fit), fit.model.equation),
            *budget_sections(fit),
            *identifiability_sections(fit),
            calibration_section(run.calibration, run.tracks),
            *_segment_sections(trajectory),
            *([estimates_section("Intermediate quantities", trajectory.geometry)] if trajectory.geometry else []),
            Section("Checks", lines=_checks(trajectory, fit)),
        ],
        origin=fit.origin,
        notes=[as_sentence(note) for note in run.notes if not any(doubt.text in note for doubt in fit.doubts)],
        verdict=fit.verdict,
    )


def _segment_sections(trajectory: Trajectory) -> list[Section]:
    rows = [(segment.label, samples_text(segment, trajectory), segment.reason) for segment in trajectory.segments]
    return [Section("Segments", words("segment", "samples", "reason"), rows)] if rows else []


def _checks(trajectory: Trajectory, fit: FitResult) -> list[str]:
    checks = [
        f"{int(trajectory.valid.sum())} of {trajectory.n} samples are measured, {fit.n} are used for the fit.",
        as_sentence(residual_text(fit)),
        f"Autocorrelation of the residual at lag 1: {fit.correlation:.2f}; the standard errors allow for it.",
        *map(as_sentence, fit.notes),
    ]
    if trajectory.smoothed is not None:
        nis = ", ".join(f"{value:.2f}" for value in trajectory.smoothed.nis)
        checks.append(f"Mean normalised innovation squared of the Kalman filter: {nis} (1 when it is consistent).")
    return checks
