"""Notes state the noise of steps and noise that depends on the level, with their size, and gaps of the input."""

import re

import numpy as np
import pytest

from fitters.ode import simulate
from iris_sysid import diagnose
from iris_sysid.diagnosis.noise_notes import FALSE_ALARM, noise_by_level
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

T_S = np.arange(800) / 100
VALUES = {"mass": 0.5, "damping": 0.6, "stiffness": 20.0, "z_0": 0.1, "vz_0": 0.0}
MODEL = MODELS["driven-oscillator"]
FORCE = MODEL.example.inputs(T_S)
PLACE = simulate(MODEL, T_S, VALUES, inputs=FORCE).observed
SPREAD, NOISE = float(np.std(PLACE)), 5e-3
STEP = 0.05 * SPREAD


def even(rng):
    return PLACE + NOISE * SPREAD * rng.standard_normal(PLACE.shape)


def louder(rng):
    """Noise that is three times as large at one spread from zero as at zero."""
    return PLACE + NOISE * SPREAD * np.sqrt(1.0 + 8.0 * (PLACE / SPREAD) ** 2) * rng.standard_normal(PLACE.shape)


def stepped(rng):
    return STEP * np.round(even(rng) / STEP)


def notes(read, seed):
    seen = read(np.random.default_rng(seed))
    clip = Trajectory(T_S, MODEL.observed, seen, np.full_like(seen, np.nan), np.ones(800, bool), MODEL.inputs, FORCE)
    found = diagnose(clip, MODEL)
    assert not found.added
    return {note.kind: note.text for note in found.notes}


def test_note_says_how_long_the_input_is_not_known():
    kept = np.r_[0:300, 330:800]
    seen = even(np.random.default_rng(0))[kept]
    unknown, valid = np.full_like(seen, np.nan), np.ones(kept.size, bool)
    clip = Trajectory(T_S[kept], MODEL.observed, seen, unknown, valid, MODEL.inputs, FORCE[kept])
    found = {note.kind: note.text for note in diagnose(clip, MODEL, effects=["quadratic-drag"]).notes}
    assert "in a gap of 0.31 s and taken on a line there" in found["input-gap"]


@pytest.mark.parametrize("seed", range(3))
def test_note_on_steps_states_their_error_and_no_force_is_missing(seed):
    text = notes(stepped, seed)["quantisation"]
    step, error = map(float, re.search(r"steps of (\S+) m, which err by (\S+) m", text).groups())
    assert step == pytest.approx(STEP, rel=0.01)
    assert error == pytest.approx(STEP / np.sqrt(12), rel=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_note_on_noise_that_grows_with_the_level_states_both_ends(seed):
    text = notes(louder, seed)["level-noise"]
    quiet, where, loud, far = map(float, re.search(r": (\S+) m at (\S+), (\S+) m at (\S+);", text).groups())
    assert abs(where) < SPREAD < abs(far)
    for noise, place in ((quiet, where), (loud, far)):
        truth = NOISE * SPREAD * np.sqrt(1.0 + 8.0 * (place / SPREAD) ** 2)
        assert noise == pytest.approx(truth, rel=0.5)


@pytest.mark.parametrize("seed", range(3))
def test_even_noise_has_no_note(seed):
    assert not {"quantisation", "level-noise"} & notes(even, seed).keys()


@pytest.mark.parametrize("draw", ["standard_normal", "laplace"])
def test_false_alarms_are_as_rare_as_stated(draw):
    rng, level = np.random.default_rng(0), PLACE[:, 0]
    alarms = sum(noise_by_level(level, getattr(rng, draw)(size=level.size), 0.0) is not None for _ in range(3000))
    assert alarms <= 3000 * FALSE_ALARM + 3
