"""The file of what was measured by hand: checked, with uncertainties as they were stated."""

import json
import math

import pytest

from iris_sysid.benchmark.groundtruth.direct import read_measured, template, with_board
from iris_sysid.benchmark.sources.published import truth_of
from iris_sysid.calibration.board.board import Board
from iris_sysid.errors import DataError
from iris_sysid.io.json_documents import document_text
from iris_sysid.io.schemas.groundtruth import MeasuredDocument

ROW = {"class": "Pendulum", "setting": "pendulum_45", "parameter": "rope_length", "value": 0.5, "uncertainty": 0.002}


def written(tmp_path, *rows, **more):
    path = tmp_path / "measured.json"
    path.write_text(json.dumps({"values": [{"unit": "m", **row} for row in rows], **more}), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("kind", "stderr", "half"),
    [("limits", 0.002 / math.sqrt(3), 0.0019), ("standard", 0.002, 0.00392), ("expanded", 0.001, 0.002)],
)
def test_stated_uncertainty_is_read_as_what_it_is(tmp_path, kind, stderr, half):
    length = read_measured(written(tmp_path, {**ROW, "kind": kind})).values_of("Pendulum", "pendulum_45")["rope_length"]
    assert length.stderr == pytest.approx(stderr)
    assert length.interval == pytest.approx((0.5 - half, 0.5 + half), abs=1e-5)


def test_what_is_said_of_a_setting_goes_before_what_is_said_of_all(tmp_path):
    everywhere = {**ROW, "class": "*", "setting": "*", "value": 1.0}
    document = read_measured(written(tmp_path, ROW, everywhere))
    assert document.values_of("Pendulum", "pendulum_45")["rope_length"].value == 0.5
    assert document.values_of("Rotation", "slow")["rope_length"].value == 1.0


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([ROW, ROW], "Pendulum pendulum_45 rope_length is given twice"),
        ([{**ROW, "uncertainty": -1.0}], "uncertainty: Input should be greater than or equal to 0"),
        ([{**ROW, "value": "0.5"}], "value: Input should be a valid number"),
        ([{**ROW, "colour": "red"}], "colour: Extra inputs are not permitted"),
    ],
)
def test_measured_file_that_is_wrong_is_refused(tmp_path, rows, message):
    with pytest.raises(DataError, match=message):
        read_measured(written(tmp_path, *rows))


def test_template_is_a_measured_file_with_the_published_values(tmp_path):
    path = tmp_path / "measured.json"
    path.write_text(document_text(template()), encoding="utf-8")
    document = read_measured(path)
    measured = document.values_of("Sliding_cone", "cone_60")
    assert measured["angle"].value == truth_of("iris", "Sliding_cone", "cone_60", "angle").value
    assert measured["angle"].unit == "deg"
    assert document.values_of("Two_Moving_Pendulums", "pendulum_20")["rope_length_2"].value == 0.5
    assert document.values_of("Falling_ball", "small")["ball_radius"].value == 0.04


def test_board_of_the_command_line_is_for_classes_without_one_of_their_own():
    own = {"class": "Pendulum", "inner_corners": [7, 5], "square_m": 0.03}
    document = MeasuredDocument.model_validate_json(json.dumps({"boards": [own]}))
    document = with_board(document, Board(9, 6, 0.025, 1e-4))
    assert document.board("Pendulum").inner_corners == (7, 5)
    assert document.board("Rotation").square_m == pytest.approx(0.025)
    assert document.board("Rotation").stderr_m == pytest.approx(1e-4)
