"""What a residual is made of, on the page of a fit: a sentence, and a bar of its parts and of noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.ode import FitRequest
from iris_sysid.diagnosis.residual_components import components_of
from iris_sysid.report.component_colours import shades_of
from iris_sysid.report.diagnosis_text import MIN_SHARE, parts_sentence, share_text, size_text
from iris_sysid.report.page import Bar
from iris_sysid.report.text import percent
from iris_sysid.types import KIND_NAMES, Components, FitResult, Trajectory

DIAGNOSE = "To look for the effects behind it: iris-sysid diagnose."


def residual_budget(trajectory: Trajectory, fit: FitResult) -> tuple[Sequence[str], Sequence[Bar]]:
    """One statement and one bar that say what the residual of a fit is made of; none where it cannot be split.

    Where the equation is not complete, no more of the residual is called noise than the measurement's own noise
    explains: the split calls noise what has no form, and a short motion shows no form.
    """
    components = components_of([FitRequest(trajectory, fit.model)], [fit]) if fit.usable else None
    if components is None:
        return [], []
    noise, equation = components.noise_share, fit.verdict.equation
    if equation is not None and not equation.complete and np.isfinite(equation.residual_over_noise):
        measured = equation.residual_over_noise**-2
        noise = measured if noise - measured > MIN_SHARE else noise
    first, *more = fit.model.observed
    bar = parts_bar(f"The residual of all, in {first.name}" if more else "The residual", components, noise=noise)
    if components.parts:
        return [f"{parts_sentence(components)} {DIAGNOSE}"], [bar]
    if noise == components.noise_share:
        return [parts_sentence(components)], [bar]
    rest = f"{percent(noise)} of the residual is noise; the rest has no form that these data show"
    return [f"{rest}. {DIAGNOSE}"], [bar]


def parts_bar(title: str, components: Components, scale: float = 1.0, noise: float | None = None) -> Bar:
    """The parts of a residual as a bar.

    Parameters
    ----------
    title
        What the bar shows.
    components
        The parts.
    scale
        Length of the bar, 1 for the whole width.
    noise
        The share that is called noise, the rest of what no part explains being of unknown form; all of it by default.
    """
    parts = [
        (
            f"{share_text(part)} {KIND_NAMES[part.kind]}",
            100 * scale * max(part.share, 0.0),
            f"{part.side} {shade}".strip(),
        )
        for part, shade in zip(components.parts, shades_of([part.side for part in components.parts]), strict=True)
    ]
    noise = components.noise_share if noise is None else noise
    unknown = components.noise_share - noise
    if unknown > 0:
        parts.append((f"{percent(unknown)} of unknown form", 100 * scale * unknown, "unknown"))
    parts.append((f"{percent(noise)} noise", 100 * scale * max(noise, 0.0), "rest"))
    return Bar(f"{title}: {size_text(components.residual_rms, components.unit)} rms", parts)
