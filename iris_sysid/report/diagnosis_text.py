"""A diagnosis in words: the parts of the residual, the finding on each, the error before and after."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.report.text import (
    MIN_PERCENT,
    as_sentence,
    percent,
    probability_text,
    rounded_to_error,
    shown_unit,
    with_error,
)
from iris_sysid.types import (
    KIND_NAMES,
    KINDS_IN_WORDS,
    MEANINGS,
    UNEXPLAINED,
    Component,
    ComponentKind,
    Components,
    Diagnosis,
    Effect,
    EffectCause,
    Estimate,
    Finding,
    times_text,
    with_unit,
)

MIN_SHARE = 0.03  # of a part of the residual that the sentence mentions
WIDE_RANGE = 0.1  # of shares, above which the range is given
SLOW: tuple[ComponentKind, ...] = ("zero-wander", "force-of-time", "own-force-drift")
MAX_ALTERNATIVES = 2  # kinds that can take the place of a part, that its clause names
MIN_PROBABILITY = 0.05  # of a cause that is mentioned
CAUSES: Mapping[EffectCause, str] = {
    "physics": "the physics",
    "measurement": "the measurement",
    "clock": "the clock",
}
MAX_NAMED = 5  # indistinguishable effects that are named; further ones are counted
MAX_SPOKEN = 2  # added effects that the sentence of the error names
MUCH_WIDER = 1.5  # ratio of the two standard errors (model-averaged over plain) above which both are given
NOT_FOLLOWED = "The equation does not follow the motion: where its residual lies, these data cannot tell."
TOO_SHORT = "The residual is too short to be split into parts."


def diagnosis_sentence(diagnosis: Diagnosis) -> str:
    """The diagnosis in a few sentences: the parts of the residual, the finding on each, the error before and after."""
    return " ".join(diagnosis_sentences(diagnosis))


def diagnosis_sentences(diagnosis: Diagnosis) -> list[str]:
    """The sentences of a diagnosis, the parts of the residual first.

    Where the clip is too short to be split: cause, added effects, the error without and with them, and that it is.
    """
    components = diagnosis.components
    if components is None and all(fitted.follows for fitted in diagnosis.bases):
        return _unsplit_sentences(diagnosis)
    named = {name for finding in diagnosis.findings if finding.word == "named" for name in finding.effects[:1]}
    others = [effect for effect in diagnosis.added if effect.name not in named]
    noise = diagnosis.noise_floor if diagnosis.incomplete or diagnosis.added else math.inf
    rest = diagnosis.noise_floor if diagnosis.incomplete else math.inf
    sentences = [
        NOT_FOLLOWED if components is None else parts_sentence(components, noise=noise),
        *(finding_sentence(finding, diagnosis) for finding in diagnosis.findings),
        f"Added as well: {' and '.join(_effect_text(effect, diagnosis) for effect in others)}." if others else "",
        _nuisance_sentence(diagnosis.nuisances),
        _error_sentence(diagnosis),
        parts_sentence(diagnosis.remaining, "residual that remains", rest) if diagnosis.added else "",
        _suggested_sentence(diagnosis),
    ]
    return list(filter(None, sentences))


def _unsplit_sentences(diagnosis: Diagnosis) -> list[str]:
    if diagnosis.added:
        still = "The model is still incomplete: the residual is"
        subject = still if diagnosis.incomplete else "The remaining residual is"
        sentences = [
            _cause_sentence(diagnosis),
            _added_sentence(diagnosis),
            _indistinguishable_sentence(diagnosis),
            f"{subject} {times_text(diagnosis.residual_ratio)} the noise.",
        ]
    else:
        sentences = [
            _nothing_added_sentence(diagnosis),
            _error_sentence(diagnosis),
            _suggested_sentence(diagnosis),
        ]
    return [*filter(None, sentences), TOO_SHORT]


def diagnosis_text(diagnosis: Diagnosis) -> str:
    """A line for each sentence, the parts of the residual first, then a line for each note."""
    notes = [f"Note: {as_sentence(note.text)}" for note in diagnosis.notes]
    return "\n".join([*diagnosis_sentences(diagnosis), *notes])


# --------------------------------------------------------------------------- parts of the residual


def parts_sentence(components: Components | None, subject: str = "residual", noise: float = math.inf) -> str:
    """What share of a residual depends on what, and what is noise; empty without ``components``.

    ``subject`` is the residual in words, ``noise`` the root mean square of the measurement's noise, in its unit.
    """
    if components is None:
        return ""
    if not components.parts and components.residual_rms > UNEXPLAINED * noise:
        times = times_text(components.residual_rms / noise)
        return f"The {subject} is {times} the noise, and no part of it has a form that these data show."
    if not components.parts:
        return f"The {subject} is noise: nothing is missing that these data could show."
    shown = [part for part in components.parts if part.share >= MIN_SHARE] or list(components.parts[:1])
    clauses = [_part_clause(part, components) for part in shown]
    first, *more = [(share_text(part), clause) for part, clause in zip(shown, clauses, strict=True)]
    small = sum(part.share for part in components.parts) - sum(part.share for part in shown)
    texts = [f"{first[0]} of the {subject} {first[1]}", *(f"{share} {clause}" for share, clause in more)]
    if small >= MIN_PERCENT:
        texts.append(f"{percent(small)} lies in smaller parts")
    return as_sentence("; ".join([*texts, f"{percent(components.noise_share)} is noise"]))


def share_text(part: Component) -> str:
    """The share of a part, with its range where that is wide."""
    low, high = part.share_range
    range_text = f" ({100 * low:.0f} to {min(100 * high, 100):.0f} %)" if high - low > WIDE_RANGE else ""
    return f"{percent(part.share)}{range_text}"


def size_text(size: float, unit: str) -> str:
    """A root mean square with its unit; angles in degrees."""
    shown, factor = shown_unit(unit)
    number = f"{factor * size:.2g}"
    return f"{number}°" if shown == "°" else with_unit(number, shown)


def _part_clause(part: Component, components: Components) -> str:
    """What a part depends on, its size, and what it stands for."""
    where = f" at {with_error(part.at)}" if part.at is not None else ""
    instead = _instead(part.similar)
    size = ", ".join(filter(None, [size_text(part.rms, components.unit), _period_text(part)]))
    meaning = f": {MEANINGS[part.kind]}" if MEANINGS[part.kind] and not instead else ""
    return f"{KINDS_IN_WORDS[part.kind]}{where}{instead} ({size}){meaning}"


def _instead(kinds: Sequence[ComponentKind]) -> str:
    """What else it may be; of many kinds, that they look alike on this motion."""
    names = [f"{'an' if KIND_NAMES[kind][0] in 'aeiou' else 'a'} {KIND_NAMES[kind]}" for kind in kinds]
    if len(names) <= MAX_ALTERNATIVES:
        return f", or is {' or '.join(names)}" if names else ""
    few = ", ".join(names[:MAX_ALTERNATIVES])
    return f", or is {few} or another of {len(names)} kinds that look the same on this motion"


def _period_text(part: Component) -> str:
    """About how long one swing of a slow part lasts; empty where it does not turn twice."""
    if part.curve is None or part.kind not in SLOW or part.curve.values.shape[0] < 3:
        return ""
    course = part.curve.values[:, 0] - part.curve.values[:, 0].mean()
    turns = np.flatnonzero(np.diff(np.sign(course)) != 0)
    if turns.size < 3:
        return ""
    at = part.curve.at[turns]
    return f"about {2 * (at[-1] - at[0]) / (turns.size - 1):.2g} s"


def finding_sentence(finding: Finding, diagnosis: Diagnosis) -> str:
    """One sentence for the finding on one part of the residual."""
    reason = f": {finding.reason}" if finding.reason else ""
    removes = f"removes {percent(finding.share)} of the residual in samples held out"
    if finding.word == "open" or (finding.word != "located" and not finding.effects):
        return as_sentence(f"something is missing, and the data do not say where{reason}")
    if finding.word == "located":
        what = f"the {KIND_NAMES[finding.component]}" if finding.component is not None else "a part of the residual"
        if finding.effects:
            return as_sentence(f"{what} is located: {_alternatives(finding.effects)} fits, but is not named{reason}")
        return as_sentence(f"no effect of the library is named for {what}{reason}; its curve is on the page")
    tested = math.isfinite(finding.share)
    if finding.word == "named":
        added = {effect.name: effect for effect in diagnosis.added}
        name = finding.effects[0]
        text = _effect_text(added[name], diagnosis) if name in added else spoken(name)
        return as_sentence(f"{text} is named{f': it {removes}' if tested else ''}")
    best = f"; the best of them {removes}" if tested and len(finding.effects) > 1 else ""
    if len(finding.effects) == 1:
        return as_sentence(f"{spoken(finding.effects[0])} or something like it acts{reason}")
    return as_sentence(f"{_alternatives(finding.effects)} acts, and the data cannot tell them apart{reason}{best}")


def _nuisance_sentence(nuisances: Sequence[Effect]) -> str:
    if not nuisances:
        return ""
    names = ", ".join(spoken(effect.name) for effect in nuisances)
    return f"In the fit as well, without being named: {names}."


# --------------------------------------------------------------------------- effects and errors


def _cause_sentence(diagnosis: Diagnosis) -> str:
    """Whether the physics, the measurement or the clock is the cause, with the probability of each."""
    by_effect = {
        effect.name: " or ".join(
            f"{CAUSES[cause]} ({probability_text(probability)})"
            for cause, probability in diagnosis.causes.get(effect.name, {}).items()
            if probability >= MIN_PROBABILITY
        )
        for effect in diagnosis.added
    }
    told = {name: text for name, text in by_effect.items() if text}
    if len(set(told.values())) == 1:
        return f"The cause is {next(iter(told.values()))}."
    parts = [f"{text} of the {spoken(name)}" for name, text in told.items()]
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
        f"{spoken(effect.name)} is indistinguishable from {_alternatives(names)}"
        for effect in diagnosis.added
        if (names := diagnosis.indistinguishable.get(effect.name, ()))
    ]
    return as_sentence("; ".join(parts))


def _nothing_added_sentence(diagnosis: Diagnosis) -> str:
    incomplete = "The model is incomplete; no" if diagnosis.incomplete else "No"
    if any(note.kind == "weak" for note in diagnosis.notes):
        return f"{incomplete} effect in the library can be named: the interval of its size would hold zero."
    return f"{incomplete} effect in the library is significant."


def _error_sentence(diagnosis: Diagnosis) -> str:
    which, before, after = _errors(diagnosis)
    noise = _angle(diagnosis, diagnosis.noise_floor)
    effects = [*diagnosis.added, *getattr(diagnosis, "nuisances", ())]
    if not effects:
        return f"The {which} is {_angle(diagnosis, before)}, the noise {noise}."
    verb = "falls" if after < before else "changes"
    few = [spoken(effect.name) for effect in effects] if len(effects) <= MAX_SPOKEN else []
    them = " and ".join(few) or "these effects"
    change = f"from {_angle(diagnosis, before)} to {_angle(diagnosis, after)}"
    return f"With {them} the {which} {verb} {change}; the noise is {noise}."


def _suggested_sentence(diagnosis: Diagnosis) -> str:
    terms = " and ".join(f"{term.term} in {term.equation}" for term in diagnosis.proposed)
    return f"The residual suggests {terms}, a term without a named effect." if terms else ""


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
        if parameter.role in ("location", "moment")
    ]
    return f"{spoken(effect.name)} ({', '.join(parts)})"


def _alternatives(names: Sequence[str]) -> str:
    more = [f"{len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
    return " or ".join([*map(spoken, names[:MAX_NAMED]), *more])


def spoken(name: str) -> str:
    """The name of an effect as words."""
    return name.replace("-", " ")


def _angle(diagnosis: Diagnosis, value: float) -> str:
    """An error in its own unit; angles in degrees."""
    if not math.isfinite(value):
        return "unknown"
    unit, factor = shown_unit(diagnosis.unit)
    return f"{factor * value:.3g}°" if unit == "°" else with_unit(f"{factor * value:.3g}", unit)


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
