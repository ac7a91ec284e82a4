"""What every effect must do: nothing at size zero, something at another, with its units and its source stated."""

from dataclasses import replace

import numpy as np
import pytest

from fitters.compose_effects import with_effect, with_effects
from fitters.ode import simulate
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Quantity
from validation.gallery import example_model

TESTED_ON = (
    "pendulum",
    "linear-oscillator",
    "projectile",
    "incline",
    "torricelli",
    "driven-pendulum",
)  # besides its own example
VOLTS = (Quantity("h", "V", "h"),)
TANK = replace(MODELS["torricelli"], name="tank-in-volts", states=VOLTS, observed=VOLTS)  # as a user's own would be


PAIRS = [
    (effect, model)
    for effect in EFFECTS.values()
    for model in {model.name: model for model in (*map(MODELS.get, TESTED_ON), example_model(effect))}.values()
    if effect.applies(model)
]


def names(item) -> str:
    return getattr(item, "name", str(item))


def motion(model, **more):
    values = {**model.example.values, **more}
    t_s = model.example.t_s[:90]
    return simulate(model, t_s, values, inputs=model.example.driven(t_s), tolerance=1e-13).observed


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=names)
def test_effect_acts_by_exactly_one_map_and_states_its_unit_and_source(effect):
    maps = [effect.acceleration, effect.observe, effect.image, effect.warp, effect.drive]
    assert sum(mapping is not None for mapping in maps) == 1
    assert effect.parameters[0].default == 0.0
    assert all(parameter.unit for parameter in effect.parameters)
    assert effect.source
    assert effect.equation
    assert effect.typical


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=names)
def test_effect_applies_to_the_model_of_its_example(effect):
    assert effect.applies(example_model(effect))


@pytest.mark.parametrize(("effect", "model"), PAIRS, ids=names)
def test_effect_of_size_zero_changes_nothing(effect, model):
    np.testing.assert_allclose(motion(with_effect(model, effect)), motion(model), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("effect", "model"), PAIRS, ids=names)
def test_effect_of_some_size_changes_what_is_seen(effect, model):
    changed = motion(with_effect(model, effect), **{effect.parameters[0].name: effect.example.size})
    assert np.max(np.abs(changed - motion(model))) > 1e-6


def test_effects_combine_and_keep_the_order_of_their_parameters():
    model = with_effects(MODELS["pendulum"], [EFFECTS["quadratic-drag"], EFFECTS["zero-offset"]])
    names_of = [parameter.name for parameter in model.parameters]
    assert names_of.index("quadratic_drag") == len(MODELS["pendulum"].parameters)
    assert names_of[-1] == "zero_offset"
    assert model.parameter("quadratic_drag").unit == "1/rad"
    assert np.ptp(motion(model, quadratic_drag=0.1, zero_offset=0.2) - motion(model, quadratic_drag=0.1)) < 1e-12


def test_quadratic_drag_matches_the_closed_form_of_a_coasting_body():
    model = with_effect(MODELS["incline"], EFFECTS["quadratic-drag"])
    t_s = np.linspace(0.0, 3.0, 40)
    values = {"acceleration": 0.0, "s_0": 0.0, "v_0": 2.0, "quadratic_drag": 0.7}
    way = np.log1p(0.7 * 2.0 * t_s) / 0.7  # s = ln(1 + c v0 t) / c
    np.testing.assert_allclose(simulate(model, t_s, values).observed[:, 0], way, rtol=1e-7, atol=1e-9)


def test_gain_of_a_sensor_changes_above_its_level_only():
    model = with_effect(TANK, EFFECTS["gain-change"])
    plain, seen = motion(TANK), motion(model, gain_change=0.5, gain_level=0.23)
    assert plain.min() < 0.23 < plain.max()
    np.testing.assert_allclose(seen, plain + 0.5 * np.maximum(plain - 0.23, 0.0), atol=1e-12)


def test_each_tank_of_two_may_run_over():
    def draining(t, state, params, inputs=()):
        return -params[0] * np.sqrt(state[0]), params[0] * (np.sqrt(state[0]) - np.sqrt(state[1]))

    pair = replace(
        TANK,
        name="two-tanks",
        states=(Quantity("upper", "V"), Quantity("lower", "V")),
        observed=(Quantity("lower", "V"),),
        rhs=draining,
        observe=None,
    )
    values = {"outflow": 0.1, "upper_0": 2.0, "lower_0": 2.0, "overflow": 3.0, "rim": 1.5}
    states = simulate(with_effect(pair, EFFECTS["overflow"]), np.linspace(0.0, 3.0, 50), values).states
    assert np.all(states[-1] < 1.52)


def test_drag_of_a_throw_acts_along_the_speed_of_the_body():
    model = with_effect(MODELS["projectile"], EFFECTS["quadratic-drag"])
    t_s = np.array([0.0, 1e-4])
    values = {"gravity": 1e-3, "x_0": 0.0, "z_0": 0.0, "vx_0": 3.0, "vz_0": 4.0, "quadratic_drag": 0.1}
    states = simulate(model, t_s, values).states
    slowing = (states[1, 2:] - states[0, 2:]) / 1e-4
    np.testing.assert_allclose(slowing, [-0.1 * 5 * 3, -0.1 * 5 * 4], rtol=1e-3)


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (["quadratic-drag", "quadratic-drag"], "already has quadratic_drag"),
        (["linear-drag"], "'linear-drag' does not apply to the model 'pendulum'; these do: .*quadratic-drag"),
    ],
)
def test_effect_that_cannot_be_added_is_refused(effects, message):
    with pytest.raises(FitError, match=message):
        with_effects(MODELS["pendulum"], [EFFECTS[name] for name in effects])


@pytest.mark.parametrize("name", ["impact", "late-release"])
def test_moment_must_lie_within_the_clip(name):
    within, before, after = ([0.5, moment, 0.02] for moment in (1.0, -0.1, 5.1))
    assert EFFECTS[name].is_meant(np.linspace(0.0, 5.0, 9), within)
    assert not EFFECTS[name].is_meant(np.linspace(0.0, 5.0, 9), before)
    assert not EFFECTS[name].is_meant(np.linspace(0.0, 5.0, 9), after)
