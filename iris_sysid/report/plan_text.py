"""What to measure next, in words, and as the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from iris_sysid.diagnosis.planning.changes import SetUpChange
from iris_sysid.diagnosis.planning.decide import Decision
from iris_sysid.diagnosis.planning.detection_limit import DetectionLimits
from iris_sysid.diagnosis.planning.plan import Plan, Proposal
from iris_sysid.diagnosis.planning.precision import Need
from iris_sysid.diagnosis.planning.rivals import NOTHING
from iris_sysid.errors import UnknownNameError
from iris_sysid.io.schemas import LimitsDocument, PlanDocument
from iris_sysid.types import with_unit

MAX_SHOWN = 12
BETTER = 0.1  # by which the best proposal's power must exceed that of a repeat to be called better


UNDESCRIBED = (
    "None of these describes today's clip, whose residual is far above its noise: what is predicted holds only if one "
    "of them is right all the same."
)
NOT_DECIDED = (
    "Even the best of these leaves a residual far above the noise of a clip: the right one may not be among them. "
    "Diagnose the clips together."
)


def advice(planned: Plan) -> tuple[str, ...]:
    """One or two sentences: the best clip to make next, and how likely it decides."""
    return (*_best(planned), *((UNDESCRIBED,) if planned.fitted.status == "misfit" else ()))


def _best(planned: Plan) -> tuple[str, ...]:
    names = [name for name in planned.probabilities if name != NOTHING]
    best, repeat = planned.best, planned.repeat
    if np.isnan(best.power):
        return (f"Next: {best.text}; {_most_precise(best, planned.stderr)}.",)
    versus = " and ".join(names[:2]) if len(names) > 1 else f"whether {names[0]} acts"
    what = f"to tell {versus} apart" if len(names) > 1 else f"to decide {versus}"
    if not planned.practical:
        return (
            f"No change of the set-up tried here is likely {what}: the best one, {best.text}, has a chance of "
            f"{percent_of(best)}.",
        )
    line = f"Next: {best.text}: a chance of {percent_of(best)} {what}"
    if best.power > repeat.power + BETTER:
        line += f" ({percent_of(repeat)} by {repeat.text})"
    return (f"{line}.",)


def percent_of(proposal: Proposal) -> str:
    """The power in percent; a few hundred draws tell no 100 %."""
    return f"{100 * min(proposal.power, 0.99):.0f} %" if proposal.power < 0.99 else "over 99 %"


def _most_precise(proposal: Proposal, today: Mapping[str, float]) -> str:
    """By how much it shrinks the error that it shrinks most."""
    ratios = {name: stderr / today[name] for name, stderr in proposal.stderr.items() if today.get(name, 0.0) > 0}
    if not ratios:
        return "no value is shared with the present clip"
    name = min(ratios, key=lambda each: ratios[each])
    return f"the standard error of {name} becomes {ratios[name]:.2g} times as large"


def plan_rows(planned: Plan) -> list[dict[str, str]]:
    """A row for each proposal, best first."""
    shared = {name for proposal in planned.proposals for name in proposal.stderr}
    rows = []
    for proposal in planned.proposals[:MAX_SHOWN]:
        power = {} if np.isnan(proposal.power) else {"power": percent_of(proposal)}
        errors = {
            f"error of {name}": f"x {proposal.stderr[name] / today:.2g}" if name in proposal.stderr else "-"
            for name, today in planned.stderr.items()
            if today > 0 and name in shared
        }
        rows.append({"change": proposal.change.name, **power, **errors, "what to do": proposal.text})
    return rows


def plan_text(planned: Plan) -> str:
    """The names in question, the proposals as a table, and the advice."""
    rows = plan_rows(planned)
    widths = {key: max(len(key), *(len(row[key]) for row in rows)) for key in rows[0]}
    lines = ["  ".join(key.ljust(width) for key, width in widths.items())]
    lines += ["  ".join(row[key].ljust(width) for key, width in widths.items()).rstrip() for row in rows]
    question = ", ".join(f"{name} ({100 * share:.0f} %)" for name, share in planned.probabilities.items())
    asked = f"In question: {question}" if len(planned.probabilities) > 1 else "One answer is left: ranked by precision"
    return "\n".join([asked, *lines, *advice(planned)])


def needs_text(planned: Plan, name: str, stderr: float) -> str:
    """What a fitted value needs to be known to a standard error, in its unit, as a sentence."""
    estimate = planned.fitted.estimates[name]
    head = f"{name} to {with_unit(f'{stderr:.2g}', estimate.unit)} ({100 * stderr / abs(estimate.value):.2g} %)"
    ways = planned.needs(name, stderr)
    if not ways:
        return f"{head}: neither more clips nor one better known systematic error is enough."
    if not ways[0].clips and not ways[0].source:
        return f"{head}: it is known to that already."
    return f"{head}: {', or '.join(_way_text(planned, way) for way in ways)}."


def _way_text(planned: Plan, way: Need) -> str:
    clips = [f"{way.clips} more clip{'s' if way.clips > 1 else ''} like this one"] if way.clips else []
    if not way.source:
        return clips[0]
    known, error = planned.fitted.estimates.get(way.source), ""
    if known is not None and known.stderr > 0:
        error = f", {with_unit(f'{way.factor * known.stderr:.2g}', known.unit)}"
    return " and ".join([*clips, f"{way.source} known to {way.factor:.2g} times its error today{error}"])


def plan_document(planned: Plan, wanted: Mapping[str, float] = MappingProxyType({})) -> PlanDocument:
    """The content of plan.json; what is not known is null.

    ``wanted`` holds standard errors by the name of the value that is to be known so well, in its unit.
    """
    needs = [{"parameter": name, "stderr": error, "ways": planned.needs(name, error)} for name, error in wanted.items()]
    named = {name: getattr(planned, name) for name in ("probabilities", "stderr", "proposals")}
    return PlanDocument.of({**named, "advice": advice(planned), "precision": needs})


def change_of(document: PlanDocument, name: str) -> SetUpChange:
    """The change of that name of a plan on disk; UnknownNameError lists those that it holds."""
    entries = {proposal.change.name: proposal.change for proposal in document.proposals}
    if name not in entries:
        raise UnknownNameError(f"no change is named {name!r}; there are: {', '.join(entries)}")
    given = entries[name].model_dump()
    return SetUpChange(**{**given, "without": tuple(given["without"])})


def decision_text(decision: Decision) -> str:
    """What the new clip left, with the probability of each name."""
    shares = ", ".join(f"{name} {100 * share:.3g} %" for name, share in decision.probabilities.items())
    left = f"leaves {decision.names[0]}" if len(decision.names) == 1 else f"leaves {' or '.join(decision.names)}"
    doubt = "" if decision.described else f"\n{NOT_DECIDED}"
    return f"The new clip {left}: {shares}{doubt}"


def limits_document(limits: DetectionLimits) -> LimitsDocument:
    """The content of plan.json before any clip; sizes that no clip shows are null."""
    return LimitsDocument.of(limits)


def limits_text(limits: DetectionLimits, wanted: float | None) -> str:
    """A table of the smallest sizes over start and length, and which clips show the size that is wanted."""
    heads = [limits.varied, *(f"{seconds:.3g} s" for seconds in limits.seconds)]
    rows = [
        [f"{start:.3g}", *(f"{size:.2g}" + ("*" if wanted is not None and size <= abs(wanted) else "") for size in row)]
        for start, row in zip(limits.starts, limits.sizes, strict=True)
    ]
    lines = ["  ".join(cell.rjust(9) for cell in row) for row in (heads, *rows)]
    said = f"Smallest {limits.effect} ({limits.unit or '1'}) that half of the clips show"
    shows = [] if wanted is None else [f"* shows {wanted:g} {limits.unit}".rstrip()]
    return "\n".join([f"{said}, by start and length of the clip:", *lines, *shows])
