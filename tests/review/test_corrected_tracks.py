"""Corrections of tracks: what changes, what stays, and what a moving camera does to a click."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.errors import DataError
from iris_sysid.review.corrected_tracks import corrected, in_frame_px, with_edits_of
from iris_sysid.review.edits import Delete, Drop, Place, SplitTrack, Swap
from iris_sysid.types import Track
from tests.review.test_doubtful_frames import N, swing


def same(one: Track, other: Track) -> bool:
    return np.array_equal(one.xy_px, other.xy_px, equal_nan=True) and np.array_equal(one.valid, other.valid)


def test_removed_frames_are_gaps_without_any_value():
    (track,) = corrected((swing(hand=np.arange(N) < 5),), Delete(body="1", first=12, last=14))
    assert np.flatnonzero(~track.valid).tolist() == [2, 3, 4]
    assert np.isnan(track.xy_px[2:5]).all()
    assert np.isnan(track.radius_px[2:5]).all()
    assert track.hand[2:5].all()
    assert np.flatnonzero(track.edited).tolist() == [2, 3, 4]


def test_point_of_an_unknown_body_makes_one():
    _, new = corrected((swing(),), Place(body="ball", frame=20, x=5.0, y=6.0))
    assert (new.body, new.n_valid) == ("ball", 1)
    assert new.xy_px[10].tolist() == [5.0, 6.0]
    assert np.array_equal(new.t_s, swing().t_s)


def test_click_is_taken_to_the_first_frame_where_the_camera_moves():
    maps = np.repeat(np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]), N, axis=0)
    maps[:, 0, 2] = 2.0 * np.arange(N)
    maps[50, 0, 1] = 0.1
    (track,) = corrected((swing(camera_motion=maps),), Place(body="1", frame=60, x=200.0, y=40.0))
    assert in_frame_px(track)[50] == pytest.approx([200.0, 40.0])
    assert track.xy_px[50] == pytest.approx([200.0 - 100.0 - 4.0, 40.0])


def test_swap_twice_is_no_swap():
    tracks = (swing(), swing("2", phase=1.0, radius_px=None))
    once = corrected(tracks, Swap(body="1", other="2", frame=110))
    assert np.array_equal(once[0].xy_px[100:], tracks[1].xy_px[100:])
    assert np.array_equal(once[1].radius_px[100:], tracks[0].radius_px[100:])
    assert np.isnan(once[0].radius_px[100:]).all()
    twice = corrected(once, Swap(body="2", other="1", frame=110))
    assert all(same(*pair) for pair in zip(twice, tracks, strict=True))


def test_split_then_swap_puts_the_track_together_again():
    parts = corrected((swing(),), SplitTrack(body="1", frame=110, name="2"))
    assert [part.n_valid for part in parts] == [100, N - 100]
    whole = corrected(parts, Swap(body="1", other="2", frame=110))
    assert same(whole[0], swing())


def test_point_of_a_body_at_rest_fills_the_gap_around_it_and_nothing_else():
    lost = corrected((swing(),), Delete(body="1", first=40, last=40))[0]  # by hand: not to be seen there
    valid = lost.valid.copy()
    valid[(lost.frame >= 30) & (lost.frame < 60)] = False
    (track,) = corrected((replace(lost, valid=valid),), Place(body="1", frame=50, x=7.0, y=8.0, at_rest=True))
    filled = (track.frame > 40) & (track.frame < 60)
    assert (track.xy_px[filled] == (7.0, 8.0)).all()
    assert track.valid[filled].all()
    assert not track.valid[(track.frame >= 30) & (track.frame <= 40)].any()
    assert np.array_equal(track.xy_px[track.frame >= 60], lost.xy_px[track.frame >= 60])
    (found,) = corrected((swing(),), Place(body="1", frame=50, x=7.0, y=8.0, at_rest=True))
    assert found.edited.sum() == 1


def test_edits_survive_tracks_made_anew_and_bodies_placed_by_hand_too():
    old = corrected((swing(),), Place(body="1", frame=60, x=1.0, y=2.0, zoom=3.0))
    old = corrected(old, Delete(body="1", first=70, last=70))
    old = corrected(old, Place(body="hand-made", frame=80, x=3.0, y=4.0))
    fresh = swing(seed=9)
    tracks = with_edits_of([fresh], old)
    assert [track.body for track in tracks] == ["1", "hand-made"]
    assert tracks[0].xy_px[50].tolist() == [1.0, 2.0]
    assert tracks[0].sigma_px[50].tolist() == [0.5, 0.5]
    assert not tracks[0].valid[60]
    assert np.flatnonzero(tracks[0].edited).tolist() == [50, 60]
    rest = np.ones(N, bool)
    rest[[50, 60]] = False
    assert np.array_equal(tracks[0].xy_px[rest], fresh.xy_px[rest])
    assert tracks[1].xy_px[70].tolist() == [3.0, 4.0]


def test_edits_in_frames_that_the_new_tracks_lack_are_left_out():
    old = corrected((swing(),), Place(body="1", frame=60, x=1.0, y=2.0))
    part = slice(100, 200)
    fresh = swing()
    short = Track(
        t_s=fresh.t_s[part],
        xy_px=fresh.xy_px[part],
        sigma_px=fresh.sigma_px[part],
        valid=fresh.valid[part],
        frame=fresh.frame[part],
    )
    (track,) = with_edits_of([short], old)
    assert same(track, short)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (Place(body="1", frame=5, x=0, y=0), "frame 5 is not among the frames that were tracked, 10 to 309"),
        (Delete(body="1", first=500, last=600), "frames 500 to 600 are not among"),
        (Delete(body="3", first=10, last=11), "there is no body '3'; there are 1, 2"),
        (SplitTrack(body="1", frame=20, name="2"), "there is a body '2' already"),
        (Swap(body="1", other="1", frame=20), "cannot be exchanged with itself"),
        (Drop(body="x"), "there is no body 'x'"),
    ],
)
def test_edit_that_cannot_be_made_says_why(edit, said):
    with pytest.raises(DataError, match=said):
        corrected((swing(), swing("2")), edit)


def test_point_before_anything_was_tracked_is_refused():
    with pytest.raises(DataError, match="track the clip first"):
        corrected((), Place(body="1", frame=5, x=0, y=0))


def test_number_of_bodies_is_bounded():
    tracks = (swing(),)
    for k in range(2, 65):
        tracks = corrected(tracks, Place(body=str(k), frame=20, x=0, y=0))
    with pytest.raises(DataError, match="at most 64"):
        corrected(tracks, Place(body="65", frame=20, x=0, y=0))
