"""A coefficient has one interval, whichever way it is asked for: fit, select_model or discover."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import Quantity, Trajectory, discover, fit, select_model


def spring(force, noise=2e-3, seed=0):
    t_s = np.arange(600) / 60
    rates = lambda t, s: [s[1], -20 * s[0] - 0.15 * s[1] + force(t, s)]  # noqa: E731
    z = solve_ivp(rates, (0, 10), [0.3, 0.3], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[:1].T
    z = z + noise * np.random.default_rng(seed).standard_normal(z.shape)
    return Trajectory(t_s, (Quantity("z", "m"),), z, np.full_like(z, np.nan), np.ones(600, bool))


def width(estimate):
    return estimate.interval[1] - estimate.interval[0]


def test_chosen_model_has_the_interval_of_its_fit_where_it_lacks_a_force():
    clip = spring(lambda t, s: -0.05 * s[1] * abs(s[1]))
    chosen = select_model(clip, ["linear-oscillator"]).nearest.fit
    alone = fit(clip, "linear-oscillator")
    assert alone.budget["damping"]["model discrepancy"] > 0
    assert width(chosen.estimates["damping"]) == pytest.approx(width(alone.estimates["damping"]), rel=0.1)


def test_discovered_coefficient_has_the_interval_of_its_fit():
    clip = spring(lambda t, s: 0.02 * np.sin(1.1 * t))
    found = discover(clip)
    assert found.matched is not None
    assert found.matched.model == "linear-oscillator"
    alone = fit(clip, "linear-oscillator")
    assert alone.budget["damping"]["model discrepancy"] > alone.budget["damping"]["random"]
    by_fit = alone.estimates
    terms = {term.term: term.coefficient for term in found.selected}
    for name, term in (("stiffness", "z"), ("damping", "z'")):
        assert width(terms[term]) == pytest.approx(width(by_fit[name]), rel=0.1)
        assert width(found.matched.parameters[name]) == pytest.approx(width(by_fit[name]), rel=0.1)
