"""The clip as a file: times, truth beside it, the same bytes again, nothing half-written, stated failures."""

import json
import os

import av
import numpy as np
import pytest

from iris_sysid.errors import DataError, OutputError, UnknownNameError
from iris_sysid.synthetic import Look, read_truth, render_clip
from iris_sysid.synthetic.encoder import Encoder
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.synthetic.truth import truth_paths

SMALL = {"size": (160, 90), "duration_s": 0.5, "fps": 30.0}
HANDHELD = Look(tilt_deg=(2.0, -3.0), roll_deg=0.6, distortion=(-0.06, 0.02), shake_px=0.4, dropped=0.01)


def read_clip(path):
    """Times and luma planes of every frame."""
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    return np.array([float(frame.pts * frame.time_base) for frame in frames]), [luma(frame) for frame in frames]


def luma(frame):
    plane = frame.planes[0]
    return np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width].astype(float)


@pytest.mark.parametrize(
    ("codec", "suffix"), [("h264", ".mp4"), ("lossless", ".mkv"), ("ffv1", ".mkv"), ("h264", ".mov")]
)
def test_clip_holds_every_frame_at_its_time(tmp_path, codec, suffix):
    clip = tmp_path / f"clip{suffix}"
    truth = render_clip("pendulum", clip, look=Look(codec=codec), **SMALL)
    times, frames = read_clip(clip)
    assert len(frames) == 15
    assert frames[0].shape == (90, 160)
    np.testing.assert_allclose(times, truth.body().t_s, atol=1.1e-3 if suffix == ".mkv" else 1e-9)  # mkv counts in ms


@pytest.mark.parametrize("fps", [24.0, 59.94, 60000 / 1001, 240.0])
def test_odd_frame_rates_are_kept_exactly(tmp_path, fps):
    clip = tmp_path / "clip.mp4"
    truth = render_clip("pendulum", clip, size=(64, 36), duration_s=0.5, fps=fps)
    times, _ = read_clip(clip)
    assert np.diff(times) == pytest.approx(1 / fps, rel=1e-6)
    np.testing.assert_allclose(times, truth.body().t_s, atol=1e-9)


def test_lossless_clip_holds_the_exact_image(tmp_path):
    from tests.synthetic._painted import painted

    look = Look.plain()
    render_clip("pendulum", tmp_path / "clip.mp4", look=look, **SMALL)
    plan = plan_clip("pendulum", look=look, **SMALL)
    expected = painted(plan.stage, plan.camera, look, [0.0])[0].luma
    np.testing.assert_array_equal(read_clip(tmp_path / "clip.mp4")[1][0], np.floor(expected + 0.5))


def test_h264_clip_stays_near_the_bit_rate_and_the_image(tmp_path):
    clip = tmp_path / "clip.mp4"
    render_clip("pendulum", clip, size=(640, 360), duration_s=2.0, look=Look(bit_rate=2e6))
    assert clip.stat().st_size * 8 / 2.0 == pytest.approx(2e6, rel=0.3)
    render_clip("pendulum", tmp_path / "exact.mp4", size=(640, 360), duration_s=0.2, look=Look(codec="lossless"))
    difference = read_clip(clip)[1][5] - read_clip(tmp_path / "exact.mp4")[1][5]
    assert np.sqrt(np.mean(difference**2)) < 4.0


def test_dropped_frames_leave_gaps_in_the_times(tmp_path):
    clip = tmp_path / "clip.mp4"
    truth = render_clip("pendulum", clip, look=Look.plain(dropped=0.3), size=(64, 36), duration_s=1.0, fps=30.0)
    times, _ = read_clip(clip)
    assert len(times) < 30
    assert np.diff(times).max() > 1.5 / 30
    np.testing.assert_allclose(times, truth.body().t_s, atol=1e-9)


def test_hidden_dropped_frame_closes_up_the_times(tmp_path):
    clip = tmp_path / "clip.mp4"
    truth = render_clip("pendulum", clip, effects={"dropped-frame": 20}, size=(64, 36), duration_s=1.0, fps=30.0)
    times, _ = read_clip(clip)
    assert np.diff(times) == pytest.approx(1 / 30)
    whole = plan_clip("pendulum", size=(64, 36), duration_s=1.0, fps=30.0).truth.body()
    np.testing.assert_allclose(truth.body().x_px[20:], whole.x_px[21:])
    np.testing.assert_allclose(truth.body().x_px[:20], whole.x_px[:20])


def test_hidden_time_scale_stretches_the_files_times():
    slow = plan_clip("pendulum", effects={"time-scale": 0.02}, size=(64, 36), duration_s=1.0).truth.body()
    true = plan_clip("pendulum", size=(64, 36), duration_s=1.0).truth.body()
    np.testing.assert_allclose(slow.t_s, 1.02 * true.t_s)
    np.testing.assert_allclose(slow.x_px, true.x_px)


def test_small_time_scale_is_kept():
    truth = plan_clip("pendulum", effects={"time-scale": 1e-4}, size=(64, 36), duration_s=1.0).truth
    assert truth.body().t_s.iloc[-1] == pytest.approx(59 / 60 * 1.0001, rel=1e-9)


def test_shake_moves_image_and_truth_together(tmp_path):
    look = Look.plain(shake_px=8.0)
    truth = render_clip("pendulum", tmp_path / "clip.mp4", look=look, size=(320, 180), duration_s=0.5)
    still = plan_clip("pendulum", look=Look.plain(), size=(320, 180), duration_s=0.5).truth.body()
    rows = truth.body()
    np.testing.assert_allclose(rows.x_px - rows.shift_x_px, still.x_px)
    y, x = np.mgrid[:180, :320]
    for frame, row in zip(read_clip(tmp_path / "clip.mp4")[1], rows.itertuples(), strict=True):
        ball = np.abs(frame - 121.0)
        assert (x * ball).sum() / ball.sum() == pytest.approx(row.x_px, abs=0.02)
        assert (y * ball).sum() / ball.sum() == pytest.approx(row.y_px, abs=0.02)


def test_same_seed_gives_the_same_bytes_and_another_seed_others(tmp_path):
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        render_clip("pendulum", tmp_path / f"{name}.mp4", seed=seed, look=HANDHELD, **SMALL)
    contents = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert contents["a.mp4"] == contents["b.mp4"]
    assert contents["a.truth.csv"] == contents["b.truth.csv"]
    assert contents["a.hidden.json"] == contents["b.hidden.json"]
    assert contents["a.mp4"] != contents["c.mp4"]


def test_truth_reads_back_as_it_was(tmp_path):
    clip = tmp_path / "clip.mp4"
    effects = {"quadratic-drag": 0.08, "finite-bob": 0.03, "camera-tilt": 0.1}
    wrote = render_clip("pendulum", clip, effects=effects, setting="pendulum_45", seed=3, **SMALL)
    read = read_truth(clip)
    assert read.effects == effects
    assert read.parameters == wrote.parameters
    assert read.hidden == wrote.hidden
    assert read.camera == wrote.camera
    assert read.true_camera == wrote.true_camera
    assert read.true_camera["rotation"] != read.camera["rotation"]
    assert read.parameters["length"].value == 0.5
    assert read.exact("length").value == pytest.approx(0.53 + 0.4 * 0.03**2 / 0.53)
    assert read.exact("damping").value == 0.06
    assert read.setting == "pendulum_45"
    assert (read.size, read.fps, read.seed) == ((160, 90), 30.0, 3)
    assert read.pixels_per_metre == wrote.pixels_per_metre
    for column in ("t_s", "x_px", "y_px", "theta_rad", "radius_px"):
        np.testing.assert_array_equal(read.body()[column], wrote.body()[column])


def test_truth_that_a_user_sees_does_not_name_the_effects(tmp_path):
    clip = tmp_path / "clip.mp4"
    effects = {"quadratic-drag": 0.08, "radial-distortion": -0.07}
    render_clip("pendulum", clip, effects=effects, **SMALL)
    truth_path, table, hidden = truth_paths(clip)
    for seen in (truth_path, table, clip):
        assert b"drag" not in seen.read_bytes()
        assert b"effect" not in seen.read_bytes()
        assert b"-0.07" not in seen.read_bytes()
    assert json.loads(hidden.read_text())["effects"] == effects


def test_hidden_file_is_there_for_a_clip_without_effects(tmp_path):
    render_clip("pendulum", tmp_path / "clip.mp4", **SMALL)
    assert json.loads((tmp_path / "clip.hidden.json").read_text())["effects"] == {}


def test_truth_of_an_unknown_parameter_lists_the_parameters():
    truth = plan_clip("pendulum", size=(64, 36), duration_s=0.5).truth
    with pytest.raises(DataError, match="no parameter 'lenght'; it has length, damping"):
        truth.exact("lenght")


def test_truth_of_an_unknown_body_lists_the_bodies():
    truth = plan_clip("pendulum", size=(64, 36), duration_s=0.5).truth
    with pytest.raises(DataError, match="no body '2'; it has 1"):
        truth.body("2")


def test_progress_reports_every_frame(tmp_path):
    progress = []
    render_clip("pendulum", tmp_path / "clip.mp4", progress=lambda done, n: progress.append((done, n)), **SMALL)
    assert progress == [(k + 1, 15) for k in range(15)]


def test_underscores_may_stand_for_hyphens():
    for name in ("two_moving_pendulum_one_static", "one-static-pendulum"):  # the second is a former name
        assert plan_clip(name, size=(64, 36), duration_s=0.5).truth.phenomenon == "two-moving-pendulum-one-static"


# --------------------------------------------------------------------------- hostile input


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"size": (0, 90)}, DataError, r"two even numbers from 32 to 7680, not \(0, 90\)"),
        ({"size": (161, 90)}, DataError, "even"),
        ({"size": (160.0, 90)}, DataError, "even"),
        ({"size": (160, 90000)}, DataError, "even"),
        ({"size": (160,)}, DataError, "two even numbers"),
        ({"size": "160x90"}, DataError, "two even numbers"),
        ({"fps": -30.0}, DataError, "fps must lie between 0.1 and 1000, not -30.0"),
        ({"fps": 0.0}, DataError, "fps must lie"),
        ({"fps": float("nan")}, DataError, "fps must lie"),
        ({"fps": "fast"}, DataError, "fps must lie"),
        ({"duration_s": 0.0}, DataError, "at least two frames"),
        ({"duration_s": -1.0}, DataError, "at least two frames"),
        ({"duration_s": float("nan")}, DataError, "at least two frames"),
        ({"duration_s": 1e9}, DataError, "more than 1000000 frames"),
        ({"duration_s": float("inf")}, DataError, "more than 1000000 frames"),
        ({"seed": -1}, DataError, "seed must be a whole number"),
        ({"seed": 1.5}, DataError, "seed must be a whole number"),
        (
            {"effects": {"quadratic_drag": 0.1}},
            UnknownNameError,
            "did you mean 'quadratic-drag'.*there are: linear-drag",
        ),
        ({"effects": {"magic": 0.1}}, UnknownNameError, "pendulum has no effect 'magic'; there are: "),
        ({"effects": {"quadratic-drag": float("inf")}}, DataError, "'quadratic-drag' must be a finite number, not inf"),
        ({"effects": {"quadratic-drag": "much"}}, DataError, "must be a finite number, not 'much'"),
        ({"effects": {"dropped-frame": 400}}, DataError, "dropped-frame must be a frame number from 1 to"),
        ({"effects": {"time-scale": -2.0}}, DataError, "'time-scale' must lie between -0.9 and 10 here"),
        ({"setting": "pendulum_60"}, UnknownNameError, "no setting 'pendulum_60'; there are: pendulum_20"),
        ({"effects": {"camera-tilt": 2.0}}, DataError, "'camera-tilt' must lie between -0.7 and 0.7 here, not 2"),
        ({"effects": {"anisotropic-scale": -1.0}}, DataError, "'anisotropic-scale' must lie"),
        ({"effects": {"slack-tether": 0.6}}, DataError, "'slack-tether' must lie between 0 and 0.45 here, not 0.6"),
        ({"effects": {"coulomb-friction": -0.6}}, DataError, "must not be negative"),
        ({"overrides": {"lenght": 0.4}}, UnknownNameError, "no parameter 'lenght'; there are: length"),
        ({"overrides": {"length": float("nan")}}, DataError, "length must be a finite number"),
        ({"overrides": {"length": -1.0}}, DataError, "length of pendulum must lie within"),
        ({"overrides": {"ball_radius": 0.0}}, DataError, "ball_radius of pendulum must lie within"),
    ],
)
def test_bad_request_is_refused_and_nothing_is_written(tmp_path, changes, error, message):
    with pytest.raises(error, match=message):
        render_clip("pendulum", tmp_path / "clip.mp4", **{**SMALL, **changes})
    assert list(tmp_path.iterdir()) == []


def test_unknown_phenomenon_lists_the_scenes(tmp_path):
    with pytest.raises(UnknownNameError, match=r"no scene is named 'pendelum'; did you mean 'pendulum'.*there are: "):
        render_clip("pendelum", tmp_path / "clip.mp4")


@pytest.mark.parametrize("name", ["clip.avi", "clip", "clip.gif", "clip.truth.json"])
def test_unknown_format_is_refused(tmp_path, name):
    with pytest.raises(OutputError, match=r"cannot tell the video format of .*; use one of .mp4"):
        render_clip("pendulum", tmp_path / name, **SMALL)


@pytest.mark.parametrize("present", ["clip.mp4", "clip.truth.csv", "clip.hidden.json"])
def test_existing_output_is_kept_unless_overwrite_is_given(tmp_path, present):
    (tmp_path / present).write_text("mine")
    with pytest.raises(OutputError, match=rf"{present} exists already"):
        render_clip("pendulum", tmp_path / "clip.mp4", **SMALL)
    assert (tmp_path / present).read_text() == "mine"
    render_clip("pendulum", tmp_path / "clip.mp4", overwrite=True, **SMALL)
    assert (tmp_path / present).read_bytes() != b"mine"


def test_unwritable_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OutputError, match="cannot write"):
        render_clip("pendulum", tmp_path / "file" / "clip.mp4", **SMALL)


def test_interruption_leaves_no_clip(tmp_path):
    def stop(done, total):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_clip("pendulum", tmp_path / "clip.mp4", progress=stop, **SMALL)
    assert list(tmp_path.iterdir()) == []


def test_failing_encoder_is_a_stated_error(tmp_path, monkeypatch):
    def fail(self, frame):
        self.failure = ValueError("out of paper")

    monkeypatch.setattr(Encoder, "_encode_one", fail)
    with pytest.raises(OutputError, match="the video could not be encoded: out of paper"):
        render_clip("pendulum", tmp_path / "clip.mp4", **SMALL)
    assert list(tmp_path.iterdir()) == []


def test_full_disk_is_a_stated_error(tmp_path):
    if not os.path.exists("/dev/full"):  # noqa: PTH110
        pytest.skip("no /dev/full on this machine")
    (tmp_path / "clip.mp4").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="not an ordinary file"):
        render_clip("pendulum", tmp_path / "clip.mp4", overwrite=True, **SMALL)


@pytest.mark.parametrize("missing", [".truth.json", ".truth.csv", ".hidden.json"])
def test_reading_an_incomplete_truth_is_a_stated_error(tmp_path, missing):
    clip = tmp_path / "clip.mp4"
    render_clip("pendulum", clip, **SMALL)
    clip.with_suffix(missing).unlink()
    with pytest.raises(DataError, match=r"truth|one that render wrote"):
        read_truth(clip)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"phenomenon": 3}', "\x00"])
def test_reading_a_foreign_truth_is_a_stated_error(tmp_path, content):
    clip = tmp_path / "clip.mp4"
    render_clip("pendulum", clip, **SMALL)
    clip.with_suffix(".truth.json").write_text(content)
    with pytest.raises(DataError):
        read_truth(clip)
