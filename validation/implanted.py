"""Effects implanted in real recordings: what the diagnosis says with the effect, against what it says without.

``python -m validation.implanted [--size 3] [--only NAME] [--effect NAME] [--folder OUT] [--seconds S]`` needs the
recordings in ``../shared/data``. Each table is diagnosed as it is, and with one effect whose trace, freed of what the
base model imitates, is a multiple of the recording's own residual (:mod:`validation.implanted_effects`). With
``--video`` the faults of a camera or a clock are put into the frames of the filmed recordings, which are tracked again
(:mod:`validation.implanted_video`). Every diagnosis runs in a separate process; answers in ``--folder`` are not
computed again, and are scored anew each time. The sealed half of the recordings needs ``--sealed``.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from iris_sysid import IrisError, Trajectory, diagnose
from validation import implanted_video as video
from validation import pages
from validation.implanted_effects import IMPLANTS, LAWS, NotShownError, based, sized
from validation.implanted_scores import LEVELS, Answer, Hidden, Score, said, score
from validation.world_recordings import RECORDINGS, Recording, sealed

ASKED = 0.6  # of the seconds, that are given to a diagnosis: the rest goes into its start
MULTIPLES = (3.0, 1.0)  # of the recording's own residual
HEADER = (
    "| recording | implant | trace (video: residual) / residual as it is | level (as it is) | added as it is "
    "| added with it | extra names | changed beside it | parameters held | size holds the truth | new doubts |\n"
    + "|---" * 11
    + "|"
)

# Answers ------------------------------------------------------------------------------------------------------------


def answered(clip: Trajectory, recording: Recording, answer: Answer, seconds: float) -> Answer:
    """The answer for a clip, the best that there is after some seconds; a fit that fails is one as well."""
    began = time.perf_counter()
    try:
        found = diagnose(clip, recording.model, fixed=recording.fixed, free=recording.free, seconds=seconds)
    except IrisError as error:
        return replace(answer, failed=str(error))
    return replace(answer, **said(found), seconds=time.perf_counter() - began)


def answer_of(clip: Trajectory, answer: Answer, seconds: float) -> Answer:
    """Implant what the answer is to be about, where it names a table's effect, and diagnose within some seconds."""
    recording = named(answer.recording)
    implant = next((each for each in IMPLANTS if each.name == answer.implant), None)
    if implant is None:
        return answered(clip, recording, answer, seconds)
    try:
        changed, ratio = sized(implant, based(recording, clip), answer.multiple)
    except NotShownError as error:
        return replace(answer, skipped=str(error))
    return answered(changed.clip, recording, replace(answer, size=changed.size, ratio=ratio), seconds)


def named(name: str) -> Recording:
    """The recording of that name."""
    return next(recording for recording in RECORDINGS if recording.name == name)


def _send(clip: Trajectory, answer: Answer, seconds: float, pipe: Connection) -> None:
    warnings.simplefilter("ignore")
    pipe.send(answer_of(clip, answer, seconds))


def within(clip: Trajectory, answer: Answer, seconds: float) -> Answer:
    """The answer from a process that is ended after some seconds."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("spawn").Process(target=_send, args=(clip, answer, ASKED * seconds, sender))
    process.start()
    sender.close()
    result = replace(answer, failed=f"no answer in {seconds:g} s")
    if receiver.poll(seconds):
        try:
            result = receiver.recv()
        except EOFError:
            result = replace(answer, failed="the program stopped")
    process.kill()
    process.join()
    return result


def kept(answer: Answer, options: argparse.Namespace, make: Callable[[Answer], Answer]) -> Answer:
    """The answer from the folder, or made and put there; one that was given up is made again where there is more time.

    Parameters
    ----------
    answer
        What it is to be about.
    options
        With ``folder`` (None: keep nothing) and ``seconds``.
    make
        Makes it.
    """
    folder = options.folder
    name = f"{answer.recording}--{answer.implant or 'as-it-is'}--{answer.multiple:g}.json"
    path = None if folder is None else folder / name
    if path is not None and path.exists():
        before = Answer(**json.loads(path.read_text()))
        if not before.failed or before.seconds >= options.seconds:
            return before
    result = replace(made, seconds=options.seconds) if (made := make(answer)).failed else made
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(result), indent=1))
    return result


# Tables -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """One case: the implant, the answers with it and without, and the score where both are diagnoses."""

    hidden: Hidden
    answer: Answer
    before: Answer
    filmed: bool = False

    @property
    def scored(self) -> Score | None:
        """The score; None where one of the diagnoses is missing."""
        if not (self.answer.usable and self.before.usable):
            return None
        return score(self.hidden, self.answer, self.before, named(self.answer.recording), filmed=self.filmed)

    @property
    def text(self) -> str:
        """The line of the table."""
        answer, before, found = self.answer, self.before, self.scored
        ratio = answer.residual / before.residual if self.filmed and before.residual else answer.ratio
        cells = [answer.recording, f"{answer.implant} {answer.size:.3g}", f"{ratio:.2f}"]
        if found is None:
            why = answer.skipped or answer.failed or f"as it is: {before.failed}"
            return f"| {answer.recording} | {answer.implant} | x {answer.multiple:g} | {_short(why)} |{' |' * 7}"
        held = f"{sum(found.held.values())} of {len(found.held)}"
        right = {True: "yes", False: "no", None: ""}[found.sized]
        cells += [f"{found.level} ({found.already})", _list(before.added), _list(answer.added)]
        cells += [_list(found.extra), _list(found.changed), held, right, _list(found.new_doubts)]
        return f"| {' | '.join(cells)} |"


def _short(text: str) -> str:
    return text.partition(". ")[0].replace("|", "/")


def _list(names: Sequence[str] | frozenset[str]) -> str:
    return ", ".join(sorted(names))


def summary(rows: Sequence[Row], multiple: float) -> str:
    """The quantities that have targets, over the cases of one multiple."""
    of = [row for row in rows if row.answer.multiple == multiple]
    scores = [row.scored for row in of if row.scored is not None]
    counts = ", ".join(f"{name} {sum(each.level == name for each in scores)}" for name in LEVELS)
    held = [right for each in scores for right in each.held.values()]
    sizes = [each.sized for each in scores if each.sized is not None]
    same = sum(each.level == each.already != "missed" for each in scores)
    doubts = sum(bool({"clock", "scale"} & set(each.new_doubts)) for each in scores)
    skipped = sum(bool(row.answer.skipped) for row in of)
    failed = sum(row.scored is None and not row.answer.skipped for row in of)
    parts = [
        f"{counts} (the same level as it is, and not missed: {same})",
        f"extra names {sum(len(each.extra) for each in scores)}",
        f"names that change beside the implant {sum(len(each.changed) for each in scores)}",
        f"parameters held {sum(held)} of {len(held)}",
        *([f"sizes that hold the truth {sum(sizes)} of {len(sizes)}"] if sizes else []),
        *([f"a doubt of clock or scale {doubts}"] if doubts else []),
        *([f"not shown by the recording {skipped}"] if skipped else []),
        *([f"no diagnosis {failed}"] if failed else []),
    ]
    return f"At {multiple:g} times the residual, of {len(scores)}: {'; '.join(parts)}."


# Cases --------------------------------------------------------------------------------------------------------------


def table_rows(recording: Recording, options: argparse.Namespace) -> Iterator[Row]:
    """The cases of one table, of which the first clip is used."""
    clip = recording.clips()[0].with_(sensor=recording.sensor)
    make = partial(within, clip, seconds=options.seconds)
    implants = [implant for implant in IMPLANTS if recording.model.name in implant.models]
    yield from cases_of(recording, implants, options, make)


def cases_of(
    recording: Recording, every: Sequence[Hidden], options: argparse.Namespace, make: Callable[[Answer], Answer]
) -> Iterator[Row]:
    """A row for each implant and multiple; none is made where there is no answer for the recording as it is."""
    before = kept(Answer(recording.name), options, make)
    for hidden, multiple in itertools.product(every, options.size or MULTIPLES):
        if options.effect in hidden.name:
            answer = Answer(recording.name, hidden.name, multiple)
            yield Row(hidden, kept(answer, options, make) if before.usable else answer, before, options.video)


def film_rows(recording: Recording, options: argparse.Namespace) -> Iterator[Row]:
    """The cases of one video, each rendered and tracked again; as it is, it is encoded again as well."""

    def make(answer: Answer) -> Answer:
        fault = next((each for each in video.FAULTS if each.name == answer.implant), video.NONE)
        size = fault.size * answer.multiple / MULTIPLES[0]
        try:
            clip, doubts = video.tracked(recording.name.removeprefix("film-"), fault, size, options.seconds)
        except IrisError as error:
            return replace(answer, size=size, failed=str(error))
        # the name of a fault of the video may be that of a table's effect, which is in this clip already
        result = within(clip.with_(sensor=recording.sensor), Answer(recording.name), options.seconds)
        about = {"implant": answer.implant, "multiple": answer.multiple, "size": size}
        return replace(result, **about, doubts=[*doubts, *result.doubts])

    yield from cases_of(recording, video.FAULTS, options, make)


def chosen(options: argparse.Namespace) -> list[Recording]:
    """The recordings to score."""
    return [
        recording
        for recording in RECORDINGS
        if options.only in recording.name
        and (options.sealed or not sealed(recording.name))
        and (recording.name.startswith("film-") if options.video else recording.model.name in LAWS)
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table as Markdown, and its summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--video", action="store_true", help="faults in the frames of the filmed recordings")
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--effect", default="", help="only implants whose name contains this")
    parser.add_argument("--size", type=float, action="append", help="times the residual: 3 or 1 (both)")
    parser.add_argument("--sealed", action="store_true", help="score the sealed recordings as well")
    parser.add_argument("--seconds", type=float, default=300.0, help="after which a diagnosis is given up")
    parser.add_argument("--folder", type=Path, help="where answers are kept")
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    cases, rows = film_rows if options.video else table_rows, []
    if options.video and options.folder is not None:
        options.folder = options.folder / "video"
    with pages.table("implanted-video" if options.video else "implanted", options.write_docs):
        print(HEADER)
        for recording in chosen(options):
            for row in cases(recording, options):
                rows.append(row)
                print(row.text, flush=True)
        print()
        for multiple in options.size or MULTIPLES:
            print(summary(rows, multiple))


if __name__ == "__main__":
    main()
