"""The verdict on a result: good, doubtful, misfit or failed, with the reasons and what to do about each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
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
ResultDoubtKind = Literal["clock", "scale", "phenomenon", "degrees", "plane-view", "several-names", "incomplete"]
DoubtKind = Literal[TrackDoubtKind, ResultDoubtKind, FitReason]
VerdictWord = Literal["good", "doubtful", "misfit", "failed"]
VERDICT_WORDS: tuple[VerdictWord, ...] = get_args(VerdictWord)  # the best first


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


@dataclass(frozen=True, slots=True)
class Verdict:
    """How far a result can be used: ``word``, and the ``reasons`` why it is not ``good``, causes first.

    ``good``: nothing speaks against it. ``doubtful``: there are numbers, but evidence says that they may be wrong or
    are undetermined. ``misfit``: the equation does not describe the motion, so the numbers mean little. ``failed``:
    there are no numbers.
    """

    word: VerdictWord
    reasons: tuple[Doubt, ...] = ()

    @property
    def good(self) -> bool:
        """Whether nothing speaks against the result."""
        return self.word == "good"

    @property
    def text(self) -> str:
        """The word and the reasons in one line."""
        return ": ".join(filter(None, [self.word, ". ".join(doubt.text for doubt in self.reasons)]))


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on results that belong together: the worst word, and each reason once."""
    every = list(verdicts)
    word: VerdictWord = max((verdict.word for verdict in every), key=VERDICT_WORDS.index, default="good")
    return Verdict(word, tuple(dict.fromkeys(doubt for verdict in every for doubt in verdict.reasons)))
