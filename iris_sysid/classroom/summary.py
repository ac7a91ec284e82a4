"""What a class found: each group's value, those that stand out with the cause, the value of all, how right it is."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitters.noise.random_effects import MIN_CLIPS, random_effects
from iris_sysid.classroom.causes import Cause, causes_of
from iris_sysid.classroom.outliers import deviations
from iris_sysid.errors import DataError, UnknownNameError
from iris_sysid.io.schemas import GroupDocument, number
from iris_sysid.registry import MODELS
from iris_sysid.report.text import shown_unit, two_digits, with_error
from iris_sysid.types import Estimate, OdeModel, Population

NOT_FOUND = "no cause found"
COMMON = ("gravity",)  # a constant that all groups take from the same place
AGREES = 2.0  # standard errors


@dataclass(frozen=True, eq=False, slots=True)
class GroupResult:
    """One group of a class.

    ``value`` is None where it has none; ``in_errors`` its distance from the other groups in standard errors, the
    scatter between groups included. ``pooled`` says whether it is in the value of all.
    """

    document: GroupDocument
    value: Estimate | None
    in_errors: float
    outlying: bool
    causes: tuple[Cause, ...]
    pooled: bool
    page: str

    @property
    def name(self) -> str:
        """Of the group."""
        return self.document.group

    @property
    def named(self) -> bool:
        """Whether it is one of those to look at: it stands out, has no value, or shows a fault."""
        return self.outlying or bool(self.causes)

    @property
    def cause(self) -> str:
        """Why, in plain words; empty for a group that does not stand out."""
        return "; ".join(cause.text for cause in self.causes) or (NOT_FOUND if self.outlying else "")


@dataclass(frozen=True, slots=True)
class ReferenceCheck:
    """The value of the class beside a reference: what is known, or the teacher's own."""

    label: str
    reference: Estimate
    difference: Estimate

    @property
    def in_errors(self) -> float:
        """The difference in its standard errors."""
        return abs(self.difference.value / self.difference.stderr) if self.difference.stderr > 0 else math.inf

    @property
    def text(self) -> str:
        """Whether both agree, and how far apart they are."""
        value = self.reference.value
        share = f"{abs(100 * self.difference.value / value):.2g} %" if value else with_error(self.difference)
        word = "agrees with" if self.in_errors <= AGREES else "differs from"
        side = "above" if self.difference.value > 0 else "below"
        return (
            f"{word} {self.label}, {with_error(self.reference)}: {share} {side}, {self.in_errors:.1f} standard errors"
        )


@dataclass(frozen=True, eq=False, slots=True)
class ClassResult:
    """A class: the ``value`` that is compared, its groups, and the value of all.

    ``pooled`` leaves out outliers, ``every`` does not; both are None where there are too few groups. ``others`` holds
    the further values that were fitted. ``comparisons`` are with what is known, and with the teacher's own.
    """

    value: str
    model: OdeModel
    groups: tuple[GroupResult, ...]
    pooled: Population | None
    every: Population | None
    others: Mapping[str, Population]
    comparisons: tuple[ReferenceCheck, ...]
    teacher: GroupResult | None = None

    @property
    def named(self) -> list[GroupResult]:
        """The groups to look at."""
        return [group for group in self.groups if group.named]

    @property
    def sentence(self) -> str:
        """The value of the class in one sentence."""
        used = sum(group.pooled for group in self.groups)
        if self.pooled is None:
            return f"{used} of {len(self.groups)} groups have a value of {shown_name(self.value)}: too few for a mean"
        factor = shown_unit(self.pooled.mean.unit)[1]
        between = self.pooled.between.value * factor
        size = f"{two_digits(between)} {shown_unit(self.pooled.mean.unit)[0]}" if between > 0 else ""
        scatter = f"groups scatter by {size}" if size else ""
        mean = f"{shown_name(self.value)} {with_error(self.pooled.mean)} from {used} of {len(self.groups)} groups"
        return "; ".join(filter(None, [mean, scatter or "groups scatter by no more than their errors"]))


def shown_name(name: str) -> str:
    """The name of a value as a reader sees it."""
    return name.replace("_", " ")


def summary_of(
    documents: Sequence[GroupDocument],
    pages: Sequence[str],
    *,
    value: str | None = None,
    known: Mapping[str, Estimate] | None = None,
    teacher: tuple[GroupDocument, str] | None = None,
) -> ClassResult:
    """Compare the groups of a class.

    Parameters
    ----------
    documents
        What each group measured.
    pages
        The page of each, as a link.
    value
        Name of the value to compare; without it the first that ``known`` names, then the first that was fitted.
    known
        Known values by name.
    teacher
        What the teacher measured, and the page; it is in no mean.

    Raises
    ------
    DataError
        When there is no group, or they have several models.
    UnknownNameError
        When no group has the requested value.
    """
    if not documents:
        raise DataError("a class has at least one group")
    model = _model_of(documents)
    known = known or {}
    chosen = value or next(iter(known), None) or _first_value(documents, model)
    _check_values(documents, [chosen, *known])
    groups = _groups(documents, pages, chosen, documents)
    own = None
    if teacher is not None:
        measured, page = teacher
        (own,) = _groups([measured], [page], chosen, [*documents, measured])
        own = replace(own, pooled=False, outlying=False)
    pooled = _pooled(groups, chosen)
    return ClassResult(
        value=chosen,
        model=model,
        groups=tuple(groups),
        pooled=pooled,
        every=_population([group.document for group in groups if group.value is not None], chosen),
        others=_others(groups, chosen, model),
        comparisons=tuple(_comparisons(groups, chosen, pooled, known, own)),
        teacher=own,
    )


def _model_of(documents: Sequence[GroupDocument]) -> OdeModel:
    names = {document.model for document in documents}
    if len(names) > 1:
        raise DataError(f"these groups have different models: {', '.join(sorted(names))}; compare those of one")
    return MODELS[names.pop()]


def _first_value(documents: Sequence[GroupDocument], model: OdeModel) -> str:
    """The first physical value of the model that most groups fitted; the first that any did, where none is."""
    fitted = Counter(name for document in documents for name in document.free)
    physical = [item.name for item in model.parameters if item.role in ("physical", "gravity") and fitted[item.name]]
    often = [name for name in physical if fitted[name] >= max(fitted[other] for other in physical)]
    return next(iter([*often, *fitted, *(item.name for item in model.parameters)]))


def _check_values(documents: Sequence[GroupDocument], names: Sequence[str]) -> None:
    usable = [document for document in documents if document.usable]
    have = list(dict.fromkeys(name for document in usable for name in document.parameters))
    for name in names:
        if usable and name not in have:
            raise UnknownNameError(f"no group has a value {name!r:.60}; they have {', '.join(have)}")
        held = usable and not any(name in document.free or _is_derived(document, name) for document in usable)
        if held:
            raise DataError(f"{name} is held in every group, not measured: free it, or compare another value")


def _is_derived(document: GroupDocument, name: str) -> bool:
    return name in document.parameters and document.parameters[name].measurement_type == "derived"


def _value_of(document: GroupDocument, name: str) -> Estimate | None:
    """A group's own value with its standard error; None where it was held, or is not determined."""
    estimate = document.estimate(name) if document.usable else None
    if estimate is None or not (name in document.free or _is_derived(document, name)):
        return None
    return estimate if math.isfinite(estimate.stderr) and estimate.stderr > 0 else None


def _groups(
    documents: Sequence[GroupDocument], pages: Sequence[str], name: str, every: Sequence[GroupDocument]
) -> list[GroupResult]:
    values = [_value_of(document, name) for document in documents]
    numbers = np.array([[math.nan, math.nan] if item is None else [item.value, item.stderr] for item in values])
    in_errors, outlying = deviations(*numbers.T)
    return [
        GroupResult(
            document=document,
            value=value,
            in_errors=float(distance),
            outlying=bool(out),
            causes=causes_of(document, every, bool(out)) or _without_value(value),
            pooled=value is not None and not out,
            page=page,
        )
        for document, value, distance, out, page in zip(documents, values, in_errors, outlying, pages, strict=True)
    ]


def _without_value(value: Estimate | None) -> tuple[Cause, ...]:
    return () if value is not None else (Cause("imprecise", "its data do not determine the value", ""),)


def _pooled(groups: Sequence[GroupResult], name: str) -> Population | None:
    return _population([group.document for group in groups if group.pooled], name)


def _population(documents: Sequence[GroupDocument], name: str) -> Population | None:
    """The mean over groups and the scatter between them; the error of common constants is added once."""
    measured = [(document, value) for document in documents if (value := _value_of(document, name)) is not None]
    if len(measured) < MIN_CLIPS:
        return None
    common = np.array([_common(document, name) for document, _ in measured])
    stderrs = np.array([value.stderr for _, value in measured])
    own = np.sqrt(np.maximum(stderrs**2 - common**2, (1e-6 * stderrs) ** 2))
    population = random_effects(np.array([value.value for _, value in measured]), own, measured[0][1].unit)
    shared = float(np.mean(common))
    mean = population.mean
    stderr = math.hypot(mean.stderr, shared)
    half = (mean.interval[1] - mean.value) * stderr / mean.stderr
    source = f"mean over {len(measured)} groups"
    whole = replace(mean, stderr=stderr, ci95=(mean.value - half, mean.value + half), source=source)
    return replace(population, mean=whole)


def _common(document: GroupDocument, name: str) -> float:
    """Standard error of a value from the constants that all groups take from the same place."""
    return math.hypot(*(number(part) for source, part in document.budget.get(name, {}).items() if source in COMMON))


def _others(groups: Sequence[GroupResult], chosen: str, model: OdeModel) -> dict[str, Population]:
    """The means of the further physical values that the groups fitted."""
    names = [item.name for item in model.parameters if item.role in ("physical", "gravity", "damping")]
    found = {name: _pooled(groups, name) for name in names if name != chosen}
    return {name: population for name, population in found.items() if population is not None}


def _comparisons(
    groups: Sequence[GroupResult],
    chosen: str,
    pooled: Population | None,
    known: Mapping[str, Estimate],
    teacher: GroupResult | None,
) -> list[ReferenceCheck]:
    found = []
    for name, reference in known.items():
        population = pooled if name == chosen else _pooled(groups, name)
        if population is not None:
            label = "what is known" if name == chosen else f"what is known of {shown_name(name)}"
            found.append(_comparison(label, population.mean, reference))
    if teacher is not None and teacher.value is not None and pooled is not None:
        # one more group: its pendulum differs from the others' as they do among themselves
        stderr = math.hypot(teacher.value.stderr, pooled.between.value)
        found.append(_comparison("the teacher's own", pooled.mean, replace(teacher.value, stderr=stderr, ci95=None)))
    return found


def _comparison(label: str, mean: Estimate, reference: Estimate) -> ReferenceCheck:
    stderr = math.hypot(mean.stderr, reference.stderr if math.isfinite(reference.stderr) else 0.0)
    return ReferenceCheck(label, reference, Estimate(mean.value - reference.value, stderr, mean.unit, "derived"))
