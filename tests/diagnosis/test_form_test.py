"""Whether the form of an effect is worth a fit, against fits that free it; motions integrated by SciPy."""

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import FitRequest
from iris_sysid.diagnosis.form_test import WORTH_FITTING, _chi2, is_form_open
from iris_sysid.diagnosis.refit import ModelWithEffects, fit_from, forms, free_values, with_free_form
from iris_sysid.registry import EFFECTS
from tests.diagnosis.test_hold_out import DRAG, NOISE, PENDULUM, SWING, T_S, VALUES, dragged, table
from validation.independent.motions import integrate


def fitted(theta, effect, seed=0):
    clip = FitRequest(table(theta, seed), PENDULUM)
    fit = fit_from(clip, with_effects(PENDULUM, [effect]), {})
    return clip, ModelWithEffects((fit,), (np.full((T_S.size, 1), NOISE),), (effect,))


@pytest.mark.parametrize(("power", "is_open"), [(1.8, True), (2.0, False)])
def test_drag_of_another_power_is_worth_a_fit(power, is_open):
    theta = integrate(SWING, VALUES, T_S, lambda t, x, v, base: -0.4 * np.abs(v) ** (power - 1) * v)[:, :1]
    clip, model = fitted(theta, DRAG)
    assert is_form_open([clip], model, DRAG) == is_open


def test_chi_square_is_what_a_fit_of_the_form_gains():
    theta = integrate(SWING, VALUES, T_S, lambda t, x, v, base: -0.4 * np.abs(v) ** 0.9 * v)[:, :1]
    clip, model = fitted(theta, DRAG)
    before, free = model.fits[0], with_free_form(DRAG)
    after = fit_from(clip, with_effects(PENDULUM, [free]), free_values(before))
    degrees = before.n - len(before.free)
    gained = degrees * (1.0 - (after.rms[0] / before.rms[0]) ** 2)
    chi2 = _chi2(clip, before, model.units[0], forms(DRAG)[0])
    assert chi2 == pytest.approx(gained, rel=0.3)
    assert chi2 > 10 * WORTH_FITTING


def test_effect_without_a_form_has_none_to_fit():
    effect = EFFECTS["constant-force"]
    clip, model = fitted(dragged(), effect)
    assert not is_form_open([clip], model, effect)


def test_prediction_that_is_not_finite_leaves_the_form_open():
    clip, model = fitted(dragged(), DRAG)
    model.fits[0].jacobian[3, 0] = np.nan
    assert is_form_open([clip], model, DRAG)
