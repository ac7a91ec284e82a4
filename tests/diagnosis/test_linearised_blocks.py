"""Errors over blocks left out to first order, against fits that did not see the blocks."""

from dataclasses import replace

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import FitRequest
from iris_sysid.diagnosis.held_out_blocks import every_block, held_out_errors
from iris_sysid.diagnosis.linearised_blocks import linearised_errors
from iris_sysid.diagnosis.refit import ModelWithEffects, fit_from
from iris_sysid.registry import EFFECTS
from tests.diagnosis.test_hold_out import NOISE, PENDULUM, SWING, T_S, VALUES, dragged, fit, table, with_drag
from validation.independent.motions import integrate


def test_errors_and_values_are_those_of_fits_without_each_block():
    requests, model = with_drag(table(dragged()))
    blocks = every_block(model.fits)
    fitted, linear = held_out_errors(requests, model, blocks), linearised_errors(model, blocks)
    np.testing.assert_allclose(linear.squares, fitted.squares, rtol=0.02)
    np.testing.assert_array_equal(linear.counts, fitted.counts)
    assert linear.rms == pytest.approx(fitted.rms, rel=0.01)
    drags = [errors.values[0]["quadratic_drag"] for errors in (linear, fitted)]
    # a fit of blocks ends within 1e-4 of its least squares
    np.testing.assert_allclose(drags[0], drags[1], atol=0.05 * np.ptp(drags[1]))


def test_error_without_the_drag_is_that_of_fits_where_it_is_far_above_the_noise():
    requests, model = with_drag(table(dragged()))
    base = ModelWithEffects((fit(requests[0].trajectory, PENDULUM),), model.units)
    blocks = every_block(base.fits)
    fitted, linear = held_out_errors(requests, base, blocks), linearised_errors(base, blocks)
    assert linear.mean == pytest.approx(fitted.mean, rel=0.2)
    assert linearised_errors(model, blocks).share_below(linear) == 1.0


def test_with_several_clips_the_size_comes_from_the_others():
    requests, model = with_drag(*(table(dragged(size), seed) for seed, size in enumerate((0.1, 0.3))))
    blocks = every_block(model.fits)
    fitted, linear = held_out_errors(requests, model, blocks), linearised_errors(model, blocks)
    assert linear.mean == pytest.approx(fitted.mean, rel=0.3)
    assert linear.mean > 10  # no other clip's drag explains a clip


def test_outlier_that_no_fit_uses_is_in_no_block():
    _, model = with_drag(table(dragged()))
    blocks = every_block(model.fits)
    used = np.flatnonzero(model.fits[0].used)
    every = [np.union1d(block, np.arange(block[0], block[-1] + 1)) for block in blocks[0]]
    assert linearised_errors(model, [every]).counts.sum() == np.isin(used, np.concatenate(every)).sum()


def test_derivative_that_is_not_finite_gives_an_infinite_error():
    _, model = with_drag(table(dragged()))
    blocks = every_block(model.fits)
    jacobian = model.fits[0].jacobian.copy()
    jacobian[5, 0] = np.inf
    broken = replace(model, fits=(replace(model.fits[0], jacobian=jacobian),))
    assert np.all(np.isinf(linearised_errors(broken, blocks).squares))


def test_form_that_the_samples_do_not_determine_does_not_move():
    """Dry friction that is the same at all speeds: the speed at which it halves may be anything above them."""
    theta = integrate(SWING, VALUES, T_S, lambda t, x, v, base: -0.1 * np.tanh(v / 0.01))[:, :1]
    effect = EFFECTS["velocity-weakening-friction"]
    request = FitRequest(table(theta + 0.004 * np.sin(3 * T_S[:, None])), PENDULUM)
    fitted = fit_from(request, with_effects(PENDULUM, [effect]), {"weakening_friction": 0.1, "weakening_speed": 90.0})
    model = ModelWithEffects((fitted,), (np.full((T_S.size, 1), NOISE),), (effect,))
    blocks = every_block(model.fits)
    assert fitted.estimates["weakening_speed"].stderr > fitted.estimates["weakening_speed"].value
    again, linear = held_out_errors([request], model, blocks), linearised_errors(model, blocks)
    assert linear.mean == pytest.approx(again.mean, rel=0.1)
    assert np.ptp(linear.values[0]["weakening_speed"]) == 0.0
