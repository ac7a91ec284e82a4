"""The column ``edited`` of a track table: which positions a person placed or removed."""

import numpy as np
import pytest

from iris_sysid.errors import DataError
from iris_sysid.io.csv_write import read_track, write_track
from tests.io.test_csv import track


def test_edited_samples_read_back(tmp_path):
    edited = np.array([False, True, True, False])
    path = write_track([track(edited=edited), track(body="2")], tmp_path / "track.csv")
    one, two = read_track(path)
    assert one.edited.tolist() == edited.tolist()
    assert two.edited is None


def test_track_that_nobody_edited_has_no_such_column(tmp_path):
    path = write_track(track(), tmp_path / "track.csv")
    assert "edited" not in path.read_text("utf-8").splitlines()[0]


def test_cell_that_is_neither_is_refused(tmp_path):
    path = tmp_path / "track.csv"
    path.write_text("t_s,x_px,y_px,edited\n0,1,1,0\n1,1,1,perhaps\n")
    with pytest.raises(DataError, match=r"edited.*neither 1 nor 0"):
        read_track(path)
