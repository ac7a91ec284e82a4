"""The tracker auto on ordinary phone clips: on the body or doubtful; the first tracker's track where it is right."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from iris_sysid.errors import DataError
from iris_sysid.registry import TRACKERS
from iris_sysid.types import Track, TrackCandidate, Tracker, TrackMark, TrackOptions, TrackQuality
from tests import _phone_clips as phone
from tests._drawn import DrawnClip, disc, moving_disc, noisy, paint, swing
from trackers._auto import verdict
from trackers._auto.appearance import Peaks
from trackers._auto.best_path import best_path
from trackers._auto.candidates import TrackingStrategy
from trackers._auto.choose import FILLED, TrackerSelection, contradicted, no_worse_filled
from trackers._auto.evidence import (
    Patches,
    disc_not_followed,
    evidence_against,
    kinks,
    lost_together,
    missed_marks,
    two_on_one,
)
from trackers._auto.marked_size import radius_by_colour
from trackers._auto.scene import SampledScene
from trackers._auto.survey import looks_like_shadow
from trackers._auto.verdict import OFF, PROBABILITY, WORDS, judged, probability_of
from trackers._auto.verdict_weights import DOUBTFUL, SURE, WEIGHTS
from trackers._detection.detect_frames import detection_setup
from trackers._frames.working_image import view_of

AUTO = TRACKERS["auto"]


def mark(phone_clip, frame, body=0, name="1"):
    x, y = phone_clip.truth[body, frame]
    return TrackMark(name, float(x), float(y), frame)


def followed(phone_clip, **options):
    return AUTO.track(phone_clip.clip, TrackOptions(**{"bodies": len(phone_clip.truth), **options}))


def doubts(tracks):
    return {doubt.kind for track in tracks for doubt in track.quality.doubts}


def test_track_of_the_first_tracker_is_taken_as_it_is_where_nothing_speaks_against_it():
    clip = moving_disc(swing(40, (80, 48), (45, 20), period=37.3), 9, (96, 160))
    (first,) = TRACKERS["median-background"].track(clip, TrackOptions())
    clip.decoded = 0
    (track,) = AUTO.track(clip, TrackOptions())
    assert clip.decoded == 40  # the clip is read no second time
    for name in ("t_s", "xy_px", "sigma_px", "valid", "radius_px", "area_px", "intensity", "hand"):
        np.testing.assert_array_equal(getattr(track, name), getattr(first, name))
    assert not track.quality.doubtful
    assert track.origin["chosen"] == "median-background"


def test_ball_is_followed_and_not_the_person_who_walks_behind_it():
    clip = phone.somebody_walks_behind()
    on_body, elsewhere = phone.on_body(clip, followed(clip))
    assert on_body > 0.95
    assert elsewhere < 0.02


def test_track_of_a_shadow_is_said_to_be_one_with_the_mark_that_helps():
    clip = phone.like_the_wall(50)
    tracks = followed(clip)
    on_body, _ = phone.on_body(clip, tracks)
    assert on_body > 0.95 or doubts(tracks) & {"shadow", "missed", "ambiguous"}
    wrong = TRACKERS["median-background"].track(clip.clip, TrackOptions())[0]
    assert phone.on_body(clip, [wrong])[0] < 0.1  # what auto has to see


def test_one_mark_makes_the_track_of_a_ball_like_the_wall_right():
    clip = phone.like_the_wall(50)
    tracks = followed(clip, marks=(mark(clip, 10),))
    assert phone.on_body(clip, tracks)[0] > 0.95
    assert tracks[0].origin["chosen"] == "marks"


def test_path_that_marks_lead_elsewhere_than_a_good_one_that_passes_them_is_contradicted():
    def candidate(name, away):
        xy_px = swing(40, (80, 48 + away), (45, 20), period=37.3)
        quality = TrackQuality((), {PROBABILITY: 0.9})
        rows, radius = np.arange(40), np.full(40, 9.0)
        return TrackCandidate(
            name, (Track(rows / 30, xy_px, np.ones_like(xy_px), rows >= 0, rows, radius_px=radius, quality=quality),)
        )

    free = candidate("path-at-marks", 0.0)
    assert contradicted(candidate("marks", 50.0), [free])
    assert not contradicted(candidate("marks", 2.0), [free])
    assert not contradicted(free, [candidate("marks", 50.0)])


def test_filled_track_is_taken_unless_that_raises_a_doubt():
    assert no_worse_filled(0.95, DOUBTFUL)
    assert not no_worse_filled(0.95, DOUBTFUL - 0.01)
    assert no_worse_filled(0.6, 0.59)
    assert not no_worse_filled(0.6, 0.5)


def test_way_that_cannot_be_more_probable_than_a_candidate_is_surpassed():
    def surpassed(probability, *against):
        rows = np.arange(9)
        quality = TrackQuality((), {PROBABILITY: probability})
        track = Track(rows / 30, np.ones((9, 2)), np.ones((9, 2)), rows >= 0, rows, quality=quality)
        choice = TrackerSelection(None, TrackOptions(), None, [TrackCandidate("first", (track,))])
        return choice.surpasses(TrackingStrategy("next", list, against))

    unseen = dict.fromkeys([*WEIGHTS, *OFF], 0.0)
    for name in ("beside", "guessed"):
        least = probability_of(unseen | {name: 1.0})
        assert surpassed(least + 1e-9, name)
        assert not surpassed(least - 1e-9, name)
        assert not surpassed(least + 1e-9)


def test_marks_name_the_bodies_and_tell_two_alike_apart():
    clip = phone.two_of_the_same_kind(40)
    marks = (mark(clip, 5, 1, "right"), mark(clip, 5, 0, "left"))
    tracks = {track.body: track for track in followed(clip, marks=marks)}
    for name, truth in zip(("left", "right"), clip.truth, strict=True):
        assert np.nanmean(np.hypot(*(tracks[name].xy_px - truth).T)) < 2


@pytest.mark.parametrize(
    ("marks", "message"),
    [
        ((TrackMark("1", 50.0, 50.0, 4000),), "frame 4000"),
        ((TrackMark("1", 5000.0, 50.0, 3),), "does not lie in the image"),
    ],
)
def test_mark_outside_of_the_clip_is_refused(marks, message):
    with pytest.raises(DataError, match=message):
        AUTO.track(moving_disc(swing(20, (64, 48), (35, 20)), 9), TrackOptions(marks=marks))


def large_and_small():
    """A large disc and a small one that goes less far: clip, and their places (40, 2) px."""
    large, small = swing(40, (80, 34), (60, 4), period=37.3), swing(40, (80, 84), (40, 2), period=33.1)
    plain = np.full((96, 160), 70.0)
    images = [
        paint(paint(plain, disc(plain.shape, *at, 12.0), 150.0), disc(plain.shape, *other, 4.0), 150.0)
        for at, other in zip(large, small, strict=True)
    ]
    return DrawnClip(noisy(images, 2.0)), large, small


def test_mark_takes_the_path_of_a_small_body_beside_a_larger_one_that_goes_farther():
    clip, large, small = large_and_small()
    options = TrackOptions(marks=(TrackMark("1", *map(float, small[7]), 7),))
    choice = TrackerSelection.of(clip, options)
    assert np.nanmax(np.hypot(*(choice.first()[0].xy_px - large).T)) < 0.5
    (track,) = choice.at_marks()
    assert np.nanmax(np.hypot(*(track.xy_px - small).T)) < 0.5
    assert track.valid.mean() > 0.95


def test_next_best_is_what_moves_beside_all_that_was_tried():
    clip, large, small = large_and_small()
    choice = TrackerSelection.of(clip, TrackOptions())
    assert (
        np.nanmax(np.hypot(*(choice.attempt(TrackingStrategy("first", choice.first)).tracks[0].xy_px - large).T)) < 0.5
    )
    (track,) = choice.next_best()
    assert np.nanmax(np.hypot(*(track.xy_px - small).T)) < 0.5


@pytest.fixture
def with_plug_in(monkeypatch):
    """Adds a tracker to the registry as an entry point would."""

    def add(tracker):
        len(TRACKERS)  # all are known before this one
        monkeypatch.setattr(TRACKERS, "_items", {**TRACKERS, tracker.name: tracker})

    return add


@pytest.mark.parametrize("suited", [True, False])
def test_registered_tracker_takes_part_where_it_suits_and_wins_by_its_tracks(with_plug_in, suited):
    clip = phone.like_the_wall(50)
    asked = []

    def known(video, options):
        t_s = np.array([frame.t_s for frame in video.frames()])
        radius = np.full(len(t_s), 8.0)
        return [Track(t_s, clip.truth[0], np.full((len(t_s), 2), 0.2), t_s >= 0, np.arange(len(t_s)), radius_px=radius)]

    def suits(video, options, moving):
        asked.append((video.width, options.bodies, moving))
        return suited

    with_plug_in(Tracker(name="foreign", summary="knows where the ball is", track=known, suits=suits))
    (track,) = AUTO.track(clip.clip, TrackOptions())
    assert asked == [(clip.clip.width, 1, True)]
    assert ("foreign" in track.origin["tried"]) == suited
    assert (track.origin["chosen"] == "foreign") == suited


def test_fewer_marked_bodies_than_asked_for_are_refused():
    clip = moving_disc(swing(20, (64, 48), (35, 20)), 9)
    with pytest.raises(DataError, match="2 bodies were requested, but 1 are marked"):
        AUTO.track(clip, TrackOptions(bodies=2, marks=(TrackMark("1", 10.0, 90.0, 3),)))


def test_mark_outside_of_the_region_is_refused():
    clip = moving_disc(swing(20, (64, 48), (35, 20)), 9)
    with pytest.raises(DataError, match=r"the mark 1=120,90@3 does not lie in the region x=0\.\.110, y=0\.\.80"):
        AUTO.track(clip, TrackOptions(roi=(0, 0, 110, 80), marks=(TrackMark("1", 120.0, 90.0, 3),)))


def test_all_candidates_are_handed_to_who_wants_them_explained():
    clip = phone.somebody_walks_behind(60)
    candidates = []
    (track,) = followed(clip, explain=candidates.extend)
    names = [candidate.name for candidate in candidates]
    assert {"median-background", "median-background-2", "appearance-1"} <= set(names)
    (chosen,) = [candidate for candidate in candidates if candidate.chosen]
    assert chosen.name == track.origin["chosen"]
    sure = {candidate.name: candidate.tracks[0].quality.evidence[PROBABILITY] for candidate in candidates}
    assert sure[chosen.name] == max(sure.values()) > sure["median-background"]


@pytest.mark.slow
@pytest.mark.parametrize("make", phone.CLIPS, ids=lambda make: make.__name__)
def test_phone_clip_is_followed_or_said_to_be_doubtful(make):
    clip = make()
    tracks = followed(clip)
    on_body, elsewhere = phone.on_body(clip, tracks)
    if doubts(tracks):
        assert make in (phone.like_the_wall, phone.mostly_at_rest)  # these need a mark
    else:
        assert on_body > 0.93
        assert elsewhere < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("make", phone.CLIPS, ids=lambda make: make.__name__)
def test_phone_clip_is_right_with_one_mark_a_body(make):
    clip = make()
    frame = int(np.flatnonzero(np.isfinite(clip.truth[..., 0]).all(axis=0))[5])
    marks = tuple(mark(clip, frame, k, str(k + 1)) for k in range(len(clip.truth)))
    on_body, elsewhere = phone.on_body(clip, followed(clip, marks=marks))
    assert on_body > 0.93
    assert elsewhere < 0.02


# --------------------------------------------------------------------------- evidence


def test_wall_in_less_light_is_a_shadow_and_a_dark_red_ball_is_none():
    wall = np.array([160.0, 132.0, 119.0])
    assert looks_like_shadow(np.array([80.0, 130.0, 123.5]), wall)
    assert not looks_like_shadow(np.array([80.0, 180.0, 110.0]), wall)
    assert not looks_like_shadow(np.array([190.0, 132.0, 119.0]), wall)


def a_track(xy_px, **more):
    clip = moving_disc(np.asarray(xy_px, float), 9, (96, 160))
    (track,) = TRACKERS["median-background"].track(clip, TrackOptions())
    return clip, replace(track, **more)


def test_what_has_not_the_stated_colour_is_no_rival_of_the_body():
    angles = 0.6 * np.cos(2 * np.pi * np.arange(40) / 26.3)
    ends = np.column_stack([160 + 150 * np.sin(angles), 20 + 150 * np.cos(angles)])
    images = [np.full((200, 320, 3), (150, 165, 172), np.uint8) for _ in ends]
    for image, end in zip(images, ends, strict=True):
        cv2.line(image, (160, 20), tuple(np.rint(end).astype(int)), (110, 90, 60), 9, cv2.LINE_AA)
        cv2.circle(image, tuple(np.rint(end).astype(int)), 8, (20, 20, 200), -1, cv2.LINE_AA)
    (track,) = AUTO.track(DrawnClip(images), TrackOptions(colour="red"))
    assert np.nanmax(np.hypot(*(track.xy_px - ends).T)) < 3.0
    assert not track.quality.doubtful
    assert track.quality.evidence["rival"] == 0.0


def scene_of(clip):
    return SampledScene(view_of(clip, TrackOptions()), clip.sample(40))


SWING = swing(40, (80, 48), (45, 20), period=37.3)
NONE = dict.fromkeys(WORDS, 0.0)


def test_probability_falls_with_every_evidence_and_never_rises():
    for name in WORDS:
        values = [probability_of({**NONE, name: share}) for share in (0.0, 0.2, 1.0)]
        assert values == sorted(values, reverse=True)
        assert (values[0] > values[2]) == (name in {*WEIGHTS, *OFF})
    assert probability_of(NONE) >= SURE >= DOUBTFUL > probability_of(dict.fromkeys(WORDS, 1.0))


def test_doubts_name_the_evidence_that_speaks_most_against_a_track_and_the_option_that_helps():
    clip, track = a_track(SWING)
    off = replace(track, xy_px=swing(40, (80, 82), (60, 2), period=51.7))
    quality = judged(off, scene_of(clip))
    assert quality.evidence[PROBABILITY] < DOUBTFUL
    assert quality.doubts
    assert len(quality.doubts) <= 3
    assert all("--mark 1=" in doubt.remedy for doubt in quality.doubts)
    assert not judged(track, scene_of(clip)).doubts


def test_every_evidence_has_a_sentence_and_an_option_that_helps():
    known = {"share": 0.5, "count": 3, "radii": 1.0, "body": "1", "frame": 7, "x": 5.0, "y": 6.0}
    for _, finding, remedy in WORDS.values():
        assert "{" not in finding.format(**known)
        assert "--" in remedy.format(**known)


def test_track_that_misses_a_mark_is_not_on_its_body():
    clip, track = a_track(SWING)
    x, y = track.xy_px[10]
    on, off = (judged(track, scene_of(clip), marks=[TrackMark("1", x + far, y, 10)]) for far in (0, 20))
    assert not on.doubts
    assert off.evidence[PROBABILITY] == 0.0
    assert off.doubts[0].kind == "off-marks"


def test_track_that_shows_the_wall_half_of_the_time_is_that_of_another_body():
    clip, track = a_track(SWING)
    xy_px = track.xy_px.copy()
    xy_px[::2] += (0, 30)
    assert evidence_against(track, scene_of(clip))["other colours"] == 0.0
    assert evidence_against(replace(track, xy_px=xy_px), scene_of(clip))["other colours"] > 0.3


def test_two_tracks_of_one_body_are_told_and_two_bodies_side_by_side_are_not():
    _, track = a_track(SWING)
    same = replace(track, xy_px=track.xy_px + 5, body="2")
    beside = replace(track, xy_px=track.xy_px + np.array([20, 0]), body="2")
    partly = np.where(np.arange(40)[:, None] < 16, same.xy_px, beside.xy_px)
    assert two_on_one(track, [same]) == 1.0
    assert two_on_one(track, [beside]) == 0.0
    assert two_on_one(track, [replace(beside, xy_px=partly)]) == pytest.approx(0.4, abs=0.05)


def dropped_by_a_fist(held=10, falling=14, n=60, shape=(120, 160)):
    """A ball that falls away from the camera while a fist leaves: clip, and radius (n,) px of the ball at (80, 60)."""
    radius = 30.0 / (1 + 0.12 * np.clip(np.arange(n) - held, 0, falling))
    images = []
    for k, size in enumerate(radius):
        image = np.full(shape, 90.0)
        left = 112 + 5 * max(0, k - held)
        image[40:80, left : left + 26] = 140.0
        images.append(paint(image, disc(shape, 80, 60, size), 200.0))
    return DrawnClip(noisy(images, 2.0)), radius


def test_ball_that_falls_away_from_the_camera_is_followed_and_not_the_fist():
    clip, radius = dropped_by_a_fist()
    (track,) = AUTO.track(clip, TrackOptions())
    assert track.origin["chosen"] == "disc" + FILLED
    assert track.valid.mean() > 0.95
    np.testing.assert_allclose(track.radius_px[track.valid], radius[track.valid], atol=0.5)


def test_share_of_a_disc_that_changes_its_size_which_a_track_leaves_out():
    clip, _ = dropped_by_a_fist()
    place = np.full((60, 2), (80.0, 60.0))
    track = Track(np.arange(60) / 60, place, np.full((60, 2), 0.1), np.ones(60, np.bool_), np.arange(60))
    assert disc_not_followed(track, scene_of(clip)) == 0.0
    assert disc_not_followed(replace(track, valid=np.arange(60) < 20), scene_of(clip)) > 0.4
    swinging = moving_disc(SWING, 9, (96, 160))
    assert scene_of(swinging).receding == {}


def test_things_of_two_colours_in_turn_are_not_one_body_of_the_colour_between_them():
    around = np.tile([119.0, 131.0, 120.0], (20, 1))
    hair, ball = np.array([47.0, 131.0, 126.0]), np.array([153.0, 68.0, 171.0])
    both = Patches(np.arange(20), np.where(np.arange(20)[:, None] % 2, hair, ball), around)
    assert np.mean(both.likeness() > 0.5) == 0.5
    shaded = Patches(np.arange(20), ball * np.linspace([0.75, 1, 1], 1, 20), around)
    assert np.all(shaded.likeness() > 0.5)


@pytest.mark.parametrize(("arm", "share"), [(True, 1.0), (False, 0.0)])
def test_body_at_the_end_of_an_arm_hangs_together_with_the_edge(arm, share):
    places = swing(40, (80, 40), (45, 12), period=37.3)
    images = []
    for x, y in places:
        image = np.full((96, 160), 110.0)
        if arm:
            image[int(y) :, int(x) - 7 : int(x) + 7] = 70.0
        images.append(paint(image, disc((96, 160), x, y, 9), 200.0))
    clip = DrawnClip(noisy(images, 2.0))
    (track,) = TRACKERS["median-background"].track(moving_disc(places, 9, (96, 160)), TrackOptions())
    assert evidence_against(track, scene_of(clip))["at the edge"] == pytest.approx(share, abs=0.3)


def test_body_near_the_edge_is_held_only_where_no_hand_was_looked_for(monkeypatch):
    clip, track = a_track(SWING)
    against = evidence_against(track, scene_of(clip)) | {"at the edge": 0.6}
    monkeypatch.setattr(verdict, "evidence_against", lambda *_: dict(against))
    assert [doubt.kind for doubt in judged(track, scene_of(clip)).doubts] == []
    assert [doubt.kind for doubt in judged(replace(track, hand=None), scene_of(clip)).doubts] == ["held"]


def test_path_is_broken_where_the_body_is_off_its_way_for_a_frame():
    _, track = a_track(SWING)
    assert kinks(track) == 0.0
    xy_px = track.xy_px.copy()
    xy_px[20] += (12, 0)
    assert kinks(replace(track, xy_px=xy_px)) == pytest.approx(1 / 38)  # its neighbours are half as far off theirs


def test_mark_is_missed_where_the_track_is_farther_off_than_the_radius():
    _, track = a_track(SWING)
    x, y = track.xy_px[10]
    near, far, other = TrackMark("1", x + 5, y, 10), TrackMark("1", x + 20, y, 10), TrackMark("2", x + 20, y, 10)
    assert missed_marks(track, [near, far, other]) == [far]


def test_best_path_goes_on_behind_a_bar_and_not_to_what_is_far_off():
    path = np.column_stack([np.arange(30.0) * 3, np.full(30, 20.0)])
    elsewhere = (200.0, 90.0)
    frames = [Peaks(place[np.newaxis], np.array([1.0])) for place in path]
    for k in (5, 6, 20):
        frames[k] = Peaks(np.array([elsewhere, path[k]]), np.array([1.5, 0.9]))
    for k in range(12, 17):
        frames[k] = Peaks(np.array([elsewhere]), np.array([0.4]))
    chosen = best_path(frames, reach=20.0)
    assert [k for k, column in enumerate(chosen) if column is None] == list(range(12, 17))
    assert [chosen[k] for k in (5, 6, 20)] == [1, 1, 1]


@pytest.mark.parametrize("radius", [4, 9, 16])
def test_radius_of_what_is_marked_is_where_its_colour_ends(radius):
    wall = np.ones((120, 160, 3)) * (90.0, 130.0, 120.0)
    (image,) = noisy([paint(wall, disc((120, 160), 70, 60, radius), (90.0, 190.0, 100.0))], 2.0)
    assert radius_by_colour(image, (71.0, 61.0)) == pytest.approx(radius, rel=0.25)


def test_things_that_move_are_sorted_by_colour_and_size_and_the_ball_is_the_likeliest_body():
    clip = phone.with_shadow(30)
    frames = clip.clip.sample(20)
    first, second = SampledScene(view_of(clip.clip, TrackOptions()), frames).kinds[:2]
    places = np.array([(thing.x, thing.y) for thing in first.seen])
    truth = np.array([clip.truth[0, frames[thing.sample].index] for thing in first.seen])
    assert np.median(np.hypot(*(places - truth).T)) < 3
    assert np.mean([thing.shadow_like for thing in second.seen]) > 0.8


def test_background_of_the_search_is_that_of_the_samples():
    clip = phone.with_shadow(30).clip
    view = view_of(clip, TrackOptions())
    setup = detection_setup(clip, view.with_chroma())
    again = SampledScene(view, setup.stack.frames)
    np.testing.assert_array_equal(SampledScene(view, setup.stack.frames, setup.still).still, again.still)
    np.testing.assert_array_equal(setup.still.background, again.still)


def test_scenery_is_where_nothing_moves_in_several_places_and_a_body_at_rest_is_none():
    path = np.vstack([swing(20, (80, 40), (45, 20), period=37.3), np.tile((100.0, 30.0), (40, 1))])
    clip, track = a_track(path)
    against = evidence_against(track, scene_of(clip))
    assert against["scenery"] == 0.0
    off = evidence_against(replace(track, xy_px=swing(60, (80, 82), (60, 2), period=51.7)), scene_of(clip))
    assert off["scenery"] > 0.3
    still = evidence_against(replace(track, xy_px=np.tile((30.0, 80.0), (60, 1))), scene_of(clip))
    assert (still["scenery"], still["nothing moves"]) == (0.0, 1.0)


def test_body_that_rests_in_most_samples_is_seen_to_move_there_too():
    path = np.vstack([np.column_stack([np.linspace(20, 110, 20), np.full(20, 40.0)]), np.tile((110.0, 40.0), (60, 1))])
    clip, track = a_track(path)
    assert evidence_against(track, scene_of(clip))["nothing moves"] == 0.0


def test_bodies_that_are_lost_together_may_have_changed_their_names():
    shown = np.ones(40, np.bool_)
    shown[15:22] = False
    place = np.column_stack([np.arange(40.0), np.full(40, 20.0)])
    tracks = [
        Track(
            np.arange(40) / 30,
            np.where(shown[:, None], place + shift, np.nan),
            np.full((40, 2), 0.1),
            shown,
            np.arange(40),
        )
        for shift in (0.0, 30.0)
    ]
    assert lost_together(tracks) == 1.0
    assert lost_together(tracks[:1]) == 0.0
    seen = [replace(body, valid=np.ones(40, np.bool_), xy_px=place) for body in tracks[:1]] + tracks[1:]
    assert lost_together(seen) == 0.0


def test_marks_on_the_wall_that_come_to_look_like_the_body_are_not_the_body_missed():
    plain = np.full((120, 160), 70.0)
    path = [(20 + 4 * k, 60) for k in range(30)]
    images = []
    for k in range(36):
        light = 170.0 if k < 6 else 112.0  # the exposure changes: later the marks on the wall look less like the ball
        image = plain
        for x in range(20, 150, 30):
            image = paint(image, disc(plain.shape, x, 20 + 2 * (x // 3), 9.0), light)
        images.append(image if k < 6 else paint(image, disc(plain.shape, *path[k - 6], 9.0), 170.0))
    clip = DrawnClip(noisy(images, 2.0))
    (track,) = TRACKERS["median-background"].track(clip, TrackOptions())
    assert evidence_against(track, scene_of(clip))["missed"] == 0.0


@pytest.mark.parametrize(("lost", "share"), [(slice(0, 0), 0.0), (slice(26, 32), 6 / 24)])
def test_body_in_view_for_a_third_of_the_clip_that_is_lost_for_a_part_of_that_is_missed(lost, share):
    path = [(20 + 3 * k, 60) for k in range(24)]
    plain = np.full((120, 160), 70.0)
    images = [plain] * 20 + [paint(plain, disc(plain.shape, *at, 9.0), 170.0) for at in path] + [plain] * 30
    clip = DrawnClip(noisy(images, 2.0))
    (track,) = TRACKERS["median-background"].track(clip, TrackOptions())
    valid = track.valid.copy()
    valid[lost] = False
    gappy = replace(track, valid=valid)
    assert evidence_against(gappy, scene_of(clip))["missed"] == pytest.approx(share, abs=0.1)
