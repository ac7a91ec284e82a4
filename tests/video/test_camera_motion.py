"""A camera that moves: found, measured and taken out; one that stands is left alone. The clips are OpenCV's alone."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from iris_sysid.io.csv_write import read_track, write_track
from iris_sysid.pipeline.one_clip import camera_note, track
from iris_sysid.registry import TRACKERS
from iris_sysid.report.overlay import draw_body
from iris_sysid.types import Track, TrackCandidate, TrackMark, TrackOptions, mapped
from iris_sysid.video.camera_motion.frame_edge import completed, is_whole, seen_part
from iris_sysid.video.camera_motion.reference import NOT_MEASURED, in_reference, on_canvas
from iris_sysid.video.camera_motion.registration import scatter_in_time
from iris_sysid.video.camera_motion.steady import examined
from iris_sysid.video.camera_motion.steady_video import SteadyVideo
from iris_sysid.video.camera_motion.survey import CameraState
from iris_sysid.video.reader import open_video
from tests._drawn import DrawnClip, moving_disc, swing
from validation.independent.shaken_scene import Shake, Studio, hand_shake, wall, write_clip

SIZE = (240, 180)
FRAMES, FPS = 45, 30
RADIUS = 9.0
RED = (40.0, 60.0, 210.0)
STILL = Shake(0.0, 0.0)


def filmed(shake, *, seed=1, contrast=8.0, path=None, frames=FRAMES):
    """A red ball before a wall: the clip, its camera's maps (n, 2, 3) and the ball's places in the still scene."""
    of_wall, of_hand, of_noise = (np.random.default_rng([seed, part]) for part in range(3))
    t_s = np.arange(frames) / FPS
    maps = hand_shake(t_s, of_hand, shake, (SIZE[0] / 2, SIZE[1] / 2))
    margin = 60 + round(abs(shake.pan_px_s) * t_s[-1])
    studio = Studio(wall(SIZE, of_wall, contrast, margin), SIZE, RADIUS, RED, 2.0, margin)
    centres = swing(frames, (120, 90), (55, 15), period=30.0) if path is None else path
    images = [studio.image(motion, centre[None], of_noise) for motion, centre in zip(maps, centres, strict=True)]
    return DrawnClip(images, FPS), maps, centres


def against_first(maps):
    """The maps from px of the first frame to px of each frame, by 3x3 inverses."""
    square = np.concatenate([maps, np.tile([0.0, 0.0, 1.0], (len(maps), 1, 1))], axis=1)
    return (square @ np.linalg.inv(square[0]))[:, :2]


def steadied(video):
    """The clip without the motion of its camera, and that motion; the clip itself and None where there is none."""
    steady = examined(video).steady
    return (video, None) if steady is None else (steady, steady.motion)


@pytest.fixture(scope="module")
def shaken():
    return filmed(Shake())


@pytest.fixture(scope="module")
def shaken_track(shaken):
    return track(shaken[0], "median-background")[0]


@pytest.mark.parametrize("point", [(120.0, 90.0), (20.0, 20.0), (220.0, 160.0)])
def test_shake_is_measured_to_a_twentieth_of_a_pixel_with_its_error(shaken, point):
    clip, maps, _ = shaken
    _, motion = steadied(clip)
    places = np.tile(point, (FRAMES, 1))
    error = mapped(motion.to_frame, places) - mapped(against_first(maps), places)
    error -= np.median(error, axis=0)  # the first frame's own error is that of the coordinates
    assert error.std() < 0.05
    assert 0.4 < (error / motion.sigma(motion.frame, places)).std() < 1.6


@pytest.mark.parametrize("error_px", [0.02, 0.1])
def test_errors_of_the_motion_show_in_time_and_the_shake_of_a_hand_does_not(error_px):
    rng = np.random.default_rng(5)
    shake = hand_shake(np.arange(150) / 50, rng, Shake(), (0.0, 0.0))[:, :, 2]
    found = scatter_in_time(shake + rng.normal(0, error_px, shake.shape))
    assert found == pytest.approx([error_px, error_px], rel=0.35)


def test_error_of_the_motion_of_a_compressed_clip_holds_what_all_points_have_in_common(tmp_path):
    rng, centre = np.random.default_rng(0), np.array([[80.0, 60.0]])
    maps = hand_shake(np.arange(60) / 50, rng, Shake(), (80.0, 60.0))
    studio = Studio(wall((160, 120), rng, 6.0), (160, 120), RADIUS, RED, 2.0)
    images = [studio.image(motion, centre, rng) for motion in maps]
    coded = {"crf": "23", "bf": "0"}  # with frames predicted from later ones, x264 writes other bytes each time
    _, motion = steadied(open_video(write_clip(tmp_path / "clip.mp4", images, 50, coded)))
    places = np.tile(centre, (60, 1))
    error = mapped(motion.to_frame, places) - mapped(against_first(maps), places)
    error -= np.median(error, axis=0)
    assert 0.6 < (error / motion.sigma(motion.frame, places)).std() < 1.5  # 2.3 by the points' scatter in a frame alone


def test_pan_is_followed_beyond_the_first_frame():
    clip, maps, _ = filmed(Shake(3.0, 0.001, 100.0))
    _, motion = steadied(clip)
    places = np.tile([120.0, 90.0], (FRAMES, 1))
    error = mapped(motion.to_frame, places) - mapped(against_first(maps), places)
    assert np.ptp(mapped(motion.to_frame, places)[:, 0]) > 130
    assert error.std() < 0.1


def test_track_of_a_shaken_clip_is_that_of_the_first_frame(shaken, shaken_track):
    _, maps, centres = shaken
    error = (shaken_track.xy_px - mapped(maps[0], centres))[shaken_track.valid]
    assert shaken_track.n_valid > 0.9 * FRAMES
    assert error.std() < 0.15
    # without compression the stated error is about twice the true one
    assert 0.3 < ((error - error.mean(axis=0)) / shaken_track.sigma_px[shaken_track.valid]).std() < 1.5


def test_track_leads_to_the_frames_as_they_were_filmed(shaken, shaken_track):
    _, maps, centres = shaken
    seen = mapped(shaken_track.camera_motion, shaken_track.xy_px)[shaken_track.valid]
    assert np.abs(seen - mapped(maps, centres)[shaken_track.valid]).max() < 0.5


def test_without_taking_the_shake_out_the_track_is_worse(shaken, shaken_track):
    clip, maps, centres = shaken
    raw = TRACKERS["median-background"].track(clip, TrackOptions())[0]
    of_raw = np.nanstd(raw.xy_px - mapped(maps[0], centres))
    assert of_raw > 10 * np.nanstd(shaken_track.xy_px - mapped(maps[0], centres))


@pytest.mark.parametrize("contrast", [8.0, 3.0])
def test_camera_that_stands_gives_the_very_same_clip(contrast):
    clip, _, _ = filmed(STILL, contrast=contrast)
    source, motion = steadied(clip)
    assert source is clip
    assert motion is None


def test_track_of_a_camera_that_stands_is_the_trackers_own():
    clip, _, _ = filmed(STILL)
    own = TRACKERS["median-background"].track(clip, TrackOptions())[0]
    ours = track(clip, "median-background")[0]
    np.testing.assert_array_equal(ours.xy_px, own.xy_px)
    np.testing.assert_array_equal(ours.sigma_px, own.sigma_px)
    assert ours.camera_motion is None
    assert camera_note([ours]) == ""
    assert dict(ours.origin) == dict(own.origin)


def test_plain_wall_says_that_motion_cannot_be_measured():
    clip = moving_disc(swing(60, (64, 48), (30, 10)), 8.0)
    assert examined(clip).state is CameraState.UNKNOWN
    (body,) = track(clip, "median-background")
    assert body.origin["camera_motion"] == NOT_MEASURED
    assert camera_note([body]).endswith(NOT_MEASURED)
    own = TRACKERS["median-background"].track(clip, TrackOptions())[0]
    np.testing.assert_array_equal(body.xy_px, own.xy_px)


def before_a_wall(patch, course):
    """A still wall before which a large patch moves as ``course`` (n, 2, 3) says."""
    rng = np.random.default_rng(5)
    background = wall(SIZE, rng, 6.0, 0)[::2, ::2]
    inside = cv2.circle(np.zeros(SIZE[::-1], np.float32), (120, 90), 62, 1.0, -1)
    images = []
    for motion in course:
        covered = cv2.warpAffine(inside, motion, SIZE)[..., None]
        image = background * (1 - covered) + cv2.warpAffine(patch, motion, SIZE) * covered
        images.append(np.clip(np.rint(image + rng.normal(0, 2, image.shape)), 0, 255).astype(np.uint8))
    return DrawnClip(images, FPS)


@pytest.mark.parametrize("kind", ["shift", "turn"])
def test_large_body_that_moves_is_no_motion_of_the_camera(kind):
    patch = wall(SIZE, np.random.default_rng(6), 25.0, 0)[::2, ::2]
    phase = 2 * np.pi * np.arange(30) / 20
    shifts = [np.array([[1, 0, 25 * np.cos(p)], [0, 1, 8 * np.sin(p)]]) for p in phase]
    turns = [cv2.getRotationMatrix2D((120, 90), float(10 * np.cos(p)), 1.0) for p in phase]
    clip = before_a_wall(patch, shifts if kind == "shift" else turns)
    assert steadied(clip) == (clip, None)


def test_light_that_flickers_is_no_motion_of_the_camera():
    clip, _, _ = filmed(STILL)
    gain = 1 + 0.15 * np.sin(np.arange(FRAMES))
    images = [np.clip(image * factor, 0, 255).astype(np.uint8) for image, factor in zip(clip.images, gain, strict=True)]
    flickering = DrawnClip(images, FPS)
    assert steadied(flickering) == (flickering, None)


def test_body_that_the_edge_of_its_own_frame_cuts_is_where_its_visible_part_says():
    path = np.column_stack([np.linspace(60.0, 300.0, FRAMES), np.full(FRAMES, 90.0)])
    clip, maps, _ = filmed(Shake(5.0, 0.001), path=path)
    (body,) = track(clip, "median-background")
    seen = mapped(maps, path)
    away = SIZE[0] - 0.5 - seen[:, 0]
    cut = (away < RADIUS - 1) & body.valid
    off_px = np.hypot(*(body.xy_px - mapped(maps[0], path))[cut].T)
    assert cut.any()
    assert np.all(off_px < 1.0)
    assert not body.valid[away < -1].any()
    assert body.valid[(seen[:, 0] > 2 * RADIUS) & (seen[:, 0] < SIZE[0] - 2 * RADIUS)].mean() > 0.8


def test_visible_part_of_a_disc_is_that_of_its_pixels():
    y, x = np.mgrid[-1:1:2000j, -1:1:2000j]
    for inside in (0.0, 0.3, 0.8, 1.0):
        seen = (np.hypot(x, y) < 1) & (x > -inside)
        share, shift = seen_part(np.array(inside))
        assert share == pytest.approx(seen.sum() / (np.hypot(x, y) < 1).sum(), abs=1e-3)
        assert shift == pytest.approx(x[seen].mean(), abs=1e-3)


@pytest.mark.parametrize(("inside", "doubts"), [(0.2, ["moving-camera"]), (0.9, [])])
def test_track_that_lies_mostly_on_the_edge_of_the_frames_is_doubtful(shaken, inside, doubts):
    steady = examined(shaken[0]).steady
    x = np.where(np.arange(FRAMES) < inside * FRAMES, SIZE[0] / 2, SIZE[0] + 2.0 * RADIUS)
    place = np.column_stack([x - steady.canvas.left, np.full(FRAMES, SIZE[1] / 2 - steady.canvas.top)])
    always, radius = np.ones(FRAMES, np.bool_), np.full(FRAMES, RADIUS)
    on_edge = Track(
        np.arange(FRAMES) / FPS, place, np.full((FRAMES, 2), 0.1), always, np.arange(FRAMES), radius_px=radius
    )
    quality = in_reference(on_edge, steady).quality
    assert [doubt.kind for doubt in (quality.doubts if quality else ())] == doubts


def test_frames_of_the_steady_clip_show_the_background_in_one_place(shaken):
    clip, _, _ = shaken
    steady, _ = steadied(clip)
    assert isinstance(steady, SteadyVideo)
    frames = steady.sample(9)
    corner = np.array([frame.luma[20:50, 20:50] for frame in frames], dtype=float)
    raw = np.array([frame.luma[20:50, 20:50] for frame in clip.sample(9)], dtype=float)
    assert corner.std(axis=0).mean() < 3.0 < raw.std(axis=0).mean()
    assert all(frame.bgr().shape == (steady.height, steady.width, 3) for frame in frames)
    assert not frames[0].luma.flags.writeable


def test_region_and_marks_are_led_to_the_steady_clip(shaken):
    clip, maps, centres = shaken
    steady, _ = steadied(clip)
    here = mapped(maps[20], centres[20])
    options = TrackOptions(roi=(10, 20, 200, 140), marks=(TrackMark("1", float(here[0]), float(here[1]), 20),))
    moved = on_canvas(options, steady)
    (mark,) = moved.marks
    corner = np.array([steady.canvas.left, steady.canvas.top])
    np.testing.assert_array_equal(moved.roi, [10 - corner[0], 20 - corner[1], 200, 140])
    np.testing.assert_allclose(np.array([mark.x_px, mark.y_px]) + corner, mapped(maps[0], centres[20]), atol=0.3)


def test_candidates_are_shown_in_px_of_the_first_frame(shaken, shaken_track):
    steady, _ = steadied(shaken[0])
    corner = np.array([steady.canvas.left, steady.canvas.top])
    shown = []
    explain = on_canvas(TrackOptions(explain=shown.extend), steady).explain
    explain([TrackCandidate("disc", (replace(shaken_track, xy_px=shaken_track.xy_px - corner),))])
    np.testing.assert_allclose(shown[0].tracks[0].xy_px, shaken_track.xy_px)
    assert shown[0].tracks[0].camera_motion is not None


def test_camera_motion_is_stored_beside_the_track_and_read_back(shaken_track, tmp_path):
    path = write_track(shaken_track, tmp_path / "track.csv")
    np.testing.assert_array_equal(read_track(path)[0].camera_motion, shaken_track.camera_motion)
    still = write_track(replace(shaken_track, camera_motion=None), tmp_path / "still.csv")
    assert read_track(still)[0].camera_motion is None


def test_overlay_is_drawn_where_the_frame_shows_the_body(shaken, shaken_track):
    _, maps, centres = shaken
    number = int(np.argmax(np.hypot(*(mapped(maps, centres) - mapped(maps[0], centres)).T)))
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    now = replace(shaken_track, valid=shaken_track.valid & (np.arange(FRAMES) == number))
    draw_body(image, now, float(now.t_s[number]), (255, 255, 255))
    rows, columns = np.nonzero(image[..., 0])
    np.testing.assert_allclose([columns.mean(), rows.mean()], mapped(maps[number], centres[number]), atol=0.7)


def test_sampled_frames_are_decoded_once_for_camera_and_tracker(pendulum_clip):
    clip = open_video(pendulum_clip)
    first = clip.sample(40)
    clip.decoded = -1
    again = clip.sample(40)
    assert clip.decoded == -1
    assert all(one is other for one, other in zip(first, again, strict=True))
    next(clip.frames())
    assert clip.sample(40)[0] is not first[0]
    assert clip.decoded > 0


def test_bodies_that_move_alike_before_a_plain_wall_are_bodies(two_movers_clip):
    (first, second) = track(open_video(two_movers_clip), options=TrackOptions(bodies=2))
    for body in (first, second):
        assert body.camera_motion is None
        assert np.ptp(body.xy_px[body.valid, 0]) == pytest.approx(60.0, abs=1.0)
        assert [doubt.kind for doubt in body.quality.doubts] == ["moving-camera"]


def test_a_body_that_its_frame_cuts_is_believed_next_to_a_frame_in_which_it_is_whole():
    xy = np.array([[6.0, 50.0], [8.0, 50.0], [12.0, 50.0], [22.0, 50.0], [32.0, 50.0]])
    radius = np.array([9.0, 9.5, 10.0, 10.0, 10.0])
    still = np.tile(np.eye(2, 3), (5, 1, 1))
    for found, expected in (([1, 1, 1, 1, 1], [1, 1, 1, 1, 1]), ([1, 0, 1, 1, 1], [0, 0, 1, 1, 1])):
        valid = np.array(found, dtype=bool)
        seen, rows = np.where(valid[:, None], xy, np.nan), np.arange(5)
        ball = Track(rows / 30, seen, np.ones((5, 2)), valid, rows, radius_px=np.where(valid, radius, np.nan))
        whole = is_whole(seen, ball, still, (100, 100))
        _, _, known = completed(seen, ball, still, (100, 100), whole)
        assert (known & valid).tolist() == [bool(one) for one in expected]
