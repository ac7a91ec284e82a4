"""How far a track can be trusted is written beside it and read back; files without it read as before."""

import json

import numpy as np

from iris_sysid import read_track, read_trajectory, to_world, uncalibrated, write_track, write_trajectory
from iris_sysid.types import Doubt, Track, TrackQuality

DOUBTFUL = TrackQuality((Doubt("shadow", "it is a shadow", "use --mark"),), {"same body": 0.4})


def a_track(body="1", quality=None):
    xy_px = np.column_stack([np.arange(5.0), np.arange(5.0)])
    times, all_valid = np.arange(5) / 30, np.ones(5, bool)
    return Track(times, xy_px, np.full((5, 2), 0.1), all_valid, np.arange(5), body=body, quality=quality)


def test_quality_of_each_body_comes_back_from_the_side_car(tmp_path):
    tracks = [a_track("a", DOUBTFUL), a_track("b", TrackQuality()), a_track("c")]
    back = read_track(write_track(tracks, tmp_path / "track.csv"))
    assert [track.quality for track in back] == [DOUBTFUL, TrackQuality(), None]
    assert [bool(track.quality and track.quality.doubtful) for track in back] == [True, False, False]


def test_doubts_go_with_the_trajectory_that_is_made_from_a_track(tmp_path):
    trajectory = to_world(a_track(quality=DOUBTFUL), uncalibrated())
    assert trajectory.doubts == DOUBTFUL.doubts
    assert read_trajectory(write_trajectory(trajectory, tmp_path / "world.csv")).doubts == DOUBTFUL.doubts


def test_side_car_without_a_quality_reads_as_before(tmp_path):
    path = write_track(a_track(), tmp_path / "track.csv")
    side_car = tmp_path / "track.csv.origin.json"
    content = json.loads(side_car.read_text())
    del content["body_quality"], content["doubts"]
    side_car.write_text(json.dumps(content))
    assert read_track(path)[0].quality is None
