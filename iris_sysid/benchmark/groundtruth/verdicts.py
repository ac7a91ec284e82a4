"""Evidence against the values of a setting: how many of its clips are doubtful or incomplete, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement
from iris_sysid.types import SPOKEN, Verdict

MAX_REASONS = 2


@dataclass(frozen=True, slots=True)
class SettingVerdict:
    """The verdict on all clips of a setting, in words.

    ``numbers``: ``usable``, or how many are not; ``equation``: ``complete``, or how many are not; ``doubts``: the
    most frequent reasons to doubt the numbers, empty where there is none.
    """

    numbers: str
    equation: str
    doubts: str


def verdict_on(clips: Sequence[ClipMeasurement]) -> SettingVerdict:
    """The verdict on the measured clips of one setting; those of runs before 2026-11-24 have none and do not count."""
    documents = [clip.document for clip in clips]
    failed = sum(document.status == "failed" for document in documents)
    verdicts = [document.verdict.verdict() for document in documents if document.verdict is not None]
    words = Counter({"failed": failed}) + Counter(verdict.word for verdict in verdicts)
    bad = [f"{SPOKEN[word]} in {words[word]} of {len(clips)}" for word in ("failed", "doubtful") if words[word]]
    incomplete = sum(not verdict.complete for verdict in verdicts)
    known = bool(verdicts) or failed > 0
    return SettingVerdict(
        numbers=", ".join(bad) or (SPOKEN["good"] if known else ""),
        equation=f"incomplete in {incomplete} of {len(clips)}" if incomplete else "complete" if verdicts else "",
        doubts=_doubts(verdicts),
    )


def _doubts(verdicts: Sequence[Verdict]) -> str:
    """The kinds of doubt that most clips have, each with the finding of the first of them."""
    findings: dict[str, str] = {}
    count: Counter[str] = Counter()
    for verdict in verdicts:
        for doubt in verdict.number_reasons:
            findings.setdefault(doubt.kind, doubt.finding)
        count.update({doubt.kind for doubt in verdict.number_reasons})
    return "; ".join(findings[kind] for kind, _ in count.most_common(MAX_REASONS))
