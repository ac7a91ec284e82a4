"""Nothing is named where the free run with all effects leaves the motion."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import MODELS, Trajectory, diagnose, simulate, with_effects
from iris_sysid.diagnosis import diagnose as module
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Finding

PENDULUM, DRAG = MODELS["pendulum"], EFFECTS["quadratic-drag"]
VALUES = {"length": 0.5, "damping": 0.1, "quadratic_drag": 0.3, "theta_0": 1.0, "omega_0": 0.0}


def swing():
    t_s = np.arange(600) / 60
    theta = simulate(with_effects(PENDULUM, [DRAG]), t_s, VALUES).observed
    theta = theta + 0.01 * np.sin(9.0 * t_s)[:, None]  # a form that no effect has, so that blocks left out decide
    theta += 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    return Trajectory(t_s, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(600, bool))


@pytest.mark.parametrize("share", [0.95, 0.5])
def test_names_go_where_held_out_blocks_of_the_motion_are_not_predicted(monkeypatch, share):
    monkeypatch.setattr(module, "_explained", lambda world, model: share)
    found = diagnose(swing(), PENDULUM, effects=["quadratic-drag"])
    (drag,) = (each for each in found.findings if each.effects == ("quadratic-drag",))
    assert (drag.word == "named") is (share > 0.9)
    assert share > 0.9 or drag.reason == "the free run does not follow the motion"


def test_finding_without_a_name_keeps_its_reason():
    located = Finding("located", "periodic-force", ("periodic-forcing",), 0.5, "it can imitate anything")
    assert module._without_name(located, "another") is located


def test_share_explained_is_of_the_variance_of_the_motion():
    motion = np.array([[1.0], [-1.0], [1.0], [-1.0]])
    fitted = SimpleNamespace(predicted=motion - 0.1, residual=np.full_like(motion, 0.1), used=np.ones(4, bool))
    world = SimpleNamespace(shares=SimpleNamespace(heldout=lambda model: (0.5, 5.0)))
    assert module._explained(world, SimpleNamespace(fits=[fitted])) == pytest.approx(0.75)


@pytest.mark.slow
def test_a_spring_with_a_stop_on_one_side_is_followed_about_its_rest_position():
    """A model that rests at zero explains 4 % of this motion, whose mean is 7 cm beside it."""
    t_s = np.arange(240) / 60
    slopes = lambda t, s: [s[1], -60.0 * s[0] - 0.1 * s[1] - 600.0 * np.maximum(s[0], 0.0)]  # noqa: E731
    x = solve_ivp(slopes, (0.0, 4.0), [0.08, 0.0], "DOP853", t_s, rtol=1e-10, atol=1e-12, max_step=1e-3).y[0]
    x = x[:, None] + 3e-4 * np.random.default_rng(2).standard_normal((240, 1))
    everywhere = np.ones(240, bool)
    clip = Trajectory(t_s, MODELS["linear-oscillator"].observed, x, np.full_like(x, np.nan), everywhere)
    found = diagnose(clip, "linear-oscillator")
    assert found.base.explained > 0.9
    assert "slack-tether" in [effect.name for effect in found.added]
    assert found.sizes["slack_tether"].value == pytest.approx(600 / 660, abs=0.03)
