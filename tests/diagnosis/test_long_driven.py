"""Long driven records are searched by their first samples; what acts later is found by all of them."""

import numpy as np
import pytest

from fitters.integrator.initial_value_problem import initial_value_problem
from iris_sysid import Trajectory, diagnose, model_from_equation, simulate
from iris_sysid.diagnosis import block_means, fit_cache

CART = model_from_equation("q'' = (35*u - c*q' - k*q)/m", units={"q": "m", "u": "V", "m": "kg"})
SATURATED = model_from_equation("q'' = (35*max(min(u, 6), -6) - c*q' - k*q)/m", units={"q": "m", "u": "V", "m": "kg"})
DRY = model_from_equation("q'' = (35*u - c*q' - k*q)/m - 1.3*tanh(q'/0.02)", units={"q": "m", "u": "V", "m": "kg"})
VALUES = {"c": 20.0, "k": 150.0, "m": 9.0, "q_0": 0.0, "q_rate_0": 0.0}
PART, WHOLE = 600, 1500
RUBBING = ("coulomb-friction", "velocity-weakening-friction", "quadratic-drag", "directional-drag", "input-delay")


def cart(model, late=1.0):
    """A cart on a spring under a voltage held for ten samples, which grows by a factor after the first samples."""
    rng, t_s = np.random.default_rng(3), np.arange(WHOLE) * 0.01
    voltage = np.repeat(rng.uniform(-3, 3, WHOLE // 10), 10)[:, None] * np.where(t_s < 0.01 * PART, 1.0, late)[:, None]
    q = simulate(model, t_s, VALUES, inputs=voltage, hold="zero-order").observed
    q = q + 2e-4 * rng.standard_normal(q.shape)
    more = {"sensor": "encoder", "hold": "zero-order"}
    return Trajectory(
        t_s, CART.observed, q, np.full_like(q, np.nan), np.ones(WHOLE, bool), CART.inputs, voltage, **more
    )


@pytest.fixture
def fitted_samples(monkeypatch):
    """The numbers of samples of each refit; a record of 1,500 samples counts as long."""
    monkeypatch.setattr(block_means, "DRIVEN", PART)
    counts, refit = [], fit_cache.refitted

    def counted(clips, *args):
        counts.append(int(clips[0].trajectory.valid.sum()))
        return refit(clips, *args)

    monkeypatch.setattr(fit_cache, "refitted", counted)
    return counts


def test_a_long_driven_record_is_valued_by_all_of_its_samples(fitted_samples):
    found = diagnose(cart(DRY), CART, effects=RUBBING)
    # the turnover of this friction is not that of the library, so that a weakening can make up for it
    assert [effect.name for effect in found.added] in (["coulomb-friction"], ["velocity-weakening-friction"])
    assert next(iter(found.sizes.values())).value == pytest.approx(1.3, rel=0.02)
    assert found.final.n > WHOLE - 20
    assert WHOLE in fitted_samples


def test_what_acts_after_the_first_samples_alone_is_found(fitted_samples):
    found = diagnose(cart(SATURATED, late=4.0), CART)
    assert [effect.name for effect in found.added] == ["input-saturation"]


def test_another_form_of_a_friction_is_in_the_intervals_of_the_values():
    found = diagnose(cart(DRY), CART)
    assert found.after.fitted < 0.01 * found.before.fitted
    for name in ("c", "k", "m"):  # a friction that weakens takes a part of the damping
        low, high = found.final.estimates[name].interval
        assert low < VALUES[name] < high
        assert high - low < 0.1 * VALUES[name]


@pytest.mark.slow
def test_values_in_weak_form_count_only_if_their_run_follows_the_motion():
    """A sensor that lags falsifies the mass and the stiffness in short windows."""
    clip, tau_s = cart(CART), 0.03
    lagging = clip.position.copy()
    for k in range(1, WHOLE):
        lagging[k] = lagging[k - 1] + (1.0 - np.exp(-0.01 / tau_s)) * (lagging[k] - lagging[k - 1])
    found = diagnose(clip.with_(position=lagging, valid=np.arange(WHOLE) < 800), CART)
    assert found.after.fitted < 0.3 * found.before.fitted
    assert "exposure-lag" in {effect for names in found.indistinguishable.values() for effect in names}
    for name in ("c", "k", "m"):
        low, high = found.final.estimates[name].interval
        assert low < VALUES[name] < high


def test_steps_span_samples_at_which_no_held_input_changes():
    clip = cart(CART)
    values = np.array([VALUES[name] for name in ("c", "k", "m", "q_0", "q_rate_0")])
    names = [parameter.name for parameter in CART.parameters]
    values[: len(names)] = [VALUES[name] for name in names]
    held = initial_value_problem(CART, clip.t_s, clip.inputs, "zero-order").planned(values, 1e-9)
    changes = 1 + np.flatnonzero(np.diff(clip.inputs[:, 0]))
    assert held.ends.size < WHOLE / 2
    assert set(changes) <= set(held.ends)
    every = initial_value_problem(CART, clip.t_s, clip.inputs, "zero-order")
    np.testing.assert_allclose(held.predicted(values), every.predicted(values), atol=1e-8)
    line = initial_value_problem(CART, clip.t_s, clip.inputs, "linear").planned(values, 1e-9)
    assert set(range(WHOLE)) <= set(line.ends)
