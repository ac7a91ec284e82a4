"""The error autocorrelation of tracks and trajectories in the files beside their tables."""

import numpy as np
import pytest

from iris_sysid.io.csv_write import read_track, read_trajectory, write_track, write_trajectory
from iris_sysid.types import ErrorAutocorrelation, Quantity, Track, Trajectory

MEASURED = ErrorAutocorrelation((0.42, -0.08), (0.05, 0.06))


def track(body, measured):
    count = 4
    xy_px = np.arange(2.0 * count).reshape(count, 2)
    origin = {"source": "a.mp4"}
    return Track(
        t_s=np.arange(count) / 60,
        xy_px=xy_px,
        sigma_px=np.full((count, 2), 0.1),
        valid=np.ones(count, bool),
        frame=np.arange(count),
        body=body,
        origin=origin,
        error_autocorrelation=measured,
    )


def trajectory(**fields):
    values = np.arange(4.0)[:, None]
    return Trajectory(np.arange(4) / 60, (Quantity("x", "m"),), values, 0 * values + 0.1, np.ones(4, bool), **fields)


@pytest.mark.parametrize("measured", [(MEASURED, MEASURED), (MEASURED, None), (None, None), (None, MEASURED)])
def test_tracks_keep_their_error_autocorrelation(tmp_path, measured):
    tracks = [track(str(body), autocorrelation) for body, autocorrelation in enumerate(measured)]
    read = read_track(write_track(tracks, tmp_path / "track.csv"))
    assert tuple(one_track.error_autocorrelation for one_track in read) == measured


def test_trajectory_keeps_error_autocorrelation_and_first_frame(tmp_path):
    written = trajectory(error_autocorrelation=MEASURED, first_frame=7)
    read = read_trajectory(write_trajectory(written, tmp_path / "trajectory.csv"))
    assert (read.error_autocorrelation, read.first_frame) == (MEASURED, 7)
