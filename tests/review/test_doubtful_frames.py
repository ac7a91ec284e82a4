"""Which frames a review asks about: those that are wrong, and few that are right."""

import itertools

import numpy as np
import pytest

from iris_sysid.review.corrected_tracks import corrected
from iris_sysid.review.doubtful_frames import questions_of
from iris_sysid.review.edits import Confirm, Place
from iris_sysid.review.history import ReviewState, after
from iris_sysid.review.request import ReviewRequest
from iris_sysid.types import Doubt, Track, TrackQuality

N = 300


def swing(body="1", phase=0.0, seed=1, **changes):
    """A body that swings 120 px to either side in 75 frames, located to 0.05 px."""
    turn = 2 * np.pi * np.arange(N) / 75 + phase
    xy = np.column_stack([160 + 120 * np.cos(turn), 90 + 10 * np.cos(2 * turn)])
    values = {
        "t_s": np.arange(N) / 60,
        "xy_px": xy + np.random.default_rng(seed).normal(0, 0.05, xy.shape),
        "sigma_px": np.full((N, 2), 0.05),
        "valid": np.ones(N, bool),
        "frame": np.arange(N) + 10,
        "body": body,
        "radius_px": np.full(N, 6.0),
    }
    return Track(**(values | changes))


def moved(track, rows, by):
    xy = track.xy_px.copy()
    xy[rows] += by
    return {"xy_px": xy}


def asked(*tracks, **more):
    return questions_of(tracks, **more)


def covers(questions, frames):
    """The share of the frames that lie in a question."""
    return np.mean([any(q.first <= frame <= q.last for q in questions) for frame in frames])


def test_track_that_is_right_is_not_asked_about():
    assert asked(swing()) == []


def test_points_beside_the_body_are_asked_about_with_the_distance():
    rows = [50, 120, 135, 200]
    questions = asked(swing(**moved(swing(), rows, (15.0, 0.0))))
    assert sorted(question.frame for question in questions) == [60, 130, 145, 210]
    assert "15 px off the course" in questions[0].reasons[0]


def test_stretch_on_another_thing_is_one_question_over_all_of_it():
    rows = np.arange(100, 125)
    track = swing()
    xy = track.xy_px.copy()
    xy[rows] = (20.0, 150.0)
    (question,) = asked(swing(xy_px=xy))
    assert (question.first, question.last) == (110, 134)
    assert "elsewhere for 25 frames" in question.reasons[0]


def test_wrong_frames_are_held_by_the_questions():
    """Of frames made wrong at random, in runs of 1 to 30, nine in ten are asked about; of the right ones few."""
    rng = np.random.default_rng(7)
    held, extra = [], []
    for seed in range(40):
        track = swing(seed=seed)
        start, length = int(rng.integers(30, 240)), int(rng.integers(1, 30))
        off = rng.uniform(8, 60) * np.array([np.cos(seed), np.sin(seed)])
        rows = np.arange(start, start + length)
        questions = asked(swing(seed=seed, **moved(track, rows, off)))
        wrong = set(track.frame[rows])
        held.append(covers(questions, wrong))
        extra.append(covers(questions, set(track.frame) - wrong))
    assert np.mean(held) >= 0.9
    assert np.mean(extra) <= 0.05


def test_gap_is_asked_about_where_it_begins_and_short_or_held_ones_are_not():
    valid = np.ones(N, bool)
    valid[100:108] = valid[150:152] = valid[200:220] = False
    hand = np.zeros(N, bool)
    hand[200:220] = True
    (question,) = asked(swing(valid=valid, hand=hand))
    assert question.frame == 110
    assert "lost for 8 frames" in question.reasons[0]


def test_body_that_leaves_the_image_is_not_lost():
    valid = np.ones(N, bool)
    valid[30:45] = False  # about the left turn, at x = 40
    track = swing(valid=valid, xy_px=np.where(valid[:, None], swing().xy_px, np.nan))
    assert len(asked(track, image_size=(320, 180))) == 1
    shifted = swing(valid=valid, xy_px=np.where(valid[:, None], swing().xy_px - (60.0, 0.0), np.nan))
    assert asked(shifted, image_size=(320, 180)) == []


def test_frames_before_the_body_comes_in_are_not_asked_about():
    valid = np.arange(N) > 80
    assert asked(swing(valid=valid)) == []


def test_size_and_standard_error_out_of_line_are_asked_about():
    radius, sigma = np.full(N, 6.0), np.full((N, 2), 0.05)
    radius[100], sigma[200] = 12.0, 3.0
    questions = asked(swing(radius_px=radius, sigma_px=sigma))
    assert {question.frame for question in questions} == {110, 210}


def test_bodies_that_meet_are_asked_about_once():
    other = swing("2", xy_px=swing().xy_px[::-1].copy())
    questions = asked(swing(), other)
    assert questions
    assert all("bodies 1 and 2 meet" in question.reasons[0] for question in questions)
    assert {question.body for question in questions} == {"1"}


def test_doubt_about_the_whole_track_is_a_question_that_can_be_confirmed():
    doubt = Doubt("jumps", "the track leaps 7 times", "mark it")
    (question,) = asked(swing(quality=TrackQuality((doubt,))))
    assert (question.doubts, question.first, question.last) == (("jumps",), 10, 309)
    (track,) = corrected(
        (swing(quality=TrackQuality((doubt,))),), Confirm(body="1", first=10, last=309, doubts=("jumps",))
    )
    assert asked(track) == []


def test_track_doubted_as_a_whole_is_asked_about_a_stretch_at_a_time_in_all_of_its_frames():
    doubt = Doubt("jumps", "the track leaps 7 times", "mark it")
    track = swing(**moved(swing(), range(100, 300), (90.0, 0.0)), quality=TrackQuality((doubt,)))
    stretches = sorted((one for one in asked(track) if one.doubts), key=lambda one: one.first)
    assert 2 <= len(stretches) <= 6
    assert (stretches[0].first, stretches[-1].last) == (10, 309)
    assert all(one.last + 1 == later.first for one, later in itertools.pairwise(stretches))
    assert any(abs(one.first - 110) <= 2 for one in stretches)  # where the track leaps
    state = ReviewState(ReviewRequest(), (track,))
    for k, one in enumerate(stretches):
        assert state.tracks[0].quality.doubts, f"stretch {k}"
        confirm = Confirm(body="1", first=one.first, last=one.last, doubts=one.doubts)
        state = after(state, confirm, lambda file: ())
    assert state.tracks[0].quality.doubts == ()


def test_question_is_answered_by_a_correction_or_by_saying_that_it_is_right():
    track = swing(**moved(swing(), [50], (15.0, 0.0)))
    (question,) = asked(track)
    assert not question.answered
    right = swing().xy_px[50]
    placed = Place(body="1", frame=60, x=right[0] + 9.0, y=right[1], zoom=4.0)
    assert all(question.answered for question in questions_of(corrected((track,), placed)))
    assert asked(track, confirmed=[("1", question.first, question.last)])[0].answered


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_short_track_is_no_trouble(n):
    values = {
        "t_s": np.arange(n) / 60,
        "xy_px": np.ones((n, 2)),
        "sigma_px": np.ones((n, 2)),
        "valid": np.ones(n, bool),
    }
    assert questions_of([Track(**values, frame=np.arange(n))]) == []


def test_body_that_was_never_found_is_no_trouble():
    nothing = np.full((N, 2), np.nan)
    assert asked(swing(xy_px=nothing, sigma_px=nothing, valid=np.zeros(N, bool), radius_px=np.full(N, np.nan))) == []
