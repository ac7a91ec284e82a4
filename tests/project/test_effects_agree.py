"""Effects have one name each: scenes, SINDy and validation use the library's names and mean the same by them."""

import math

import numpy as np
import pytest

from fitters.sindy import library
from iris_sysid.registry import EFFECTS, PHENOMENA
from iris_sysid.synthetic.effects import (
    CAMERA,
    FORCES,
    FORCING_HZ,
    WEAKENING_SPEED,
    dry_friction,
    extra_acceleration,
)
from iris_sysid.synthetic.scene import SCENES
from validation import blind_video, search

START = {"release-velocity"}  # an initial value, which every fit estimates: no effect that an equation may lack
SHAPES = {
    "periodic-forcing": (2 * math.pi * FORCING_HZ, 0.0, 0.0),
    "velocity-weakening-friction": (WEAKENING_SPEED, 0.03),  # the second is the speed of the turnover
}
MOTIONS = [(0.4, 0.3, 1.7), (1.9, -0.2, 2.5), (0.2, 0.5, -3.1)]  # s, position, velocity: fast, where friction is dry


def test_synthetic_effects_have_the_names_of_the_library():
    named = {*FORCES, *CAMERA, *(effect for scene in SCENES.values() for effect in scene.effects)}
    assert named - START <= set(EFFECTS)


def test_sindy_names_effects_of_the_library():
    assert set(library.EFFECTS.values()) <= set(EFFECTS)


def test_validation_names_effects_of_the_library():
    assert {blind_video.LOST, *blind_video.OTHERWISE} <= set(EFFECTS)
    assert {name for hidden in search.HIDDEN for name in hidden} <= set(EFFECTS)


@pytest.mark.parametrize("name", sorted(set(FORCES) - START - {"zero-offset", "parameter-drift"}))
@pytest.mark.parametrize("motion", MOTIONS)
def test_synthetic_force_is_that_of_the_library(name, motion):
    t, position, velocity = motion
    size = 0.37
    friction = dry_friction({name: size})(t, np.array([position, velocity])) * np.sign(velocity)
    synthetic = extra_acceleration({name: size})(t, position, velocity) - friction
    usual = tuple(parameter.default for parameter in EFFECTS[name].parameters[1:])
    params = (size, *SHAPES.get(name, usual))
    fitted = EFFECTS[name].acceleration(t, position, velocity, abs(velocity), -1.0, params)
    assert synthetic != 0
    assert synthetic == pytest.approx(fitted, rel=1e-3)  # the library's friction turns over smoothly at v = 0


@pytest.mark.parametrize("name", sorted(SCENES))
def test_scene_has_the_name_of_its_phenomenon(name):
    assert SCENES[name].folder in {described.folder for described in PHENOMENA[name].classes}
