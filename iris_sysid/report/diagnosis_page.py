"""The page that a diagnosis makes: the residual before and after, over time and over state, then the numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from iris_sysid import wording
from iris_sysid.diagnosis import Diagnosis
from iris_sysid.documents import checked, entries_of, fit_document, plain_origin, term_entry, write_document
from iris_sysid.files import check_writable
from iris_sysid.report import write_page
from iris_sysid.report.page import Page, Picture, Section, estimates_section, png_of
from iris_sysid.schemas import DiagnosisDocument, known_number
from iris_sysid.scores import Score
from iris_sysid.types import Array, FitResult, Trajectory

FILES = ("diagnosis.json", "residual.png", "state.png", "report.html")
BEFORE, AFTER = "#D55E00", "#0072B2"  # Okabe and Ito (2008)


def check_folder(folder: str | Path, *, overwrite: bool = False) -> Path:
    """Raise OutputError when :func:`write_diagnosis` could not write into the folder: to be asked before the work."""
    for name in FILES:
        check_writable(Path(folder) / name, overwrite=overwrite)
    return Path(folder)


def write_diagnosis(
    diagnosis: Diagnosis,
    trajectories: Trajectory | Sequence[Trajectory],
    folder: str | Path,
    *,
    overwrite: bool = False,
) -> Path:
    """Write ``diagnosis.json`` and ``report.html`` with its pictures into a folder.

    Parameters
    ----------
    diagnosis
        What :func:`iris_sysid.diagnose` returned.
    trajectories
        What was diagnosed, one clip or several.
    folder
        Made when it does not exist.
    overwrite
        Replace the files of an earlier diagnosis.

    Returns
    -------
    Path
        The page, written last.
    """
    folder = check_folder(folder, overwrite=overwrite)
    clips = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    write_document(diagnosis_document(diagnosis, clips), folder / "diagnosis.json", overwrite=overwrite)
    return write_page(diagnosis_page(diagnosis, clips), folder, overwrite=overwrite)


def diagnosis_document(diagnosis: Diagnosis, clips: Sequence[Trajectory]) -> DiagnosisDocument:
    """The content of diagnosis.json; ``clips`` as they were given to :func:`iris_sysid.diagnose`."""
    sizes = diagnosis.sizes
    added = [
        {"effect": effect.name, "parameters": entries_of({one.name: sizes[one.name] for one in effect.parameters})}
        for effect in diagnosis.added
    ]
    first, *others = [
        {"base": fit_document(base, clip), "final": fit_document(final, clip), "origin": plain_origin(clip.origin)}
        for base, final, clip in zip(diagnosis.bases, diagnosis.finals, clips, strict=True)
    ]
    ruled_out = [
        {"effect": one.effect, "parameter": one.parameter, "upper_95": known_number(one.upper_95), "unit": one.unit}
        for one in diagnosis.ruled_out
    ]
    errors = {
        when: {"fitted": known_number(errors.fitted), "heldout": known_number(errors.heldout)}
        for when, errors in (("before", diagnosis.before), ("after", diagnosis.after))
    }
    floor = {"noise_floor": known_number(diagnosis.noise_floor), "unit": diagnosis.unit}
    return checked(
        DiagnosisDocument,
        sentence=wording.diagnosis_sentence(diagnosis),
        **first,
        added=added,
        indistinguishable={name: list(others) for name, others in diagnosis.indistinguishable.items()},
        ruled_out=ruled_out,
        error={**errors, **floor},
        proposed=[term_entry(one) for one in diagnosis.proposed],
        notes=list(diagnosis.notes),
        further_clips=others,
    )


def diagnosis_page(diagnosis: Diagnosis, clips: Sequence[Trajectory]) -> Page:
    """Say what the model lacks; the pictures and values are those of the first clip."""
    base, final = diagnosis.base, diagnosis.final
    pictures = [Picture("residual", png_of(residual_figure(diagnosis)), "What is left over, before and after")]
    if base.model.second_order:
        caption = "Where in its motion the model is wrong: the residual's colour over place and speed, before and after"
        pictures.append(Picture("state", png_of(state_figure(diagnosis)), caption))
    sections = [
        Section("Error before and after", ("", "#fitted", "#held out", "#noise floor"), _error_rows(diagnosis)),
        estimates_section("After", wording.shown(final), final.model.equation),
        estimates_section("Before", wording.shown(base), base.model.equation),
        *_clips_section(diagnosis, clips),
        *_proposed_section(diagnosis),
        *(_round_section(k, scores) for k, scores in enumerate(diagnosis.rounds, start=1)),
        Section(
            "Ruled out",
            ("effect", "#at most, at 95 %"),
            [(one.effect, _limit_text(one)) for one in diagnosis.ruled_out],
        ),
    ]
    name = _name(clips[0]) + (f" and {len(clips) - 1} more" if len(clips) > 1 else "")
    return Page(
        title=f"{name}: what {base.model.name} lacks",
        headline=wording.diagnosis_sentence(diagnosis),
        summary=base.model.summary,
        pictures=pictures,
        sections=sections,
        origin=clips[0].origin,
    )


def _name(clip: Trajectory) -> str:
    return str(clip.origin.get("source", "trajectory"))


def _clips_section(diagnosis: Diagnosis, clips: Sequence[Trajectory]) -> list[Section]:
    """Residual and effects of each clip, when there are several."""
    if len(clips) < 2:
        return []
    names = [effect.parameters[0].name for effect in diagnosis.added]
    rows = [
        (
            _name(clip),
            *(
                f"{float(np.sqrt(np.nanmean(one.residual[one.used] ** 2))):.4g} {diagnosis.unit}"
                for one in (base, final)
            ),
            *(wording.with_error(final.estimates[name]) for name in names),
        )
        for clip, base, final in zip(clips, diagnosis.bases, diagnosis.finals, strict=True)
    ]
    return [Section("Clips", ("clip", "#residual before", "#residual after", *(f"#{name}" for name in names)), rows)]


def _error_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str, str]]:
    return [
        (when, f"{errors.fitted:.4g}", f"{errors.heldout:.4g}", f"{diagnosis.noise_floor:.4g} {diagnosis.unit}")
        for when, errors in (("before", diagnosis.before), ("after", diagnosis.after))
    ]


def _proposed_section(diagnosis: Diagnosis) -> list[Section]:
    """Terms for what is left, when there are any."""
    rows = [
        (f"{one.term} in {one.equation}", wording.with_error(one.coefficient), f"{100 * one.inclusion:.0f} %")
        for one in diagnosis.proposed
    ]
    columns = ("term that no effect is named after", "#coefficient, to first order", "#chosen in resampled data")
    return [Section("Proposed for what is left", columns, rows)] if rows else []


def _round_section(number: int, scores: tuple[Score, ...]) -> Section:
    rows = [
        (
            score.effect,
            f"{100 * score.gain:.2g} %",
            f"{score.size:.3g} ± {score.stderr:.2g} {score.unit}" if np.isfinite(score.size) else "cannot be seen here",
            f"{score.z:.1f}" if np.isfinite(score.z) else "",
        )
        for score in scores
    ]
    columns = ("effect", "#share of the residual it explains", "#size, to first order", "#in standard errors")
    return Section(f"Screen, round {number}", columns, rows)


def _limit_text(limit: object) -> str:
    upper, unit = getattr(limit, "upper_95", np.nan), getattr(limit, "unit", "")
    return f"{upper:.2g} {unit}" if np.isfinite(upper) else "cannot be seen here"


def residual_figure(diagnosis: Diagnosis) -> Figure:
    """The residual over time, before above and after below, with the noise as a band."""
    fits = [(diagnosis.base, BEFORE, "before"), (diagnosis.final, AFTER, "after")]
    figure = Figure(figsize=(9, 5), layout="constrained")
    for axes, (fit, colour, when) in zip(figure.subplots(2, 1, sharex=True, sharey=True), fits, strict=True):
        axes.axhspan(
            -2 * diagnosis.noise_floor, 2 * diagnosis.noise_floor, color="#009E73", alpha=0.2, label="± 2 noise"
        )
        for k in range(fit.residual.shape[1]):
            axes.plot(fit.t_s, fit.residual[:, k], ".", color=colour, markersize=2)
        axes.set_ylabel(f"{when} ({diagnosis.unit})")
        axes.legend(loc="upper right", framealpha=0.8)
    axes.set_xlabel("time (s)")
    return figure


def state_figure(diagnosis: Diagnosis) -> Figure:
    """The residual's sign and size over place and speed, before and after, on one colour scale."""
    fits = [(diagnosis.base, "before"), (diagnosis.final, "after")]
    largest = float(np.nanpercentile(np.abs(diagnosis.base.residual[:, 0]), 98))
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, (fit, when) in zip(panels, fits, strict=True):
        drawn = _draw_state(axes, fit, largest)
        axes.set(title=when, xlabel=f"{fit.model.observed[0].name} ({diagnosis.unit})")
    panels[0].set_ylabel(f"speed ({diagnosis.unit}/s)")
    figure.colorbar(drawn, ax=panels, label=f"residual ({diagnosis.unit})")
    return figure


def _draw_state(axes: Axes, fit: FitResult, largest: float) -> PathCollection:
    used = fit.used
    place = fit.predicted[used, 0]
    speed: Array = np.gradient(place, fit.t_s[used])
    return axes.scatter(place, speed, c=fit.residual[used, 0], s=4, cmap="RdBu_r", vmin=-largest, vmax=largest)
