"""Real recordings: what the diagnosis says of each, against what was known beforehand and what a physicist finds.

``python -m validation.world_effects --reference FOLDER [--write-docs]`` needs the recordings in ``../shared/data``.
FOLDER has, or gets, the rows of :mod:`validation.reference_fits`; without it only what was known counts. About half of
the recordings are sealed, by a hash of the name: they are scored with ``--sealed`` (or ``--write-docs``), and are not
looked at while the programs are written. Each recording has a process of its own and ``--seconds``; results in
``--folder`` are not computed again, so that an interrupted run goes on.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from iris_sysid import EFFECTS, Diagnosis, FitError, diagnose, diagnosis_sentence
from validation import pages, reference_fits
from validation.reference_fits import Row, components, supported
from validation.world_recordings import RECORDINGS, SEEN, Recording, sealed

WORDS = ("as known", "group", "located", "incomplete", "wrong", "failed", "no answer")
WORSE = 1.2  # held-out error over that of the reference, above which something is still missing
PLACES = ("force", "own-force", "reading", "zero")  # on a motion that never turns, force and reading look alike


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one recording: ``verdict`` is one of ``WORDS``, ``added`` the names given, and the sentence.

    ``component`` is the largest part of the residual, empty where it was not split; ``agrees`` says whether the
    reference has it too, ``ratio`` is the held-out error over the reference's; None where there is nothing to compare.
    """

    name: str
    verdict: str
    added: tuple[str, ...] = ()
    sentence: str = ""
    seconds: float = 0.0
    component: str = ""
    agrees: bool | None = None
    ratio: float | None = None

    @property
    def sealed(self) -> bool:
        """Whether it may not be looked at while the programs are written."""
        return sealed(self.name)


def agreement(recording: Recording, diagnosis: Diagnosis, reference: Row | None) -> bool | None:
    """Whether the largest component, or one that can take its place, is in the reference; None where one has none."""
    split = diagnosis.components
    found = set() if reference is None else components(reference)
    if split is None or not split.parts or not found:
        return None
    largest = split.parts[0]
    kinds = {largest.kind, *largest.similar}
    if recording.turns:
        return bool(kinds & found)
    return bool(kinds & found) or all(any(kind.startswith(PLACES) for kind in each) for each in (kinds, found))


def ratio_of(diagnosis: Diagnosis, reference: Row | None) -> float | None:
    """The held-out error over that of the reference; None where they were not held out alike."""
    if reference is None or not reference.alike or not diagnosis.after.heldout > 0:
        return None
    return diagnosis.after.heldout / reference.chosen.heldout


def is_wrong(recording: Recording, names: Sequence[set[str]], allowed: set[str], added: Sequence[str]) -> bool:
    """Whether an effect is named that the sensor cannot have, or that neither the rig nor the reference has."""
    impossible = any(recording.sensor not in EFFECTS[name].sensors for name in added)
    return impossible or any(not each & allowed for each in names)


def verdict_of(recording: Recording, diagnosis: Diagnosis, reference: Row | None = None) -> str:
    """Compare what the diagnosis says with what was known and with what the reference finds: one of ``WORDS``."""
    added = [effect.name for effect in diagnosis.added]
    groups = [{name, *diagnosis.indistinguishable[name]} for name in added]
    found = set() if reference is None else supported(reference)
    allowed = recording.right | recording.plausible | found
    if is_wrong(recording, groups, allowed, added):
        return "wrong"
    agrees = agreement(recording, diagnosis, reference)
    wanted = recording.right | found
    if added and (not wanted or any(each & wanted for each in groups)):
        return named(set(added), allowed, wanted, ratio_of(diagnosis, reference))
    if agrees is False:
        return "wrong"
    unexplained = diagnosis.remaining_force is not None and diagnosis.remaining_force.significant
    if recording.outside and (diagnosis.incomplete or unexplained):
        return "as known"
    if agrees:
        return "located"
    something = recording.right or recording.outside or (reference is not None and reference.chosen.terms)
    return "incomplete" if something or diagnosis.incomplete or unexplained else "as known"


def named(added: set[str], allowed: set[str], wanted: set[str], ratio: float | None) -> str:
    """The verdict on effects of which at least one group is right."""
    if ratio is not None and ratio > WORSE:
        return "incomplete"
    return "as known" if added <= allowed and (not wanted or added & wanted) else "group"


def judged(recording: Recording, reference: Row | None) -> Verdict:
    """Diagnose one recording; a fit that fails is a row as well."""
    began = time.perf_counter()
    try:
        clips = [clip.with_(sensor=recording.sensor) for clip in recording.clips()]
        found = diagnose(clips, recording.model, fixed=recording.fixed, free=recording.free)
    except FitError as error:
        return Verdict(recording.name, "failed", (), str(error), time.perf_counter() - began)
    parts = () if found.components is None else found.components.parts
    return Verdict(
        recording.name,
        verdict_of(recording, found, reference),
        tuple(effect.name for effect in found.added),
        diagnosis_sentence(found),
        time.perf_counter() - began,
        f"{parts[0].kind} {100 * parts[0].share:.0f} %" if parts else "",
        agreement(recording, found, reference),
        ratio_of(found, reference),
    )


def reference_of(recording: Recording, folder: Path | None) -> Row | None:
    """What the reference finds, from its folder; None without one."""
    return None if folder is None else reference_fits.kept(recording, folder)


def _send(name: str, reference: Path | None, pipe: Connection) -> None:
    warnings.simplefilter("ignore")
    recording = next(recording for recording in RECORDINGS if recording.name == name)
    pipe.send(judged(recording, reference_of(recording, reference)))


def within(recording: Recording, seconds: float, folder: Path | None, reference: Path | None) -> Verdict:
    """The verdict from the folder, or from a process that is ended after some seconds."""
    kept = None if folder is None else folder / f"{recording.name}.json"
    if kept is not None and kept.exists():
        content = json.loads(kept.read_text())
        return Verdict(**{**content, "added": tuple(content["added"])})
    reference_of(recording, reference)  # computed here, so that it does not take of the seconds
    verdict = in_process(recording, seconds, reference)
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(asdict(verdict), indent=1))
    return verdict


def in_process(recording: Recording, seconds: float, reference: Path | None) -> Verdict:
    """The verdict from a process of its own."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("spawn").Process(target=_send, args=(recording.name, reference, sender))
    process.start()
    sender.close()
    verdict = Verdict(recording.name, "no answer", (), f"no answer in {seconds:g} s", seconds)
    if receiver.poll(seconds):
        try:
            verdict = receiver.recv()
        except EOFError:
            verdict = Verdict(recording.name, "failed", (), "the program stopped", seconds)
    process.kill()
    process.join()
    return verdict


def line(recording: Recording, verdict: Verdict) -> str:
    """One row of the table."""
    agrees = {True: ", agrees", False: ", differs", None: ""}[verdict.agrees]
    cells = (
        f"{recording.name}{' (sealed)' if verdict.sealed else ''}",
        f"{recording.known}. *{recording.source}*",
        f"{recording.sensor}; {recording.model.name}",
        ", ".join(verdict.added) or "nothing",
        f"{verdict.component}{agrees}",
        "" if verdict.ratio is None else f"{verdict.ratio:.2f}",
        verdict.verdict,
    )
    return f"| {' | '.join(cells)} |"


def summary(verdicts: Sequence[Verdict], label: str) -> str:
    """How many rows came out with which word."""
    counts = {word: sum(verdict.verdict == word for verdict in verdicts) for word in WORDS}
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
    parser.add_argument("--sealed", action="store_true", help="score the sealed recordings as well")
    parser.add_argument("--sentences", action="store_true", help="print what the program says of each as well")
    parser.add_argument("--shapes", action="store_true", help="only load the recordings and print how large they are")
    parser.add_argument("--seconds", type=float, default=300.0, help="after which a diagnosis is given up")
    parser.add_argument("--folder", type=Path, help="where results are kept")
    parser.add_argument("--reference", type=Path, help="where the rows of reference_fits are kept")
    pages.add_option(parser)
    options = parser.parse_args()
    chosen = [recording for recording in RECORDINGS if options.only in recording.name]
    if options.shapes:
        for recording in chosen:
            clips = recording.clips()
            print(recording.name, [clip.position.shape for clip in clips][:8], len(clips), flush=True)
        return
    if not (options.sealed or options.write_docs):
        chosen = [recording for recording in chosen if not sealed(recording.name)]
    with pages.table("world-effects", options.write_docs):
        print("| recording | known beforehand | sensor; model | added | largest part | held out | verdict |")
        print("|---|---|---|---|---|---|---|")
        verdicts = []
        for recording in chosen:
            verdicts.append(within(recording, options.seconds, options.folder, options.reference))
            print(line(recording, verdicts[-1]), flush=True)
            if options.sentences:
                print(f"{verdicts[-1].seconds:.0f} s: {verdicts[-1].sentence}", flush=True)
        print()
        print("\n".join(summaries(verdicts)))


if __name__ == "__main__":
    main()
