"""Numbers and results as text: one format of value, standard error and unit everywhere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.types import (
    Diagnosis,
    Discovery,
    Doubt,
    Effect,
    EffectCause,
    Estimate,
    FitResult,
    ForceForm,
    ForceKind,
    Match,
    MissingForce,
    PooledFit,
    Segment,
    Trajectory,
    Verdict,
)

SMALLEST_PROBABILITY = 0.05  # of a cause that is mentioned
CAUSES: Mapping[EffectCause, str] = {
    "physics": "the physics",
    "measurement": "the measurement",
    "clock": "the clock",
}
MOST_NAMED = 5  # indistinguishable effects that are named; further ones are counted
MUCH_WIDER = 1.5  # ratio of the two standard errors (model-averaged over plain) above which both are given
DEGREES: Mapping[str, tuple[str, float]] = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
NOTEWORTHY = 0.2  # smallest inclusion at which a term that was not selected is shown
FORCES_IN_WORDS: Mapping[ForceKind, str] = {
    "against-velocity": "a force against the velocity",
    "odd-in-position": "a restoring force",
    "even-in-position": "a force that is even in the position",
    "drift": "a force that grows with time",
    "own-force-drift": "a change of the model's own force with time",
    "pulse": "a pulse",
    "sine": "a periodic force",
}


# --------------------------------------------------------------------------- numbers


def percent(probability: float) -> str:
    """A probability in percent; never 100, which no data give: 0.926 is "93 %", 0.9999 "over 99 %"."""
    return "over 99 %" if probability > 0.99 else f"{100 * probability:.0f} %"


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


def shown_unit(unit: str) -> tuple[str, float]:
    """The unit in which a reader gets a value, and the factor to it: degrees for radians, else the unit itself."""
    return DEGREES.get(unit, (unit, 1.0))


def with_error(estimate: Estimate) -> str:
    """Write an estimate with its standard error and unit, e.g. ``1.7034 ± 0.0042 m``; angles in degrees."""
    if not math.isfinite(estimate.stderr) and estimate.measurement_type in ("fitted", "derived"):
        return "undetermined"
    if not math.isfinite(estimate.value):
        return "undetermined"
    unit, factor = shown_unit(estimate.unit)
    value, stderr = rounded_to_error(factor * estimate.value, factor * estimate.stderr)
    return with_unit(f"{value} ± {stderr}" if stderr else value, unit)


def with_unit(number: str, unit: str) -> str:
    """A number with its unit, if it has one."""
    return number if unit in ("", "1") else f"{number} {unit}"


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
    """The verdict as lines of text: its word with the first reason and what to do about it, then further reasons."""
    first, *more = [as_sentence(_reason_text(doubt)) for doubt in verdict.reasons] or [""]
    return [f"{verdict.word}: {first}" if first else verdict.word, *(f"  also: {text}" for text in more)]


def _reason_text(doubt: Doubt) -> str:
    return ". ".join(filter(None, [doubt.finding, as_sentence(doubt.remedy)]))


# --------------------------------------------------------------------------- fits


def shown_estimates(fit: FitResult) -> dict[str, Estimate]:
    """The estimates to show: all except unknown constants and quantities derived from them."""
    hidden = ("assumed", "derived")
    return {
        name: estimate
        for name, estimate in fit.estimates.items()
        if math.isfinite(estimate.value) or estimate.measurement_type not in hidden
    }


def fit_headline(fit: FitResult) -> str:
    """The result in one line: fitted and derived values except initial states, or the reason why there are none.

    A value whose 95 % interval holds zero is named as not distinguishable from zero, without its size.
    """
    found = {
        name: estimate
        for name, estimate in shown_estimates(fit).items()
        if name not in fit.model.initial_names and estimate.measurement_type in ("fitted", "derived")
    }
    parts = [f"{name} = {with_error(value)}" for name, value in found.items() if not _holds_zero(value)]
    unsure = [name for name, value in found.items() if _holds_zero(value)]
    parts += [f"not distinguishable from zero: {', '.join(unsure)}"] if unsure else []
    return "; ".join(parts) if fit.usable and parts else f"{fit.status}: {fit.message}"


def _holds_zero(estimate: Estimate) -> bool:
    lower, upper = estimate.interval
    return lower <= 0.0 <= upper and lower < upper


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


# --------------------------------------------------------------------------- diagnoses


def diagnosis_sentence(diagnosis: Diagnosis) -> str:
    """The diagnosis in at most five sentences: cause, added effects, the error without and with them, missing force."""
    if diagnosis.added:
        sentences = [
            _cause_sentence(diagnosis),
            _added_sentence(diagnosis),
            _indistinguishable_sentence(diagnosis),
            _remaining_sentence(diagnosis),
            _missing_force_sentence(diagnosis.remaining_force if diagnosis.incomplete else None),
        ]
    else:
        sentences = [
            _nothing_added_sentence(diagnosis),
            _error_sentence(diagnosis),
            _missing_force_sentence(diagnosis.remaining_force),
            _suggested_sentence(diagnosis),
        ]
    return " ".join(filter(None, sentences))


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """The sentence, then a line for each note."""
    notes = [f"Note: {as_sentence(note.text)}" for note in diagnosis.notes]
    return "\n".join([diagnosis_sentence(diagnosis), *notes])


def _cause_sentence(diagnosis: Diagnosis) -> str:
    """Whether the physics, the measurement or the clock is the cause, with the probability of each."""
    by_effect = {
        effect.name: " or ".join(
            f"{CAUSES[cause]} ({percent(probability)})"
            for cause, probability in diagnosis.causes.get(effect.name, {}).items()
            if probability >= SMALLEST_PROBABILITY
        )
        for effect in diagnosis.added
    }
    told = {name: text for name, text in by_effect.items() if text}
    if len(set(told.values())) == 1:
        return f"The cause is {next(iter(told.values()))}."
    parts = [f"{text} of the {_spoken(name)}" for name, text in told.items()]
    return f"The cause is {', '.join(parts)}." if parts else ""


def _added_sentence(diagnosis: Diagnosis) -> str:
    effects = " and ".join(_effect_text(effect, diagnosis) for effect in diagnosis.added)
    which, before, after = _errors(diagnosis)
    if before == after:  # found with all samples only: the held-out error is without it
        which, before, after = "residual", diagnosis.before.fitted, diagnosis.after.fitted
    verb = "reduces" if after < before else "changes"
    return f"Adding {effects} {verb} the {which} from {_angle(diagnosis, before)} to {_angle(diagnosis, after)}."


def _indistinguishable_sentence(diagnosis: Diagnosis) -> str:
    parts = [
        f"{_spoken(effect.name)} is indistinguishable from {_alternatives(names)}"
        for effect in diagnosis.added
        if (names := diagnosis.indistinguishable.get(effect.name, ()))
    ]
    return as_sentence("; ".join(parts))


def _remaining_sentence(diagnosis: Diagnosis) -> str:
    subject = "The model is still incomplete: the residual is" if diagnosis.incomplete else "The remaining residual is"
    return f"{subject} {diagnosis.residual_ratio:.2g} times the noise."


def _nothing_added_sentence(diagnosis: Diagnosis) -> str:
    incomplete = "The model is incomplete; no" if diagnosis.incomplete else "No"
    if any(note.kind == "weak" for note in diagnosis.notes):
        return f"{incomplete} effect in the library can be named: the interval of its size would hold zero."
    return f"{incomplete} effect in the library is significant."


def _error_sentence(diagnosis: Diagnosis) -> str:
    which, before, _ = _errors(diagnosis)
    noise = _angle(diagnosis, diagnosis.noise_floor)
    return f"The {which} is {_angle(diagnosis, before)}, the noise {noise}."


def _suggested_sentence(diagnosis: Diagnosis) -> str:
    terms = " and ".join(f"{term.term} in {term.equation}" for term in diagnosis.proposed)
    return f"The residual suggests {terms}, a term without a named effect." if terms else ""


def _missing_force_sentence(force: MissingForce | None) -> str:
    """What acts on the body that no effect accounts for, in one sentence; empty where no force is significant."""
    if force is None or not force.significant:
        return ""
    size = f"No effect of the library accounts for the missing force ({_force_size(force)} rms)"
    if force.form is None:
        return as_sentence(f"{size}, and it has no simple form")
    similar = " or ".join(FORCES_IN_WORDS[kind] for kind in force.form.similar)
    return as_sentence(f"{size}: {_force_form(force.form)}{f'; {similar} explains it as well' if similar else ''}")


def _force_size(force: MissingForce) -> str:
    """Root mean square of the force over time, for each degree of freedom."""
    sizes = np.sqrt(np.mean(force.force**2, axis=0))
    return ", ".join(with_unit(f"{size:.2g}", unit) for size, unit in zip(sizes, force.units, strict=True))


def _force_form(form: ForceForm) -> str:
    """A clause that says how a force depends on time, position or velocity."""
    power = "" if form.shape is None else f"^({' ± '.join(rounded_to_error(form.shape.value, form.shape.stderr))})"
    value = "" if form.shape is None else with_error(form.shape)
    clauses: Mapping[ForceKind, str] = {
        "against-velocity": f"it acts against the velocity{f' and grows like |v|{power}' if power else ''}",
        "odd-in-position": f"it changes sign with the position{f' and grows like |x|{power}' if power else ''}",
        "even-in-position": f"it is even in the position{f' and grows like |x|{power}' if power else ''}",
        "drift": "it grows evenly with time",
        "own-force-drift": "the model's own force grows or shrinks evenly with time",
        "pulse": f"it acts at t = {value}",
        "sine": f"it is periodic with a frequency of {value}",
    }
    return clauses[form.kind]


def _errors(diagnosis: Diagnosis) -> tuple[str, float, float]:
    """The held-out error before and after, or the residual where nothing could be held out; and its name."""
    before, after = diagnosis.before, diagnosis.after
    if math.isfinite(before.heldout) and math.isfinite(after.heldout):
        return "held-out error", before.heldout, after.heldout
    return "residual", before.fitted, after.fitted


def _effect_text(effect: Effect, diagnosis: Diagnosis) -> str:
    """The effect's name and size with its error, and when or where it acts."""
    size, *others = (diagnosis.sizes[parameter.name] for parameter in effect.parameters)
    alone = diagnosis.final.estimates[effect.parameters[0].name]
    parts = [with_error(size)]
    if len(diagnosis.finals) == 1 and size.stderr > MUCH_WIDER * alone.stderr > 0:
        _, factor = shown_unit(alone.unit)
        stderr = rounded_to_error(factor * alone.value, factor * alone.stderr)[1]
        parts.append(f"± {stderr} assuming no further missing effect")
    parts += [
        f"{parameter.name.replace('_', ' ')} {with_error(value)}"
        for parameter, value in zip(effect.parameters[1:], others, strict=True)
        if parameter.role == "location"
    ]
    return f"{_spoken(effect.name)} ({', '.join(parts)})"


def _alternatives(names: Sequence[str]) -> str:
    more = [f"{len(names) - MOST_NAMED} more"] if len(names) > MOST_NAMED else []
    return " or ".join([*map(_spoken, names[:MOST_NAMED]), *more])


def _spoken(name: str) -> str:
    return name.replace("-", " ")


def _angle(diagnosis: Diagnosis, value: float) -> str:
    """An error in its own unit; angles in degrees."""
    if not math.isfinite(value):
        return "unknown"
    unit, factor = shown_unit(diagnosis.unit)
    return f"{factor * value:.3g}°" if unit == "°" else with_unit(f"{value:.3g}", unit)


def changed_parameters(diagnosis: Diagnosis) -> list[tuple[str, Estimate, Estimate]]:
    """Parameters that change by more than twice their standard error when the effects are added, before and after.

    Initial states and the small offsets of a geometry are left out.
    """
    base, final = diagnosis.base, diagnosis.final
    offsets = {parameter.name for parameter in base.model.parameters if parameter.constant and parameter.default == 0}
    pairs = [
        (name, base.estimates[name], final.estimates[name])
        for name in base.free
        if name not in {*base.model.initial_names, *offsets}
    ]
    return [pair for pair in pairs if abs(pair[2].value - pair[1].value) > 2 * pair[2].stderr]


# --------------------------------------------------------------------------- discoveries


def discovery_sentence(discovery: Discovery) -> str:
    """The discovered equation in words: a model of the bank with its parameters, or the nearest one."""
    sentences = [_model_sentences(discovery)]
    if discovery.alternatives:
        sentences.append(f"The data cannot distinguish it from {' or from '.join(discovery.alternatives)}.")
    if discovery.status != "ok":
        sentences.append(f"Reservation ({discovery.status}): {discovery.message}")
    return " ".join(sentences)


def _model_sentences(discovery: Discovery) -> str:
    if discovery.matched is not None:
        return _matched_sentences(discovery.matched)
    if discovery.nearest is not None:
        return _nearest_sentences(discovery, discovery.nearest)
    return "Not in the bank: no model observes these quantities."


def _matched_sentences(match: Match) -> str:
    sentences = [f"This is the {match.model} with {_values(match)}."]
    if match.same:
        sentences.append(f"The same equation: {', '.join(match.same)}.")
    if match.note:
        sentences.append(f"But its {match.note}.")
    return " ".join(sentences)


def _nearest_sentences(discovery: Discovery, nearest: Match) -> str:
    missing = [f"without {', '.join(nearest.missing)}"] if nearest.missing else []
    extra = [f"with {', '.join(nearest.extra)} added"] if nearest.extra else []
    sentences = [f"Not in the bank: the nearest is {nearest.model}, {' and '.join([*missing, *extra])}."]
    effects = [term.effect for term in discovery.selected if f"{term.term} in {term.equation}" in nearest.extra]
    named = ", ".join(dict.fromkeys(filter(None, effects)))
    if named:
        sentences.append(f"Effects with such terms: {named}.")
    if values := _values(nearest):
        sentences.append(f"As {nearest.model} alone it has {values}, and {nearest.note}.")
    return " ".join(sentences)


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
