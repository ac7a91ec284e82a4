"""What is said against the values of a setting, and a stated board that a rendered clip contradicts."""

import json
from dataclasses import replace

import pytest

from iris_sysid.benchmark.groundtruth.boards import board_of
from iris_sysid.benchmark.groundtruth.verdicts import verdict_on
from iris_sysid.errors import CalibrationError
from iris_sysid.io.schemas import VerdictEntry
from iris_sysid.io.schemas.groundtruth import BoardEntry, MeasuredDocument
from iris_sysid.types import Completeness, Doubt, Verdict
from tests._clip_documents import clip_measured

PLANE = Doubt("plane-view", "the board may not lie in the plane of motion", "give --plane-view")


def clip(name, verdict, status="ok"):
    measured = clip_measured(name, {"length": (0.5, 0.001, "m")} if status == "ok" else {}, status=status)
    entry = None if verdict is None else VerdictEntry.of(verdict)
    return replace(measured, document=measured.document.model_copy(update={"verdict": entry}))


def test_doubts_and_incomplete_equations_of_the_clips_are_counted():
    good, lacking = Completeness(0.9999, True, 1.0), Completeness(0.99, False, 6.0)
    clips = [
        clip("1", Verdict("good", (), good)),
        clip("2", Verdict("good", (), lacking)),
        clip("3", Verdict("doubtful", (PLANE,), lacking)),
        clip("4", None, status="failed"),
    ]
    said = verdict_on(clips)
    assert said.numbers == "failed in 1 of 4, doubtful in 1 of 4"
    assert said.equation == "incomplete in 2 of 4"
    assert said.doubts == PLANE.finding


def test_setting_without_doubts_is_usable_and_complete():
    said = verdict_on([clip("1", Verdict("good", (), Completeness(0.9999, True, 1.0)))])
    assert (said.numbers, said.equation, said.doubts) == ("usable", "complete", "")


def test_clips_of_an_earlier_version_have_no_verdict():
    assert verdict_on([clip("1", None)]).numbers == ""


@pytest.mark.parametrize(("square_m", "refused"), [(0.04, False), (0.0402, False), (0.025, True)])
def test_stated_square_of_a_rendered_board_is_compared_with_its_truth(tmp_path, square_m, refused):
    board = {"board": {"inner_corners": [9, 6], "square_m": 0.04}}
    (tmp_path / "checkerboard.truth.json").write_text(json.dumps(board))
    stated = MeasuredDocument(boards=[BoardEntry(inner_corners=(9, 6), square_m=square_m)])
    if refused:
        with pytest.raises(CalibrationError, match="stated to be 25 mm wide, but were rendered with 40 mm"):
            board_of(tmp_path / "checkerboard.mp4", "Pendulum", stated)
    else:
        assert board_of(tmp_path / "checkerboard.mp4", "Pendulum", stated).square_m == square_m
