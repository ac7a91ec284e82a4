"""Faults of a camera that OpenCV makes are named through the view of the clip, and leave the parameters right."""

import numpy as np
import pytest

from iris_sysid import MODELS, diagnose
from validation.blind_independent import trajectory_of
from validation.independent.camera import SIZE_PX
from validation.independent.cases import Case
from validation.independent.effects import HIDDEN
from validation.independent.motions import MOTIONS

PENDULUM = {"length": 0.7, "damping": 0.05, "x0": 0.9, "v0": 0.3}
THROW = {"x0": 0.05, "x1": 0.6, "v0": 2.0, "v1": 3.0}


def clip_with(hidden, motion, values, size, seed=0):
    """The table of a filmed motion in which one fault of the camera is hidden, with white noise."""
    effect = next(effect for effect in HIDDEN if effect.name == hidden)
    t_s = MOTIONS[motion].times()
    clean = effect.show(MOTIONS[motion], values, t_s, size, {})
    observed = clean + MOTIONS[motion].noise * np.random.default_rng(seed).standard_normal(clean.shape)
    return trajectory_of(Case(seed, MOTIONS[motion], values, "white", t_s, observed, clean, effect, size, 1.0, {}))


@pytest.mark.parametrize(
    ("hidden", "size", "right"),
    [
        ("rolling shutter", 0.02 / SIZE_PX[1], "rolling-shutter"),
        ("camera tilt", 0.25, "camera-tilt"),
    ],
)
def test_fault_of_the_camera_is_in_the_class_and_the_length_is_right(hidden, size, right):
    diagnosis = diagnose(clip_with(hidden, "pendulum", PENDULUM, size), MODELS["pendulum"])
    classes = [{effect.name, *diagnosis.indistinguishable[effect.name]} for effect in diagnosis.added]
    assert any(right in names for names in classes), classes
    length = diagnosis.final.estimates["length"]
    assert abs(length.value - PENDULUM["length"]) < 3 * length.stderr
    assert length.stderr < 5e-3


def test_shutter_of_a_throw_is_named():
    diagnosis = diagnose(clip_with("rolling shutter", "projectile", THROW, 0.03 / SIZE_PX[1]), MODELS["projectile"])
    assert [effect.name for effect in diagnosis.added] == ["rolling-shutter"]
    assert diagnosis.sizes["rolling_shutter"].value == pytest.approx(0.03, abs=0.005)


def test_encoder_is_never_said_to_have_a_camera():
    clip = clip_with("rolling shutter", "pendulum", PENDULUM, 0.02 / SIZE_PX[1]).with_(sensor="encoder", view=None)
    diagnosis = diagnose(clip, MODELS["pendulum"])
    tested = {score.effect for score in diagnosis.rounds[0]}
    assert not tested & {"rolling-shutter", "camera-tilt", "radial-distortion", "anisotropic-scale", "camera-drift"}


def test_each_of_several_clips_is_seen_in_its_own_view():
    size, other = 0.03, {"x0": 0.0, "x1": 1.4, "v0": 0.6, "v1": 1.0}
    clips = [clip_with("rolling shutter", "projectile", values, size / SIZE_PX[1]) for values in (THROW, other)]
    assert clips[0].view != clips[1].view
    right = diagnose(clips, MODELS["projectile"]).sizes["rolling_shutter"]
    assert right.value == pytest.approx(size, abs=3 * right.stderr)
    assert right.stderr < 0.003
