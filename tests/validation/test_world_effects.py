"""The table of real recordings: the verdicts, the split into looked at and sealed, and the readers."""

import zipfile
from types import SimpleNamespace

import numpy as np
import pytest

from iris_sysid import EFFECTS, MODELS
from validation.world_effects import verdict_of
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


def a_recording(right=NOTHING, plausible=NOTHING, sensor="camera", outside=False):
    return Recording("x", "here", "that", MODELS["pendulum"], list, sensor, right, plausible, outside)


def a_diagnosis(*names, alike=(), incomplete=False):
    added = tuple(EFFECTS[name] for name in names)
    similar = {name: tuple(alike) for name in names}
    return SimpleNamespace(added=added, indistinguishable=similar, incomplete=incomplete, remaining_force=None)


VERDICTS = [
    (a_recording(QUADRATIC, DRAG), a_diagnosis("quadratic-drag"), "exact"),
    (a_recording(QUADRATIC, DRAG), a_diagnosis("camera-tilt", alike=["quadratic-drag"]), "in class"),
    (a_recording(QUADRATIC, DRAG), a_diagnosis(incomplete=True), "incomplete"),
    (a_recording(QUADRATIC, DRAG), a_diagnosis("linear-drag", incomplete=True), "incomplete"),
    (a_recording(QUADRATIC, DRAG), a_diagnosis(), "missed"),
    (a_recording(QUADRATIC, DRAG), a_diagnosis("camera-tilt"), "wrong"),
    (a_recording(QUADRATIC, DRAG), a_diagnosis("quadratic-drag", "impact"), "wrong"),
    (a_recording(NOTHING, DRAG), a_diagnosis(), "exact"),
    (a_recording(NOTHING, DRAG), a_diagnosis(incomplete=True), "incomplete"),
    (a_recording(NOTHING, DRAG), a_diagnosis("linear-drag"), "exact"),
    (a_recording(NOTHING, DRAG), a_diagnosis("impact"), "wrong"),
    (a_recording(NOTHING, DRAG, "encoder"), a_diagnosis("camera-tilt", alike=["linear-drag"]), "physically impossible"),
    (a_recording(outside=True), a_diagnosis(incomplete=True), "exact"),
    (a_recording(outside=True), a_diagnosis(), "missed"),
    (a_recording(NOTHING, ZERO, outside=True), a_diagnosis("leak"), "wrong"),
]


@pytest.mark.parametrize(("recording", "diagnosis", "verdict"), VERDICTS)
def test_verdict_compares_the_names_with_what_was_known(recording, diagnosis, verdict):
    assert verdict_of(recording, diagnosis) == verdict


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
