"""What is said of a recording with an implant, against what is said of it as it is: levels, extra names, intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from iris_sysid import EFFECTS, Diagnosis, Estimate
from iris_sysid.types import SIDES
from validation.world_recordings import Recording

NORMAL_975 = 1.96
LEVELS = ("named", "class", "located", "missed")
MEASURED = frozenset({"measurement", "clock"})

Number = tuple[float, float]  # a value and its standard error


@dataclass(frozen=True, eq=False, slots=True)
class Hidden:
    """What is implanted.

    ``right`` are the library's names for it, ``kinds`` the components that it belongs to, ``parameter`` the library's
    size that has the same definition (empty: none).
    """

    name: str
    right: frozenset[str]
    kinds: frozenset[str]
    parameter: str


@dataclass(frozen=True, slots=True)
class Answer:
    """What the diagnosis says of one clip.

    ``size`` is that of the implant, ``ratio`` its trace over the recording's residual; ``skipped`` says why there is
    no implant, ``failed`` why no diagnosis. ``classes`` are the names added, each with those indistinguishable from it;
    ``findings`` are (word, component, effects), ``similar`` the kinds that can take the place of a component that is
    left, ``components`` (kind, share). ``values`` are the parameters of the
    model and ``sizes`` those of the effects, each with its standard error; ``residual`` is the root mean square of the
    base model's; ``doubts`` are kinds of doubt of the run.
    """

    recording: str
    implant: str = ""
    multiple: float = 0.0
    size: float = 0.0
    ratio: float = 0.0
    skipped: str = ""
    failed: str = ""
    classes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    findings: Sequence[tuple[str, str, Sequence[str]]] = ()
    similar: Mapping[str, Sequence[str]] = field(default_factory=dict)
    components: Sequence[tuple[str, float]] = ()
    values: Mapping[str, Number] = field(default_factory=dict)
    sizes: Mapping[str, Number] = field(default_factory=dict)
    residual: float = 0.0
    doubts: Sequence[str] = ()
    seconds: float = 0.0

    @property
    def added(self) -> frozenset[str]:
        """The names that are given."""
        return frozenset(self.classes)

    @property
    def usable(self) -> bool:
        """Whether there is a diagnosis."""
        return not (self.skipped or self.failed)


def said(found: Diagnosis) -> dict[str, Any]:
    """The part of an :class:`Answer` that comes from a diagnosis, by field; it may lack components and findings."""
    free = [parameter.name for parameter in found.base.model.parameters if parameter.name in found.final.free]
    parts = found.components.parts if found.components is not None else ()
    left = found.remaining.parts if found.remaining is not None else ()
    return {
        "classes": {effect.name: [effect.name, *found.indistinguishable[effect.name]] for effect in found.added},
        "findings": [(each.word, each.component or "", list(each.effects)) for each in found.findings],
        "similar": {part.kind: list(part.similar) for part in left},
        "components": [(part.kind, float(part.share)) for part in parts],
        "values": {name: _number(found.final.estimates[name]) for name in free},
        "sizes": {name: _number(estimate) for name, estimate in found.sizes.items()},
        "residual": math.hypot(*found.base.rms) / math.sqrt(found.base.rms.size),
        "doubts": [doubt.kind for doubt in found.verdict.reasons],
    }


def _number(estimate: Estimate) -> Number:
    return float(estimate.value), float(estimate.stderr)


@dataclass(frozen=True, slots=True)
class Score:
    """One implant: the level at which it is found, and what else the answer says.

    ``already`` is the level that the same effect has in the recording as it is. ``extra`` are names that neither the
    implant nor the recording explains, ``changed`` those that came or went beside the implant's. ``held`` says of each
    parameter whether it is the same within the combined error, ``sized`` of the size whether its 95 % interval holds
    the truth (None where it cannot be compared). ``new_doubts`` are kinds of doubt that came with the implant.
    """

    level: str
    already: str
    extra: tuple[str, ...]
    changed: tuple[str, ...]
    held: Mapping[str, bool]
    sized: bool | None
    new_doubts: tuple[str, ...]


def level(hidden: Hidden, answer: Answer, before: Answer | None = None) -> str:
    """How well an answer names an implant; in a video a new reading or clock counts as the place of it.

    A component without an effect is named by its kind: a wander of the zero is all that there is to say of one.

    Parameters
    ----------
    hidden
        The implant.
    answer
        What was said with it.
    before
        What was said of the recording as it is, for a video.
    """
    told = {component for word, component, effects in answer.findings if word in ("located", "open") and not effects}
    if hidden.right & (answer.added | told):
        return "named"
    groups = [effects for word, _, effects in answer.findings if word == "group"]
    alike = [answer.similar.get(component, ()) for component in told]
    if any(hidden.right & set(names) for names in [*answer.classes.values(), *groups, *alike]):
        return "class"
    if hidden.kinds & {component for _, component, _ in answer.findings}:
        return "located"
    return "located" if before is not None and measured_newly(answer, before) else "missed"


def measured_newly(answer: Answer, before: Answer) -> bool:
    """Whether the largest new component, or a new name, is of the reading or of the clock."""
    new = [(share, kind) for kind, share in answer.components if kind not in dict(before.components)]
    if new and SIDES[max(new)[1]] in ("reading", "clock"):
        return True
    return any(EFFECTS[name].cause in MEASURED for name in _effects(answer) - _effects(before) if name in EFFECTS)


def _effects(answer: Answer) -> set[str]:
    return answer.added | {name for _, _, effects in answer.findings for name in effects}


def extra_names(hidden: Hidden, answer: Answer, before: Answer, recording: Recording) -> tuple[str, ...]:
    """Names in whose class nothing is that the implant, the recording or its own diagnosis explains."""
    explained = hidden.right | recording.right | recording.plausible | before.added
    return tuple(name for name, names in answer.classes.items() if not explained & set(names))


def changed_names(hidden: Hidden, answer: Answer, before: Answer) -> tuple[str, ...]:
    """Names that came, or went from all findings, but for those that stand for the implant.

    What was the largest part of a residual is a small one beside the implant: then it may be told without a name.
    """
    standing = {name for each in (answer, before) for name, names in each.classes.items() if hidden.right & set(names)}
    came, gone = answer.added - _effects(before), before.added - _effects(answer)
    return tuple(sorted((came | gone) - standing))


def same(first: Number, second: Number) -> bool:
    """Whether two values differ by less than 95 % of their combined error."""
    return abs(first[0] - second[0]) <= NORMAL_975 * math.hypot(first[1], second[1])


def size_holds(hidden: Hidden, answer: Answer, before: Answer) -> bool | None:
    """Whether the size grew by the implant's; None where no size of the same definition is given.

    A force of either phase has either sign.
    """
    if hidden.parameter not in answer.sizes:
        return None
    own = before.sizes.get(hidden.parameter, (0.0, 0.0))
    value, stderr = answer.sizes[hidden.parameter]
    if hidden.parameter == "periodic_forcing":
        value, own = abs(value), (0.0, 0.0)
    return same((value, stderr), (own[0] + answer.size, own[1]))


def score(hidden: Hidden, answer: Answer, before: Answer, recording: Recording, *, filmed: bool = False) -> Score:
    """Compare the answer with an implant with that for the recording as it is."""
    both = [name for name, value in before.values.items() if name in answer.values and math.isfinite(value[1])]
    return Score(
        level(hidden, answer, before if filmed else None),
        level(hidden, before),
        extra_names(hidden, answer, before, recording),
        changed_names(hidden, answer, before),
        {name: same(answer.values[name], before.values[name]) for name in both},
        size_holds(hidden, answer, before),
        tuple(sorted(set(answer.doubts) - set(before.doubts))),
    )
