"""One page a clip: the number and whether it can be used, the clip with its model, the residual; tables last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from iris_sysid.io.files import check_folder, write_atomic
from iris_sysid.report.budget import budget_sections, calibration_section
from iris_sysid.report.chart import Chart
from iris_sysid.report.figures import fit_figure, track_figure
from iris_sysid.report.film import film_of
from iris_sysid.report.identifiability import identifiability_sections
from iris_sysid.report.page import (
    KeyValue,
    Page,
    PageImage,
    Section,
    estimates_section,
    fit_section,
    html_of,
    png_of,
    symbols_of,
    words,
)
from iris_sysid.report.residual_budget import residual_budget
from iris_sysid.report.residual_charts import input_charts, motion_chart, residual_chart
from iris_sysid.report.text import (
    as_sentence,
    is_in_px,
    main_names,
    residual_text,
    samples_text,
    with_error,
)
from iris_sysid.trajectory.vertical_and_scale import vertical_note
from iris_sysid.types import FitResult, Run, Trajectory

SYMBOL_LENGTH = 2  # letters of a name that is a symbol, and keeps its case
MAX_VALUES = 3  # numbers beside the picture
IN_PX = "Lengths are in px: no scale was stated."


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
    """Write a page's images and then ``report.html`` into a folder, made when missing; the page's path."""
    files = {f"{image.name}.png": image.png for image in page.images} | {"report.html": html_of(page)}
    folder = check_folder(folder, files, overwrite=overwrite)
    for name, content in files.items():
        write_atomic(folder / name, content, overwrite=overwrite)
    return folder / "report.html"


def clip_page(run: Run) -> Page:
    """The page of one clip."""
    fit, trajectory = run.fit, run.trajectory
    track = track_figure(run.video, run.tracks, trajectory, run.calibration)
    page = table_page(f"{run.source.name}: {run.phenomenon.name}", trajectory, fit)
    first, *_, checks = page.sections
    segments = [(one.label, samples_text(one, trajectory), one.reason) for one in trajectory.segments]
    return replace(
        page,
        summary=f"{fit.model.summary}. {IN_PX}" if is_in_px(fit) else fit.model.summary,
        warnings=[as_sentence(note) for note in _warnings(run)],
        film=film_of(run, trajectory, {"before": ("the model", fit)} if fit.usable else {}),
        sections=[
            first,
            *budget_sections(fit),
            *identifiability_sections(fit),
            calibration_section(run.calibration, run.tracks),
            *([Section("Segments", words("segment", "samples", "reason"), segments)] if segments else []),
            *_geometry_sections(trajectory),
            Section(checks.title, lines=_checks(run, checks.lines)),
        ],
        origin=fit.origin,
        images=[
            PageImage("track", png_of(track), "Multiple exposure of the clip with the track, coloured by segment"),
            _fit_image(trajectory, fit),
        ],
    )


def table_page(title: str, trajectory: Trajectory, fit: FitResult) -> Page:
    """The page of a fit to a table: the motion with its fit, the numbers, what was left out."""
    statements, bars = residual_budget(trajectory, fit)
    symbols, names = symbols_of(fit.model), main_names(fit)[:MAX_VALUES] if fit.usable else []
    checks = [
        f"{int(trajectory.valid.sum())} of {trajectory.n} samples are measured, {fit.n} are used for the fit.",
        f"Residual: {residual_text(fit)}.",
        *map(as_sentence, fit.notes),
    ]
    return Page(
        title=title,
        headline=headline(fit),
        summary=fit.model.summary,
        values=[KeyValue(name, symbols.get(name, ""), fit.estimates[name]) for name in names],
        verdict=fit.verdict,
        statements=statements,
        bars=bars,
        charts=fit_charts(trajectory, fit),
        sections=[
            fit_section("Parameters", fit),
            *_geometry_sections(trajectory),
            Section("Checks", lines=checks),
        ],
        origin=fit.origin or trajectory.origin,
        images=[_fit_image(trajectory, fit)] if fit.usable else [],
    )


def _fit_image(trajectory: Trajectory, fit: FitResult) -> PageImage:
    return PageImage("fit", png_of(fit_figure(trajectory, fit)), "Measured motion and fit, with the residual below")


def _geometry_sections(trajectory: Trajectory) -> list[Section]:
    return [estimates_section("Intermediate quantities", trajectory.geometry)] if trajectory.geometry else []


def fit_charts(trajectory: Trajectory, fit: FitResult) -> list[Chart]:
    """The residual of each quantity and its motion with the model, then the inputs; without a fit the motion alone."""
    charts: list[Chart] = []
    for k in range(len(fit.model.observed)):
        if fit.usable:
            charts.append(residual_chart(fit, k, float(fit.noise[k]), name=f"residual-{k}"))
        charts.append(motion_chart(trajectory, [(fit, "the model", "before")], k))
    return [*charts, *input_charts(trajectory, fit)]


def headline(fit: FitResult) -> str:
    """The result in one sentence: the first number, and what is to be thought of it."""
    if not fit.usable:
        return as_sentence(f"no number could be measured: {fit.finding or fit.message}")
    verdict = fit.verdict
    name = next(iter(main_names(fit)), "")
    value = f"{name.replace('_', ' ')} is {with_error(fit.estimates[name])}" if name else "the motion is fitted"
    if not verdict.good:
        rest = ", but there is reason to doubt it."
    elif verdict.complete:
        rest = ", and the equation is complete as far as the data show."
    else:
        rest = "; the equation lacks something, and the error allows for it."
    word = value.split()[0]
    return f"{value[:1].upper() if word.isalpha() and len(word) > SYMBOL_LENGTH else value[:1]}{value[1:]}{rest}"


def _warnings(run: Run) -> list[str]:
    """Notes that say that something is wrong: not what was done, nor what the verdict says already."""
    done = _remarks(run)
    told = [note for note in run.notes if note not in done]
    return [note for note in told if not any(doubt.text in note for doubt in run.fit.doubts)]


def _remarks(run: Run) -> list[str]:
    """Notes on what was done or taken: how the vertical is known, and how the motion of the camera was undone."""
    treated = {str(body.origin["camera_motion"]) for body in run.tracks if "camera_motion" in body.origin}
    done = {vertical_note(run.calibration), *(f"the motion of the camera is {how}" for how in treated)}
    return [note for note in run.notes if note in done]


def _checks(run: Run, of_fit: Sequence[str]) -> list[str]:
    """The checks of the fit, with what was done to the clip among them."""
    counts, residual, *notes = of_fit
    checks = [
        counts,
        residual,
        f"Autocorrelation of the residual at lag 1: {run.fit.correlation:.2f}; the standard errors allow for it.",
        *notes,
        *map(as_sentence, _remarks(run)),
    ]
    if run.trajectory.smoothed is not None:
        nis = ", ".join(f"{value:.2f}" for value in run.trajectory.smoothed.nis)
        checks.append(f"Mean normalised innovation squared of the Kalman filter: {nis} (1 when it is consistent).")
    return checks
