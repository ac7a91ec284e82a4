"""A failed diagnosis states which part failed and why, and keeps the base fit."""

import re
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import EFFECTS, MODELS, Estimate, OdeModel, Parameter, Quantity, Trajectory, diagnose
from iris_sysid.errors import FitError

T_S = np.arange(120) / 60
NOISE_M = 1e-3
WAY = Quantity("s", "m", "s")


def clip(values, quantity=WAY, t_s=T_S) -> Trajectory:
    position = np.asarray(values, dtype=float)[:, None]
    return Trajectory(t_s, (quantity,), position, np.full_like(position, np.nan), np.ones(len(t_s), bool))


def coasting_way() -> Trajectory:
    noise = NOISE_M * np.random.default_rng(0).standard_normal(T_S.size)
    return clip(1.5 * (1 - np.exp(-0.8 * T_S)) / 0.8 + noise)


def coast(t, state, params):
    return state[1], -params[0] * state[1]


def mine(rhs=coast, **more) -> OdeModel:
    plain = OdeModel(
        name="mine",
        summary="a body that coasts",
        equation="",
        source="",
        states=(WAY, Quantity("v", "m/s", "v")),
        parameters=(Parameter("drag", "1/s", "b", lower=0.0),),
        observed=(WAY,),
        rhs=rhs,
        guess=lambda trajectory: {"drag": 0.5, "s_0": 0.0, "v_0": 1.0},
    )
    return replace(plain, **more)


def raises(*arguments):
    raise KeyError("mass")


def is_nan(t, state, params):
    return state[1], np.nan * state[0]


def is_nan_later(t, state, params):
    return state[1], -params[0] * np.sqrt(0.3 - state[0])


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (mine(raises), r"rhs of model 'mine' raises KeyError: 'mass'; it is called as rhs\(t, state, params\)"),
        (
            mine(lambda t, state, params: (state[1],)),
            r"rhs of model 'mine' must return a tuple .*\(s, v\), not 1 values",
        ),
        (mine(is_nan), r"rhs of model 'mine' gives no finite rate of v at the start \(drag = 0.5"),
        (
            mine(is_nan_later),
            r"the base model cannot be diagnosed, its fit failed \(diverged\): the solution diverges",
        ),
        (mine(observe=lambda t_s, states, params: states[:, 0]), r"observe .* must return an array \(120, 1\), not"),
        (mine(observe=raises), r"observe of model 'mine' raises KeyError: 'mass'; it is called as observe\(t_s"),
        (mine(guess=raises), r"guess of model 'mine' raises KeyError: 'mass'; give a start for drag"),
        (mine(observed=(Quantity("s", "rad"),)), "model 'mine' needs s in rad, but it is in m"),
    ],
)
def test_own_model_that_fails_is_named_with_what_fails_and_why(model, message):
    with pytest.raises(FitError, match=message):
        diagnose(coasting_way(), model)


def test_too_few_samples_are_counted():
    with pytest.raises(FitError, match=r"too-short.: only 4 usable samples for 3 unknowns"):
        diagnose(clip([0.0, 0.1, 0.2, 0.3], t_s=T_S[:4]), mine())


def test_few_samples_that_suffice_are_diagnosed():
    few = slice(0, 42, 6)
    diagnosis = diagnose(
        clip(coasting_way().position[few, 0], t_s=T_S[few]), mine(), effects=[EFFECTS["periodic-forcing"]]
    )
    assert diagnosis.added == ()


def test_noise_larger_than_the_motion_is_reported():
    trembling = clip(0.02 * np.random.default_rng(0).standard_normal(T_S.size), Quantity("theta", "rad"))
    diagnosis = diagnose(trembling, MODELS["linear-pendulum"], effects=[EFFECTS["zero-offset"]])
    assert diagnosis.base.usable
    (note,) = [note.text for note in diagnosis.notes if note.kind == "noise"]
    assert re.match(r"the noise of theta \(0\.0\d+ rad\) exceeds its motion \(0\.00\d+ rad\)", note)


def test_clip_of_something_that_stands_still_exactly_is_not_an_error():
    diagnosis = diagnose(clip(np.full(T_S.size, 0.3)), MODELS["incline"], effects=[EFFECTS["constant-force"]])
    assert diagnosis.added == ()


def test_effects_that_the_parameters_imitate_are_named():
    effects = [EFFECTS["linear-drag"]]
    diagnosis = diagnose(coasting_way(), mine(parameters=(Parameter("drag", "1/s", "b"),)), effects=effects)
    assert diagnosis.base.ok
    assert diagnosis.added == ()
    (note,) = diagnosis.notes
    assert note.kind == "no-effect"
    assert "(linear-drag)" in note.text


def test_model_that_no_effect_applies_to_keeps_its_fit():
    diagnosis = diagnose(coasting_way(), mine(), effects=[EFFECTS["overflow"]])
    assert diagnosis.base.ok
    assert [note.text for note in diagnosis.notes] == ["no effect of the library applies to this model"]


def test_refit_that_diverges_is_named_and_the_base_fit_stays():
    away = replace(
        EFFECTS["constant-force"],
        name="runaway",
        acceleration=lambda t, x, v, speed, base, params: 1.0 if params[0] == 1.0 else np.nan,  # the screen's own size
    )
    pushed = clip(coasting_way().position[:, 0] + 0.3 * T_S**2)
    diagnosis = diagnose(pushed, mine(), fixed={"drag": 0.8}, effects=[away])
    assert diagnosis.base.usable
    assert diagnosis.added == ()
    (note,) = [note for note in diagnosis.notes if note.kind == "refit-failed"]
    assert note.text.startswith("the refit with runaway failed (diverged): ")


def test_clip_in_pixels_is_diagnosed_in_pixels():
    way_px = clip(500 * coasting_way().position[:, 0], Quantity("s", "px"))
    diagnosis = diagnose(way_px, mine(), effects=[EFFECTS["constant-force"]])
    assert diagnosis.unit == "px"
    assert diagnosis.noise_floor == pytest.approx(500 * NOISE_M, rel=0.35)
    assert diagnosis.rounds[0][0].unit == "px/s^2"


def test_angle_of_a_board_does_not_keep_a_slide_from_being_diagnosed():
    noise = NOISE_M * np.random.default_rng(1).standard_normal(T_S.size)
    angle = Estimate(0.384, 0.001, "rad", "fitted", "direction of the motion")
    slide = clip(0.1 * T_S + 0.4 * T_S**2 + noise).with_(geometry={"angle": angle})
    diagnosis = diagnose(slide, MODELS["incline"], effects=[EFFECTS["zero-offset"]])
    assert diagnosis.base.estimates["acceleration"].value == pytest.approx(0.8, rel=0.01)
    assert diagnosis.base.estimates["friction"].stderr > 0
