"""The page of a diagnosis: what is missing, the clip before and after, the parts of the residual; tables last."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from iris_sysid.diagnosis.planning.plan import Plan
from iris_sysid.io.discovery_json import term_entry
from iris_sysid.io.files import check_folder
from iris_sysid.io.json_documents import (
    checked,
    entries_of,
    fit_document,
    plain_origin,
    validation_entry,
    write_document,
)
from iris_sysid.io.schemas import DiagnosisDocument, ValidationEntry
from iris_sysid.report.clip_page import MAX_VALUES, write_page
from iris_sysid.report.component_figure import component_caption, component_figure
from iris_sysid.report.component_table import parts_sections
from iris_sysid.report.diagnosis_charts import component_bars, component_charts, residual_charts, state_image
from iris_sysid.report.diagnosis_files import FILES
from iris_sysid.report.diagnosis_tables import WITH, WITHOUT, diagnosis_sections
from iris_sysid.report.diagnosis_text import diagnosis_sentence, diagnosis_sentences, finding_sentence, spoken
from iris_sysid.report.film import Film, Filmed, film_of
from iris_sysid.report.page import KeyValue, Page, PageImage, Section, png_of, symbols_of, words
from iris_sysid.report.plan_figure import plan_figure
from iris_sysid.report.plan_text import advice, plan_document, plan_rows
from iris_sysid.report.plots import figure_of
from iris_sysid.report.text import as_sentence, main_names, with_error
from iris_sysid.report.validation_figure import CAPTION, ValidatedDiagnosis, validation_figure
from iris_sysid.types import Diagnosis, FindingWord, Trajectory

BEST_FIRST: tuple[FindingWord, ...] = ("named", "group", "located", "open")


def write_diagnosis(
    diagnosis: Diagnosis,
    trajectories: Trajectory | Sequence[Trajectory],
    folder: str | Path,
    *,
    planned: Plan | None = None,
    footage: Filmed | None = None,
    validated: ValidatedDiagnosis | None = None,
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
    footage
        The :class:`iris_sysid.Run` of the first clip: the page then shows it with the model before and after.
    validated
        How the models do on a record that was not used, for both files.
    overwrite
        Replace the files of an earlier diagnosis.

    Returns
    -------
    Path
        The page, written last.
    """
    folder = check_folder(folder, FILES, overwrite=overwrite)
    clips = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    write_document(diagnosis_document(diagnosis, clips, validated), folder / "diagnosis.json", overwrite=overwrite)
    if planned is not None:
        write_document(plan_document(planned), folder / "plan.json", overwrite=overwrite)
    return write_page(diagnosis_page(diagnosis, clips, planned, footage, validated), folder, overwrite=overwrite)


def diagnosis_document(
    diagnosis: Diagnosis, clips: Sequence[Trajectory], validated: ValidatedDiagnosis | None = None
) -> DiagnosisDocument:
    """The content of diagnosis.json; arguments as for :func:`write_diagnosis`."""
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
    return checked(
        DiagnosisDocument,
        sentence=diagnosis_sentence(diagnosis),
        components=diagnosis.components,
        remaining=diagnosis.remaining,
        findings=diagnosis.findings,
        nuisances=[effect.name for effect in diagnosis.nuisances],
        verdict=diagnosis.verdict,
        **first,
        added=added,
        indistinguishable=diagnosis.indistinguishable,
        probabilities=diagnosis.probabilities,
        causes=diagnosis.causes,
        ruled_out=diagnosis.ruled_out,
        before=diagnosis.before,
        after=diagnosis.after,
        noise_floor=diagnosis.noise_floor,
        unit=diagnosis.unit,
        proposed=[term_entry(term) for term in diagnosis.proposed],
        notes=[note.text for note in diagnosis.notes],
        further_clips=further,
        **_validation_entries(validated),
    )


def diagnosis_page(
    diagnosis: Diagnosis,
    clips: Sequence[Trajectory],
    planned: Plan | None = None,
    footage: Filmed | None = None,
    validated: ValidatedDiagnosis | None = None,
) -> Page:
    """The page of a diagnosis; charts, film and values are those of the first clip.

    Parameters
    ----------
    diagnosis, clips
        As for :func:`write_diagnosis`.
    planned
        What to film next.
    footage
        The first clip with its tracks.
    validated
        How the models do on a record that was not used.
    """
    model, sentences = diagnosis.base.model, diagnosis_sentences(diagnosis)
    name = str(clips[0].origin.get("source", "trajectory")) + (f" and {len(clips) - 1} more" if len(clips) > 1 else "")
    first = headline(diagnosis)
    state = state_image(diagnosis)
    plan_images, validation_images = _plan_images(planned), _validation_images(validated)
    return Page(
        title=f"{name}: diagnosis of the model {model.name}",
        headline=first,
        summary=model.summary,
        values=_values(diagnosis),
        verdict=diagnosis.verdict,
        film=_film(diagnosis, clips[0], footage),
        statements=[sentence for sentence in sentences if sentence != first],
        bars=component_bars(diagnosis),
        charts=[*component_charts(diagnosis), *residual_charts(diagnosis, clips[0])],
        sections=[
            *_plan_section(planned, plan_images),
            *_validation_section(validated, validation_images),
            *parts_sections(diagnosis),
            *diagnosis_sections(diagnosis, clips),
            *([Section("Residual in the phase plane", image=state)] if state is not None else []),
        ],
        origin=clips[0].origin,
        images=[
            *_component_images(diagnosis),
            PageImage("residual", png_of(figure_of(diagnosis)), "Motion and residual over time"),
            *([state] if state is not None else []),
            *plan_images,
            *validation_images,
        ],
    )


def headline(diagnosis: Diagnosis) -> str:
    """The answer in one sentence: the effects that are named, else the finding on the residual's largest part."""
    named = {finding.effects[0] for finding in diagnosis.findings if finding.word == "named"}
    missing = [effect for effect in diagnosis.added if effect.name in named]
    if missing:
        sizes = [with_error(diagnosis.sizes[effect.parameters[0].name]) for effect in missing]
        lacks = " and ".join(f"{spoken(one.name)} ({size})" for one, size in zip(missing, sizes, strict=True))
        return as_sentence(f"the equation lacks {lacks}{f': {missing[0].summary}' if len(missing) == 1 else ''}")
    findings = sorted(diagnosis.findings, key=lambda finding: BEST_FIRST.index(finding.word))
    if diagnosis.components is not None and findings:
        return finding_sentence(findings[0], diagnosis)
    return diagnosis_sentences(diagnosis)[0]


def _values(diagnosis: Diagnosis) -> list[KeyValue]:
    """The size of each added effect, then the values of the model with them."""
    final = diagnosis.final
    if not final.usable:
        return []
    sizes = [effect.parameters[0] for effect in diagnosis.added]
    effects = [KeyValue(size.name, size.symbol, diagnosis.sizes[size.name]) for size in sizes]
    symbols, seen = symbols_of(final.model), {size.name for size in sizes}
    values = [KeyValue(name, symbols.get(name, ""), final.estimates[name]) for name in main_names(final)]
    return [*effects, *(value for value in values if value.name not in seen)][:MAX_VALUES]


def _film(diagnosis: Diagnosis, clip: Trajectory, footage: Filmed | None) -> Film | None:
    if footage is None:
        return None
    models = {"before": ("the model", diagnosis.base)}
    if diagnosis.added:
        models = {"before": (f"model {WITHOUT}", diagnosis.base), "after": (f"model {WITH}", diagnosis.final)}
    return film_of(footage, clip, models)


def _component_images(diagnosis: Diagnosis) -> list[PageImage]:
    components = diagnosis.components
    if components is None or not components.parts:
        return []
    remaining = diagnosis.remaining if diagnosis.added else None
    figure = component_figure(components, remaining)
    return [PageImage("components", png_of(figure), component_caption(components, added=remaining is not None))]


def _validation_entries(validated: ValidatedDiagnosis | None) -> dict[str, ValidationEntry]:
    if validated is None:
        return {}
    return {
        "validation": validation_entry(validated.after, validated.record),
        "validation_before": validation_entry(validated.before, validated.record),
    }


def _validation_images(validated: ValidatedDiagnosis | None) -> list[PageImage]:
    return [] if validated is None else [PageImage("validation", png_of(validation_figure(validated.after)), CAPTION)]


def _validation_section(validated: ValidatedDiagnosis | None, images: Sequence[PageImage]) -> list[Section]:
    """The simulation errors on the validation record, without the effects, with them, and of a linear model."""
    if validated is None:
        return []
    same = validated.before is validated.after
    rows = [(f"model {WITHOUT}", validated.before), *([] if same else [(f"model {WITH}", validated.after)])]
    found = [(name, each.rms, each.fit_percent) for name, each in rows]
    linear = validated.after.linear
    if linear is not None:
        found.append((f"linear model of order {linear.order}", linear.rms, linear.fit_percent))
    cells = [
        (name, quantity.name, f"{rms[k]:.4g} {quantity.unit}", f"{share[k]:.2f} %")
        for k, quantity in enumerate(validated.after.quantities)
        for name, rms, share in found
    ]
    header = words("model", "quantity", "simulation error", "fit")
    return [Section("Validation on a record that was not used", header, cells, [], image=next(iter(images), None))]


def _plan_images(planned: Plan | None) -> list[PageImage]:
    if planned is None or not planned.best.differences:
        return []
    caption = (
        "What the names in question predict, after a refit of all values to the first of them: in today's set-up "
        "(left) and in the best one tried (right); above each, the chance that such a clip leaves a single name"
    )
    return [PageImage("plan", png_of(plan_figure(planned)), caption)]


def _plan_section(planned: Plan | None, images: Sequence[PageImage]) -> list[Section]:
    """The changes of the set-up, best first."""
    if planned is None:
        return []
    rows = plan_rows(planned)
    cells = [tuple(row.values()) for row in rows]
    image = next(iter(images), None)
    return [Section("What to film next", words(*rows[0]), cells, list(advice(planned)), image=image)]
