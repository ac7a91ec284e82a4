"""Numbers and results as text: one format of value, standard error and unit everywhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.types import (
    SPOKEN,
    Discovery,
    Estimate,
    FitResult,
    Match,
    PooledFit,
    Segment,
    Trajectory,
    Verdict,
    with_unit,
)

DEGREES: Mapping[str, tuple[str, float]] = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
NOTEWORTHY = 0.2  # smallest inclusion at which a term that was not selected is shown
MIN_PERCENT = 0.005  # a share below it is "under 1 %"


# --------------------------------------------------------------------------- numbers


def percent(share: float) -> str:
    """A share in percent, e.g. "93 %"; one that rounds to zero is "under 1 %"."""
    if not math.isfinite(share):
        return "unknown"
    return "under 1 %" if share < MIN_PERCENT else f"{min(100 * share, 100):.0f} %"


def probability_text(probability: float) -> str:
    """A probability in percent; never 100, which no data give: 0.9999 is "99 %"."""
    return percent(min(probability, 0.99))


def rounded_to_error(value: float, stderr: float) -> tuple[str, str]:
    """Round a value to the second digit of its standard error: (1.70342, 0.0042) is ("1.7034", "0.0042")."""
    if not math.isfinite(value):
        return "undetermined", ""
    if not math.isfinite(stderr) or stderr <= 0:
        return f"{value:.6g}", ""
    digits = 1 - math.floor(math.log10(float(f"{stderr:.1e}")))  # 0.00999 rounds to 0.010
    if stderr >= 1e7 or abs(value) >= 1e7 or digits > 9:
        decimals = max(digits + math.floor(math.log10(max(abs(value), stderr))), 1)
        return f"{value:.{decimals}e}", f"{stderr:.1e}"
    # + 0.0: no negative zero
    return f"{round(value, digits) + 0.0:.{max(digits, 0)}f}", f"{round(stderr, digits):.{max(digits, 0)}f}"


def two_digits(size: float) -> str:
    """A size above 0 with two digits, written out: ``0.000032``, ``120``; with an exponent only where it is extreme."""
    return rounded_to_error(size, size)[1]


def shown_unit(unit: str) -> tuple[str, float]:
    """The unit in which a reader gets a value, and the factor to it: degrees for radians, else the unit itself."""
    return DEGREES.get(unit, (unit, 1.0))


def with_error(estimate: Estimate) -> str:
    """Write an estimate with its standard error and unit, e.g. ``1.7034 ± 0.0042 m``; angles in degrees."""
    return with_unit(*number_and_unit(estimate))


def number_and_unit(estimate: Estimate) -> tuple[str, str]:
    """The two parts of :func:`with_error`; a value that is not determined, or dimensionless, has no unit."""
    if not math.isfinite(estimate.stderr) and estimate.measurement_type in ("fitted", "derived"):
        return "undetermined", ""
    if not math.isfinite(estimate.value):
        return "undetermined", ""
    unit, factor = shown_unit(estimate.unit)
    value, stderr = rounded_to_error(factor * estimate.value, factor * estimate.stderr)
    return f"{value} ± {stderr}" if stderr else value, "" if unit == "1" else unit


def round_step(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten, for the lines of a grid."""
    power = 10.0 ** math.floor(math.log10(value))
    return min((1, 2, 5, 10), key=lambda digit: abs(math.log(digit * power / value))) * power


def interval_text(estimate: Estimate) -> str:
    """Write the 95 % interval, e.g. ``1.6950 to 1.7118``, in the unit shown; empty where there is none."""
    _, factor = shown_unit(estimate.unit)
    lower, upper = (factor * end for end in estimate.interval)
    if not (math.isfinite(lower) and math.isfinite(upper)) or upper <= lower:
        return ""
    width = upper - lower
    return f"{rounded_to_error(lower, width / 4)[0]} to {rounded_to_error(upper, width / 4)[0]}"


def as_sentence(text: str) -> str:
    """The text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""


# --------------------------------------------------------------------------- verdicts


def verdict_lines(verdict: Verdict) -> list[str]:
    """The verdict as lines of text: whether the numbers can be used, and why not; whether the equation is complete."""
    return [*number_lines(verdict), *equation_lines(verdict)]


def number_lines(verdict: Verdict) -> list[str]:
    """Whether the numbers can be used, with their relative errors or the reasons to doubt them."""
    reasons = verdict.number_reasons if verdict.equation is not None else verdict.reasons
    said = (". ".join(filter(None, [doubt.finding, as_sentence(doubt.remedy)])) for doubt in reasons)
    about, *more = [*map(as_sentence, said)] or [verdict.accuracy_text]
    word = SPOKEN[verdict.word]
    return [f"{word}: {about}" if about else word, *(f"  also: {text}" for text in more)]


def equation_lines(verdict: Verdict) -> list[str]:
    """Whether the equation is complete, and what to do where it is not; nothing where there is no fit."""
    if verdict.equation is None:
        return []
    remedies = [] if verdict.complete else [as_sentence(doubt.remedy) for doubt in verdict.equation_reasons]
    return [" ".join([f"{verdict.equation.text}{'.' if remedies else ''}", *filter(None, remedies)])]


# --------------------------------------------------------------------------- fits


def shown_estimates(fit: FitResult) -> dict[str, Estimate]:
    """The estimates to show: all except unknown constants and quantities derived from them."""
    hidden = ("assumed", "derived")
    return {
        name: estimate
        for name, estimate in fit.estimates.items()
        if math.isfinite(estimate.value) or estimate.measurement_type not in hidden
    }


def main_names(fit: FitResult) -> list[str]:
    """The names of the values that a person came for: those whose accuracy the verdict gives, else what was fitted."""
    accurate = [name for name in fit.verdict.accuracy if name in fit.estimates]
    found = [
        name
        for name, estimate in shown_estimates(fit).items()
        if estimate.measurement_type in ("fitted", "derived") and name not in fit.model.initial_names
    ]
    return accurate or found


def table_names(fit: FitResult) -> list[str]:
    """The names that a table shows at once: the main ones, and a damping that was fitted."""
    damping = [parameter.name for parameter in fit.model.with_role("damping") if parameter.name in fit.free]
    return list(dict.fromkeys([*main_names(fit), *damping]))


def is_in_px(fit: FitResult) -> bool:
    """Whether a number that a person came for has a unit with px, because no scale is known."""
    return fit.usable and any("px" in fit.estimates[name].unit for name in main_names(fit))


def samples_text(segment: Segment, trajectory: Trajectory) -> str:
    """Say which samples a segment covers, e.g. ``0-2 (0.000-0.200 s)``."""
    last = segment.stop - 1
    return f"{segment.start}-{last} ({trajectory.t_s[segment.start]:.3f}-{trajectory.t_s[last]:.3f} s)"


def residual_text(fit: FitResult) -> str:
    """Compare the residual with the noise that was estimated without the model, for each quantity."""
    parts = []
    for quantity, rms, noise in zip(fit.model.observed, fit.rms, fit.noise, strict=True):
        unit, factor = shown_unit(quantity.unit)
        known = np.isfinite(noise) and noise > 0
        ratio = f", {rms / noise:.2f} times the noise of {factor * noise:.3g}" if known else ""
        size = f"{with_unit(f'{factor * rms:.3g}', unit)} rms" if np.isfinite(rms) else "unknown"
        parts.append(f"{quantity.name}: residual {size}{ratio}")
    return "; ".join(parts)


def fit_table(fit: FitResult) -> str:
    """The estimates as a table of plain text: name, value ± standard error, 95 % interval, kind; then the residual."""
    rows = [
        (name, with_error(estimate), interval_text(estimate), estimate.measurement_type)
        for name, estimate in shown_estimates(fit).items()
    ]
    return "\n".join([*_aligned(rows), residual_text(fit)])


def pooled_table(pooled: PooledFit) -> str:
    """A fit to several clips as plain text: shared values, then means over clips with the scatter between them."""
    count = sum(fit.usable for fit in pooled.clips)
    lines = [f"{name}  {with_error(estimate)}  shared by {count} clips" for name, estimate in pooled.shared.items()]
    lines += [
        f"{name}  {with_error(spread.mean)}  mean over {count} clips; between clips {with_error(spread.between)} "
        f"({interval_text(spread.between) or 'no scatter detected'}), within one "
        f"{shown_unit(spread.mean.unit)[1] * spread.within:.3g}"
        for name, spread in pooled.population.items()
    ]
    return "\n".join(lines)


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows of cells as lines with aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


# --------------------------------------------------------------------------- discoveries


def discovery_sentence(discovery: Discovery) -> str:
    """The discovered equation in words: a model of the bank with its parameters, or the nearest one."""
    if discovery.matched is not None:
        sentences = _matched_sentences(discovery.matched)
    elif discovery.nearest is not None:
        sentences = _nearest_sentences(discovery, discovery.nearest)
    else:
        sentences = ["Not in the bank: no model observes these quantities."]
    if discovery.alternatives:
        sentences.append(f"The data cannot distinguish it from {' or from '.join(discovery.alternatives)}.")
    if discovery.status != "ok":
        sentences.append(f"Reservation: {discovery.message}")
    return " ".join(sentences)


def _matched_sentences(match: Match) -> list[str]:
    sentences = [f"This is the {match.model} with {_values(match)}."]
    if match.same:
        sentences.append(f"The same equation: {', '.join(match.same)}.")
    if match.note:
        sentences.append(f"But its {match.note}.")
    return sentences


def _nearest_sentences(discovery: Discovery, nearest: Match) -> list[str]:
    missing = [f"without {', '.join(nearest.missing)}"] if nearest.missing else []
    extra = [f"with {', '.join(nearest.extra)} added"] if nearest.extra else []
    sentences = [f"Not in the bank: the nearest is {nearest.model}, {' and '.join([*missing, *extra])}."]
    effects = [term.effect for term in discovery.selected if f"{term.term} in {term.equation}" in nearest.extra]
    named = ", ".join(dict.fromkeys(filter(None, effects)))
    if named:
        sentences.append(f"Effects with such terms: {named}.")
    if values := _values(nearest):
        sentences.append(f"As {nearest.model} alone it has {values}, and {nearest.note}.")
    return sentences


def _values(match: Match) -> str:
    return ", ".join(
        f"{name} = {with_error(estimate)}"
        for name, estimate in match.parameters.items()
        if estimate.measurement_type != "assumed"
    )


def discovery_text(discovery: Discovery) -> str:
    """The equations, their terms with interval and inclusion, and a summary, as plain text."""
    rows = [("term", "coefficient", "95 % interval", "inclusion")]
    rows += [
        (
            f"{term.equation}: {term.term}",
            with_error(term.coefficient),
            interval_text(term.coefficient),
            f"{term.inclusion:.2f}",
        )
        for term in discovery.terms
        if term.selected or term.inclusion >= NOTEWORTHY
    ]
    equations = [f"{equation.lhs} = {equation.rhs}" for equation in discovery.equations]
    return "\n".join([*equations, *_aligned(rows), discovery_sentence(discovery)])
