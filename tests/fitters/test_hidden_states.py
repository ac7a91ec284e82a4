"""Effects with hidden states against SciPy's own integration: sizes come out, and a diagnosis names them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.compose_effects import with_effects
from fitters.effect_sensitivity import sensitivity, shaped
from fitters.ode import fit, simulate
from iris_sysid import diagnose
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory

STEP_S, HELD, SAMPLES, NOISE = 0.01, 10, 1000, 2e-3  # of the standard deviation of the motion
PLANT = {"mass": 0.5, "damping": 0.6, "stiffness": 20.0}
HIDDEN = ("presliding", "hysteresis", "hidden-mode")
DRY = 0.3  # m/s^2


def own(position, velocity, force):
    return (force - PLANT["damping"] * velocity - PLANT["stiffness"] * position) / PLANT["mass"]


def plain(t, state, force):
    return state[1], own(*state, force)


def dry(t, state, force):
    return state[1], own(*state, force) - DRY * np.tanh(state[1] / 1e-3)


def dahl(t, state, force):
    """Dahl's own form, a stiffness times (1 - sgn(v) F / Fc): the force itself is the state."""
    position, velocity, friction = state
    slope = DRY / 0.01 * (1.0 - np.sign(velocity) * friction / DRY)
    return velocity, own(position, velocity, force) - friction, slope * velocity


def bouc_wen(t, state, force):
    """With A, beta and gamma, as Wen writes it."""
    position, velocity, z = state
    a, beta, gamma = 1.0, 40.0, 40.0
    slope = a * velocity - beta * abs(velocity) * z - gamma * velocity * abs(z)
    return velocity, own(position, velocity, force) - 20.0 * z, slope


def two_masses(t, state, force):
    """The places of both masses; 30 % of the mass is the hidden one."""
    position, velocity, hidden, slip = state
    heavy, light = 0.7 * PLANT["mass"], 0.3 * PLANT["mass"]
    spring = light * (25.0**2 * (position - hidden) + 2 * 0.05 * 25.0 * (velocity - slip))
    return velocity, (own(position, velocity, force) * PLANT["mass"] - spring) / heavy, slip, spring / light


@dataclass(frozen=True)
class Case:
    effect: str
    slopes: Callable
    states: int
    truth: dict
    shape: tuple[float, ...] = ()


CASES = [
    Case("presliding", dahl, 3, {"presliding": DRY, "presliding_distance": 0.01}, (0.01, 0.1)),
    Case("hysteresis", bouc_wen, 3, {"hysteresis": 20.0, "yield_way": 1 / 80}, (1 / 80, 0.5, 0.1)),
    Case(
        "hidden-mode", two_masses, 4,
        {"hidden_share": 0.3, "hidden_rate": 25.0, "hidden_loss": 0.05}, (25.0, 0.05, 6.0),
    ),
]  # fmt: skip
each = pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect)


def record(slopes, states, seed=0, noise=NOISE):
    """What a sensor reads of the plant under a force that is held for HELD samples."""
    rng = np.random.default_rng(seed)
    forces = rng.uniform(-1, 1, SAMPLES // HELD)
    state, seen, times = np.zeros(states), [], np.arange(HELD + 1) * STEP_S
    for force in forces:
        solved = solve_ivp(slopes, (0.0, times[-1]), state, "LSODA", times, args=(force,), rtol=1e-8, atol=1e-10).y
        seen.append(solved[0, :-1])
        state = solved[:, -1]
    position = np.concatenate(seen)[:, None]
    position = position + noise * np.std(position) * rng.standard_normal(position.shape)
    model, unknown = MODELS["driven-oscillator"], np.full_like(position, np.nan)
    inputs, more = np.repeat(forces, HELD)[:, None], {"hold": "zero-order", "sensor": "encoder"}
    t_s, valid = STEP_S * np.arange(SAMPLES), np.ones(SAMPLES, bool)
    return Trajectory(t_s, model.observed, position, unknown, valid, model.inputs, inputs, **more)


@each
def test_simulation_with_the_effect_is_the_physics(case):
    clip = record(case.slopes, case.states, noise=0.0)
    model = with_effects("driven-oscillator", [case.effect])
    values = {**PLANT, **case.truth, "z_0": 0.0, "vz_0": 0.0}
    seen = simulate(model, clip.t_s, values, inputs=clip.inputs, hold=clip.hold).observed
    np.testing.assert_allclose(seen, clip.position, atol=3e-5 * np.std(clip.position))


@each
def test_fit_finds_the_size_and_the_form(case):
    clip = record(case.slopes, case.states)
    model = with_effects("driven-oscillator", [case.effect])
    start = {**PLANT, **{name: 1.3 * value for name, value in case.truth.items()}, "z_0": 0.0, "vz_0": 0.0}
    result = fit(clip, model, start=start)
    assert result.status == "ok", result.message
    assert not {f"{state.name}_0" for state in EFFECTS[case.effect].hidden} & {*result.free}
    for name, value in {**PLANT, **case.truth}.items():
        found = result.estimates[name]
        assert abs(found.value - value) < 4 * found.stderr < 0.2 * value, name


@each
def test_first_order_sensitivity_is_that_of_the_fitted_prediction(case):
    clip = record(plain, 2)
    fitted = fit(clip, "driven-oscillator")
    effect = shaped(EFFECTS[case.effect], case.shape)
    name, values = effect.parameters[0].name, {key: each.value for key, each in fitted.estimates.items()}
    step = 1e-3 * case.truth[name]
    composed = with_effects("driven-oscillator", [effect])
    above, below = (
        simulate(composed, clip.t_s, {**values, name: size}, inputs=clip.inputs, hold=clip.hold).observed
        for size in (step, -step)
    )
    slope = (above - below) / (2 * step)
    np.testing.assert_allclose(sensitivity(effect, fitted, clip), slope, atol=0.03 * np.max(np.abs(slope)))


@each
def test_diagnosis_names_it_alone(case):
    found = diagnose(record(case.slopes, case.states), "driven-oscillator")
    assert [effect.name for effect in found.added] == [case.effect]
    for name, value in case.truth.items():
        assert found.final.estimates[name].value == pytest.approx(value, rel=0.03), name
    low, high = found.sizes[EFFECTS[case.effect].parameters[0].name].interval
    assert 0 < low < high


@pytest.mark.parametrize(("slopes", "named"), [(plain, set()), (dry, {"coulomb-friction"})], ids=["plain", "dry"])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_diagnosis_names_none_where_there_is_none(slopes, named, seed):
    assert {effect.name for effect in diagnose(record(slopes, 2, seed), "driven-oscillator").added} == named


def test_effects_after_one_with_a_memory_act_as_before_it():
    model = with_effects("driven-oscillator", ["hidden-mode", "presliding", "quadratic-drag"])
    assert [state.name for state in model.states[2:]] == ["hidden_way", "hidden_slip", "presliding_state"]
    assert (model.second_order, model.degrees_of_freedom, model.hidden) == (True, 1, 3)
    state, params = (0.1, 0.2, 0.03, 0.4, 0.5), (2.0, 0.0, 0.0, 1.0, 0.25, 3.0, 0.1, 2.0, 0.7, 0.5, 1.0, 1.5)
    given = dict(zip([parameter.name for parameter in model.parameters], params, strict=False))
    drag = {parameter.name: parameter.default for parameter in EFFECTS["quadratic-drag"].parameters[1:]}
    rates = model.rhs(0.0, state, (*params, *drag.values()), (4.0,))
    base = 4.0 / 2.0
    slower = 9.0 * 0.03 + 2 * 0.1 * 3.0 * 0.4
    moved = base + given["hidden_share"] * (base + slower) / 0.75
    expected = (0.2, moved - 0.7 * 0.5 - 1.5 * 0.2**2, 0.4, -(base + slower) / 0.75, (0.2 - 0.2 * 0.5) / 0.5)
    np.testing.assert_allclose(rates, expected, rtol=1e-12)


@pytest.mark.parametrize("name", HIDDEN)
def test_a_memory_is_for_one_driven_coordinate_that_does_not_fall(name):
    applies = {model for model in MODELS if EFFECTS[name].applies(MODELS[model])}
    assert applies == {"driven-cart", "driven-oscillator", "driven-pendulum", "rlc-circuit"}
    with pytest.raises(FitError, match="does not apply to the model"):
        with_effects("coupled-oscillators", [name])
