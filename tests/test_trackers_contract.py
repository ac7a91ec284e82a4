"""What every registered tracker keeps to, whatever it measures: iterates over the registry."""

import numpy as np
import pytest

from iris_sysid.errors import DataError, IrisError, TrackingError
from iris_sysid.registry import TRACKERS
from iris_sysid.types import Tracker, TrackOptions
from tests._drawn import DrawnClip, moving_disc, noisy, swing

N = 40
PATH = swing(N, (80, 48), (45, 20), period=37.3)


def swinging():
    clip = moving_disc(PATH, 9, (96, 160))
    for picture in clip.pictures:
        picture.flags.writeable = False  # a tracker leaves the frames as they are
    return clip


def tracks_of(tracker: Tracker, clip, **options):
    """The tracks, or None where a tracker says that this clip is not for it."""
    try:
        return tracker.track(clip, TrackOptions(**options))
    except TrackingError:
        return None


@pytest.fixture(params=sorted(TRACKERS))
def tracker(request):
    return TRACKERS[request.param]


@pytest.fixture
def tracks(tracker):
    return tracks_of(tracker, swinging()) or pytest.skip(f"{tracker.name} does not follow a plain disc")


def test_tracker_has_a_name_and_a_one_line_summary(tracker):
    assert tracker.name == tracker.name.lower()
    assert " " not in tracker.name
    assert 10 < len(tracker.summary) < 110
    assert "\n" not in tracker.summary


def test_track_has_one_row_a_frame_with_the_frames_own_times(tracks):
    (found,) = tracks
    np.testing.assert_array_equal(found.frame, np.arange(N))
    np.testing.assert_array_equal(found.t_s, [frame.t_s for frame in swinging().frames()])


def test_valid_samples_have_position_and_standard_error_and_gaps_have_neither(tracks):
    (found,) = tracks
    assert np.isfinite(found.xy_px[found.valid]).all()
    assert (found.sigma_px[found.valid] > 0).all()
    assert np.isnan(found.xy_px[~found.valid]).all()


def test_plain_disc_is_found_where_it_is_drawn(tracks):
    (found,) = tracks
    assert found.n_valid >= N - 2
    assert np.sqrt(np.nanmean((found.xy_px - PATH) ** 2)) < 0.5


def test_origin_names_the_tracker(tracker, tracks):
    assert tracks[0].origin["tracker"] == tracker.name


def test_same_frames_give_the_same_tracks(tracker, tracks):
    (again,) = tracks_of(tracker, swinging())
    np.testing.assert_array_equal(again.xy_px, tracks[0].xy_px)
    np.testing.assert_array_equal(again.sigma_px, tracks[0].sigma_px)


def test_region_that_is_not_in_the_picture_is_refused(tracker):
    with pytest.raises(DataError, match="160"):
        tracker.track(swinging(), TrackOptions(roi=(100, 50, 200, 100)))


def test_progress_is_reported_up_to_the_last_frame(tracker, tracks):
    calls = []
    tracks_of(tracker, swinging(), progress=lambda done, expected: calls.append((done, expected)))
    assert calls
    assert calls[-1] == (N, N)


def refusal(tracker, clip):
    """What a tracker says against a clip; None when it takes it."""
    try:
        tracker.track(clip, TrackOptions())
    except IrisError as error:
        return str(error)
    return None


@pytest.mark.parametrize("frames", [1, 2, 20])
def test_clip_in_which_nothing_is_to_be_found_is_refused_in_words(tracker, frames):
    said = refusal(tracker, DrawnClip(noisy([np.full((96, 160), 90.0)] * frames, 2.0)))
    assert said is None or len(said) > 30
