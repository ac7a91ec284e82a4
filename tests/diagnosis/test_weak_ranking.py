"""A drive whose base model has no friction at all: the weak form names what a free run cannot show."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import FitRequest
from iris_sysid import Trajectory, diagnose, model_from_equation
from iris_sysid.diagnosis.block_means import DRIVEN
from iris_sysid.diagnosis.weak_ranking import _first_samples
from validation.driven_speed import CART as SPRUNG
from validation.driven_speed import DRY as DRY_FORCE
from validation.driven_speed import MASS as SPRUNG_MASS
from validation.driven_speed import record

MASS, VISCOUS, DRY, OFFSET = 20.0, 30.0, 12.0, 3.0  # kg, N s/m, N, N
CART = model_from_equation("q'' = u/m")
STEP_S, N = 0.01, 1500


def drive(dry, viscous, offset, seed=0):
    """A cart that a controller moves to and fro, by SciPy, with a force that wanders by a few per cent of the input."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(N) * STEP_S
    state, q, u = np.array([0.0, 0.0]), np.empty(N), np.empty(N)
    wander = np.repeat(0.6 * rng.standard_normal(N // 100), 100)
    for k in range(N):
        aim = 0.15 * np.sin(1.3 * t_s[k]) + 0.05 * np.sin(3.1 * t_s[k])
        q[k], u[k] = state[0], 900.0 * (aim - state[0]) - 120.0 * state[1]

        def slope(t, now, force=u[k] + wander[k]):
            v = now[1]
            return v, (force - viscous * v - dry * v / np.hypot(v, 1e-3) + offset) / MASS

        state = solve_ivp(slope, (0.0, STEP_S), state, rtol=1e-8, atol=1e-10).y[:, -1]
    q += 1e-6 * rng.standard_normal(N)
    unknown, valid = np.full((N, 1), np.nan), np.ones(N, bool)
    more = {"sensor": "encoder", "hold": "zero-order"}
    return Trajectory(t_s, CART.observed, q[:, None], unknown, valid, CART.inputs, u[:, None], **more)


@pytest.mark.slow
def test_friction_and_offset_are_named_from_a_base_model_without_any():
    found = diagnose(drive(DRY, VISCOUS, OFFSET), CART)
    named = {effect.name for effect in found.added}
    assert named == {"coulomb-friction", "linear-drag", "constant-force"}
    assert all(finding.share > 0.25 for finding in found.findings if finding.effects)
    mass = found.final.estimates["m"].value
    assert mass == pytest.approx(MASS, rel=0.05)
    assert mass * found.sizes["coulomb_friction"].value == pytest.approx(DRY, rel=0.1)
    assert mass * found.sizes["linear_drag"].value == pytest.approx(VISCOUS, rel=0.15)
    assert mass * found.sizes["constant_force"].value == pytest.approx(OFFSET, rel=0.1)


@pytest.mark.slow
def test_a_drive_with_viscous_friction_alone_gets_no_dry_friction():
    named = {effect.name for effect in diagnose(drive(0.0, VISCOUS, 0.0), CART).added}
    assert named == {"linear-drag"}


@pytest.mark.slow
def test_dry_friction_is_not_taken_for_a_form_of_it_with_one_more_value():
    found = diagnose(record(2000), SPRUNG)
    assert [effect.name for effect in found.added] == ["coulomb-friction"]
    assert found.sizes["coulomb_friction"].value == pytest.approx(DRY_FORCE / SPRUNG_MASS, rel=0.05)


@pytest.mark.parametrize(("samples", "kept"), [(2 * DRIVEN - 1, 2 * DRIVEN - 1), (2 * DRIVEN, DRIVEN)])
def test_a_memory_is_looked_for_in_the_first_samples_of_a_long_record(samples, kept):
    t_s, zero = np.arange(samples) * STEP_S, np.zeros((samples, 1))
    clip = Trajectory(t_s, CART.observed, zero, zero * np.nan, np.ones(samples, bool), CART.inputs, zero)
    assert _first_samples(FitRequest(clip, CART)).trajectory.valid.sum() == kept
