"""The curve behind a track's intensities, and what their errors have in common, survive the way through a file."""

import numpy as np
import pytest

from iris_sysid.errors import DataError
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_track
from iris_sysid.types import Track, Transfer

N = 12


def track(body="1", **brightness):
    t_s = np.arange(N) / 30
    light = np.exp(-t_s)
    return Track(
        t_s, np.zeros((N, 2)), np.ones((N, 2)), np.ones(N, bool), np.arange(N), body, intensity=light, **brightness
    )


def test_transfer_and_patterns_are_read_back(tmp_path):
    patterns = {"transfer function": np.linspace(0, 0.1, N)[np.newaxis], "compression lag": np.ones((2, N)) / 3}
    lit = track("1", transfer=Transfer("gamma", 2.2, 0.03, "given"), intensity_patterns=patterns)
    grey = track("2")
    first, second = read_track(write_track([lit, grey], tmp_path / "track.csv"))
    assert first.transfer == lit.transfer
    assert first.intensity_patterns.keys() == patterns.keys()
    for source, rows in patterns.items():
        np.testing.assert_array_equal(first.intensity_patterns[source], rows)
    assert second.transfer is None
    assert not second.intensity_patterns


def test_patterns_of_another_length_are_refused():
    with pytest.raises(DataError, match="intensity_patterns"):
        track(transfer=Transfer("srgb"), intensity_patterns={"exposure": np.ones((1, N + 1))})


@pytest.mark.parametrize(("name", "gamma", "stderr"), [("rec709", 1, 0.1), ("gamma", 0.01, 0.1), ("srgb", 1, -0.1)])
def test_transfer_that_makes_no_sense_is_refused(name, gamma, stderr):
    with pytest.raises(DataError, match=r"transfer function|gamma"):
        Transfer(name, gamma, stderr)
