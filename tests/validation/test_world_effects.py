"""The table of real recordings: the verdicts, the split into looked at and sealed, and the readers."""

import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from iris_sysid import EFFECTS, MODELS
from validation.reference_fits import Candidate, Row
from validation.world_effects import Verdict, agreement, summaries, verdict_of
from validation.world_recordings import (
    DRAG,
    NOTHING,
    QUADRATIC,
    RECORDINGS,
    SEEN,
    ZERO,
    Recording,
    sealed,
    series,
    sheet_rows,
)


def a_recording(right=NOTHING, plausible=NOTHING, sensor="camera", outside=False, model="pendulum"):
    return Recording("x", "here", "that", MODELS[model], list, sensor, right, plausible, outside)


def a_part(kind, *similar):
    return SimpleNamespace(kind=kind, similar=similar, share=0.8)


def a_diagnosis(*names, alike=(), incomplete=False, part=None, heldout=1.0):
    return SimpleNamespace(
        added=tuple(EFFECTS[name] for name in names),
        indistinguishable={name: tuple(alike) for name in names},
        incomplete=incomplete,
        remaining_force=None,
        components=None if part is None else SimpleNamespace(parts=(part,)),
        after=SimpleNamespace(heldout=heldout),
    )


def a_candidate(*terms, error=1.0):
    return Candidate(terms, error, error, (error**2,) * 8, {})


def a_reference(*terms, alike=True):
    rest = [a_candidate(error=3.0)] if terms else []
    return Row("x", "rad", 100, alike, (a_candidate(*terms), *rest))


RIG = a_recording(QUADRATIC, DRAG)
UNKNOWN = a_recording(NOTHING, DRAG)
VERDICTS = [
    (RIG, a_diagnosis("quadratic-drag"), "as known"),
    (RIG, a_diagnosis("camera-tilt", alike=["quadratic-drag"]), "group"),
    (RIG, a_diagnosis(incomplete=True), "incomplete"),
    (RIG, a_diagnosis("linear-drag", incomplete=True), "incomplete"),
    (RIG, a_diagnosis(), "incomplete"),
    (RIG, a_diagnosis("camera-tilt"), "wrong"),
    (RIG, a_diagnosis("quadratic-drag", "impact"), "wrong"),
    (UNKNOWN, a_diagnosis(), "as known"),
    (UNKNOWN, a_diagnosis(incomplete=True), "incomplete"),
    (UNKNOWN, a_diagnosis("linear-drag"), "as known"),
    (UNKNOWN, a_diagnosis("impact"), "wrong"),
    (a_recording(NOTHING, DRAG, "encoder"), a_diagnosis("camera-tilt", alike=["linear-drag"]), "wrong"),
    (a_recording(outside=True), a_diagnosis(incomplete=True), "as known"),
    (a_recording(outside=True), a_diagnosis(), "incomplete"),
    (a_recording(NOTHING, ZERO, outside=True), a_diagnosis("leak"), "wrong"),
]
AGAINST_THE_REFERENCE = [
    (UNKNOWN, a_diagnosis("cubic-stiffness"), a_reference("cubic-force"), "as known"),
    (UNKNOWN, a_diagnosis("cubic-stiffness"), a_reference("zero-wander"), "wrong"),
    (UNKNOWN, a_diagnosis("cubic-stiffness", heldout=1.3), a_reference("cubic-force"), "incomplete"),
    (UNKNOWN, a_diagnosis("cubic-stiffness", heldout=1.3), a_reference("cubic-force", alike=False), "as known"),
    (UNKNOWN, a_diagnosis("linear-drag"), a_reference("cubic-force"), "incomplete"),
    (UNKNOWN, a_diagnosis(part=a_part("force-of-position")), a_reference("cubic-force"), "located"),
    (UNKNOWN, a_diagnosis(part=a_part("clock", "force-of-position")), a_reference("cubic-force"), "located"),
    (UNKNOWN, a_diagnosis(part=a_part("zero-wander")), a_reference("cubic-force"), "wrong"),
    (UNKNOWN, a_diagnosis(), a_reference("cubic-force"), "incomplete"),
    (UNKNOWN, a_diagnosis(), a_reference(), "as known"),
]


@pytest.mark.parametrize(("recording", "diagnosis", "verdict"), VERDICTS)
def test_verdict_compares_the_names_with_what_was_known(recording, diagnosis, verdict):
    assert verdict_of(recording, diagnosis) == verdict


@pytest.mark.parametrize(("recording", "diagnosis", "reference", "verdict"), AGAINST_THE_REFERENCE)
def test_verdict_counts_what_the_reference_finds(recording, diagnosis, reference, verdict):
    assert verdict_of(recording, diagnosis, reference) == verdict


def test_force_and_reading_agree_on_a_motion_that_never_turns():
    fall, reference = a_recording(model="free-fall"), a_reference("linear-drag")
    assert agreement(fall, a_diagnosis(part=a_part("reading-of-position")), reference)
    assert not agreement(UNKNOWN, a_diagnosis(part=a_part("reading-of-position")), reference)
    assert not agreement(fall, a_diagnosis(part=a_part("clock")), reference)
    assert agreement(fall, a_diagnosis(), reference) is None


def test_summaries_keep_apart_what_was_looked_at_before():
    names = ["pendulum-wooden-bob", "pendulum-foucault", "air-track-single"]
    lines = summaries([Verdict(name, "as known") for name in names])
    assert [line.split(":")[1] for line in lines] == [" 1 of 1 as known (as known 1)."] * 3


def test_a_hash_of_the_name_seals_about_half_of_the_recordings():
    names = [recording.name for recording in RECORDINGS]
    assert names == sorted(set(names))
    assert sealed("pendulum-foucault")
    assert not sealed("pendulum-wooden-bob")
    assert 0.35 * len(names) < sum(map(sealed, names)) < 0.65 * len(names)
    assert set(names) >= SEEN


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
