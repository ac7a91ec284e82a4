"""The frames of a page: which ones, how large, and where the models are drawn on them."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from iris_sysid import MODELS, fit, read_trajectory, run, save
from iris_sysid.io.clip_place import CLIP_PLACE
from iris_sysid.pipeline.diagnose_each import DiagnoseEach, DiagnosisRequest, NamedTable
from iris_sysid.report import film as film_module
from iris_sysid.report.film import Footage, film_of, footage_of_table, model_px
from iris_sysid.types import Quantity, Track, Trajectory
from iris_sysid.video.multiple_exposure import phases_of
from tests._drawn import DrawnClip, moving_disc


@pytest.fixture(scope="module")
def measured(pendulum_clip):
    return run(pendulum_clip, "pendulum")


def of(measured, **models):
    return film_of(measured, measured.trajectory, models)


def test_film_shows_frames_with_the_body_where_it_was_tracked(measured):
    film = of(measured)
    assert len(film.frames) == len(film.t_s) == 60
    assert film.size == (160, 90)
    (body,) = film.markers
    rows = np.searchsorted(measured.tracks[0].t_s, film.t_s)
    np.testing.assert_allclose(body.xy_px, measured.tracks[0].xy_px[rows] + 0.5)
    picture = cv2.imdecode(np.frombuffer(film.frames[0], np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (90, 160, 3)
    assert json.dumps(film.document(), allow_nan=False)


def test_model_is_drawn_where_it_predicts_the_body(measured):
    """On the circle about the pivot, at the predicted angle."""
    place, _ = model_px(measured.tracks[0], measured.trajectory, measured.fit)
    geometry = {name: estimate.value for name, estimate in measured.trajectory.geometry.items()}
    theta, used = measured.fit.predicted[:, 0], measured.fit.used
    x = geometry["pivot_x"] + geometry["arc_radius"] * np.sin(theta)
    y = -geometry["pivot_z"] + geometry["arc_radius"] * np.cos(theta)
    # its distance from the arc is as measured: where the body is known roughly, within that error
    off, rough = np.abs(place - np.column_stack([x, y]))[used], measured.tracks[0].sigma_px[used]
    assert np.all(off <= np.maximum(0.3, rough))
    assert np.mean(off <= 0.3) > 0.99
    assert np.isnan(place[: np.flatnonzero(used)[0]]).all()


def test_model_is_shifted_by_what_the_residual_is_in_the_image(measured):
    moved = replace(measured.fit, predicted=measured.fit.predicted + 0.1)
    place, _ = model_px(measured.tracks[0], measured.trajectory, moved)
    before, _ = model_px(measured.tracks[0], measured.trajectory, measured.fit)
    shift = np.hypot(*(place - before)[measured.fit.used].T)
    np.testing.assert_allclose(shift, 0.1 * measured.trajectory.geometry["arc_radius"].value, rtol=0.02)


def along(names, positions, xy_px):
    n, t_s = len(xy_px), np.arange(len(xy_px)) / 30
    quantities = tuple(Quantity(name, unit) for name, unit in names)
    track = Track(t_s, xy_px, np.full((n, 2), 0.1), np.ones(n, bool), np.arange(n))
    return track, Trajectory(t_s, quantities, positions, np.full_like(positions, np.nan), np.ones(n, bool))


def test_model_of_a_throw_is_drawn_in_both_coordinates():
    t_s = np.arange(30) / 30
    position = np.column_stack([2.0 * t_s, 3.0 * t_s - 4.9 * t_s**2])
    track, trajectory = along([("x", "m"), ("z", "m")], position, position @ [[100.0, 0.0], [0.0, -100.0]] + 50.0)
    place, _ = model_px(track, trajectory, fit(trajectory, MODELS["projectile"]))
    np.testing.assert_allclose(place, track.xy_px, atol=0.5)


def test_each_of_two_bodies_has_its_own_model():
    t_s = np.arange(60) / 30
    theta = np.column_stack([0.3 * np.cos(4.4 * t_s), 0.2 * np.sin(3.7 * t_s)])
    tracks = []
    for k, pivot in enumerate((100.0, 200.0)):
        xy_px = np.column_stack([pivot + 80 * np.sin(theta[:, k]), 20 + 80 * np.cos(theta[:, k])])
        track, trajectory = along([("theta1", "rad"), ("theta2", "rad")], theta, xy_px)
        tracks.append(track)
    fitted = fit(trajectory, MODELS["coupled-pendulums"])
    moved = replace(fitted, predicted=theta + np.array([0.1, 0.0]))
    (first, _), (second, _) = (model_px(track, trajectory, moved) for track in tracks)
    assert np.hypot(*(first - tracks[0].xy_px).T).min() == pytest.approx(8.0, rel=0.02)
    np.testing.assert_allclose(second, tracks[1].xy_px, atol=1e-6)


def test_brightness_has_no_place_in_the_image():
    t_s = np.arange(40) / 30
    level = np.exp(-t_s)[:, None] + 0.001 * np.sin(40 * t_s)[:, None]
    xy_px = np.random.default_rng(0).normal(50.0, 2.0, (40, 2))
    track, trajectory = along([("intensity", "1")], level, xy_px)
    place, _ = model_px(track, trajectory, fit(trajectory, MODELS["exponential-decay"]))
    assert place is None


def test_frames_keep_to_the_budget(monkeypatch):
    rng = np.random.default_rng(1)
    images = [rng.integers(0, 255, (200, 300, 3), dtype=np.uint8) for _ in range(20)]
    whole = sum(map(len, film_module._within_budget(images)))
    monkeypatch.setattr(film_module, "MAX_BYTES", whole // 3)
    small = film_module._within_budget(images)
    assert len(small) == 20
    assert sum(map(len, small)) <= whole // 3


def test_large_frames_are_made_small_and_bodies_with_them():
    places = np.column_stack([np.linspace(300, 1500, 12), np.full(12, 500.0)])
    clip = moving_disc(places, 30.0, shape=(1000, 1920))
    valid = np.ones(12, bool)
    track = Track(np.arange(12) / 60, places, np.full((12, 2), 0.1), valid, np.arange(12), radius_px=np.full(12, 30.0))
    trajectory = Trajectory(track.t_s, (Quantity("x", "px"),), places[:, :1], np.full((12, 1), 0.1), valid)
    film = film_of(Footage(clip, [track]), trajectory, {})
    assert film.size == (640, 333)
    assert film.markers[0].radius_px == pytest.approx(np.full(len(film.t_s), 10.0))
    picture = cv2.imdecode(np.frombuffer(film.frames[0], np.uint8), cv2.IMREAD_GRAYSCALE).astype(float)
    x, y = film.markers[0].xy_px[0].astype(int)
    assert abs(picture[y, x] - np.median(picture)) > 30


def test_clip_without_a_body_has_no_film():
    clip = DrawnClip([np.zeros((20, 20, 3), np.uint8)] * 3)
    gaps = np.full((3, 2), np.nan)
    lost = Track(np.arange(3) / 60, gaps, gaps, np.zeros(3, bool), np.arange(3))
    trajectory = Trajectory(lost.t_s, (Quantity("x", "px"),), gaps[:, :1], gaps[:, :1], lost.valid)
    assert film_of(Footage(clip, [lost]), trajectory, {}) is None
    assert film_of(Footage(clip, []), trajectory, {}) is None


# --------------------------------------------------------------------------- the clip of a table


@pytest.fixture
def saved(measured, pendulum_clip, tmp_path):
    """A run and a copy of its clip beside it, which alone is near."""
    save(measured, tmp_path / "out")
    (tmp_path / "pendulum.mp4").write_bytes(pendulum_clip.read_bytes())
    (tmp_path / "out" / CLIP_PLACE).unlink()
    return tmp_path


@pytest.mark.parametrize("asked", ["out", "out/trajectory.csv"])
def test_clip_beside_the_folder_of_run_is_found(saved, asked):
    trajectory = read_trajectory(saved / "out" / "trajectory.csv")
    footage = footage_of_table(saved / asked, trajectory)
    assert (footage.video.width, footage.video.height) == (160, 90)
    assert footage.tracks[0].n_valid >= int(trajectory.valid.sum())


def test_page_of_each_clip_of_a_batch_shows_its_film(saved):
    table = NamedTable("swing", saved / "out" / "trajectory.csv")
    prepare = DiagnoseEach(lambda path: DiagnosisRequest(read_trajectory(path), MODELS["pendulum"]))
    assert prepare(saved / "all", table) == ""
    assert "/9j/" in (saved / "all" / "swing" / "report.html").read_text("utf-8")  # a JPEG in base64


def test_another_clip_of_the_same_name_is_not_taken(saved, still_clip):
    trajectory = read_trajectory(saved / "out" / "trajectory.csv")
    (saved / "pendulum.mp4").write_bytes(still_clip.read_bytes())
    assert footage_of_table(saved / "out", trajectory) is None


@pytest.mark.parametrize("lost", ["pendulum.mp4", "out/track.csv"])
def test_table_whose_clip_or_track_is_gone_has_no_footage(saved, lost):
    trajectory = read_trajectory(saved / "out" / "trajectory.csv")
    (saved / lost).unlink()
    assert footage_of_table(saved / "out", trajectory) is None


def test_damaged_track_gives_no_footage_and_no_error(saved):
    trajectory = read_trajectory(saved / "out" / "trajectory.csv")
    (saved / "out" / "track.csv").write_text("t_s,x_px\n1,2\n")
    assert footage_of_table(saved / "out", trajectory) is None


def test_name_of_a_clip_leads_to_no_other_folder(saved):
    trajectory = read_trajectory(saved / "out" / "trajectory.csv")
    astray = trajectory.with_(origin={**trajectory.origin, "source": "../../etc/pendulum.mp4"})
    assert footage_of_table(saved / "out", astray) is not None  # the name alone counts, and the content
    nameless = trajectory.with_(origin={**trajectory.origin, "source": 7})
    assert footage_of_table(saved / "out", nameless) is None


def test_phases_of_a_swing_that_sampling_would_show_at_one_place_are_spread():
    k = np.arange(60)
    xy_px = np.column_stack([np.sin(2 * np.pi * k * 8 / 59), np.zeros(60)])  # every 7th or 8th is at one place
    apart = np.diff(np.sort(xy_px[phases_of(xy_px, 9), 0]))
    assert apart.min() > 0.05
    assert phases_of(np.full((60, 2), np.nan), 3) == [0, 30, 59]
