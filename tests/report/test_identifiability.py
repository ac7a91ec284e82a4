"""The section of the report on identifiability."""

import numpy as np

from fitters.ode import fit, simulate
from iris_sysid.registry import MODELS
from iris_sysid.report.identifiability import correlations, identifiability_sections
from iris_sysid.types import Quantity, Trajectory


def swing(seconds):
    t_s = np.arange(int(60 * seconds)) / 60
    theta = simulate(MODELS["pendulum"], t_s, {"length": 0.5, "damping": 0.05, "theta_0": 0.6, "omega_0": 0.0}).observed
    theta = theta + 1e-3 * np.random.default_rng(1).standard_normal(theta.shape)
    return Trajectory(t_s, (Quantity("theta", "rad"),), theta, np.full_like(theta, 1e-3), np.ones(t_s.size, bool))


def test_values_known_well_have_no_strong_correlation_and_a_one_step_residual():
    result = fit(swing(10.0), MODELS["pendulum"])
    (section,) = identifiability_sections(result)
    assert correlations(result) == []
    assert section.rows == []
    assert "are the least distinguishable" in " ".join(section.lines)
    one_step = next(line for line in section.lines if line.startswith("One-step residual of the equation in theta"))
    assert "rad²" in one_step


def test_gravity_and_length_of_a_swing_are_named_as_undetermined():
    result = fit(swing(10.0), MODELS["pendulum"], free=["gravity"])
    (section,) = identifiability_sections(result)
    undetermined = [line for line in section.lines if line.startswith("Not determined: ")]
    assert len(undetermined) == 1
    assert "length" in undetermined[0]
    assert "gravity" in undetermined[0]


def test_values_that_correlate_are_listed_with_their_correlation():
    result = fit(swing(0.35), MODELS["pendulum"])
    (section,) = identifiability_sections(result)
    strongest = correlations(result)[0]
    assert abs(strongest[0]) > 0.9
    assert section.rows[0] == (strongest[1], strongest[2], f"{strongest[0]:+.3f}")


def test_fit_that_failed_has_no_such_section():
    result = fit(swing(0.05), MODELS["pendulum"])
    assert not result.usable
    assert identifiability_sections(result) == []
