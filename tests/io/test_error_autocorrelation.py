"""The error autocorrelation of tracks and trajectories in the files beside their tables, also of version 1."""

import json

import numpy as np
import pytest

from iris_sysid.io.csv_write import read_track, read_trajectory, write_track, write_trajectory
from iris_sysid.types import ErrorAutocorrelation, Quantity, Track, Trajectory

MEASURED = ErrorAutocorrelation((0.42, -0.08), (0.05, 0.06))
PAIRS = [[0.42, 0.05], [-0.08, 0.06]]


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


def rewrite(path, **changes):
    """Change the file beside a table, as an older version would have written it."""
    beside = path.with_name(path.name + ".origin.json")
    content = json.loads(beside.read_text()) | {"version": 1} | changes
    for key in ("error_autocorrelation", "body_error_autocorrelation", "first_frame"):
        del content[key]
    beside.write_text(json.dumps(content))


@pytest.mark.parametrize("measured", [(MEASURED, MEASURED), (MEASURED, None), (None, None), (None, MEASURED)])
def test_tracks_keep_their_error_autocorrelation(tmp_path, measured):
    tracks = [track(str(body), autocorrelation) for body, autocorrelation in enumerate(measured)]
    read = read_track(write_track(tracks, tmp_path / "track.csv"))
    assert tuple(one_track.error_autocorrelation for one_track in read) == measured


def test_trajectory_keeps_error_autocorrelation_and_first_frame(tmp_path):
    written = trajectory(error_autocorrelation=MEASURED, first_frame=7)
    read = read_trajectory(write_trajectory(written, tmp_path / "trajectory.csv"))
    assert (read.error_autocorrelation, read.first_frame) == (MEASURED, 7)


def test_track_of_version_1_is_read(tmp_path):
    path = write_track(track("1", None), tmp_path / "track.csv")
    rewrite(path, origin={"source": "a.mp4", "error_memory": PAIRS})
    (read,) = read_track(path)
    assert read.error_autocorrelation == MEASURED
    assert dict(read.origin) == {"source": "a.mp4"}


def test_tracks_of_version_1_with_several_bodies_are_read(tmp_path):
    path = write_track([track("1", None), track("2", None)], tmp_path / "track.csv")
    rewrite(path, origin={}, bodies={"1": {"error_memory": PAIRS}, "2": {"source": "b.mp4"}})
    read = {body.body: body for body in read_track(path)}
    assert read["1"].error_autocorrelation == MEASURED
    assert read["2"].error_autocorrelation is None


def test_trajectory_of_version_1_is_read(tmp_path):
    path = write_trajectory(trajectory(), tmp_path / "trajectory.csv")
    entry = {"ci95": [0.0, 1.0], "unit": "1", "measurement_type": "derived", "source": "outline"}
    geometry = {
        f"error_memory_{lag}": {"value": value, "stderr": stderr, **entry}
        for lag, (value, stderr) in enumerate(PAIRS, 1)
    }
    # the origin held the tracker's own standard errors, the geometry those for a fit
    rewrite(path, geometry=geometry, origin={"first_frame": 7, "error_memory": [[0.42, 0.01], [-0.08, 0.01]]})
    read = read_trajectory(path)
    assert (read.error_autocorrelation, read.first_frame) == (MEASURED, 7)
    assert dict(read.geometry) == dict(read.origin) == {}


def test_radius_of_version_1_has_no_error_autocorrelation(tmp_path):
    path = write_trajectory(trajectory(), tmp_path / "trajectory.csv")
    rewrite(path, origin={"error_memory": PAIRS})
    assert read_trajectory(path).error_autocorrelation is None
