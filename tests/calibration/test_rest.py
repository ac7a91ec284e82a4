"""A board that rests in a clip: its corners are those of the frame that the encoder has made clearest."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import BoardPlacement, calibrate_board
from iris_sysid.synthetic.board import _stage, board_for
from iris_sysid.synthetic.encoder import Encoder
from iris_sysid.synthetic.picture import Picture
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.synthetic.sensor import Sensor

SIZE = (320, 180)
FRAMES = 34


@pytest.fixture
def filmed(tmp_path):
    """Error of the scale by a filmed board, its squares ``factor`` times the usual size; its stated error; notes."""

    def calibrated(factor, px_per_frame=0.0):
        plan = plan_clip("dropping-ball", size=SIZE, fps=60.0, duration_s=1.0, seed=0)
        usual = board_for(plan.camera, 0)
        board = replace(usual, square_m=usual.square_m * factor)
        picture = Picture(_stage(board, plan), plan.camera, plan.look, np.random.default_rng(0))
        sensor = Sensor(SIZE, plan.look, np.random.default_rng(1))
        clip = tmp_path / f"{factor}-{px_per_frame}.mp4"
        with Encoder(clip, SIZE, plan.timing.rate, plan.look) as encoder:
            for number in range(FRAMES):
                frame, planes = encoder.blank()
                sensor.read(picture.at(0.0, np.array([px_per_frame * number, 0.0])), planes)
                encoder.write(frame, number)
        plane = calibrate_board(
            [clip], Board(9, 6, board.square_m), placement=BoardPlacement(view=0), one_image=True
        ).calibration
        true = plan.camera.pixels_per_metre
        return (
            plane.scale.value / true - 1,
            plane.scale.stderr / true,
            [note for note in plane.notes if "rests" in note],
        )

    return calibrated


@pytest.mark.parametrize("factor", [1.0, 1.02, 0.93])
def test_resting_board_is_measured_where_the_encoder_shows_it_best(filmed, factor):
    off, stderr, notes = filmed(factor)
    assert abs(off) < 0.001  # by the key frame alone 0.0028 for the first
    assert abs(off) < 2 * stderr
    assert len(notes) == 1


def test_board_that_moves_is_measured_in_the_frame_that_was_named(filmed):
    *_, notes = filmed(1.02, px_per_frame=0.4)
    assert notes == []
