"""The hold-out is sealed: motions integrated by SciPy, and what happens in the samples held out is changed."""

from types import MappingProxyType

import numpy as np
import pytest

from fitters.ode import FitRequest, fit
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.prediction_error import held_out
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.diagnosis.training import Training
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Array, Trajectory
from validation.independent.motions import MOTIONS, integrate

SWING = MOTIONS["pendulum"]
VALUES = MappingProxyType({"length": 0.5, "damping": 0.05, "x0": 0.8, "v0": 0.1})
T_S = np.arange(360) / 60
NOISE = 5e-4
FEW = [EFFECTS[name] for name in ("quadratic-drag", "constant-force", "impact")]


def table(theta: Array, seed: int = 0) -> Trajectory:
    seen = theta + NOISE * np.random.default_rng(seed).standard_normal(theta.shape)
    unknown, valid = np.full_like(seen, np.nan), np.ones(T_S.size, dtype=bool)
    return Trajectory(T_S, MODELS["pendulum"].observed, seen, unknown, valid, sensor="encoder")


def dragged(t: float, x: Array, v: Array, base: Array) -> Array:
    return -0.3 * np.abs(v) * v


def trained_on(clip: Trajectory, base: ModelWithEffects) -> Training:
    requests = [FitRequest(clip, MODELS["pendulum"])]
    library = EffectLibrary(FEW, MODELS["pendulum"], [clip])
    found = Training.of(requests, MODELS["pendulum"], library, base, 0.3, lambda text: None)
    assert found is not None
    return found


def test_search_does_not_see_a_sample_that_is_held_out():
    clip = table(integrate(SWING, VALUES, T_S, dragged)[:, :1])
    base = ModelWithEffects.without_effects([FitRequest(clip, MODELS["pendulum"])], [fit(clip, MODELS["pendulum"])])
    first = trained_on(clip, base)
    changed = clip.position.copy()
    changed[first.left_out[0]] += 0.1 * np.random.default_rng(1).standard_normal((first.left_out[0].size, 1))
    second = trained_on(clip.with_(position=changed), base)
    assert first.final.names == second.final.names == {"quadratic-drag"}
    values = [found.final.fits[0].estimates["quadratic_drag"].value for found in (first, second)]
    assert values[0] == values[1]
    assert second.errors_after[0] > 10 * first.errors_after[0]  # but the error is over these samples


def test_error_before_and_after_is_over_the_same_samples_at_the_noise():
    diagnosis = diagnose(table(integrate(SWING, VALUES, T_S, dragged)[:, :1]), MODELS["pendulum"], effects=FEW)
    assert [effect.name for effect in diagnosis.added] == ["quadratic-drag"]
    assert diagnosis.after.heldout == pytest.approx(NOISE, rel=0.25)  # 108 samples tell it to 7 %
    assert diagnosis.before.heldout > 3 * NOISE
    assert diagnosis.after.weighed == pytest.approx(1.0, rel=0.25)


def test_what_acts_after_the_last_sample_seen_is_said_to_be_untested():
    kicked = integrate(SWING, VALUES, T_S, kicks={5.8: np.array([0.3])})[:, :1]
    diagnosis = diagnose(table(kicked), MODELS["pendulum"], effects=FEW)
    assert [effect.name for effect in diagnosis.added] == ["impact"]
    (note,) = [note for note in diagnosis.notes if note.kind == "late"]
    assert "impact" in note.text
    assert diagnosis.after.heldout == diagnosis.before.heldout > NOISE


def test_held_out_samples_are_the_end_of_each_part_and_leave_enough():
    base = fit(table(integrate(SWING, VALUES, T_S)[:, :1]), MODELS["pendulum"])
    assert np.array_equal(held_out(base, 0.3, 3), np.concatenate([np.arange(84, 120) + 120 * k for k in range(3)]))
    assert held_out(base, 0.99, 3) is None
