import numpy as np
import pytest

from validation.latent_losses import BENDS, INTEGRATORS, stiffness_of


@pytest.mark.parametrize("integrator", ["Euler-Cromer"])
def test_a_loss_minimised_on_its_own_integrators_path_returns_its_stiffness(integrator):
    theta, v, dt = [0.4], 0.0, 1 / 60
    for _ in range(200):
        z, v = INTEGRATORS[integrator](np.array(theta[-1]), np.array(v), dt, lambda z, v: -20.0 * z - 0.05 * v)
        theta.append(float(z))
    assert stiffness_of(np.array(theta), dt, INTEGRATORS[integrator], 1, BENDS["linear"]) == pytest.approx(20, rel=1e-6)


def test_the_step_without_acceleration_has_no_gradient_at_one_step_ahead():
    theta = np.cos(4.4 * np.arange(100) / 60)
    assert np.isnan(stiffness_of(theta, 1 / 60, INTEGRATORS["no acceleration in z"], 1, BENDS["linear"]))
