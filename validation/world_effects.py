"""Real recordings: what the diagnosis says of each, against what was known beforehand and what a physicist finds.

``python -m validation.world_effects --reference FOLDER [--write-docs]`` needs the recordings in ``../shared/data``.
FOLDER has, or gets, the rows of :mod:`validation.reference_fits`; without it only what was known counts. About half of
the recordings are sealed, by a hash of the name: they are scored with ``--sealed`` (or ``--write-docs``), and are not
looked at while the programs are written. Each recording runs in a separate process and ``--seconds``; answers in
``--folder`` are not computed again, but judged anew (:mod:`validation.world_answers`).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from iris_sysid import EFFECTS
from validation import pages, reference_fits
from validation.reference_fits import Row, places, supported
from validation.world_answers import Answer, answer_of
from validation.world_recordings import SEEN, Recording, chosen, sealed

WORDS = ("as known", "group", "located", "incomplete", "wrong", "failed", "no answer")
WORSE = 1.2  # held-out error over that of the reference, above which something is still missing
LARGE = 0.2  # share of the residual's variance from which a part that is not the largest counts as well
PLACES = ("force", "own-force", "reading", "zero")  # on a motion that never turns, force and reading look alike


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one recording: one of ``WORDS``, and the answer that it is of.

    ``agrees`` says whether the reference has one of its large parts too, ``ratio`` is the held-out error over the
    reference's; None where there is nothing to compare.
    """

    answer: Answer
    word: str
    agrees: bool | None = None
    ratio: float | None = None

    @property
    def name(self) -> str:
        """The recording's."""
        return self.answer.name

    @property
    def sealed(self) -> bool:
        """Whether it may not be looked at while the programs are written."""
        return sealed(self.name)


def agreement(recording: Recording, answer: Answer, reference: Row | None) -> bool | None:
    """Whether a large part, or what can take the largest one's place, is in the reference; None where one has none."""
    found = set() if reference is None else places(reference)
    if not answer.parts or not found:
        return None
    largest = answer.parts[0]
    kinds = {largest.kind, *largest.similar, *(part.kind for part in answer.parts if part.share >= LARGE)}
    if recording.turns:
        return bool(kinds & found)
    return bool(kinds & found) or all(any(kind.startswith(PLACES) for kind in each) for each in (kinds, found))


def ratio_of(answer: Answer, reference: Row | None) -> float | None:
    """The held-out error over that of the reference; None where they were not held out alike."""
    if reference is None or not reference.alike or not answer.after > 0:
        return None
    return answer.after / reference.chosen.heldout


def is_wrong(recording: Recording, answer: Answer, allowed: set[str]) -> bool:
    """Whether an effect is named that the sensor cannot have, or that neither the rig nor the reference has."""
    impossible = any(recording.sensor not in EFFECTS[name].sensors for name in answer.added)
    return impossible or any(not set(group) & allowed for group in answer.groups)


def word_of(recording: Recording, answer: Answer, reference: Row | None = None) -> str:
    """Compare what the diagnosis says with what was known and with what the reference finds: one of ``WORDS``."""
    if answer.failed:
        return "no answer" if answer.failed.startswith("no answer") else "failed"
    found = set() if reference is None else supported(reference)
    beside = set() if reference is None else reference_fits.allowed(reference)
    allowed, wanted = recording.right | recording.plausible | beside, recording.right | found
    if is_wrong(recording, answer, allowed):
        return "wrong"
    agrees = agreement(recording, answer, reference)
    if answer.added and (not wanted or any(set(group) & wanted for group in answer.groups)):
        return named(set(answer.added), allowed, wanted, ratio_of(answer, reference))
    if agrees is False:
        return "wrong"
    if recording.outside and answer.incomplete:
        return "as known"
    if agrees:
        return "located"
    lacks = answer.incomplete if reference is None else reference.chosen.terms
    return "incomplete" if recording.right or recording.outside or lacks else "as known"


def named(added: set[str], allowed: set[str], wanted: set[str], ratio: float | None) -> str:
    """The verdict on effects of which at least one group is right."""
    if ratio is not None and ratio > WORSE:
        return "incomplete"
    return "as known" if added <= allowed and (not wanted or added & wanted) else "group"


def judged(recording: Recording, answer: Answer, reference: Row | None) -> Verdict:
    """The verdict on an answer."""
    return Verdict(
        answer,
        word_of(recording, answer, reference),
        agreement(recording, answer, reference),
        ratio_of(answer, reference),
    )


def reference_of(recording: Recording, folder: Path | None) -> Row | None:
    """What the reference finds, from its folder; None without one, or without the recording's equation in it."""
    if folder is None or not reference_fits.has_motion(recording):
        return None
    return reference_fits.kept(recording, folder)


def line(recording: Recording, verdict: Verdict) -> str:
    """One row of the table."""
    agrees = {True: ", agrees", False: ", differs", None: ""}[verdict.agrees]
    cells = (
        f"{recording.name}{' (sealed)' if verdict.sealed else ''}",
        f"{recording.known}. *{recording.source}*",
        f"{recording.sensor}; {recording.model.name}",
        names_in(verdict.answer),
        f"{verdict.answer.parts[0] if verdict.answer.parts else ''}{agrees}",
        "" if verdict.ratio is None else f"{verdict.ratio:.2f}",
        verdict.word,
    )
    return f"| {' | '.join(cells)} |"


def names_in(answer: Answer) -> str:
    """The names given, each with how many others there are that cannot be told apart from it."""
    rivals = {group[0]: len(group) - 1 for group in answer.groups}
    return ", ".join(f"{name} (or {count} more)" if count else name for name, count in rivals.items()) or "nothing"


def summary(verdicts: Sequence[Verdict], label: str) -> str:
    """How many rows came out with which word."""
    counts = {word: sum(verdict.word == word for verdict in verdicts) for word in WORDS}
    parts = ", ".join(f"{word} {count}" for word, count in counts.items() if count)
    return f"{label}: {counts['as known']} of {len(verdicts)} as known ({parts or 'none'})."


def summaries(verdicts: Sequence[Verdict]) -> list[str]:
    """One line for those that may be looked at, and two for the sealed ones: an earlier lot had not sealed them all."""
    lots = (
        ("Looked at", [verdict for verdict in verdicts if not verdict.sealed]),
        ("Sealed, never looked at", [verdict for verdict in verdicts if verdict.sealed and verdict.name not in SEEN]),
        ("Sealed, but looked at before", [verdict for verdict in verdicts if verdict.sealed and verdict.name in SEEN]),
    )
    return [summary(lot, label) for label, lot in lots]


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--without", default="", help="leave out recordings whose name contains this")
    parser.add_argument("--sealed", action="store_true", help="score the sealed recordings as well")
    parser.add_argument("--sentences", action="store_true", help="print what the program says of each as well")
    parser.add_argument("--shapes", action="store_true", help="only load the recordings and print how large they are")
    parser.add_argument("--seconds", type=float, default=300.0, help="after which a diagnosis is given up")
    parser.add_argument("--folder", type=Path, help="where results are kept")
    parser.add_argument("--reference", type=Path, help="where the rows of reference_fits are kept")
    pages.add_option(parser)
    options = parser.parse_args()
    recordings = chosen(options.only, options.without)
    if options.shapes:
        for recording in recordings:
            clips = recording.clips()
            print(recording.name, [clip.position.shape for clip in clips][:8], len(clips), flush=True)
        return
    if not (options.sealed or options.write_docs):
        recordings = [recording for recording in recordings if not sealed(recording.name)]
    with pages.table("world-effects", options.write_docs):
        print("| recording | known beforehand | sensor; model | added | largest part | held out | verdict |")
        print("|---|---|---|---|---|---|---|")
        verdicts = []
        for recording in recordings:
            reference = reference_of(recording, options.reference)
            answer = answer_of(recording.name, options.seconds, options.folder)
            verdicts.append(judged(recording, answer, reference))
            print(line(recording, verdicts[-1]), flush=True)
            if options.sentences:
                print(f"{answer.seconds:.0f} s: {answer.failed or answer.sentence}", flush=True)
        print()
        print("\n".join(summaries(verdicts)))


if __name__ == "__main__":
    main()
