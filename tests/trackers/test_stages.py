"""The three stages of a tracker: what each finds, what its options mean, and that each can be replaced."""

import numpy as np
import pytest

from iris_sysid import detect, frames_from_array, link, measure, track
from iris_sysid.errors import DataError, TrackingError, UnknownNameError
from iris_sysid.registry import DETECTORS, LINKERS, MEASURERS, TRACKERS
from iris_sysid.types import Detections, Detector, LinkOptions, TrackOptions
from tests._drawn import DrawnClip, disc, moving_disc, noisy, paint, swing

SHAPE = (96, 160)
N = 60


def swinging():
    """A disc that swings: the clip, and its places (60, 2) px."""
    path = swing(N, (80, 48), (45, 20), period=37.3)
    return moving_disc(path, 9, SHAPE), path


def seen(paths, sigma=0.3, hidden=(), clutter=0, seed=0, radius=6.0):
    """Detections of bodies on some paths (n, 2), px, with an error; with ``clutter`` false ones in each frame."""
    rng = np.random.default_rng(seed)
    frames, places, sure = [], [], []
    for k in range(len(paths[0])):
        bodies = [] if k in hidden else [path[k] + rng.normal(0, sigma, 2) for path in paths]
        false = rng.uniform((0, 0), SHAPE[::-1], (clutter, 2))
        frames += [k] * (len(bodies) + clutter)
        places += [*bodies, *false]
        sure += [0.9] * len(bodies) + [0.2] * clutter
    order = rng.permutation(len(frames))
    order = order[np.argsort(np.array(frames)[order], kind="stable")]
    count = len(frames)
    return Detections(
        frames=np.arange(len(paths[0])),
        t_s=np.arange(len(paths[0])) / 60,
        size=SHAPE[::-1],
        frame=np.array(frames)[order],
        xy_px=np.array(places)[order],
        sigma_px=np.full(count, sigma),
        radius_px=np.full(count, radius),
        probability=np.array(sure)[order],
        looks=np.zeros((count, 0)),
    )


def off(track, path):
    return float(np.nanmax(np.hypot(*(track.xy_px - path).T)))


@pytest.mark.parametrize("detector", sorted(DETECTORS))
def test_body_is_among_the_detections_of_every_frame_and_likelier_than_all_others(detector):
    clip, path = swinging()
    found = detect(clip, detector)
    np.testing.assert_array_equal(found.frames, np.arange(N))
    away = np.hypot(*(found.xy_px - path[found.frame]).T)
    on_body = away < 4.5
    assert set(found.frame[on_body]) == set(range(N))
    assert found.probability[on_body].min() > 0.3
    assert found.probability[~on_body].max(initial=0.0) < np.median(found.probability[on_body])


@pytest.mark.parametrize("detector", sorted(DETECTORS))
def test_stages_together_give_the_positions_of_the_tracker_whatever_detects(detector):
    clip, path = swinging()
    (measured,) = measure(clip, link(detect(clip, detector)))
    (known,) = TRACKERS["median-background"].track(clip, TrackOptions())
    assert measured.n_valid >= N - 3
    both = measured.valid & known.valid
    np.testing.assert_allclose(measured.xy_px[both], known.xy_px[both], atol=1e-9)
    assert np.sqrt(np.nanmean((measured.xy_px - path) ** 2)) < 0.02


@pytest.mark.parametrize("linker", sorted(LINKERS))
def test_linker_leaves_gaps_where_the_body_is_not_detected(linker):
    path = swing(N, (80, 48), (45, 20), period=37.3)
    (body,) = link(seen([path], hidden=range(25, 29)), by=linker)
    assert not body.valid[25:29].any()
    assert body.n_valid == N - 4
    assert off(body, path) < 2.0


@pytest.mark.parametrize("measurer", sorted(MEASURERS))
def test_measurer_finds_the_centre_to_a_fraction_of_a_pixel(measurer):
    clip, path = swinging()
    (measured,) = measure(clip, link(detect(clip)), by=measurer)
    assert measured.n_valid >= N - 3
    assert np.sqrt(np.nanmean((measured.xy_px - path) ** 2)) < 0.05


def test_array_of_frames_is_a_clip_and_rate_or_times_say_when():
    clip, _ = swinging()
    images = np.stack(clip.images)
    by_rate, by_times = frames_from_array(images, 60.0), frames_from_array(images, np.arange(N) / 60)
    of_clip, of_rate = detect(clip), detect(by_rate)
    np.testing.assert_allclose(of_rate.xy_px, of_clip.xy_px, atol=0.1)
    np.testing.assert_array_equal(detect(by_times).t_s, of_rate.t_s)
    assert track(by_rate, "median-background")[0].n_valid == N


def test_colours_of_an_array_are_blue_green_red():
    red = np.zeros((4, 8, 8, 3), np.uint8)
    red[..., 2] = 255
    frame = next(frames_from_array(red, 30.0).frames())
    assert frame.luma[0, 0] == 76  # 0.299 of 255
    np.testing.assert_array_equal(frame.bgr(), red[0])


@pytest.mark.parametrize(
    ("images", "times", "message"),
    [
        (np.zeros((3, 4, 4)), 60.0, "float64 of shape"),
        (np.zeros((3, 4, 4, 4), np.uint8), 60.0, "uint8, .n, h, w. or .n, h, w, 3."),
        (np.zeros((0, 4, 4), np.uint8), 60.0, "there must be a frame"),
        (np.zeros((3, 4, 4), np.uint8), 0.0, "rate is 0 frames/s"),
        (np.zeros((3, 4, 4), np.uint8), np.nan, "rate is nan frames/s"),
        (np.zeros((3, 4, 4), np.uint8), [0.0, 0.1], "2 times of 3 frames"),
        (np.zeros((3, 4, 4), np.uint8), [0.0, 0.2, 0.1], "must increase"),
    ],
)
def test_array_that_is_no_clip_is_refused(images, times, message):
    with pytest.raises(DataError, match=message):
        frames_from_array(images, times)


@pytest.mark.parametrize("bodies", [1, 2, 3])
def test_any_number_of_bodies_is_linked_alike_among_false_detections(bodies):
    ways = [swing(N, (80, 20 + 25 * k), (50, 6), period=31.0 + 4 * k) for k in range(3)]
    tracks = link(seen(ways, clutter=4), LinkOptions(bodies=bodies, search_range_px=12))
    assert len(tracks) == bodies
    for body in tracks:
        assert min(off(body, way) for way in ways) < 2.0
        assert body.n_valid > 0.95 * N


def test_bodies_that_cross_keep_their_names():
    x = np.linspace(20, 140, N)
    up, down = np.column_stack([x, x / 2]), np.column_stack([x, 80 - x / 2])
    tracks = link(seen([up, down]), LinkOptions(bodies=2))
    assert sorted(min((off(body, way), k) for k, way in enumerate((up, down)))[1] for body in tracks) == [0, 1]
    assert max(min(off(body, up), off(body, down)) for body in tracks) < 1.5


def test_body_that_is_struck_is_one_body():
    height = np.concatenate([np.linspace(10, 80, 30), np.linspace(80, 31, 30)])
    (body,) = link(seen([np.column_stack([np.full(N, 50.0), height])], clutter=2))
    assert body.n_valid > 0.95 * N


@pytest.mark.parametrize(("memory", "frames"), [(12, 50), (5, 25)])
def test_body_unseen_for_longer_than_the_memory_is_another(memory, frames):
    path = np.column_stack([np.linspace(20, 140, N), np.full(N, 40.0)])
    (body,) = link(seen([path], hidden=range(25, 35)), LinkOptions(memory=memory))
    assert body.n_valid == frames


@pytest.mark.parametrize(("search_range_px", "frames"), [(40.0, 60), (5.0, 30)])
def test_body_farther_from_its_prediction_than_the_search_range_is_another(search_range_px, frames):
    x = np.linspace(20, 80, N) + np.where(np.arange(N) < 30, 0, 6)
    path = np.column_stack([x, np.full(N, 40.0)])
    odds = {"birth_odds": 1e-9, "death_odds": 1e-9}  # else the leap is as well a birth and a death
    (body,) = link(seen([path]), LinkOptions(search_range_px=search_range_px, **odds))
    assert body.n_valid == frames


@pytest.mark.parametrize(("odds", "frames"), [(1e-9, 60), (0.3, 30)])
def test_births_and_deaths_that_are_likely_part_a_body_that_leaps(odds, frames):
    x = np.linspace(20, 80, N) + np.where(np.arange(N) < 30, 0, 6)
    (body,) = link(
        seen([np.column_stack([x, np.full(N, 40.0)])]), LinkOptions(memory=0, birth_odds=odds, death_odds=odds)
    )
    assert body.n_valid == frames


def test_gap_that_is_unlikely_parts_a_body():
    path = np.column_stack([np.linspace(20, 140, N), np.full(N, 40.0)])
    found = seen([path], hidden=range(25, 35))
    assert link(found, LinkOptions(gap_odds=0.5))[0].n_valid == 50
    assert link(found, LinkOptions(gap_odds=1e-9))[0].n_valid == 25


def test_likelier_body_comes_first_though_another_is_seen_as_long():
    found = seen([np.column_stack([np.linspace(20, 140, N), np.full(N, y)]) for y in (20.0, 70.0)])
    lower = found.xy_px[:, 1] > 45
    doubted = Detections(
        **{
            name: getattr(found, name)
            for name in ("frames", "t_s", "size", "frame", "xy_px", "sigma_px", "radius_px", "looks")
        },
        probability=np.where(lower, 0.95, 0.6),
    )
    (body,) = link(doubted)
    assert np.nanmedian(body.xy_px[:, 1]) > 45


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bodies": 0}, "bodies = 0"),
        ({"search_range_px": -1.0}, "search_range_px = -1"),
        ({"search_range_px": np.nan}, "search_range_px = nan"),
        ({"memory": -1}, "memory = -1"),
        ({"birth_odds": 0.0}, "birth_odds = 0"),
        ({"death_odds": 1.5}, "death_odds = 1.5"),
        ({"gap_odds": np.nan}, "gap_odds = nan"),
    ],
)
def test_link_options_that_mean_nothing_are_refused(options, message):
    with pytest.raises(DataError, match=message):
        LinkOptions(**options)


def test_fewer_tracks_than_bodies_are_refused_with_what_helps():
    with pytest.raises(TrackingError, match="2 bodies were requested, but 1"):
        link(seen([swing(N, (80, 48), (45, 20))]), LinkOptions(bodies=2))
    nothing = DrawnClip(noisy([np.full(SHAPE, 90.0)] * 8, 2.0))
    with pytest.raises(TrackingError, match="0 tracks have 3 detections"):
        link(detect(nothing))
    with pytest.raises(TrackingError, match="restrict the region"):
        link(seen([np.zeros((N, 2))], clutter=60))


def test_gap_is_where_another_thing_is_nearer_or_nothing_is_there():
    clip, _ = swinging()
    (known,) = link(detect(clip))
    shifted = known.xy_px + np.where(np.arange(N) < 10, 40.0, 0.0)[:, np.newaxis]
    moved = type(known)(known.t_s, shifted, known.sigma_px, known.valid, known.frame, radius_px=known.radius_px)
    (measured,) = measure(clip, [moved])
    np.testing.assert_array_equal(measured.valid, np.arange(N) >= 10)
    with pytest.raises(TrackingError, match="nothing moves where the track of body 1 is"):
        measure(clip, [known, known])  # one body is not two


def test_measuring_nothing_is_refused():
    clip, _ = swinging()
    with pytest.raises(DataError, match="no tracks to measure"):
        measure(clip, [])
    (known,) = link(detect(clip))
    elsewhere = type(known)(known.t_s, known.xy_px, known.sigma_px, known.valid, known.frame + 500)
    with pytest.raises(DataError, match="no frame in common"):
        measure(clip, [elsewhere])


def brightest(video, options):
    """A detector of one's own: the brightest pixel of each frame."""
    frames = list(video.frames())
    at = [np.unravel_index(np.argmax(frame.luma), frame.luma.shape) for frame in frames]
    count, numbers = len(frames), np.array([frame.index for frame in frames])
    return Detections(
        frames=numbers,
        t_s=np.array([frame.t_s for frame in frames]),
        size=(video.width, video.height),
        frame=numbers,
        xy_px=np.array(at, dtype=float)[:, ::-1],
        sigma_px=np.full(count, 3.0),
        radius_px=np.full(count, 9.0),
        probability=np.full(count, 0.9),
        looks=np.zeros((count, 1)),
    )


def test_detector_of_ones_own_takes_the_place_of_one_of_the_library(tmp_path):
    clip, path = swinging()
    own = Detector(name="brightest", summary="the brightest pixel", detect=brightest)
    (measured,) = measure(clip, link(detect(clip, own)))
    assert measured.n_valid > N - 3
    assert off(measured, path) < 0.1
    file = tmp_path / "own.py"
    file.write_text(
        "from iris_sysid import Detector\nfrom tests.trackers.test_stages import brightest\n"
        "mine = Detector(name='mine', summary='the brightest pixel', detect=brightest)\n"
    )
    np.testing.assert_array_equal(detect(clip, f"{file}:mine").xy_px, detect(clip, own).xy_px)


def test_unknown_stage_is_refused_with_the_names_there_are():
    clip, _ = swinging()
    with pytest.raises(UnknownNameError, match="no detector is named 'motoin'; did you mean 'motion'"):
        detect(clip, "motoin")
    assert set(LINKERS) == {"assignment"}
    assert set(MEASURERS) == {"coverage"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"probability": np.full(60, 1.2)}, "a probability is 1.2"),
        ({"probability": np.full(60, np.nan)}, "a probability is nan"),
        ({"frame": np.full(60, 99)}, "not among the frames"),
        ({"t_s": np.arange(3.0)}, "3 times of 60 frames"),
        ({"xy_px": np.zeros((60, 3))}, "xy_px must have shape"),
    ],
)
def test_detections_that_do_not_fit_together_are_refused(change, message):
    found = seen([swing(N, (80, 48), (45, 20))])
    fields = ("frames", "t_s", "size", "frame", "xy_px", "sigma_px", "radius_px", "probability", "looks")
    with pytest.raises(DataError, match=message):
        Detections(**{name: getattr(found, name) for name in fields} | change)


def test_disc_at_rest_is_told_from_one_that_moves():
    plain = paint(np.full(SHAPE, 70.0), disc(SHAPE, 30, 70, 8), 150.0)
    path = swing(N, (90, 40), (45, 20), period=37.3)
    clip = DrawnClip(noisy([paint(plain, disc(SHAPE, *at, 9.0), 150.0) for at in path], 2.0))
    found = detect(clip, "disc")
    at_rest = np.hypot(*(found.xy_px - (30, 70)).T) < 2
    assert at_rest.sum() > N / 2
    assert found.probability[at_rest].max() < found.probability[~at_rest].min()
