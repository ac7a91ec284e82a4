"""The verdict on a result: whether its numbers can be used, and whether its equation is complete."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

FitReason = Literal[
    "too-few-samples",
    "missing-value",
    "rate-not-finite",
    "solution-diverges",
    "not-converged",
    "undetermined",
    "at-bound",
    "residual-above-noise",
]
TrackDoubtKind = Literal[
    "another-body",
    "shadow",
    "missed",
    "jumps",
    "unsteady-size",
    "faint",
    "ambiguous",
    "moving-camera",
    "off-marks",
    "held",
    "unknown-transfer",
    "exposure",
    "saturated",
]
ResultDoubtKind = Literal[
    "clock",
    "scale",
    "phenomenon",
    "degrees",
    "plane-view",
    "several-names",
    "incomplete",
    "imprecise",
    "little-explained",
    "poorly-predicted",
]
DoubtKind = Literal[TrackDoubtKind, ResultDoubtKind, FitReason]
VerdictWord = Literal["good", "doubtful", "failed"]
VERDICT_WORDS: tuple[VerdictWord, ...] = get_args(VerdictWord)  # the best first
SPOKEN: Mapping[VerdictWord, str] = {"good": "usable", "doubtful": "doubtful", "failed": "failed"}
OF_THE_EQUATION: tuple[DoubtKind, ...] = ("residual-above-noise", "incomplete")
MAX_ACCURACIES = 3  # values whose accuracy the text gives
WHOLE_PERCENT = 0.995  # relative error from which percents are given without decimals


@dataclass(frozen=True, slots=True)
class Doubt:
    """One reason to doubt a track or a result: what was found, and the option that helps."""

    kind: DoubtKind
    finding: str
    remedy: str

    @property
    def text(self) -> str:
        """Finding and remedy in one line."""
        return f"{self.finding}; {self.remedy}" if self.remedy else self.finding


def explained_percent(share: float) -> str:
    """A share of the motion in percent, with two digits of what is lacking: 0.994 is "99.4 %", 0.99997 "99.997 %"."""
    lacking = 100 * (1 - min(max(share, 0.0), 1.0))
    if lacking < 1e-4:
        return "over 99.9999 %"
    return f"{100 - lacking:.{max(0, -math.floor(math.log10(lacking)))}f} %"


def times_text(ratio: float) -> str:
    """A ratio with two digits, written out: "1.0 times", "210 times"."""
    rounded = float(f"{ratio:.2g}")
    return f"{rounded:.{'1f' if 1 <= rounded < 10 else '15g'}} times"


@dataclass(frozen=True, slots=True)
class Completeness:
    """How much of the motion an equation explains.

    ``explained`` is the fraction of the motion's variance that the equation explains, NaN where it is not known;
    ``complete`` says whether the data show no sign that it lacks something. ``residual_over_noise`` is the ratio of the
    two root mean squares, NaN where the noise is not known. ``rest`` says in a clause what the residual is made of;
    empty where that is not known.
    """

    explained: float
    complete: bool
    residual_over_noise: float = math.nan
    rest: str = ""

    @property
    def text(self) -> str:
        """Whether it is complete, what it explains, and what the residual is, in one line."""
        clauses = [
            f"it explains {explained_percent(self.explained)} of the motion" if math.isfinite(self.explained) else "",
            f"the residual is {times_text(self.residual_over_noise)} the noise"
            if math.isfinite(self.residual_over_noise)
            else "",
            self.rest,
        ]
        word = "equation complete" if self.complete else "equation incomplete"
        return ": ".join(filter(None, [word, "; ".join(filter(None, clauses))]))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether the numbers of a result can be used, and whether its equation is complete.

    ``word`` is about the numbers. ``good``: they can be used with their errors, which allow for what the equation
    lacks. ``doubtful``: evidence says that they may be wrong or are undetermined. ``failed``: there are no numbers.
    ``equation`` says how much of the motion the equation explains; None where there is no fit. ``reasons`` say why the
    word is not ``good`` or the equation not complete, causes first. ``accuracy`` holds the relative standard error of
    the values that matter by name, the first one first.
    """

    word: VerdictWord
    reasons: tuple[Doubt, ...] = ()
    equation: Completeness | None = None
    accuracy: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def good(self) -> bool:
        """Whether the numbers can be used with their errors."""
        return self.word == "good"

    @property
    def complete(self) -> bool:
        """Whether nothing says that the equation lacks something."""
        return self.equation is None or self.equation.complete

    @property
    def number_reasons(self) -> tuple[Doubt, ...]:
        """The reasons to doubt the numbers."""
        return tuple(doubt for doubt in self.reasons if doubt.kind not in OF_THE_EQUATION)

    @property
    def equation_reasons(self) -> tuple[Doubt, ...]:
        """The reasons why the equation is not complete."""
        return tuple(doubt for doubt in self.reasons if doubt.kind in OF_THE_EQUATION)

    @property
    def accuracy_text(self) -> str:
        """The relative standard errors, e.g. ``length good to 0.7 %, mass to 12 %``; empty without any."""
        some = list(self.accuracy.items())[:MAX_ACCURACIES]
        return ", ".join(
            f"{name.replace('_', ' ')} {'to' if k else 'good to'} {relative_text(error)}"
            for k, (name, error) in enumerate(some)
        )

    @property
    def text(self) -> str:
        """Both axes in one line."""
        about = self.accuracy_text if self.good else ". ".join(doubt.text for doubt in self.number_reasons)
        number = ": ".join(filter(None, [SPOKEN[self.word], about]))
        return ". ".join(filter(None, [number, self.equation.text if self.equation is not None else ""]))


def relative_text(error: float) -> str:
    """A standard error over its value in percent, e.g. ``0.68 %``, ``154 %``."""
    return f"{100 * error:{'.2g' if error < WHOLE_PERCENT else '.0f'}} %"


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on results that belong together: the worst of each axis, and each reason once."""
    every = list(verdicts)
    word: VerdictWord = max((verdict.word for verdict in every), key=VERDICT_WORDS.index, default="good")
    reasons = tuple(dict.fromkeys(doubt for verdict in every for doubt in verdict.reasons))
    accuracy: dict[str, float] = {}
    for verdict in every:
        for name, error in verdict.accuracy.items():
            accuracy[name] = max(error, accuracy.get(name, 0.0))
    equations = [verdict.equation for verdict in every if verdict.equation is not None]
    return Verdict(word, reasons, _worst_equation(equations), accuracy)


def _worst_equation(equations: list[Completeness]) -> Completeness | None:
    """The one that explains least, incomplete where one of them is."""
    if not equations:
        return None
    worst = min(equations, key=lambda one: (one.complete, one.explained if math.isfinite(one.explained) else math.inf))
    ratios = [one.residual_over_noise for one in equations if math.isfinite(one.residual_over_noise)]
    return Completeness(worst.explained, worst.complete, max(ratios, default=math.nan), worst.rest)
