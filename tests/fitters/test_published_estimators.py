"""The published estimators do what the paper says, and are off where theory says by how much."""

import math

import numpy as np
import pytest
from scipy.special import ellipk

from fitters.published_estimators import RECIPES, damped_cosine, envelope, free_fall, incline
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate, Quantity, Trajectory
from tests._motions import pendulum_angle

G = {"gravity": Estimate(9.80665, 0.0, "m/s^2", "assumed")}
T_S = np.arange(1200) / 60


def of(name, unit, values, t_s=T_S):
    position = values[:, None]
    valid = np.ones(t_s.size, dtype=bool)
    return Trajectory(
        t_s=t_s, quantities=(Quantity(name, unit),), position=position, sigma=np.full_like(position, 1e-3), valid=valid
    )


def test_envelope_gives_the_damping_of_a_damped_cosine():
    angle = 0.2 * np.exp(-0.06 * T_S / 2) * np.cos(4.4 * T_S)
    assert envelope(of("theta", "rad", angle), {})["damping"].value == pytest.approx(0.06, rel=0.02)


def test_damped_cosine_gives_the_parameters_of_the_linear_equation():
    w = math.sqrt(9.80665 / 0.5 - 0.06**2 / 4)
    angle = 0.2 * np.exp(-0.06 * T_S / 2) * (np.cos(w * T_S) + 0.3 * np.sin(w * T_S)) + 0.01
    estimates = damped_cosine(of("theta", "rad", angle), G)
    assert estimates["stiffness"].value == pytest.approx(9.80665 / 0.5, rel=1e-6)
    assert estimates["damping"].value == pytest.approx(0.06, rel=1e-5)
    assert estimates["length"].value == pytest.approx(0.5, rel=1e-6)


@pytest.mark.parametrize("degrees", [20, 45, 90])
def test_damped_cosine_makes_a_pendulum_too_long_by_its_period(degrees):
    theta_0 = math.radians(degrees)
    exact = (2 / math.pi * ellipk(math.sin(theta_0 / 2) ** 2)) ** 2  # square of the period over that of small angles
    estimates = damped_cosine(of("theta", "rad", pendulum_angle(T_S, theta_0, length_m=0.5, damping=0.0)), G)
    assert estimates["length"].value / 0.5 == pytest.approx(exact, rel=2e-3)


def test_polynomials_give_gravity_and_friction():
    t_s = np.arange(25) / 60
    fall = free_fall(of("z", "m", 1.0 - 0.3 * t_s - 9.79 / 2 * t_s**2, t_s), {})
    assert fall["gravity"].value == pytest.approx(9.79, rel=1e-9)
    angle = math.radians(45)
    acceleration = 9.80665 * (math.sin(angle) - 0.25 * math.cos(angle))
    known = {**G, "angle": Estimate(angle, 0.0, "rad")}
    slide = incline(of("s", "m", 0.2 * t_s + acceleration / 2 * t_s**2, t_s), known)
    assert slide["friction"].value == pytest.approx(0.25, rel=1e-9)
    assert slide["acceleration"].value == pytest.approx(acceleration, rel=1e-9)


def test_friction_needs_metres_and_an_angle():
    t_s = np.arange(25) / 60
    assert "friction" not in incline(of("s", "px", t_s**2, t_s), {**G, "angle": Estimate(1.0, 0.0, "rad")})
    assert "friction" not in incline(of("s", "m", t_s**2, t_s), G)


def test_envelope_of_too_few_peaks_says_what_to_do():
    with pytest.raises(FitError, match=r"has 2 peaks, the envelope needs 3; film longer"):
        envelope(of("theta", "rad", np.cos(4.0 * T_S[:120] - 2.0), T_S[:120]), {})


def test_too_few_samples_are_refused():
    with pytest.raises(FitError, match="has 4 samples, at least 5"):
        free_fall(of("z", "m", np.zeros(4), T_S[:4]), {})


def test_recipes_belong_to_models_and_give_their_parameters():
    for name, recipes in RECIPES.items():
        ours = {parameter.name for parameter in (*MODELS[name].parameters, *MODELS[name].derived)}
        assert all(set(recipe.gives) <= ours for recipe in recipes)
