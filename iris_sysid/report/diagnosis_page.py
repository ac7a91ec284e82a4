"""The page of a diagnosis: the parts of the residual, what is said of each, the numbers, before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from iris_sysid.diagnosis.planning.plan import Plan
from iris_sysid.io.components_json import components_entry, finding_entry
from iris_sysid.io.discovery_json import term_entry
from iris_sysid.io.json_documents import checked, entries_of, fit_document, plain_origin, write_document
from iris_sysid.io.schemas import DiagnosisDocument, VerdictEntry, known_number
from iris_sysid.report.clip_page import write_page
from iris_sysid.report.component_figure import component_caption, component_figure
from iris_sysid.report.component_table import parts_sections
from iris_sysid.report.diagnosis_files import check_folder
from iris_sysid.report.diagnosis_text import changed_parameters, diagnosis_sentence, diagnosis_sentences
from iris_sysid.report.figures import MOST_POINTS, outline
from iris_sysid.report.page import Page, PageImage, Section, estimates_section, numbers, png_of, words
from iris_sysid.report.plan_figure import plan_figure
from iris_sysid.report.plan_text import advice, plan_document, plan_rows
from iris_sysid.report.text import (
    as_sentence,
    fit_headline,
    interval_text,
    probability_text,
    shown_estimates,
    with_error,
    with_unit,
)
from iris_sysid.types import Array, Diagnosis, EffectCause, FitResult, Limit, Score, Trajectory

MARKERS = ".x+1"  # one for each observed quantity, in their order
WITHOUT, WITH = "without the added effects", "with the added effects"
ENLARGED_BELOW = 0.1  # ratio of the residuals below which the smaller one gets its own, enlarged panel
BEFORE, AFTER = "#D55E00", "#0072B2"  # Okabe and Ito (2008)


def write_diagnosis(
    diagnosis: Diagnosis,
    trajectories: Trajectory | Sequence[Trajectory],
    folder: str | Path,
    *,
    planned: Plan | None = None,
    overwrite: bool = False,
) -> Path:
    """Write ``diagnosis.json`` and ``report.html`` with its images into a folder, and ``plan.json`` where there is one.

    Parameters
    ----------
    diagnosis
        What :func:`iris_sysid.diagnose` returned.
    trajectories
        The diagnosed clips, one or several.
    folder
        Created when it does not exist.
    planned
        What :func:`iris_sysid.plan` says of these clips, for the page.
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
    if planned is not None:
        write_document(plan_document(planned), folder / "plan.json", overwrite=overwrite)
    return write_page(diagnosis_page(diagnosis, clips, planned), folder, overwrite=overwrite)


def diagnosis_document(diagnosis: Diagnosis, clips: Sequence[Trajectory]) -> DiagnosisDocument:
    """The content of diagnosis.json; ``clips`` as they were given to :func:`iris_sysid.diagnose`."""
    sizes = diagnosis.sizes
    added = [
        {
            "effect": effect.name,
            "parameters": entries_of({parameter.name: sizes[parameter.name] for parameter in effect.parameters}),
        }
        for effect in diagnosis.added
    ]
    first, *further = [
        {"base": fit_document(base, clip), "final": fit_document(final, clip), "origin": plain_origin(clip.origin)}
        for base, final, clip in zip(diagnosis.bases, diagnosis.finals, clips, strict=True)
    ]
    limits = [{**asdict(limit), "upper_95": known_number(limit.upper_95)} for limit in diagnosis.ruled_out]
    errors = {
        when: {name: known_number(error) for name, error in asdict(errors).items()}
        for when, errors in (("before", diagnosis.before), ("after", diagnosis.after))
    }
    return checked(
        DiagnosisDocument,
        sentence=diagnosis_sentence(diagnosis),
        components=components_entry(diagnosis.components),
        remaining=components_entry(diagnosis.remaining),
        findings=[finding_entry(finding) for finding in diagnosis.findings],
        nuisances=[effect.name for effect in diagnosis.nuisances],
        verdict=VerdictEntry.of(diagnosis.verdict),
        **first,
        added=added,
        indistinguishable={name: list(others) for name, others in diagnosis.indistinguishable.items()},
        probabilities={name: dict(shares) for name, shares in diagnosis.probabilities.items()},
        causes={name: dict(shares) for name, shares in diagnosis.causes.items()},
        ruled_out=limits,
        **errors,
        noise_floor=known_number(diagnosis.noise_floor),
        unit=diagnosis.unit,
        proposed=[term_entry(term) for term in diagnosis.proposed],
        notes=[note.text for note in diagnosis.notes],
        further_clips=further,
    )


def diagnosis_page(diagnosis: Diagnosis, clips: Sequence[Trajectory], planned: Plan | None = None) -> Page:
    """The page of a diagnosis, with what is ``planned`` next; images and fitted values are those of the first clip."""
    model, (headline, *statements) = diagnosis.base.model, diagnosis_sentences(diagnosis)
    name = _name(clips[0]) + (f" and {len(clips) - 1} more" if len(clips) > 1 else "")
    return Page(
        title=f"{name}: diagnosis of the model {model.name}",
        headline=headline,
        statements=statements,
        verdict=diagnosis.verdict,
        summary=model.summary,
        first=[
            *_component_images(diagnosis),
            *parts_sections(diagnosis),
            _values_section(diagnosis),
            _error_section(diagnosis),
        ],
        images=[*_images(diagnosis), *_plan_images(planned)],
        sections=[
            *_added_section(diagnosis),
            *_notes_section(diagnosis),
            *_plan_section(planned),
            *_suggested_section(diagnosis),
            *_changed_section(diagnosis),
            *_fit_sections(diagnosis),
            *_clips_section(diagnosis, clips),
            _limits_section(diagnosis),
            *(_score_section(number, scores) for number, scores in enumerate(diagnosis.rounds, start=1)),
        ],
        origin=clips[0].origin,
    )


def _component_images(diagnosis: Diagnosis) -> list[PageImage]:
    components = diagnosis.components
    if components is None or not components.parts:
        return []
    remaining = diagnosis.remaining if diagnosis.added else None
    figure = component_figure(components, remaining)
    return [PageImage("components", png_of(figure), component_caption(components, added=remaining is not None))]


def _values_section(diagnosis: Diagnosis) -> Section:
    """The values with the effects, each with its error."""
    title = "Values with the added effects" if diagnosis.added else "Values"
    return Section(title, lines=[fit_headline(diagnosis.final)])


def _images(diagnosis: Diagnosis) -> list[PageImage]:
    caption = "Residual over time" + (" without (top) and with (bottom) the added effects" if diagnosis.added else "")
    images = [PageImage("residual", png_of(residual_figure(diagnosis)), caption)]
    if diagnosis.base.model.second_order:
        caption = "Residual in the phase plane; its sign and size as colour"
        caption += ", without (left) and with (right) the added effects" if diagnosis.added else ""
        images.append(PageImage("state", png_of(state_figure(diagnosis)), caption))
    return images


def _plan_images(planned: Plan | None) -> list[PageImage]:
    if planned is None or not planned.best.differences:
        return []
    caption = (
        "What the names in question predict, after a refit of all values to the first of them: in today's set-up "
        "(left) and in the best one tried (right); above each, the chance that such a clip leaves a single name"
    )
    return [PageImage("plan", png_of(plan_figure(planned)), caption)]


def _plan_section(planned: Plan | None) -> list[Section]:
    """The changes of the set-up, best first."""
    if planned is None:
        return []
    rows = plan_rows(planned)
    return [Section("What to film next", words(*rows[0]), [tuple(row.values()) for row in rows], list(advice(planned)))]


def _added_section(diagnosis: Diagnosis) -> list[Section]:
    """Model-averaged sizes of the added effects over all clips, and the effects indistinguishable from them."""
    rows = [
        (
            effect.name,
            parameter.name,
            with_error(diagnosis.sizes[parameter.name]),
            interval_text(diagnosis.sizes[parameter.name]),
            _shares(diagnosis.probabilities.get(effect.name, {})),
            _shares(diagnosis.causes.get(effect.name, {})),
        )
        for effect in diagnosis.added
        for parameter in effect.parameters
        if diagnosis.sizes[parameter.name].stderr > 0
    ]
    sizes = numbers("value ± standard error", "95 % interval (model-averaged)")
    columns = (*words("effect", "parameter"), *sizes, *words("this or what explains the data as well", "cause"))
    return [Section("Missing effects", columns, rows)] if rows else []


def _shares(probabilities: Mapping[str, float] | Mapping[EffectCause, float]) -> str:
    """Names with their probabilities in percent."""
    return ", ".join(f"{name} {probability_text(probability)}" for name, probability in probabilities.items())


def _notes_section(diagnosis: Diagnosis) -> list[Section]:
    lines = [as_sentence(note.text) for note in diagnosis.notes]
    return [Section("Notes", lines=lines)] if lines else []


def _fits(diagnosis: Diagnosis) -> list[tuple[FitResult, str]]:
    """The first clip's fit with the effects and without; a single fit where no effect was added."""
    if not diagnosis.added:
        return [(diagnosis.base, "")]
    return [(diagnosis.final, WITH), (diagnosis.base, WITHOUT)]


def _fit_sections(diagnosis: Diagnosis) -> list[Section]:
    assuming = {WITH: f"Fit {WITH}, assuming no further missing effect", WITHOUT: f"Fit {WITHOUT}", "": "Fit"}
    return [
        estimates_section(assuming[which], shown_estimates(fit), fit.model.equation) for fit, which in _fits(diagnosis)
    ]


def _changed_section(diagnosis: Diagnosis) -> list[Section]:
    """Parameters of the model that change when the effects are added."""
    rows = [(name, with_error(base), with_error(final)) for name, base, final in changed_parameters(diagnosis)]
    columns = (*words("parameter"), *numbers(WITHOUT, WITH))
    return [Section("Parameters that change", columns, rows)] if rows else []


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
            *(_error_text(_rms(fit), diagnosis.unit) for fit in (base, final)),
            *(with_error(final.estimates[name]) for name in names),
        )
        for clip, base, final in zip(clips, diagnosis.bases, diagnosis.finals, strict=True)
    ]
    return [Section("Clips", (*words("clip"), *numbers("residual before", "residual after", *names)), rows)]


def _rms(fit: FitResult) -> float:
    return float(np.sqrt(np.nanmean(fit.residual[fit.used] ** 2)))


def _error_section(diagnosis: Diagnosis) -> Section:
    rows = [
        (
            when,
            *(_error_text(error, diagnosis.unit) for error in (errors.fitted, errors.heldout, diagnosis.noise_floor)),
        )
        for when, errors in (("before", diagnosis.before), ("after", diagnosis.after))
    ]
    columns = (*words(""), *numbers("fitted samples", "held-out samples", "noise"))
    if diagnosis.added:
        return Section("Error before and after", columns, rows)
    return Section("Error", columns[1:], [row[1:] for row in rows[:1]])


def _error_text(error: float, unit: str) -> str:
    return with_unit(f"{error:.4g}", unit) if np.isfinite(error) else "no samples to spare"


def _suggested_section(diagnosis: Diagnosis) -> list[Section]:
    """Terms that the remaining residual suggests, when there are any."""
    rows = [
        (f"{term.term} in {term.equation}", with_error(term.coefficient), f"{100 * term.inclusion:.0f} %")
        for term in diagnosis.proposed
    ]
    columns = (
        *words("term without a named effect"),
        *numbers("coefficient, to first order", "selected in resampled data"),
    )
    return [Section("Suggested terms", columns, rows)] if rows else []


def _limits_section(diagnosis: Diagnosis) -> Section:
    rows = [(limit.effect, _limit_text(limit)) for limit in diagnosis.ruled_out]
    return Section("Upper limits on other effects", (*words("effect"), *numbers("largest size, at 95 %")), rows)


def _score_section(number: int, scores: tuple[Score, ...]) -> Section:
    rows = [
        (
            score.effect,
            f"{100 * score.gain:.3g} %",
            _size_text(score),
            f"{score.z:.1f}" if np.isfinite(score.z) else "",
        )
        for score in scores
    ]
    columns = (
        *words("effect"),
        *numbers("of the residual explained", "size, to first order", "size / standard error"),
    )
    return Section(f"Score tests, round {number}", columns, rows, folded=True)


def _size_text(score: Score) -> str:
    if not np.isfinite(score.size):
        return "not identifiable"
    return with_unit(f"{score.size:.3g} ± {score.stderr:.2g}", score.unit)


def _limit_text(limit: Limit) -> str:
    return with_unit(f"{limit.upper_95:.2g}", limit.unit) if np.isfinite(limit.upper_95) else "not identifiable"


def residual_figure(diagnosis: Diagnosis) -> Figure:
    """The residual over time, without the effects (top) and with them (bottom); a band shows the noise.

    The last panel enlarges a residual that the effects reduce strongly.
    """
    fits = [(fit, which, False) for fit, which in _fits(diagnosis)[::-1]]
    if _largest_residual(diagnosis.final) < ENLARGED_BELOW * _largest_residual(diagnosis.base):
        fits.append((diagnosis.final, f"{WITH}, enlarged", True))
    figure = Figure(figsize=(9, 1 + 2 * len(fits)), layout="constrained")
    panels = figure.subplots(len(fits), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (fit, which, enlarged) in zip(panels, fits, strict=True):
        _draw_residual(axes, fit, AFTER if fit is diagnosis.final and diagnosis.added else BEFORE, diagnosis)
        axes.set_title(which, loc="left", fontsize=10)
        if not enlarged and axes is not panels[0]:
            axes.set_ylim(panels[0].get_ylim())
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=1 + len(MARKERS), frameon=False)
    panels[-1].set_xlabel("time (s)")
    return figure


def _largest_residual(fit: FitResult) -> float:
    return float(np.nanmax(np.abs(fit.residual)))


def _draw_residual(axes: Axes, fit: FitResult, colour: str, diagnosis: Diagnosis) -> None:
    noise, size = diagnosis.noise_floor, _size_of_dots(fit)
    axes.axhspan(-2 * noise, 2 * noise, color="#009E73", alpha=0.2, label="± 2 noise")
    for k, quantity in enumerate(fit.model.observed):
        name = quantity.name if len(fit.model.observed) > 1 else None
        shown, marker = outline(fit.residual[:, k]), MARKERS[k % len(MARKERS)]
        axes.plot(fit.t_s[shown], fit.residual[shown, k], marker, color=colour, markersize=size, label=name)
    axes.set_ylabel(f"residual ({diagnosis.unit})")
    axes.margins(x=0.01)


def state_figure(diagnosis: Diagnosis) -> Figure:
    """The residual's sign and size as colour in the phase plane, without and with the effects, on one scale."""
    fits = _fits(diagnosis)[::-1]
    k = _most_varied(diagnosis.base)
    largest = float(np.nanpercentile(np.abs(diagnosis.base.residual[:, k]), 98))
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, len(fits), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (fit, which) in zip(panels, fits, strict=True):
        points = _draw_state(axes, fit, k, largest)
        axes.set(xlabel=f"{fit.model.observed[k].name} ({diagnosis.unit})")
        axes.set_title(which, loc="left", fontsize=10)
    panels[0].set_ylabel(f"speed ({diagnosis.unit}/s)")
    figure.colorbar(points, ax=panels, label=f"residual ({diagnosis.unit})")
    return figure


def _size_of_dots(fit: FitResult) -> float:
    """Points, drawn larger where there are few samples."""
    return float(np.clip(60.0 / np.sqrt(max(fit.n, 1)), 2.0, 6.0))


def _speed(fit: FitResult, k: int) -> Array:
    """Rate of change (n,) of the k-th quantity at the samples used."""
    return np.asarray(np.gradient(fit.predicted[fit.used, k], fit.t_s[fit.used]))


def _most_varied(fit: FitResult) -> int:
    """The quantity whose speed changes most: a throw's height, not its horizontal position."""
    return int(np.argmax([np.ptp(_speed(fit, k)) for k in range(fit.predicted.shape[1])]))


def _draw_state(axes: Axes, fit: FitResult, k: int, largest: float) -> PathCollection:
    some = slice(None, None, -(-fit.n // MOST_POINTS))
    position, colour = fit.predicted[fit.used, k][some], fit.residual[fit.used, k][some]
    size, speed = _size_of_dots(fit) ** 2, _speed(fit, k)[some]
    return axes.scatter(position, speed, s=size, c=colour, cmap="RdBu_r", vmin=-largest, vmax=largest)
