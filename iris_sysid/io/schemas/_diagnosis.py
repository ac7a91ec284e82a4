"""What a model lacks (diagnosis.json)."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import JsonValue, model_validator

from iris_sysid.io.schemas._discovery import TermEntry
from iris_sysid.io.schemas._fit import FitDocument
from iris_sysid.io.schemas._parts import Document, EstimateEntry, Number, Part, QuantityEntry, VerdictEntry
from iris_sysid.io.schemas._validation import ValidationEntry
from iris_sysid.types import ComponentCurve, ComponentKind, ComponentSide, FindingWord


class AddedEffect(Part):
    """An effect that was added to the model."""

    effect: str
    parameters: dict[str, EstimateEntry]


class Excluded(Part):
    """The largest size of an effect that the data allow; null where they say nothing about it."""

    effect: str
    parameter: str
    upper_95: Number
    unit: str


class FitErrorEntry(Part):
    """Root mean square of the residual over the samples fitted, and over later ones that were held out."""

    fitted: Number
    heldout: Number
    weighed: Number = None
    """The held-out error in units of each sample's noise."""


class FurtherClip(Part):
    """A clip after the first: its fits without and with the effects, and where it comes from."""

    base: FitDocument
    final: FitDocument
    origin: dict[str, JsonValue]


class CurveEntry(Part):
    """A part of a residual as a function of its own argument; rows of tables are values of the argument."""

    argument: str
    """The velocity, the position or the time."""
    unit: str
    """Of the argument."""
    at: list[float]
    quantities: list[QuantityEntry]
    """What the columns of the tables are, with their units."""
    values: list[list[Number]]
    """What changes of the fitted parameters can imitate is removed."""
    stderr: list[list[Number]]

    @model_validator(mode="before")
    @classmethod
    def _of_curve(cls, value: Any) -> Any:
        """A ComponentCurve can stand for its entry."""
        if not isinstance(value, ComponentCurve):
            return value
        arrays = {name: getattr(value, name).tolist() for name in ("at", "values", "stderr")}
        return {"argument": value.argument.name, "unit": value.argument.unit, "quantities": value.quantities, **arrays}


class ComponentEntry(Part):
    """One part of a residual."""

    kind: ComponentKind
    side: ComponentSide
    """Where it lies: in the forces, in the reading, in the clock, or in a measured input."""
    share: Number
    """Fraction of the residual's variance."""
    share_range: tuple[Number, Number]
    """Its smallest and largest value over the explanations, and over the orders in which parts can be added."""
    rms: Number
    """Size of its contribution, in the observed unit."""
    probability: Number
    """That there is such a part."""
    at: EstimateEntry | None = None
    """Moment of a pulse or frequency of a periodic force."""
    similar: list[ComponentKind] = []
    """Kinds that can take its place."""
    curve: CurveEntry | None = None


class ExplanationEntry(Part):
    """A set of parts that explains the residual, with its probability."""

    kinds: list[ComponentKind]
    probability: Number

    @model_validator(mode="before")
    @classmethod
    def _of_pair(cls, value: Any) -> Any:
        return dict(zip(("kinds", "probability"), value, strict=True)) if isinstance(value, tuple) else value


class ComponentsEntry(Part):
    """The additive parts of a residual, largest share first; shares and noise sum to 1."""

    residual_rms: Number
    noise_rms: Number
    """Of the rest that no part explains."""
    motion_rms: Number
    unit: str
    """Of these three."""
    noise_share: Number
    correlation: Number
    """Of that rest, over one sample step."""
    motion_explained: Number
    """Fraction of the motion's variance that the model explains."""
    parts: list[ComponentEntry]
    """Empty where the residual is noise."""
    explanations: list[ExplanationEntry] = []
    """Sets of parts that explain the data about equally well, likeliest first."""


class FindingEntry(Part):
    """The finding on one part of the residual: a named effect, a group of effects, its place, or that it is open."""

    word: FindingWord
    component: ComponentKind | None
    """null where it is open."""
    effects: list[str]
    """The best first."""
    share: Number
    """Fraction of the residual's variance removed in samples held out; null where none could be."""
    reason: str = ""
    """Why no more can be said; empty for a named effect."""


class DiagnosisDocument(Document):
    """What a model lacks, if anything (diagnosis.json)."""

    document: Literal["diagnosis"] = "diagnosis"
    version: Literal[2] = 2
    sentence: str
    """The result in a few sentences: the parts of the residual, the finding on each, the error before and after."""
    components: ComponentsEntry | None = None
    """Parts of the residual of the first clip without effects; null where the clip is too short to be split."""
    remaining: ComponentsEntry | None = None
    """Parts of the residual with the effects."""
    findings: list[FindingEntry] = []
    """The finding on each part."""
    nuisances: list[str] = []
    """Effects that are in the final fit because they improve the prediction, but which are not named."""
    verdict: VerdictEntry | None = None
    """How far the result can be used."""
    base: FitDocument
    """Of the first clip, as ``final``."""
    final: FitDocument
    added: list[AddedEffect]
    """In the order in which they were found; of several clips, their size over all."""
    indistinguishable: dict[str, list[str]]
    """For each effect added, those that explain the data as well."""
    probabilities: dict[str, dict[str, float]] = {}
    """For each effect added, the probability of it and of those that explain the data as well; they sum to 1."""
    causes: dict[str, dict[str, float]] = {}
    """For each effect added, the probability that its cause is the physics, the measurement, or the clock."""
    ruled_out: list[Excluded]
    before: FitErrorEntry
    """Error without the added effects."""
    after: FitErrorEntry
    noise_floor: Number
    """Noise of the measurement."""
    unit: str
    """Of these errors and of the noise."""
    proposed: list[TermEntry] = []
    """Terms without a named effect that the remaining residual suggests; coefficients to first order."""
    notes: list[str] = []
    """What could not be tested, and which effects were rejected, with the reason."""
    validation: ValidationEntry | None = None
    """Of the model with the effects, where a record that was not used was given."""
    validation_before: ValidationEntry | None = None
    """The same of the model without them."""
    further_clips: list[FurtherClip] = []
    origin: dict[str, JsonValue]
