"""What every registered model promises."""

import re

import numpy as np
import pytest

from fitters.ode import fit, sensitivity, simulate
from iris_sysid.registry import MODELS
from iris_sysid.types import OdeModel, Trajectory

NOISE = 2e-3  # as a share of the size of the motion

every_model = pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))


def example(model: OdeModel):
    """Values by name and sample times of the motion that the model gives as its example."""
    assert model.example is not None, f"{model.name} has no example; give OdeModel(example=ModelExample(...))"
    return dict(model.example.values), model.example.t_s


def clip(model: OdeModel, noise: float = 0.0, seed: int = 0) -> Trajectory:
    values, t_s = example(model)
    inputs = model.example.driven(t_s)
    observed = simulate(model, t_s, values, inputs=inputs).observed
    size = np.std(observed, axis=0)
    observed = observed + noise * size * np.random.default_rng(seed).standard_normal(observed.shape)
    unknown, valid = np.full_like(observed, np.nan), np.ones(t_s.size, bool)
    return Trajectory(t_s, model.observed, observed, unknown, valid, model.inputs, inputs)


@every_model
def test_name_is_kebab_case(model):
    assert re.fullmatch(r"[a-z]+(-[a-z0-9]+)*", model.name)


@every_model
def test_equation_source_summary_and_symbols_are_stated(model):
    assert all([model.summary, model.equation, model.source, model.typical])
    assert all(parameter.symbol for parameter in model.parameters)


@every_model
def test_every_quantity_and_parameter_has_a_unit(model):
    for item in (*model.states, *model.observed, *model.parameters, *model.derived, *model.inputs):
        assert item.unit, item


@every_model
def test_constants_say_where_they_come_from(model):
    assert all(parameter.source for parameter in model.parameters if parameter.constant)


@every_model
def test_defaults_lie_inside_the_bounds(model):
    for parameter in model.parameters:
        assert parameter.lower < parameter.upper
        if parameter.default is not None:
            assert parameter.lower <= parameter.default <= parameter.upper


@every_model
@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_guess_lies_inside_the_bounds_and_names_what_there_is(model, noise):
    guess = model.guess(clip(model, noise))
    names = {parameter.name: parameter for parameter in model.parameters}
    states = {f"{state.name}_0" for state in model.states}
    assert set(guess) <= set(names) | states
    for name in set(guess) & set(names):
        assert names[name].lower < guess[name] < names[name].upper


@every_model
def test_fit_recovers_the_truth_of_exact_data(model):
    values, _ = example(model)
    result = fit(clip(model), model)
    assert result.status == "ok", result.message
    for name, value in values.items():
        assert result.estimates[name].value == pytest.approx(value, rel=1e-4, abs=1e-5), name


@every_model
def test_fit_recovers_the_truth_of_noisy_data_within_its_errors(model):
    values, _ = example(model)
    result = fit(clip(model, NOISE, seed=3), model)
    assert result.status == "ok", result.message
    for name, value in values.items():
        if name in result.free:
            assert abs(result.estimates[name].value - value) < 4 * result.estimates[name].stderr, name


@every_model
def test_right_hand_side_is_the_derivative_of_the_solution(model):
    values, t_s = example(model)
    fine = t_s[len(t_s) // 2] + 1e-3 * np.arange(-1, 2)
    times = np.concatenate([t_s[t_s < fine[0]], fine])
    inputs = model.example.driven(times)
    states = simulate(model, times, values, inputs=inputs).states[-3:]
    given_inputs = () if inputs is None else (tuple(inputs[-2]),)
    given = {p.name: p.default for p in model.parameters} | values
    params = tuple(np.nan if given[p.name] is None else given[p.name] for p in model.parameters)
    modes = ((0.0,), (1.0,), (2.0,)) if model.events else ((),)
    differences = (states[2] - states[0]) / 2e-3
    slopes = [np.array(model.rhs(fine[1], (*states[1], *mode), params, *given_inputs)) for mode in modes]
    nearest = min(slopes, key=lambda slope: np.abs(slope - differences).max())
    np.testing.assert_allclose(nearest, differences, rtol=1e-4, atol=1e-4 * np.abs(nearest).max())


@every_model
def test_first_integral_is_conserved_without_dissipation(model):
    if model.first_integral is None:
        pytest.skip("the model states no first integral")
    values, t_s = example(model)
    values = {**values, **dict.fromkeys(model.dissipative, 0.0)}
    states = simulate(model, t_s, values, tolerance=1e-11).states
    given = {p.name: p.default for p in model.parameters} | values
    params = np.array([np.nan if given[p.name] is None else given[p.name] for p in model.parameters])
    integral = model.first_integral(states, params)
    assert integral.shape == t_s.shape
    moving = np.ptp(states, axis=0).max() ** 2
    varies = "first_integral varies; a parameter that takes energy belongs in the model's dissipative"
    assert np.ptp(integral) < 1e-8 * max(np.abs(integral).max(), moving), varies


@every_model
def test_dissipative_parameters_exist(model):
    assert {model.parameter(name).name for name in model.dissipative} == set(model.dissipative)


@every_model
def test_every_free_parameter_moves_the_prediction(model):
    values, t_s = example(model)
    names = [parameter.name for parameter in model.parameters if not parameter.constant]
    slopes = sensitivity(model, t_s, values, names, inputs=model.example.driven(t_s))
    assert np.all(np.max(np.abs(slopes), axis=(0, 1)) > 0)


@every_model
def test_derived_quantities_are_given_with_errors(model):
    result = fit(clip(model, NOISE), model)
    assert set(result.estimates) >= {quantity.name for quantity in model.derived}
    for quantity in model.derived:
        assert result.estimates[quantity.name].measurement_type == "derived"
        assert result.estimates[quantity.name].unit == quantity.unit
