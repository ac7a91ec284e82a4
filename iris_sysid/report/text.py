"""How numbers and results are spelled for people: value, standard error and unit in one way everywhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from iris_sysid.types import Discovery, Effect, Estimate, FitResult, PooledFit, Segment, Trajectory

if TYPE_CHECKING:
    from iris_sysid.diagnosis.diagnose import Diagnosis

MOST_NAMED = 5  # of the effects that one cannot be told from
MUCH_WIDER = 1.5  # times the standard error that holds if nothing else is lacking, from which both are said
UNEXPLAINED = 2.0  # times the noise: what is left is then plain to see, and is no error in the noise
NOTEWORTHY = 0.2  # inclusion of a term that was not selected, from which on it is shown


def rounded(value: float, stderr: float) -> tuple[str, str]:
    """Spell a value to the second digit of its standard error: (1.70342, 0.0042) is ("1.7034", "0.0042")."""
    if not math.isfinite(value):
        return "undetermined", ""
    if not math.isfinite(stderr) or stderr <= 0:
        return f"{value:.6g}", ""
    digits = 1 - math.floor(math.log10(float(f"{stderr:.1e}")))  # of 0.00999, which is 0.010
    if stderr >= 1e7 or abs(value) >= 1e7 or digits > 9:
        wanted = max(digits + math.floor(math.log10(max(abs(value), stderr))), 1)
        return f"{value:.{wanted}e}", f"{stderr:.1e}"
    # + 0.0: no negative zero
    return f"{round(value, digits) + 0.0:.{max(digits, 0)}f}", f"{round(stderr, digits):.{max(digits, 0)}f}"


def with_error(estimate: Estimate) -> str:
    """Spell an estimate with its standard error and unit, e.g. ``1.7034 ± 0.0042 m``."""
    if not math.isfinite(estimate.stderr) and estimate.measurement_type in ("fitted", "derived"):
        return "undetermined"
    value, stderr = rounded(estimate.value, estimate.stderr)
    if value == "undetermined":
        return value
    return in_unit(f"{value} ± {stderr}" if stderr else value, estimate.unit)


def in_unit(number: str, unit: str) -> str:
    """A number with its unit, which a pure number has none of."""
    return number if unit in ("", "1") else f"{number} {unit}"


def interval(estimate: Estimate) -> str:
    """Spell the 95 % interval, e.g. ``1.6950 to 1.7118``; empty where there is none."""
    lower, upper = estimate.interval
    if not (math.isfinite(lower) and math.isfinite(upper)) or upper <= lower:
        return ""
    width = upper - lower
    return f"{rounded(lower, width / 4)[0]} to {rounded(upper, width / 4)[0]}"


def shown(fit: FitResult) -> dict[str, Estimate]:
    """The estimates to show: not the constants that nobody gave, nor what would follow from them."""
    hidden = ("assumed", "derived")
    return {
        name: estimate
        for name, estimate in fit.estimates.items()
        if math.isfinite(estimate.value) or estimate.measurement_type not in hidden
    }


def headline(fit: FitResult) -> str:
    """The result in one line: the fitted and derived values that are no initial state, or why there are none."""
    initial = {f"{state.name}_0" for state in fit.model.states}
    parts = [
        f"{name} = {with_error(estimate)}"
        for name, estimate in shown(fit).items()
        if name not in initial and estimate.measurement_type in ("fitted", "derived")
    ]
    text = "; ".join(parts)
    return text if fit.usable and parts else f"{fit.status}: {fit.message}"


def frames_text(segment: Segment, trajectory: Trajectory) -> str:
    """Say which samples a segment covers, e.g. ``0-2 (0.000-0.200 s)``."""
    last = segment.stop - 1
    return f"{segment.start}-{last} ({trajectory.t_s[segment.start]:.3f}-{trajectory.t_s[last]:.3f} s)"


def residual_text(fit: FitResult) -> str:
    """Compare the residual with the noise that was estimated without the model, for each quantity."""
    parts = []
    for quantity, rms, noise in zip(fit.model.observed, fit.rms, fit.noise, strict=True):
        ratio = f", {rms / noise:.2f} times the noise of {noise:.3g}" if np.isfinite(noise) and noise > 0 else ""
        size = f"{rms:.3g} {quantity.unit} rms" if np.isfinite(rms) else "not known"
        parts.append(f"{quantity.name}: residual {size}{ratio}")
    return "; ".join(parts)


def estimates_text(fit: FitResult) -> str:
    """The estimates as a small table of plain text: name, value ± standard error, 95 % interval, kind."""
    rows = [
        (name, with_error(estimate), interval(estimate), estimate.measurement_type)
        for name, estimate in shown(fit).items()
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, residual_text(fit)])


def pooled_text(pooled: PooledFit) -> str:
    """A fit to several clips as plain text: shared values, then means over clips with the scatter between them."""
    count = sum(one.usable for one in pooled.clips)
    lines = [f"{name}  {with_error(one)}  shared by {count} clips" for name, one in pooled.shared.items()]
    lines += [
        f"{name}  {with_error(one.mean)}  mean over {count} clips; between clips {with_error(one.between)} "
        f"({interval(one.between) or 'no scatter seen'}), within one {one.within:.3g}"
        for name, one in pooled.population.items()
    ]
    return "\n".join(lines)


def diagnosis_sentence(diagnosis: Diagnosis) -> str:
    """What a model lacks, as a person would write it, with the error before and after and what moved."""
    both = (diagnosis.before, diagnosis.after)
    heldout = all(math.isfinite(errors.heldout) for errors in both)
    which = "held-out error" if heldout else "residual"
    before, after = (_angles(diagnosis, errors.heldout if heldout else errors.fitted) for errors in both)
    floor = _angles(diagnosis, diagnosis.noise_floor)
    left = diagnosis.after.fitted / diagnosis.noise_floor if diagnosis.noise_floor > 0 else 1.0
    named = [_effect_text(effect, diagnosis) for effect in diagnosis.added]
    if named:
        text = f"Adding {' and '.join(named)} takes the {which} from {before} to {after}; the noise floor is {floor}."
        moved = _moved(diagnosis)
        text += f" {moved}" if moved else ""
        text += f" More is lacking: what is left is {left:.2g} times the noise." if left > UNEXPLAINED else ""
    elif left > UNEXPLAINED:
        text = "Something is lacking, but no effect here is shown to be it: "
        text += f"the {which} is {before}, the noise floor {floor}."
    else:
        text = f"Nothing to add: the {which} is {before}, the noise floor {floor}."
    return text + _proposed(diagnosis) + "".join(f" Note: {note}." for note in diagnosis.notes)


def _proposed(diagnosis: Diagnosis) -> str:
    """Terms without a named effect that what is left calls for, as a further sentence after a space."""
    terms = " and ".join(f"{one.term} in {one.equation}" for one in diagnosis.proposed)
    return f" What is left calls for {terms}, which no effect is named after." if terms else ""


def _effect_text(effect: Effect, diagnosis: Diagnosis) -> str:
    """The effect's name and size, when or where it acts, and what it cannot be told from."""
    sizes = [diagnosis.sizes[one.name] for one in effect.parameters]
    alone = diagnosis.final.estimates[effect.parameters[0].name]
    parts = [with_error(sizes[0])]
    if len(diagnosis.finals) == 1 and sizes[0].stderr > MUCH_WIDER * alone.stderr > 0:
        parts.append(f"± {rounded(alone.value, alone.stderr)[1]} if nothing else is lacking")
    for parameter, size in zip(effect.parameters[1:], sizes[1:], strict=True):
        chosen = effect.nearby is not None and parameter is effect.parameters[1]
        if parameter.unit in ("s", "{x}") and (chosen or not parameter.constant):
            parts.append(f"{parameter.name.replace('_', ' ')} {with_error(size)}")
    alike = diagnosis.indistinguishable.get(effect.name, ())
    if alike:
        more = f" or {len(alike) - MOST_NAMED} more" if len(alike) > MOST_NAMED else ""
        parts.append(f"or as well {' or '.join(one.replace('-', ' ') for one in alike[:MOST_NAMED])}{more}")
    return f"{effect.name.replace('-', ' ')} ({', '.join(parts)})"


def _angles(diagnosis: Diagnosis, value: float) -> str:
    """Angles in degrees, all else in its own unit."""
    if not math.isfinite(value):
        return "not known"
    if diagnosis.unit == "rad":
        return f"{np.degrees(value):.3g}°"
    return in_unit(f"{value:.3g}", diagnosis.unit)


def _moved(diagnosis: Diagnosis) -> str:
    """Base parameters that moved by more than twice their standard error; not the small offsets of a geometry."""
    offsets = {one.name for one in diagnosis.base.model.parameters if one.constant and one.default == 0}
    parts = []
    for name in diagnosis.base.free:
        base, final = diagnosis.base.estimates[name], diagnosis.final.estimates[name]
        if name.endswith("_0") or name in offsets or not abs(final.value - base.value) > 2 * final.stderr:
            continue
        old, new = rounded(base.value, final.stderr)[0], rounded(final.value, final.stderr)[0]
        parts.append(f"{name} moves from {old} to {in_unit(new, base.unit)}")
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}." if parts else ""


def discovery_sentence(found: Discovery) -> str:
    """Name the discovered equation: a model of the bank with its parameters, or the nearest one and how it differs."""
    matched, nearest = found.matched, found.nearest
    if matched is not None:
        values = [f"{name} = {with_error(one)}" for name, one in matched.parameters.items()
                  if one.measurement_type != "assumed"]  # fmt: skip
        text = f"This is the {matched.model} with {', '.join(values)}."
        text += f" The same equation: {', '.join(matched.same)}." if matched.same else ""
        text += f" But its {matched.note}." if matched.note else ""
    elif nearest is not None:
        lacks = [f"{', '.join(nearest.missing)} was not found"] if nearest.missing else []
        lacks += [f"{', '.join(nearest.extra)} is there as well"] if nearest.extra else []
        text = f"Not in the bank: the nearest is {nearest.model}, but {'; '.join(lacks)}."
        effects = [one.effect for one in found.selected if f"{one.term} in {one.equation}" in nearest.extra]
        named = ", ".join(dict.fromkeys(one for one in effects if one))
        text += f" Effects with such terms: {named}." if named else ""
        values = [f"{name} = {with_error(one)}" for name, one in nearest.parameters.items()
                  if one.measurement_type != "assumed"]  # fmt: skip
        text += f" As {nearest.model} alone it has {', '.join(values)}, and {nearest.note}." if values else ""
    else:
        text = "Not in the bank: no model there observes these quantities."
    if found.alternatives:
        text += f" The data cannot tell it from {' or from '.join(found.alternatives)}."
    if found.status != "ok":
        text += f" With a reservation ({found.status}): {found.message}"
    return text


def discovery_text(found: Discovery) -> str:
    """The equations, their terms with interval and inclusion, and the sentence, as plain text."""
    rows = [("term", "coefficient", "95 % interval", "inclusion")]
    rows += [
        (f"{one.equation}: {one.term}", with_error(one.coefficient), interval(one.coefficient), f"{one.inclusion:.2f}")
        for one in found.terms
        if one.selected or one.inclusion >= NOTEWORTHY
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*(f"{one.lhs} = {one.rhs}" for one in found.equations), *table, discovery_sentence(found)])
