"""Clips of other sizes: what acts at one level acts there in all, and a clip that does not reach it says nothing."""

import warnings

import numpy as np
import pytest

from fitters.ode import FitRequest
from iris_sysid import EFFECTS, Quantity, Trajectory, diagnose, fit, model_from_equation
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.diagnosis.score_test import common_size
from iris_sysid.diagnosis.screening import Screening
from tests._held_inputs import held_record, states_under

LEVEL_V = 4.0
MOTOR = model_from_equation("w' = -k*w + b*u")


def driven(largest_v: float, seed: int) -> Trajectory:
    """A motor under held voltages up to a size, cut at the level, integrated by SciPy from jump to jump."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(-largest_v, largest_v, 20), 30)
    cut = lambda w, u: 12.0 * np.clip(u, -LEVEL_V, LEVEL_V) - 2.0 * w  # noqa: E731
    speed = states_under(cut, [0.0], voltage, 30, 0.02, method="DOP853", rtol=1e-10)[:, 0]
    seen = speed + 0.1 * rng.standard_normal(voltage.size)
    return held_record(Quantity("w", "rad/s"), seen, Quantity("u", "V"), voltage, 0.02)


def test_level_of_an_input_is_one_in_all_clips_and_a_small_clip_does_not_contradict_it():
    clips = [driven(2.0, 1), driven(5.0, 2), driven(8.0, 3)]
    requests = [FitRequest(clip, MOTOR) for clip in clips]
    base = ModelWithEffects.without_effects(requests, [fit(clip, MOTOR) for clip in clips])
    starts = Screening.of([EFFECTS["input-saturation"]], base, requests).single("input-saturation").starts
    sizes, shapes = zip(*(start["input-saturation"] for start in starts), strict=True)
    assert len(set(shapes)) == 1
    assert shapes[0][0] == pytest.approx(LEVEL_V, rel=0.15)
    assert sizes[0] == pytest.approx(1.0, abs=0.5)


def test_clip_in_which_the_effect_does_not_act_leaves_no_doubt():
    found = diagnose([driven(2.0, 1), driven(8.0, 3)], MOTOR, effects=("input-saturation",))
    assert [(finding.word, finding.effects) for finding in found.findings] == [("named", ("input-saturation",))]
    assert found.verdict.good, found.verdict.text
    level = found.sizes["saturation_level"]
    assert abs(level.value - LEVEL_V) < 4 * level.stderr


def test_size_that_is_far_beyond_all_others_is_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert common_size([(0.1, 0.01), (1e200, 0.02)])[1] == np.inf
