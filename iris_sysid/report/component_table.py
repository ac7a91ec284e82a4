"""The parts of a residual as a table: the share of each, its size, and the finding on it."""

from __future__ import annotations

import math

from iris_sysid.report.diagnosis_text import size_text
from iris_sysid.report.page import Section, numbers, words
from iris_sysid.report.text import as_sentence, percent, probability_text, with_error
from iris_sysid.types import KIND_NAMES, SIDE_NAMES, Component, Components, Diagnosis, Finding, FindingWord

SAID: dict[FindingWord, str] = {"named": "named", "group": "group", "located": "no formula fits", "open": "open"}


def parts_sections(diagnosis: Diagnosis) -> list[Section]:
    """The parts of the residual with the finding on each; then those that remain with the added effects."""
    sections = []
    if diagnosis.components is not None:
        lines = [_sides(diagnosis.components), *_open(diagnosis)]
        sections.append(_table("Parts of the residual", diagnosis.components, diagnosis.findings, lines))
    if diagnosis.remaining is not None and diagnosis.added:
        sections.append(_table("Parts of the residual with the added effects", diagnosis.remaining, (), ()))
    return sections


def _table(title: str, components: Components, findings: tuple[Finding, ...], lines: list[str] | tuple[()]) -> Section:
    of_part = {finding.component: finding for finding in findings if finding.component is not None}
    rows = [_row(part, components.unit, of_part.get(part.kind)) for part in components.parts]
    noise_rms = size_text(components.noise_rms, components.unit)
    rows.append(("noise", percent(components.noise_share), "", noise_rms, "", "", ""))
    columns = (*words("part"), *numbers("share", "range", "size", "probability"), *words("or instead", "finding"))
    filled = [k for k in range(len(columns)) if any(row[k] for row in rows)]
    return Section(title, [columns[k] for k in filled], [[row[k] for k in filled] for row in rows], lines)


def _row(part: Component, unit: str, finding: Finding | None) -> tuple[str, ...]:
    where = f" at {with_error(part.at)}" if part.at is not None else ""
    low, high = part.share_range
    return (
        f"{KIND_NAMES[part.kind]}{where}",
        percent(part.share),
        f"{100 * low:.0f} to {min(100 * high, 100):.0f} %",
        size_text(part.rms, unit),
        probability_text(part.probability),
        ", ".join(KIND_NAMES[kind] for kind in part.similar),
        _said(finding),
    )


def _said(finding: Finding | None) -> str:
    if finding is None:
        return ""
    names = " or ".join(finding.effects)
    removed = f"removes {percent(finding.share)} in samples held out" if math.isfinite(finding.share) else ""
    head = ": ".join(filter(None, [SAID[finding.word], names]))
    return "; ".join(filter(None, [head, removed, finding.reason]))


def _open(diagnosis: Diagnosis) -> list[str]:
    """The finding that is on no part in particular."""
    return [
        as_sentence(f"open: {finding.reason}" if finding.reason else "something is missing; the data do not say where")
        for finding in diagnosis.findings
        if finding.component is None
    ]


def _sides(components: Components) -> str:
    """The share of each side, and the size of the residual beside the motion."""
    shares = [f"{percent(share)} lies in {SIDE_NAMES[side]}" for side, share in components.side_shares.items()]
    shares.append(f"{percent(components.noise_share)} is noise")
    residual, motion = (size_text(size, components.unit) for size in (components.residual_rms, components.motion_rms))
    return as_sentence(f"of the residual ({residual} rms, of a motion of {motion} rms) {', '.join(shares)}")
