"""What the diagnosis says of each real recording, kept apart from the judgement of it, so that a rule costs no new run.

Each recording runs in a separate process. The diagnosis is asked for its best answer after a share of the time allowed;
the process is ended when all of it is over.
"""

from __future__ import annotations

import json
import multiprocessing
import time
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path

from iris_sysid import Diagnosis, IrisError, diagnose, diagnosis_sentence
from iris_sysid.types import Components
from validation.world_recordings import RECORDINGS, Recording

ASKED = 0.75  # of the time allowed, after which the best answer is asked for


@dataclass(frozen=True, slots=True)
class Part:
    """One part of a residual: its kind, its share of the variance, and the kinds that can take its place."""

    kind: str
    share: float
    similar: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.kind} {100 * self.share:.0f} %"


@dataclass(frozen=True, slots=True)
class Answer:
    """What a diagnosis said.

    ``groups`` has each effect that it added, with those that cannot be told apart from it; ``nuisances`` are in the
    model, but are no names. ``parts`` are those of the residual without effects. ``failed`` says why there is nothing
    (empty where there is something), ``stopped`` that the time was over before the search ended. ``before`` and
    ``after`` are the errors over blocks held out, ``incomplete`` that something is still missing.
    """

    name: str
    groups: tuple[tuple[str, ...], ...] = ()
    nuisances: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()
    words: Mapping[str, str] = field(default_factory=dict)
    before: float = float("nan")
    after: float = float("nan")
    incomplete: bool = False
    stopped: bool = False
    failed: str = ""
    sentence: str = ""
    seconds: float = 0.0

    @property
    def added(self) -> tuple[str, ...]:
        """The names that were given."""
        return tuple(group[0] for group in self.groups)


def said(name: str, found: Diagnosis) -> Answer:
    """The answer from a diagnosis."""
    return Answer(
        name,
        tuple((effect.name, *found.indistinguishable.get(effect.name, ())) for effect in found.added),
        tuple(effect.name for effect in found.nuisances),
        parts_of(found.components),
        {finding.effects[0]: finding.word for finding in found.findings if finding.effects},
        found.before.heldout,
        found.after.heldout,
        found.incomplete or not found.verdict.complete,
        any(note.kind == "stopped" for note in found.notes),
        sentence=diagnosis_sentence(found),
    )


def parts_of(components: Components | None) -> tuple[Part, ...]:
    """The parts of a residual; none where it could not be split."""
    parts = () if components is None else components.parts
    return tuple(Part(part.kind, part.share, tuple(part.similar)) for part in parts)


def answered(recording: Recording, seconds: float) -> Answer:
    """Diagnose one recording; a fit that fails is an answer as well."""
    try:
        clips = [clip.with_(sensor=recording.sensor) for clip in recording.clips()]
        found = diagnose(clips, recording.model, fixed=recording.fixed, free=recording.free, seconds=seconds)
    except IrisError as error:
        return Answer(recording.name, failed=str(error))
    return said(recording.name, found)


def _send(name: str, seconds: float, pipe: Connection) -> None:
    warnings.simplefilter("ignore")
    pipe.send(answered(next(recording for recording in RECORDINGS if recording.name == name), seconds))


def in_process(name: str, seconds: float) -> Answer:
    """The answer from a separate process, which is ended when the time is over."""
    began = time.perf_counter()
    receiver, sender = multiprocessing.Pipe(duplex=False)
    arguments = (name, ASKED * seconds, sender)
    process = multiprocessing.get_context("spawn").Process(target=_send, args=arguments)
    process.start()
    sender.close()
    answer = Answer(name, failed=f"no answer in {seconds:g} s")
    if receiver.poll(seconds):
        try:
            answer = receiver.recv()
        except EOFError:
            answer = Answer(name, failed="the program stopped")
    process.kill()
    process.join()
    return replace(answer, seconds=time.perf_counter() - began)


def answer_of(name: str, seconds: float, folder: Path | None) -> Answer:
    """The answer from the folder, or from a run that is then kept there."""
    kept = None if folder is None else folder / f"{name}.json"
    if kept is not None and kept.exists():
        return read_answer(kept)
    answer = in_process(name, seconds)
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(asdict(answer), indent=1))
    return answer


def read_answer(path: Path) -> Answer:
    """An answer as it was written."""
    content = json.loads(path.read_text())
    return Answer(
        **{
            **content,
            "groups": tuple(map(tuple, content["groups"])),
            "nuisances": tuple(content["nuisances"]),
            "parts": tuple(Part(**{**part, "similar": tuple(part["similar"])}) for part in content["parts"]),
        }
    )
