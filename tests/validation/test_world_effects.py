"""The table of real recordings: the verdicts, the split into looked at and sealed, and the readers."""

import json
import zipfile
from dataclasses import asdict

import numpy as np
import pytest

from iris_sysid import EFFECTS, MODELS
from validation.reference_fits import Candidate, Row
from validation.world_answers import Answer, Part, answer_of
from validation.world_effects import Verdict, agreement, names_in, summaries, word_of
from validation.world_recordings import (
    DRAG,
    NOTHING,
    QUADRATIC,
    RECORDINGS,
    SEEN,
    ZERO,
    Recording,
    chosen,
    sealed,
    series,
    sheet_rows,
)


def a_recording(right=NOTHING, plausible=NOTHING, sensor="camera", outside=False, model="pendulum"):
    return Recording("x", "here", "that", MODELS[model], list, sensor, right, plausible, outside)


def an_answer(*names, alike=(), incomplete=False, parts=(), heldout=1.0):
    groups = tuple((name, *alike) for name in names)
    return Answer("x", groups, parts=parts, after=heldout, incomplete=incomplete)


def a_part(kind, *similar, share=0.8):
    return (Part(kind, share, similar),)


def a_candidate(*terms, error=1.0):
    return Candidate(terms, error, error, (error**2,) * 8, {})


def a_reference(*terms, alike=True):
    rest = [a_candidate(error=3.0)] if terms else []
    return Row("x", "rad", 100, alike, (a_candidate(*terms), *rest))


BOTH = (*a_part("zero-wander", share=0.6), *a_part("force-of-position", share=0.3))
RIG = a_recording(QUADRATIC, DRAG)
UNKNOWN = a_recording(NOTHING, DRAG)
VERDICTS = [
    (RIG, an_answer("quadratic-drag"), "as known"),
    (RIG, an_answer("camera-tilt", alike=["quadratic-drag"]), "group"),
    (RIG, an_answer(incomplete=True), "incomplete"),
    (RIG, an_answer("linear-drag", incomplete=True), "incomplete"),
    (RIG, an_answer(), "incomplete"),
    (RIG, an_answer("camera-tilt"), "wrong"),
    (RIG, an_answer("quadratic-drag", "impact"), "wrong"),
    (UNKNOWN, an_answer(), "as known"),
    (UNKNOWN, an_answer(incomplete=True), "incomplete"),
    (UNKNOWN, an_answer("linear-drag"), "as known"),
    (UNKNOWN, an_answer("impact"), "wrong"),
    (a_recording(NOTHING, DRAG, "encoder"), an_answer("camera-tilt", alike=["linear-drag"]), "wrong"),
    (a_recording(outside=True), an_answer(incomplete=True), "as known"),
    (a_recording(outside=True), an_answer(), "incomplete"),
    (a_recording(NOTHING, ZERO, outside=True), an_answer("leak"), "wrong"),
]
AGAINST_THE_REFERENCE = [
    (UNKNOWN, an_answer("cubic-stiffness"), a_reference("cubic-force"), "as known"),
    (UNKNOWN, an_answer("cubic-stiffness"), a_reference("zero-wander"), "wrong"),
    (UNKNOWN, an_answer("cubic-stiffness", heldout=1.3), a_reference("cubic-force"), "incomplete"),
    (UNKNOWN, an_answer("cubic-stiffness", heldout=1.3), a_reference("cubic-force", alike=False), "as known"),
    (UNKNOWN, an_answer("linear-drag"), a_reference("cubic-force"), "incomplete"),
    (UNKNOWN, an_answer(parts=a_part("force-of-position")), a_reference("cubic-force"), "located"),
    (UNKNOWN, an_answer(parts=a_part("clock", "force-of-position")), a_reference("cubic-force"), "located"),
    (UNKNOWN, an_answer(parts=a_part("zero-wander")), a_reference("cubic-force"), "wrong"),
    (UNKNOWN, an_answer(parts=BOTH), a_reference("cubic-force"), "located"),
    (UNKNOWN, an_answer(), a_reference("cubic-force"), "incomplete"),
    (UNKNOWN, an_answer(), a_reference(), "as known"),
    (UNKNOWN, an_answer(incomplete=True), a_reference(), "as known"),
]


@pytest.mark.parametrize(("recording", "answer", "verdict"), VERDICTS)
def test_verdict_compares_the_names_with_what_was_known(recording, answer, verdict):
    assert word_of(recording, answer) == verdict


@pytest.mark.parametrize(("recording", "answer", "reference", "verdict"), AGAINST_THE_REFERENCE)
def test_verdict_counts_what_the_reference_finds(recording, answer, reference, verdict):
    assert word_of(recording, answer, reference) == verdict


def test_force_and_reading_agree_on_a_motion_that_never_turns():
    fall, reference = a_recording(model="free-fall"), a_reference("linear-drag")
    assert agreement(fall, an_answer(parts=a_part("reading-of-position")), reference)
    assert not agreement(UNKNOWN, an_answer(parts=a_part("reading-of-position")), reference)
    assert not agreement(fall, an_answer(parts=a_part("clock")), reference)
    assert agreement(fall, an_answer(), reference) is None


def test_an_answer_that_failed_is_no_wrong_name():
    assert word_of(RIG, Answer("x", failed="no answer in 120 s")) == "no answer"
    assert word_of(RIG, Answer("x", failed="the fit failed")) == "failed"


def test_an_answer_is_read_as_it_was_written(tmp_path):
    answer = Answer(
        "x", (("linear-drag", "quadratic-drag"),), ("zero-wander",), BOTH, {"linear-drag": "group"}, 2.0, 1.0
    )
    (tmp_path / "x.json").write_text(json.dumps(asdict(answer)))
    assert answer_of("x", 1.0, tmp_path) == answer
    assert names_in(answer) == "linear-drag (or 1 more)"


def test_summaries_keep_apart_what_was_looked_at_before():
    names = ["pendulum-wooden-bob", "pendulum-foucault", "air-track-single"]
    lines = summaries([Verdict(Answer(name), "as known") for name in names])
    assert [line.split(":")[1] for line in lines] == [" 1 of 1 as known (as known 1)."] * 3


def test_a_hash_of_the_name_seals_about_half_of_the_recordings():
    names = [recording.name for recording in RECORDINGS]
    assert names == sorted(set(names))
    assert sealed("pendulum-foucault")
    assert not sealed("pendulum-wooden-bob")
    assert 0.35 * len(names) < sum(map(sealed, names)) < 0.65 * len(names)
    assert set(names) >= SEEN
    assert {each.name for each in chosen("pendulum", "wide")} < {each.name for each in chosen("pendulum")} < set(names)


@pytest.mark.parametrize("recording", RECORDINGS, ids=lambda recording: recording.name)
def test_what_is_known_names_effects_of_the_library_that_the_sensor_can_have(recording):
    names = recording.right | recording.plausible
    assert names <= set(EFFECTS)
    assert all(recording.sensor in EFFECTS[name].sensors for name in names)
    assert recording.known
    assert recording.source


def test_sheet_of_a_workbook_is_read_by_its_name(tmp_path):
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    rows = '<row><c t="s"><v>0</v></c><c t="s"><v>1</v></c><c t="s"><v>2</v></c></row>'
    rows += "<row><c><v>1</v></c><c><v>0.5</v></c><c><v>-47.25</v></c></row>"
    with zipfile.ZipFile(tmp_path / "book.xls", "w") as archive:
        archive.writestr(
            "xl/workbook.xml", f'<workbook {space}><sheets><sheet name="A"/><sheet name="B"/></sheets></workbook>'
        )
        archive.writestr("xl/worksheets/sheet1.xml", f"<worksheet {space}><sheetData/></worksheet>")
        archive.writestr("xl/worksheets/sheet2.xml", f"<worksheet {space}><sheetData>{rows}</sheetData></worksheet>")
    np.testing.assert_array_equal(sheet_rows(tmp_path / "book.xls", "B"), [[1.0, 0.5, -47.25]])


def test_samples_whose_time_does_not_increase_are_dropped():
    z = MODELS["free-fall"].observed[0]
    clip = series(np.array([0.0, 1.0, 1.0, 0.5, 2.0]), np.array([5.0, 4.0, 3.0, 2.0, np.nan]), z)
    np.testing.assert_array_equal(clip.t_s, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(clip.valid, [True, True, False])
