"""What every registered tracker keeps to, whatever it measures: iterates over the registry."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from iris_sysid.errors import DataError, IrisError
from iris_sysid.registry import TRACKERS
from tests._changing import LAMP, WALLS, draining, fading, turning, weight_at
from tests._drawn import DrawnClip, moving_disc, noisy, swing

N = 40


@dataclass
class Followed:
    """A clip that a tracker promises to follow, and where its body then is (n, 2) px."""

    clip: DrawnClip
    path: np.ndarray


def a_disc_that_moves():
    path = swing(N, (80, 48), (45, 20), period=37.3)
    return Followed(moving_disc(path, 9, (96, 160)), path)


def a_lamp_that_fades():
    return Followed(fading(N)[0], np.tile(LAMP[:2], (N, 1)))


def an_arm_that_turns():
    angle = 0.3 + 0.09 * np.arange(N)
    return Followed(turning(angle), weight_at(angle))


def a_vessel_that_drains():
    level = np.linspace(30.0, 90.0, N)
    return Followed(draining(level), np.column_stack([np.full(N, (sum(WALLS) - 1) / 2), level]))


SCENES = {
    "moving-disc": a_disc_that_moves,
    "fading-lamp": a_lamp_that_fades,
    "turning-arm": an_arm_that_turns,
    "draining-vessel": a_vessel_that_drains,
}


def options_for(tracker, **more):
    return replace(tracker.example.options, **more)


def clip_for(tracker):
    followed = SCENES[tracker.example.scene]()
    for image in followed.clip.images:
        image.flags.writeable = False  # a tracker leaves the frames as they are
    return followed


@pytest.fixture(params=sorted(TRACKERS))
def tracker(request):
    return TRACKERS[request.param]


@pytest.fixture
def tracks(tracker):
    return tracker.track(clip_for(tracker).clip, options_for(tracker))


def test_tracker_has_a_name_and_a_one_line_summary(tracker):
    assert tracker.name == tracker.name.lower()
    assert " " not in tracker.name
    assert 10 < len(tracker.summary) < 110
    assert "\n" not in tracker.summary


def test_track_has_one_row_a_frame_with_the_frames_own_times(tracker, tracks):
    (track,) = tracks
    np.testing.assert_array_equal(track.frame, np.arange(N))
    np.testing.assert_array_equal(track.t_s, [frame.t_s for frame in clip_for(tracker).clip.frames()])


def test_valid_samples_have_position_and_standard_error_and_gaps_have_neither(tracks):
    (track,) = tracks
    assert np.isfinite(track.xy_px[track.valid]).all()
    assert (track.sigma_px[track.valid] > 0).all()
    assert np.isnan(track.xy_px[~track.valid]).all()


def test_what_a_tracker_is_for_is_found_where_it_is_drawn(tracker, tracks):
    (track,) = tracks
    assert track.n_valid >= N - 2
    off = track.xy_px - clip_for(tracker).path
    assert np.sqrt(np.nanmean(off**2)) < tracker.example.tolerance_px


def test_origin_names_the_tracker(tracker, tracks):
    assert tracks[0].origin["tracker"] == tracker.name


def test_same_frames_give_the_same_tracks(tracker, tracks):
    (again,) = tracker.track(clip_for(tracker).clip, options_for(tracker))
    np.testing.assert_array_equal(again.xy_px, tracks[0].xy_px)
    np.testing.assert_array_equal(again.sigma_px, tracks[0].sigma_px)


def test_region_that_is_not_in_the_image_is_refused(tracker):
    with pytest.raises(DataError, match="160"):
        tracker.track(clip_for(tracker).clip, options_for(tracker, roi=(100, 50, 200, 100)))


def test_progress_is_reported_up_to_the_last_frame(tracker):
    calls = []
    options = options_for(tracker, progress=lambda done, expected: calls.append((done, expected)))
    tracker.track(clip_for(tracker).clip, options)
    assert calls
    assert calls[-1] == (N, N)


def refusal(tracker, clip):
    """What a tracker says against a clip; None when it takes it."""
    try:
        tracker.track(clip, options_for(tracker))
    except IrisError as error:
        return str(error)
    return None


@pytest.mark.parametrize("frames", [1, 2, 20])
def test_clip_in_which_nothing_is_to_be_found_is_refused_in_words(tracker, frames):
    message = refusal(tracker, DrawnClip(noisy([np.full((96, 160), 90.0)] * frames, 2.0)))
    assert message is None or len(message) > 30
