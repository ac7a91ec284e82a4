"""Effects of a camera act on the image: they are what OpenCV's camera makes of a motion, wherever its zero is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from fitters.compose_effects import with_effect, with_effects
from fitters.image_effects import offered, view_of
from fitters.ode import fit, simulate
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Estimate, Quantity, Trajectory, View
from validation.blind_independent import view_through
from validation.independent.camera import SIZE_PX
from validation.independent.effects import camera_before, filmed
from validation.independent.motions import MOTIONS, integrate

CAMERA_EFFECTS = ("rolling-shutter", "camera-tilt", "radial-distortion", "anisotropic-scale", "camera-drift")
VALUES = {
    "pendulum": {"length": 0.7, "damping": 0.05, "x0": 0.9, "v0": 0.3},
    "linear-oscillator": {"stiffness": 25.0, "damping": 0.1, "x0": 0.25, "v0": 0.1},
    "incline": {"acceleration": 1.2, "x0": 0.05, "v0": 0.3},
    "free-fall": {"gravity": 9.81, "x0": 1.8, "v0": 0.1},
    "projectile": {"x0": 0.05, "x1": 0.6, "v0": 2.0, "v1": 3.0},
}
# the library's effect, the camera's value, and its size: each a few percent of the motion
FAULTS = (
    ("camera-tilt", "tilt_rad", 0.15),
    ("camera-tilt", "tilt_rad", -0.3),
    ("radial-distortion", "distortion", -0.6),
    ("radial-distortion", "distortion", 0.4),
    ("rolling-shutter", "line_s", 0.016 / SIZE_PX[1]),
    ("rolling-shutter", "line_s", -0.03 / SIZE_PX[1]),
    ("anisotropic-scale", "aspect", 0.04),
)
# filmed along a row, where a shutter does nothing; along a column, where a tilt about the vertical does nothing
IDLE = {("linear-oscillator", "rolling-shutter"), ("incline", "rolling-shutter"), ("free-fall", "camera-tilt")}
CASES = [
    (name, *fault)
    for name in VALUES
    for fault in FAULTS
    if EFFECTS[fault[0]].applies(MODELS[name]) and (name, fault[0]) not in IDLE
]


def undisturbed(name):
    motion = MOTIONS[name]
    t_s = motion.times()
    return motion, t_s, integrate(motion, VALUES[name], t_s)[:, : motion.size]


def seen_with(fault, name, observed):
    """The view of a camera with a fault, whose pivot is where it is seen."""
    motion, values = MOTIONS[name], VALUES[name]
    return view_through(camera_before(motion, values, observed).with_(**fault), motion, values, observed)


def in_view(effect, model, view, t_s, observed, size):
    """What the library's effect makes of a motion that is given, whatever the model's parameters."""
    composed = with_effect(replace(model, observe=lambda t, states, params: observed), EFFECTS[effect], view)
    _, *shape = EFFECTS[effect].parameters
    params = np.array([1.0] * len(model.parameters) + [size] + [parameter.default for parameter in shape])
    return composed.observe(t_s, np.zeros((t_s.size, len(model.states))), params)


@pytest.mark.parametrize(("name", "effect", "change", "size"), CASES)
def test_effect_is_what_opencv_makes_of_the_motion(name, effect, change, size):
    motion, t_s, observed = undisturbed(name)
    stated = 1.0 + size if change == "aspect" else size
    expected = filmed(change, motion, VALUES[name], t_s, stated, {}) - observed
    in_library = size * SIZE_PX[1] if change == "line_s" else size
    view = seen_with({change: stated}, name, observed)
    changed = in_view(effect, MODELS[name], view, t_s, observed, in_library) - observed
    assert np.max(np.abs(expected)) > 1e-3 * np.ptp(observed)
    np.testing.assert_allclose(changed, expected, rtol=0, atol=0.02 * np.max(np.abs(expected)))


def table(quantities, n=20, **more):
    rng = np.random.default_rng(0)
    position = rng.uniform(0.1, 0.5, (n, len(quantities)))
    return Trajectory(np.arange(n) / 60, quantities, position, np.full_like(position, np.nan), np.ones(n, bool), **more)


@pytest.mark.parametrize("sensor", ["encoder", "gauge"])
def test_sensor_without_a_camera_gets_no_effect_of_one(sensor):
    model = MODELS["pendulum"]
    names = {effect.name for effect in offered(EFFECTS.values(), model, [table(model.observed, sensor=sensor)])}
    assert not names & set(CAMERA_EFFECTS)
    assert {"zero-offset", "zero-drift", "quadratic-drag", "dropped-frame"} <= names


@pytest.mark.parametrize("sensor", ["camera", "unknown"])
def test_camera_gets_its_effects_and_no_drift_of_a_sensor(sensor):
    model = MODELS["pendulum"]
    names = {effect.name for effect in offered(EFFECTS.values(), model, [table(model.observed, sensor=sensor)])}
    assert set(CAMERA_EFFECTS) <= names
    assert "zero-drift" not in names


def test_clips_of_different_sensors_get_what_all_of_them_can_have():
    model = MODELS["pendulum"]
    clips = [table(model.observed, sensor=sensor) for sensor in ("camera", "encoder")]
    assert not {effect.name for effect in offered(EFFECTS.values(), model, clips)} & {*CAMERA_EFFECTS, "zero-drift"}


def test_pivot_that_all_clips_have_measured_is_not_wrong_as_well():
    model = MODELS["pendulum"]
    across = {"pivot_across": Estimate(0.0, 1e-4, "1", "fitted")}
    filmed, typed = (table(model.observed, sensor="camera", geometry=geometry) for geometry in (across, {}))
    assert "wrong-pivot" not in {effect.name for effect in offered(EFFECTS.values(), model, [filmed])}
    assert "wrong-pivot" in {effect.name for effect in offered(EFFECTS.values(), model, [filmed, typed])}


def test_brightness_has_no_place_in_an_image():
    model = MODELS["exponential-decay"]
    names = {effect.name for effect in offered(EFFECTS.values(), model, [table(model.observed, sensor="camera")])}
    assert not names & set(CAMERA_EFFECTS)
    assert "zero-drift" in names


def test_image_of_a_table_lies_about_its_motion_wherever_the_zero_is():
    model, t_s = MODELS["free-fall"], np.arange(40) / 60
    z = (2.0 - 4.9 * t_s**2)[:, None]
    views = [view_of(table(model.observed, 40).with_(position=z + shift), model) for shift in (0.0, 100.0)]
    for effect in CAMERA_EFFECTS[:3]:
        seen = [
            in_view(effect, model, view, t_s, z + shift, 0.03) - shift
            for shift, view in zip((0.0, 100.0), views, strict=True)
        ]
        np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
        assert np.max(np.abs(seen[0] - z)) > 1e-5


def test_view_that_the_table_states_is_used_for_its_own_quantities_only():
    model = MODELS["pendulum"]
    stated = View("angle", (640.0, 80.0), (500.0, 0.0), (0.0, -500.0), (1280.0, 720.0), (640.0, 360.0), 900.0)
    clip = table(model.observed, sensor="camera", view=stated)
    assert view_of(clip, model) is stated
    renamed = clip.with_(quantities=(Quantity("s", "m", "s"),))
    assert renamed.view is None
    assert view_of(renamed, MODELS["incline"]).kind == "line"


def test_shutter_of_a_filmed_pendulum_leaves_its_length_right():
    motion, values = MOTIONS["pendulum"], VALUES["pendulum"]
    t_s = motion.times()
    seen = filmed("line_s", motion, values, t_s, 0.02 / SIZE_PX[1], {})
    noisy = seen + 5e-4 * np.random.default_rng(3).standard_normal(seen.shape)
    undisturbed = integrate(motion, values, t_s)[:, :1]
    view = seen_with({"line_s": 0.02 / SIZE_PX[1]}, "pendulum", undisturbed)
    clip = table(MODELS["pendulum"].observed, t_s.size).with_(t_s=t_s, position=noisy, sensor="camera", view=view)
    fitted = fit(clip, with_effects(MODELS["pendulum"], [EFFECTS["rolling-shutter"]], clip.view))
    length, delay = fitted.estimates["length"], fitted.estimates["rolling_shutter"]
    assert abs(length.value - values["length"]) < 3 * length.stderr
    assert abs(delay.value - 0.02) < 3 * delay.stderr
    assert length.stderr < 1e-3


@pytest.mark.parametrize("pivot", ["arc", "arc-of-known-radius", "marked"])
@pytest.mark.parametrize("distortion", [-0.25, 0.3])
def test_pivot_is_where_the_analysis_of_the_bent_picture_puts_it(pivot, distortion):
    theta, true_pivot, lever = np.linspace(-0.9, 0.8, 200)[:, None], np.array([640.0, 60.0]), 500.0
    axis, focal = np.array([640.0, 360.0]), 900.0

    def bent(points):
        away = points - axis
        return axis + away * (1 + distortion * np.sum(away**2, axis=1, keepdims=True) / focal**2)

    seen = bent(true_pivot + lever * np.hstack([np.sin(theta), np.cos(theta)]))
    centre = bent(true_pivot[None])[0] if pivot == "marked" else circle_of(seen, lever if "known" in pivot else None)
    radius = lever if "known" in pivot else np.mean(np.hypot(*(seen - centre).T))
    view = View("angle", tuple(centre), (radius, 0.0), (0.0, -radius), (1280.0, 720.0), tuple(axis), focal, pivot=pivot)
    expected = np.arctan2(seen[:, 0] - centre[0], seen[:, 1] - centre[1])
    found = in_view("radial-distortion", MODELS["pendulum"], view, np.arange(200) / 60, theta, distortion)
    change = np.max(np.abs(expected - theta[:, 0]))
    np.testing.assert_allclose(found[:, 0], expected, atol=0.01 * change)


def circle_of(points, radius):
    """Centre of the circle of least orthogonal distances, by SciPy."""

    def distances(shape):
        return np.hypot(*(points - shape[:2]).T) - (shape[2] if radius is None else radius)

    start = [640.0, 60.0, 500.0] if radius is None else [640.0, 60.0]
    return least_squares(distances, start, xtol=1e-14, ftol=1e-14).x[:2]


def test_unknown_focal_length_is_in_the_error_of_what_depends_on_it():
    motion, values = MOTIONS["pendulum"], VALUES["pendulum"]
    t_s = motion.times()
    seen = filmed("tilt_rad", motion, values, t_s, 0.3, {})
    noisy = seen + 1e-4 * np.random.default_rng(3).standard_normal(seen.shape)
    undisturbed = integrate(motion, values, t_s)[:, :1]
    view = seen_with({"tilt_rad": 0.3}, "pendulum", undisturbed)
    stderrs, model = [], with_effects(MODELS["pendulum"], [EFFECTS["camera-tilt"]], view)
    for focal in ({}, {"focal_ratio": Estimate(1.0, 0.0, "1", "direct")}):
        clip = table(MODELS["pendulum"].observed, t_s.size).with_(t_s=t_s, position=noisy, geometry=focal)
        length = fit(clip, model).estimates["length"]
        assert abs(length.value - values["length"]) < 4 * length.stderr
        stderrs.append(length.stderr)
    assert stderrs[0] > 2 * stderrs[1]


def test_simulated_effect_of_a_camera_is_found_again_by_a_fit():
    model = with_effects(MODELS["projectile"], [EFFECTS["radial-distortion"]])
    values = {"gravity": 9.80665, "x_0": 0.0, "z_0": 0.6, "vx_0": 2.0, "vz_0": 3.0, "radial_distortion": 0.3}
    t_s = np.arange(60) / 60
    seen = simulate(model, t_s, values).observed
    clip = table(model.observed, 60).with_(
        t_s=t_s, position=seen + 1e-4 * np.random.default_rng(1).normal(size=(60, 2))
    )
    found = fit(clip, model).estimates["radial_distortion"]
    assert abs(found.value - 0.3) < 4 * found.stderr
    assert found.stderr < 0.05
