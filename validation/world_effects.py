"""Real recordings with a known effect: what the diagnosis says of each, against what was known beforehand.

``python -m validation.world_effects [--write-docs]`` needs the recordings in ``../shared/data``. Rows are in
alphabetical order, and about half are sealed, by a hash of the name: they are scored with ``--sealed`` (or
``--write-docs``), and are not looked at while the programs are written. Each recording has a process of its own and ``--seconds``; results in
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
from validation import pages
from validation.world_recordings import RECORDINGS, Recording, sealed

AS_KNOWN = ("exact", "in class")


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one recording: ``verdict`` against what was known, the names given, and the program's sentence."""

    name: str
    verdict: str
    added: tuple[str, ...]
    sentence: str
    seconds: float

    @property
    def sealed(self) -> bool:
        """Whether nobody looked at it while the programs were written."""
        return sealed(self.name)


def verdict_of(recording: Recording, diagnosis: Diagnosis) -> str:
    """Compare the effects that were added with what was known."""
    added = [effect.name for effect in diagnosis.added]
    classes = {name: {name, *diagnosis.indistinguishable[name]} for name in added}
    if any(recording.sensor not in EFFECTS[name].sensors for name in added):
        return "physically impossible"
    allowed = recording.right | recording.plausible
    if any(not names & allowed for names in classes.values()):
        return "wrong"
    unexplained = diagnosis.remaining_force is not None and diagnosis.remaining_force.significant
    said = diagnosis.incomplete or unexplained
    if recording.outside:
        return "exact" if said else "missed"
    if recording.right and not any(names & recording.right for names in classes.values()):
        return "incomplete" if said else "missed"
    if not added:
        return "incomplete" if said else "exact"
    exact = set(added) <= allowed and (not recording.right or bool(recording.right & set(added)))
    return "exact" if exact else "in class"


def judged(recording: Recording) -> Verdict:
    """Diagnose one recording; a fit that fails is a row as well."""
    began = time.perf_counter()
    try:
        clips = [clip.with_(sensor=recording.sensor) for clip in recording.clips()]
        found = diagnose(clips, recording.model, fixed=recording.fixed, free=recording.free)
    except FitError as error:
        return Verdict(recording.name, "fit failed", (), str(error), time.perf_counter() - began)
    added = tuple(effect.name for effect in found.added)
    took_s = time.perf_counter() - began
    return Verdict(recording.name, verdict_of(recording, found), added, diagnosis_sentence(found), took_s)


def _send(name: str, pipe: Connection) -> None:
    warnings.simplefilter("ignore")
    pipe.send(judged(next(recording for recording in RECORDINGS if recording.name == name)))


def within(recording: Recording, seconds: float, folder: Path | None) -> Verdict:
    """The verdict from the folder, or from a process that is ended after some seconds."""
    kept = None if folder is None else folder / f"{recording.name}.json"
    if kept is not None and kept.exists():
        content = json.loads(kept.read_text())
        return Verdict(**{**content, "added": tuple(content["added"])})
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("spawn").Process(target=_send, args=(recording.name, sender))
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
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(asdict(verdict), indent=1))
    return verdict


def line(recording: Recording, verdict: Verdict) -> str:
    """One row of the table."""
    cells = (
        f"{recording.name}{' (sealed)' if verdict.sealed else ''}",
        f"{recording.known}. *{recording.source}*",
        f"{recording.sensor}; {recording.model.name}",
        ", ".join(verdict.added) or "nothing",
        verdict.verdict,
    )
    return f"| {' | '.join(cells)} |"


def summary(verdicts: Sequence[Verdict], label: str) -> str:
    """How many rows came out as known."""
    names = (
        "exact",
        "in class",
        "incomplete",
        "missed",
        "wrong",
        "physically impossible",
        "fit failed",
        "failed",
        "no answer",
    )
    counts = {name: sum(verdict.verdict == name for verdict in verdicts) for name in names}
    known = sum(counts[name] for name in AS_KNOWN)
    parts = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    return f"{label}: {known} of {len(verdicts)} as known ({parts})."


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--sealed", action="store_true", help="score the sealed recordings as well")
    parser.add_argument("--sentences", action="store_true", help="print what the program says of each as well")
    parser.add_argument("--shapes", action="store_true", help="only load the recordings and print how large they are")
    parser.add_argument("--seconds", type=float, default=300.0, help="after which a diagnosis is given up")
    parser.add_argument("--folder", type=Path, help="where results are kept")
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
        print("| recording | known beforehand | sensor; model | added | verdict |\n|---|---|---|---|---|")
        verdicts = []
        for recording in chosen:
            verdicts.append(within(recording, options.seconds, options.folder))
            print(line(recording, verdicts[-1]), flush=True)
            if options.sentences:
                print(f"{verdicts[-1].seconds:.0f} s: {verdicts[-1].sentence}", flush=True)
        print()
        print(summary([verdict for verdict in verdicts if not verdict.sealed], "Looked at"))
        if any(verdict.sealed for verdict in verdicts):
            print(summary([verdict for verdict in verdicts if verdict.sealed], "Sealed"))


if __name__ == "__main__":
    main()
