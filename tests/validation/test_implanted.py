"""Implanted effects: their size, the simulation beside the library's, the scores, and the pictures that are bent."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from iris_sysid import MODELS, Trajectory, diagnose, open_video, simulate, with_effects
from iris_sysid.types import SIDES
from tests._real_data import alexiev_length_68
from validation import implanted
from validation import implanted_video as video
from validation.implanted_effects import IMPLANTS, NotShownError, based, sized, trace
from validation.implanted_scores import Answer, Hidden, level, measured_newly, same, score
from validation.world_recordings import NOTHING, Recording

DAMPED = {"pendulum": {"length": 0.5, "damping": 0.05, "theta_0": 0.6, "omega_0": 0.1}}
DAMPED["linear-oscillator"] = {"stiffness": 20.0, "damping": 0.05, "z_0": 0.3, "vz_0": 0.1}
DAMPED["free-fall"] = {"gravity": 9.81, "z_0": 2.0, "vz_0": 0.0}
NOISE = 2e-3
BY_NAME = {implant.name: implant for implant in IMPLANTS}


def a_recording(model="pendulum", right=NOTHING, plausible=NOTHING):
    return Recording("x", "here", "that", MODELS[model], list, "camera", right, plausible)


def a_base(model="pendulum", seconds=6.0, start_s=0.0):
    t_s = start_s + np.arange(round(60 * seconds)) / 60
    observed = simulate(model, t_s, DAMPED[model]).observed
    observed = observed + NOISE * np.random.default_rng(1).standard_normal(observed.shape)
    valid = np.ones(t_s.size, dtype=bool)
    clip = Trajectory(t_s, MODELS[model].observed, observed, np.full_like(observed, np.nan), valid)
    return based(a_recording(model), clip)


# Sizes --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("multiple", [3.0, 1.0])
@pytest.mark.parametrize("name", sorted(set(BY_NAME) - {"dropped-frame"}))
def test_trace_of_an_implant_is_the_multiple_of_the_residual(name, multiple):
    base = a_base()
    changed, ratio = sized(BY_NAME[name], base, multiple)
    assert ratio == pytest.approx(multiple, rel=0.05)
    assert trace(base, changed) == pytest.approx(ratio * base.rms)


def test_lost_frames_are_whole_and_close_the_gap():
    base = a_base(start_s=1.0)
    changed = BY_NAME["dropped-frame"].add(base, 2.0)
    assert changed.clip.n == base.clip.n - 2
    assert changed.size == pytest.approx(2 / 60)
    np.testing.assert_allclose(np.diff(changed.clip.t_s), 1 / 60)
    np.testing.assert_array_equal(changed.clip.position, base.clip.position[changed.kept])


def test_lost_frames_that_leave_too_little_are_not_implanted(monkeypatch):
    """What one frame leaves says how many are needed; where the body rests, more leave no more."""
    base = a_base()
    one = trace(base, BY_NAME["dropped-frame"].add(base, 1.0))
    traces = iter([one, 0.2 * base.rms])
    monkeypatch.setattr("validation.implanted_effects.trace", lambda base, changed: next(traces))
    with pytest.raises(NotShownError, match=r"frames leave 0\.2 times"):
        sized(BY_NAME["dropped-frame"], base, 3.0)


def test_what_the_fitted_values_imitate_is_not_implanted():
    with pytest.raises(NotShownError, match="imitate"):
        sized(BY_NAME["zero-offset"], a_base("free-fall", seconds=0.6), 1.0)


def test_an_effect_as_large_as_the_motion_is_not_implanted():
    with pytest.raises(NotShownError, match="no size below"):
        sized(BY_NAME["zero-wander"], a_base(), 1e4)


def test_noise_stays_real():
    base = a_base()
    changed = BY_NAME["zero-wander"].add(base, 0.01)
    change = changed.clip.position - base.clip.position
    assert np.sqrt(np.mean(change**2)) == pytest.approx(0.01)
    assert np.max(np.abs(np.diff(change[:, 0]))) < 0.1 * NOISE * 10


# The simulation beside the library's --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "name", "size"),
    [
        ("pendulum", "quadratic-drag", 0.2),
        ("free-fall", "quadratic-drag", 0.02),
        ("linear-oscillator", "cubic-stiffness", 5.0),
        ("pendulum", "parameter-drift", 0.01),
    ],
)
def test_change_is_what_the_library_simulates_with_the_effect_less_without(model, name, size):
    base = a_base(model, seconds=0.6 if model == "free-fall" else 6.0)
    implant = BY_NAME[name]
    changed = implant.add(base, size).clip.position - base.clip.position
    values = {
        quantity: value
        for quantity, value in base.values.items()
        if quantity in MODELS[model].units() and value == value
    }
    without = simulate(model, base.clip.t_s, values).observed
    form = {"drift_damping": values["damping"]} if name == "parameter-drift" else {}  # the implant drifts as a whole
    acted = simulate(with_effects(model, [name]), base.clip.t_s, {**values, **form, implant.parameter: size}).observed
    np.testing.assert_allclose(changed, acted - without, atol=1e-7 * np.ptp(without))


# Scores -------------------------------------------------------------------------------------------------------------

DRAG = Hidden("drag", frozenset({"quadratic-drag"}), frozenset({"force-of-velocity"}), "quadratic_drag")
LEVELS = [
    (Answer("x", classes={"quadratic-drag": ["quadratic-drag"]}), "named"),
    (Answer("x", classes={"linear-drag": ["linear-drag", "quadratic-drag"]}), "class"),
    (Answer("x", findings=[("group", "force-of-velocity", ["linear-drag", "quadratic-drag"])]), "class"),
    (Answer("x", findings=[("located", "force-of-velocity", [])]), "located"),
    (Answer("x", findings=[("located", "zero-wander", [])]), "missed"),
    (Answer("x", classes={"impact": ["impact"]}), "missed"),
    (Answer("x"), "missed"),
]


@pytest.mark.parametrize(("answer", "expected"), LEVELS)
def test_level_is_the_best_of_what_is_said(answer, expected):
    assert level(DRAG, answer) == expected


def test_a_new_reading_is_where_a_fault_of_the_camera_lies():
    tilt = Hidden("tilt", frozenset({"camera-tilt"}), frozenset({"reading-of-position"}), "")
    before = Answer("x", components=[("force-of-velocity", 0.8)])
    with_it = Answer("x", components=[("force-of-velocity", 0.5), ("reading-of-velocity", 0.3), ("pulse", 0.1)])
    assert level(tilt, with_it) == "missed"
    assert level(tilt, with_it, before) == "located"
    assert not measured_newly(before, before)
    assert measured_newly(Answer("x", classes={"radial-distortion": ["radial-distortion"]}), before)
    assert not measured_newly(Answer("x", components=[("pulse", 0.9), ("zero-wander", 0.05)]), before)


def test_names_that_nothing_explains_are_extra():
    before = Answer("x", classes={"zero-offset": ["zero-offset"]})
    names = {name: [name] for name in ("quadratic-drag", "zero-offset", "linear-drag", "impact")}
    found = score(DRAG, Answer("x", classes=names), before, a_recording(plausible=frozenset({"linear-drag"})))
    assert found.extra == ("impact",)
    assert found.changed == ("impact", "linear-drag")
    assert found.already == "missed"


def test_a_name_that_stands_for_the_implant_is_no_change():
    with_it = Answer("x", classes={"linear-drag": ["linear-drag", "quadratic-drag"]})
    found = score(DRAG, with_it, Answer("x"), a_recording())
    assert found.changed == found.extra == ()


def test_values_hold_within_the_combined_error():
    assert same((1.0, 0.03), (1.1, 0.05))
    assert not same((1.0, 0.03), (1.2, 0.05))
    before = Answer("x", values={"length": (0.5, 0.001), "damping": (0.1, 0.01)})
    with_it = Answer("x", values={"length": (0.5, 0.001), "damping": (0.2, 0.01)})
    assert score(DRAG, with_it, before, a_recording()).held == {"length": True, "damping": False}


@pytest.mark.parametrize(("said", "own", "right"), [(0.21, 0.0, True), (0.3, 0.0, False), (0.3, 0.1, True)])
def test_size_is_that_of_the_implant_and_of_what_was_there(said, own, right):
    with_it = Answer("x", size=0.2, sizes={"quadratic_drag": (said, 0.01)})
    before = Answer("x", sizes={"quadratic_drag": (own, 0.0)})
    assert score(DRAG, with_it, before, a_recording()).sized is right
    assert score(DRAG, Answer("x", size=0.2), before, a_recording()).sized is None


def test_doubts_that_came_with_the_implant_are_told_apart():
    found = score(DRAG, Answer("x", doubts=["clock", "jumps"]), Answer("x", doubts=["jumps"]), a_recording())
    assert found.new_doubts == ("clock",)


def test_every_component_that_an_implant_is_looked_for_in_exists():
    kinds = frozenset().union(*(hidden.kinds for hidden in (*IMPLANTS, *video.FAULTS)))
    assert kinds - {"zero", "constant"} <= set(SIDES)


def test_answers_are_kept_until_there_is_more_time(tmp_path):
    def options(seconds):
        return implanted.argparse.Namespace(folder=tmp_path, seconds=seconds)

    made = []

    def make(answer):
        made.append(answer)
        return Answer("x", failed="no answer") if len(made) == 1 else Answer("x", classes={"impact": ["impact"]})

    assert implanted.kept(Answer("x"), options(1.0), make).failed
    assert implanted.kept(Answer("x"), options(1.0), make).failed
    assert implanted.kept(Answer("x"), options(2.0), make).added == {"impact"}
    assert implanted.kept(Answer("x"), options(9.0), make).usable
    assert len(made) == 2


def test_summary_counts_levels_and_names():
    before = Answer("pendulum-90deg-3", values={"length": (0.5, 0.001)})
    with_it = Answer("pendulum-90deg-3", "drag", 3.0, classes={"quadratic-drag": ["quadratic-drag"]})
    rows = [implanted.Row(DRAG, with_it, before), implanted.Row(DRAG, Answer("x", "drag", 3.0, skipped="no"), before)]
    text = implanted.summary(rows, 3.0)
    assert "of 1: named 1, class 0" in text
    assert "not shown by the recording 1" in text
    assert rows[0].text.count("|") == rows[1].text.count("|") == implanted.HEADER.splitlines()[0].count("|")


# Pictures -----------------------------------------------------------------------------------------------------------

WIDTH, HEIGHT = 320, 240
POINT = (90.0, 60.0)
BY_FAULT = {fault.name: fault for fault in video.FAULTS}


def a_picture(x=POINT[0], y=POINT[1]):
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    image[:] = (200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 4.0**2)))[..., None]
    return image


def place(image):
    grey = image[..., 0].astype(float)
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return np.array([np.sum(columns * grey), np.sum(rows * grey)]) / grey.sum()


def still(count=6):
    return [(k / 30, a_picture()) for k in range(count)]


def projected(turn_rad, distortion):
    """Where OpenCV shows the point, on a plane one focal length's worth of unit distance away."""
    matrix = video.camera_matrix(WIDTH, HEIGHT)
    away = (np.array(POINT) - matrix[:2, 2]) / matrix[0, 0]
    lens = np.array([distortion, 0.0, 0.0, 0.0])
    point = np.array([[*away, 0.0]])
    return cv2.projectPoints(point, np.array([0.0, turn_rad, 0.0]), np.array([0.0, 0.0, 1.0]), matrix, lens)[0].ravel()


@pytest.mark.parametrize(
    ("name", "size", "expected"),
    [("camera-tilt", 0.25, projected(0.25, 0.0)), ("radial-distortion", 0.3, projected(0.0, 0.3))],
)
def test_bent_picture_shows_the_point_where_a_projector_does(name, size, expected):
    _, image = next(iter(video.frames_with(BY_FAULT[name], size, still(), 6)))
    assert np.linalg.norm(expected - POINT) > 3
    np.testing.assert_allclose(place(image), expected, atol=0.15)
    marked = video.seen_through(BY_FAULT[name], size, WIDTH, HEIGHT)(np.array([POINT]))[0]
    np.testing.assert_allclose(marked, expected, atol=1e-6)


def test_camera_that_wanders_moves_the_point_by_its_path():
    moved = list(video.frames_with(BY_FAULT["camera-wander"], 4.0, still(), 6))
    path = video.camera_path(4.0, np.linspace(0, 1, 6))
    np.testing.assert_allclose([place(image) for _, image in moved], np.array(POINT) + path, atol=0.1)
    fine = video.camera_path(4.0, np.linspace(0, 1, 1001))
    np.testing.assert_allclose(np.abs(fine).max(axis=0), 4.0)


def test_rolling_shutter_shows_each_row_at_its_own_time():
    frames = [(k / 30, a_picture(x=100.0 + 0.5 * k)) for k in range(5)]
    rolled = list(video.frames_with(BY_FAULT["rolling-shutter"], 1.0, frames, 5))
    late = POINT[1] / (HEIGHT - 1) - 0.5
    for number in (1, 2, 3):
        np.testing.assert_allclose(place(rolled[number][1])[0], 100.0 + 0.5 * (number + late), atol=0.05)
    assert [t_s for t_s, _ in rolled] == [t_s for t_s, _ in frames]


def test_lost_frames_of_a_clip_close_the_gap():
    frames = [(k / 30, a_picture(x=50.0 + k)) for k in range(10)]
    left = list(video.frames_with(BY_FAULT["dropped-frame"], 3.0, frames, 10))
    np.testing.assert_allclose([t_s for t_s, _ in left], np.arange(7) / 30)
    np.testing.assert_allclose([place(image)[0] - 50 for _, image in left], [0, 1, 2, 3, 7, 8, 9], atol=0.05)


def test_wrong_rate_scales_the_times_and_a_rate_that_is_stated():
    fault = BY_FAULT["wrong-rate"]
    times = [t_s for t_s, _ in video.frames_with(fault, 0.03, still(), 6)]
    np.testing.assert_allclose(times, np.arange(6) / 30 / 1.03)
    assert video.stated_again("--fps 240 --scale 440px=1m", fault, 0.03, (WIDTH, HEIGHT)) == (
        "--fps 247.2 --scale 440px=1m"
    )


def test_marks_move_with_the_picture():
    words = video.stated_again("--fps 240 --mark launch=90,60", BY_FAULT["camera-tilt"], 0.25, (WIDTH, HEIGHT))
    x, y = projected(0.25, 0.0)
    assert words == f"--fps 240 --mark launch={x:.2f},{y:.2f}"


def test_clip_is_encoded_without_loss_at_its_own_times(tmp_path):
    times = np.array([0.0, 0.1, 0.15, 0.4])
    pictures = [a_picture(x=60.0 + 10 * k) for k in range(4)]
    path = video.encode(tmp_path / "clip.mp4", zip(times, pictures, strict=True))
    read = list(open_video(path).frames())
    np.testing.assert_allclose([frame.t_s for frame in read], times, atol=1e-5)
    for frame, picture in zip(read, pictures, strict=True):
        np.testing.assert_array_equal(frame.bgr(), picture)


# Real recordings ----------------------------------------------------------------------------------------------------


def diagnosis_with(name, multiple=3.0):
    """Of a real pendulum with an implant, whose size is given as well."""
    clip = alexiev_length_68().with_(sensor="camera")
    changed, _ = sized(BY_NAME[name], based(replace(a_recording(), clips=lambda: [clip]), clip), multiple)
    return diagnose(changed.clip, MODELS["pendulum"]), changed.size


@pytest.mark.slow
def test_wrong_zero_does_not_give_way_to_a_wander_so_slow_that_it_is_one():
    found, _ = diagnosis_with("zero-offset")
    named = [each.effects for each in found.findings if each.word in ("named", "group")]
    assert any("zero-offset" in names for names in named)
    assert ("zero-wander",) not in named


@pytest.mark.slow
def test_drift_that_imitates_anything_is_tried_in_the_place_of_a_formula():
    found, size = diagnosis_with("parameter-drift")
    drift = found.sizes["parameter_drift"]
    assert abs(drift.value - size) < 3.0 * drift.stderr
    assert found.residual_ratio < 1.4
