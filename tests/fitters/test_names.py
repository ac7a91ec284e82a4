"""A name stands for a registered item wherever an item is taken; a wrong one is refused with the right one."""

import numpy as np
import pytest

from iris_sysid import (
    EFFECTS,
    MODELS,
    DataError,
    Quantity,
    Trajectory,
    UnknownNameError,
    diagnose,
    fit,
    fit_clips,
    select_model,
    simulate,
    with_effects,
)
from tests._motions import pendulum_angle

T_S = np.arange(240) / 60
ANGLE = (Quantity("theta", "rad"),)
VALUES = {"length": 1.0, "damping": 0.1, "theta_0": 0.5, "omega_0": 0.0}


def swing(seed=0):
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(T_S.size)
    theta = (pendulum_angle(T_S, 0.6) + noise)[:, None]
    return Trajectory(T_S, ANGLE, theta, np.full_like(theta, np.nan), np.ones(T_S.size, dtype=bool))


def test_name_of_a_model_gives_what_the_model_gives():
    clip = swing()
    by_name, by_object = (repr(fit(clip, model).estimates) for model in ("pendulum", MODELS["pendulum"]))
    assert by_name == by_object


def test_names_in_diagnosis_of_model_and_effects():
    found = diagnose(swing(), "pendulum", effects=["quadratic-drag", EFFECTS["coulomb-friction"]])
    assert {limit.effect for limit in found.ruled_out} == {"quadratic-drag", "coulomb-friction"}


def test_names_in_fit_of_several_clips_and_in_simulation():
    pooled = fit_clips([swing(0), swing(1)], "pendulum", shared=["length"])
    assert pooled.shared["length"].value == pytest.approx(1.0, abs=0.01)
    by_name, by_object = (simulate(model, T_S, VALUES).observed for model in ("pendulum", MODELS["pendulum"]))
    np.testing.assert_array_equal(by_name, by_object)


def test_one_effect_may_be_given_without_a_list():
    assert with_effects("pendulum", "quadratic-drag").name == "pendulum + quadratic-drag"


def test_list_of_names_is_a_bank():
    ranking = select_model(swing(), ["pendulum", MODELS["angular-oscillator"]]).ranking
    assert {candidate.model for candidate in ranking} == {"pendulum", "angular-oscillator"}


@pytest.mark.parametrize(
    "call",
    [
        lambda: fit(swing(), "pendulun"),
        lambda: diagnose(swing(), "pendulun"),
        lambda: simulate("pendulun", T_S, VALUES),
        lambda: select_model(swing(), ["pendulun"]),
        lambda: with_effects("pendulun", []),
    ],
)
def test_wrong_name_is_refused_with_the_right_one(call):
    with pytest.raises(UnknownNameError, match="did you mean 'pendulum'"):
        call()


def test_what_is_neither_name_nor_item_is_refused():
    with pytest.raises(
        DataError, match="of type Effect is no model; give the name of one, or an object of type OdeModel"
    ):
        fit(swing(), EFFECTS["quadratic-drag"])
    with pytest.raises(DataError, match="is no effect"):
        diagnose(swing(), "pendulum", effects=[MODELS["pendulum"]])


def test_registry_shows_its_names_in_three_lines():
    shown = repr(EFFECTS)
    assert "linear-drag" in shown
    assert len(shown.splitlines()) <= 3
