"""Gaps of a track that are filled by the body's looks: at the right places, roughly, and never with another thing."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.registry import TRACKERS
from iris_sysid.types import TrackMark, TrackOptions
from tests._drawn import DrawnClip, disc, moving_disc, noisy, paint, swing
from trackers._auto.appearance import Peaks, search_image
from trackers._auto.best_path import MARKED, best_path
from trackers._auto.fill_gaps import with_gaps_filled, with_marks
from trackers._auto.known_body import KnownBody
from trackers._auto.scene import SampledScene
from trackers._frames.working_image import view_of

RADIUS, SHAPE = 9.0, (96, 160)
PATH = swing(40, (80, 48), (45, 20), period=37.3)
GAP = slice(15, 20)


def with_gap(clip, truth=PATH):
    """The track of a disc without its rows in the gap."""
    valid = np.ones(len(truth), np.bool_)
    valid[GAP] = False
    (track,) = TRACKERS["median-background"].track(moving_disc(truth, RADIUS, SHAPE), TrackOptions())
    return replace(track, valid=valid, xy_px=np.where(valid[:, None], track.xy_px, np.nan)), clip


def filled(track, clip, *others):
    return with_gaps_filled(clip, SampledScene(view_of(clip, TrackOptions()), clip.sample(40)), track, others)


def test_gap_is_filled_where_the_body_is_seen_and_known_to_a_third_of_its_radius():
    track = filled(*with_gap(moving_disc(PATH, RADIUS, SHAPE)))
    assert track.valid.all()
    assert np.hypot(*(track.xy_px - PATH)[GAP].T).max() < RADIUS / 3
    np.testing.assert_allclose(track.sigma_px[GAP], 0.35 * RADIUS, rtol=0.1)
    assert track.sigma_px[:10].max() < 0.1


def test_filled_place_is_no_better_known_than_those_beside_it():
    track, clip = with_gap(moving_disc(PATH, RADIUS, SHAPE))
    rough = replace(track, sigma_px=np.full_like(track.sigma_px, 7.0))
    np.testing.assert_allclose(filled(rough, clip).sigma_px[GAP], 7.0)


def test_frames_in_which_the_body_is_held_or_hidden_stay_gaps():
    track, clip = with_gap(moving_disc(PATH, RADIUS, SHAPE))
    assert not filled(replace(track, hand=~track.valid), clip).valid[GAP].any()
    hidden = moving_disc(np.where(track.valid[:, None], PATH, -100.0), RADIUS, SHAPE)
    assert not filled(track, hidden).valid[GAP].any()


def test_track_that_few_samples_show_is_left_as_it_is():
    track, clip = with_gap(moving_disc(PATH, RADIUS, SHAPE))
    scene = SampledScene(view_of(clip, TrackOptions()), clip.sample(40)[GAP])
    assert with_gaps_filled(clip, scene, track) is track


@pytest.mark.parametrize("there", [True, False])
def test_ends_of_a_track_are_filled_as_long_as_the_body_is_where_its_motion_leads(there):
    ends = np.r_[0:2, 38:40]
    path = PATH.copy()
    path[ends] += 0.0 if there else np.array([0.0, 500.0])
    track = with_gap(moving_disc(PATH, RADIUS, SHAPE))[0]
    valid = ~np.isin(np.arange(len(PATH)), ends)
    short = replace(track, valid=valid, xy_px=np.where(valid[:, None], PATH, np.nan))
    found = filled(short, moving_disc(path, RADIUS, SHAPE))
    assert np.all(found.valid[ends] == there)
    if there:
        assert np.hypot(*(found.xy_px - PATH)[ends].T).max() < RADIUS / 2


def test_mark_in_a_gap_says_where_the_body_is_if_the_motion_leads_there_or_the_track_passes_another():
    track = with_gap(moving_disc(PATH, RADIUS, SHAPE))[0]
    lost, seen = (TrackMark("1", *PATH[frame], frame) for frame in (GAP.start, 5))
    found = with_marks(track, [lost, seen])
    assert np.array_equal(np.flatnonzero(found.valid & ~track.valid), [GAP.start])
    np.testing.assert_allclose(found.xy_px[GAP.start], PATH[GAP.start])
    assert found.sigma_px[GAP.start].min() > 1.0
    assert with_marks(track, [lost]).valid[GAP.start]
    assert with_marks(track, [replace(lost, y_px=lost.y_px - 60)]) is track


def test_gap_is_not_filled_with_another_body_that_is_followed():
    other_path = PATH + np.array([0.0, 25.0])
    images = []
    for k, pair in enumerate(zip(PATH, other_path, strict=True)):
        image = np.full((120, 160), 70.0)
        for place in pair[GAP.start <= k < GAP.stop :]:
            image = paint(image, disc(image.shape, *place, RADIUS), 170.0)
        images.append(image)
    track, clip = with_gap(DrawnClip(noisy(images, 2.0)))
    other = replace(track, xy_px=other_path, valid=np.ones(40, np.bool_), body="2")
    assert filled(track, clip).valid[GAP].any()
    assert not filled(track, clip, other).valid[GAP].any()


@pytest.mark.parametrize("twin", [True, False])
def test_place_that_looks_like_the_body_in_samples_with_the_body_elsewhere_does_not_show_it(twin):
    still = np.full(SHAPE, 70.0)
    if twin:
        still = paint(still, disc(SHAPE, 130, 80, RADIUS), 170.0)
    path = swing(40, (70, 40), (45, 20), period=37.3)
    clip = DrawnClip(noisy([paint(still, disc(SHAPE, *place, RADIUS), 170.0) for place in path], 2.0))
    scene = SampledScene(view_of(clip, TrackOptions()), clip.sample(40))
    body = KnownBody.learned(scene, dict(enumerate(path[:30])), RADIUS)
    shown = noisy([paint(np.full(SHAPE, 70.0), disc(SHAPE, 130, 80, RADIUS), 170.0)], 2.0)
    seen = body.clearly_in(search_image(scene.view, next(DrawnClip(shown).frames())))
    assert len(seen.score) == (0 if twin else 1)


def test_marks_do_not_hide_the_body_in_the_frames_between_them():
    path = np.column_stack([np.arange(30.0) * 3, np.full(30, 20.0)])
    frames = [Peaks(place[np.newaxis], np.array([MARKED if k % 3 else 1.0])) for k, place in enumerate(path)]
    assert best_path(frames, reach=20.0) == [0] * 30


def test_body_that_comes_back_for_six_frames_after_a_cut_is_followed_again():
    nothing = [Peaks(np.zeros((0, 2)), np.zeros(0))] * 20
    there = [Peaks(np.array([[4.0 * k, 20.0]]), np.array([1.0])) for k in range(20)]
    back = [Peaks(np.array([[200.0 - 4 * k, 60.0]]), np.array([1.0])) for k in range(6)]
    assert best_path([*there, *nothing, *back], reach=20.0)[-6:] == [0] * 6
