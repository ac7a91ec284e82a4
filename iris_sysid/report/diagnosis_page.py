"""The page that a diagnosis makes: the residual before and after, over time and over state, then the numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from iris_sysid.diagnosis.diagnose import Diagnosis, Limit
from iris_sysid.diagnosis.score_test import Score
from iris_sysid.io.files import check_writable
from iris_sysid.io.json_documents import checked, entries_of, fit_document, plain_origin, term_entry, write_document
from iris_sysid.io.schemas import DiagnosisDocument, known_number
from iris_sysid.report import text
from iris_sysid.report.clip_page import write_page
from iris_sysid.report.page import Page, Picture, Section, estimates_section, png_of
from iris_sysid.types import Array, FitResult, Trajectory

FILES = ("diagnosis.json", "residual.png", "state.png", "report.html")
MARKERS = ".x+1"  # of the observed quantities, in their order
TITLES = {"the fit": "The fit", "before": "Before", "after": "After, if nothing else is lacking"}
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
        sentence=text.diagnosis_sentence(diagnosis),
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
    base = diagnosis.base
    when = ", before and after" if diagnosis.added else ""
    pictures = [Picture("residual", png_of(residual_figure(diagnosis)), f"What is left over{when}")]
    if base.model.second_order:
        caption = f"Where in its motion the model is wrong: the residual's colour over place and speed{when}"
        pictures.append(Picture("state", png_of(state_figure(diagnosis)), caption))
    sections = [
        Section("Error before and after", ("", "#fitted", "#held out", "#noise floor"), _error_rows(diagnosis)),
        *_added_section(diagnosis),
        *(estimates_section(TITLES[one], text.shown(fit), fit.model.equation) for fit, one in _fits(diagnosis)),
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
        headline=text.diagnosis_sentence(diagnosis),
        summary=base.model.summary,
        pictures=pictures,
        sections=sections,
        origin=clips[0].origin,
    )


def _added_section(diagnosis: Diagnosis) -> list[Section]:
    """Sizes of what was added, over all clips, with one more effect allowed for that the data do not show."""
    rows = [
        (
            effect.name,
            parameter.name,
            text.with_error(size),
            text.interval(size),
            ", ".join(diagnosis.indistinguishable[effect.name]),
        )
        for effect in diagnosis.added
        for parameter, size in ((one, diagnosis.sizes[one.name]) for one in effect.parameters)
        if size.stderr > 0
    ]
    columns = ("effect", "value", "#± standard error", "#95 % interval, one more effect allowed for", "or as well")
    return [Section("Added", columns, rows)] if rows else []


def _fits(diagnosis: Diagnosis) -> list[tuple[FitResult, str]]:
    """The first clip's fit with the effects, and without; the only one where none was added."""
    if not diagnosis.added:
        return [(diagnosis.base, "the fit")]
    return [(diagnosis.final, "after"), (diagnosis.base, "before")]


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
            *(text.with_error(final.estimates[name]) for name in names),
        )
        for clip, base, final in zip(clips, diagnosis.bases, diagnosis.finals, strict=True)
    ]
    return [Section("Clips", ("clip", "#residual before", "#residual after", *(f"#{name}" for name in names)), rows)]


def _error_rows(diagnosis: Diagnosis) -> list[tuple[str, str, str, str]]:
    return [
        (when, f"{errors.fitted:.4g}", _heldout_text(errors.heldout), f"{diagnosis.noise_floor:.4g} {diagnosis.unit}")
        for when, errors in (("before", diagnosis.before), ("after", diagnosis.after))
    ]


def _heldout_text(error: float) -> str:
    return f"{error:.4g}" if np.isfinite(error) else "nothing could be held out"


def _proposed_section(diagnosis: Diagnosis) -> list[Section]:
    """Terms for what is left, when there are any."""
    rows = [
        (f"{one.term} in {one.equation}", text.with_error(one.coefficient), f"{100 * one.inclusion:.0f} %")
        for one in diagnosis.proposed
    ]
    columns = ("term that no effect is named after", "#coefficient, to first order", "#chosen in resampled data")
    return [Section("Proposed for what is left", columns, rows)] if rows else []


def _round_section(number: int, scores: tuple[Score, ...]) -> Section:
    rows = [
        (
            score.effect,
            f"{100 * score.gain:.3g} %",
            _size_text(score),
            f"{score.z:.1f}" if np.isfinite(score.z) else "",
        )
        for score in scores
    ]
    columns = ("effect", "#share of the residual it explains", "#size, to first order", "#in standard errors")
    return Section(f"Screen, round {number}", columns, rows)


def _size_text(score: Score) -> str:
    if not np.isfinite(score.size):
        return "cannot be seen here"
    return text.in_unit(f"{score.size:.3g} ± {score.stderr:.2g}", score.unit)


def _limit_text(limit: Limit) -> str:
    return text.in_unit(f"{limit.upper_95:.2g}", limit.unit) if np.isfinite(limit.upper_95) else "cannot be seen here"


def residual_figure(diagnosis: Diagnosis) -> Figure:
    """The residual over time, before above and after below, with the noise as a band."""
    fits = _fits(diagnosis)[::-1]
    figure = Figure(figsize=(9, 1 + 2 * len(fits)), layout="constrained")
    panels = figure.subplots(len(fits), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (fit, when), colour in zip(panels, fits, (BEFORE, AFTER), strict=False):
        axes.axhspan(
            -2 * diagnosis.noise_floor, 2 * diagnosis.noise_floor, color="#009E73", alpha=0.2, label="± 2 noise"
        )
        for k in range(fit.residual.shape[1]):
            name = fit.model.observed[k].name if fit.residual.shape[1] > 1 else None
            marker, size = MARKERS[k % len(MARKERS)], _size_of_dots(fit)
            axes.plot(fit.t_s, fit.residual[:, k], marker, color=colour, markersize=size, label=name)
        axes.set_ylabel(f"{when if diagnosis.added else 'residual'} ({diagnosis.unit})")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    axes.set_xlabel("time (s)")
    return figure


def state_figure(diagnosis: Diagnosis) -> Figure:
    """The residual's sign and size over place and speed, before and after, on one colour scale."""
    fits = _fits(diagnosis)[::-1]
    k = _most_varied(diagnosis.base)
    largest = float(np.nanpercentile(np.abs(diagnosis.base.residual[:, k]), 98))
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, len(fits), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (fit, when) in zip(panels, fits, strict=True):
        drawn = _draw_state(axes, fit, k, largest)
        axes.set(title=when if diagnosis.added else "", xlabel=f"{fit.model.observed[k].name} ({diagnosis.unit})")
    panels[0].set_ylabel(f"speed ({diagnosis.unit}/s)")
    figure.colorbar(drawn, ax=panels, label=f"residual ({diagnosis.unit})")
    return figure


def _size_of_dots(fit: FitResult) -> float:
    """Points; few samples are drawn larger, so that they are seen."""
    return float(np.clip(60.0 / np.sqrt(max(fit.n, 1)), 2.0, 6.0))


def _speed(fit: FitResult, k: int) -> Array:
    """How fast (n,) the k-th quantity changes at the samples used."""
    return np.asarray(np.gradient(fit.predicted[fit.used, k], fit.t_s[fit.used]))


def _most_varied(fit: FitResult) -> int:
    """The quantity whose speed changes most: a throw's height, not its way along."""
    return int(np.argmax([np.ptp(_speed(fit, k)) for k in range(fit.predicted.shape[1])]))


def _draw_state(axes: Axes, fit: FitResult, k: int, largest: float) -> PathCollection:
    place, colour = fit.predicted[fit.used, k], fit.residual[fit.used, k]
    size = _size_of_dots(fit) ** 2
    return axes.scatter(place, _speed(fit, k), s=size, c=colour, cmap="RdBu_r", vmin=-largest, vmax=largest)
