"""Oscillations about another place than the zero of the scale."""

import numpy as np
import pytest

from fitters.ode import fit, simulate
from fitters.ode.several_clips import fit_clips
from iris_sysid.registry import MODELS
from iris_sysid.types import Quantity, Trajectory

SPRING = {"stiffness": 81.0, "damping": 0.2, "z_0": 0.05, "vz_0": 0.0}
PAIR = {
    "stiffness_1": 20.0, "stiffness_2": 14.0, "damping_1": 0.04, "damping_2": 0.05, "coupling_1": 8.0,
    "coupling_2": 6.0, "z1_0": 0.05, "z2_0": -0.02, "v1_0": 0.0, "v2_0": 0.0,
}  # fmt: skip


def seen(model, values, rest, seed=0, noise=1e-3, unit="", count=240):
    t_s = np.arange(count) / 60
    observed = simulate(MODELS[model], t_s, values).observed + np.asarray(rest)
    observed = observed + noise * np.random.default_rng(seed).standard_normal(observed.shape)
    quantities = tuple(Quantity(q.name, unit or q.unit) for q in MODELS[model].observed)
    return Trajectory(t_s, quantities, observed, np.full_like(observed, np.nan), np.ones(count, bool))


@pytest.mark.parametrize("unit", ["m", "px"])
@pytest.mark.parametrize("rest", [0.25, -0.02, 0.001])
def test_oscillation_about_another_place_has_its_stiffness_and_its_rest(rest, unit):
    result = fit(seen("linear-oscillator", SPRING, rest, unit=unit), "linear-oscillator")
    assert result.ok
    assert abs(result.estimates["stiffness"].value - 81.0) < 4 * result.estimates["stiffness"].stderr
    assert abs(result.estimates["rest"].value - rest) < 4 * result.estimates["rest"].stderr
    assert result.estimates["rest"].unit == unit
    assert any("not about zero" in note for note in result.notes)


def test_angle_that_is_counted_from_elsewhere_and_two_bodies_have_their_rests():
    cone = {"stiffness": 8.0, "damping": 0.05, "phi_0": 0.5, "omega_0": 0.0}
    result = fit(seen("angular-oscillator", cone, 2.0), "angular-oscillator")
    assert abs(result.estimates["rest"].value - 2.0) < 4 * result.estimates["rest"].stderr
    pair = fit(seen("coupled-oscillators", PAIR, (0.3, 0.5)), "coupled-oscillators")
    assert pair.ok
    assert pair.estimates["rest_1"].value == pytest.approx(0.3, abs=1e-3)
    assert pair.estimates["rest_2"].value == pytest.approx(0.5, abs=1e-3)
    assert abs(pair.estimates["stiffness_1"].value - 20.0) < 4 * pair.estimates["stiffness_1"].stderr


def test_oscillation_about_zero_keeps_its_rest_there():
    freed = [
        "rest" in fit(seen("linear-oscillator", SPRING, 0.0, seed), "linear-oscillator").free for seed in range(20)
    ]
    assert sum(freed) <= 1


def test_rest_that_is_stated_is_held_there():
    clip = seen("linear-oscillator", SPRING, 0.02)
    assert "rest" not in fit(clip, "linear-oscillator", fixed={"rest": 0.0}).free
    held = fit(clip, "linear-oscillator", fixed={"rest": 0.02})
    assert held.ok
    assert "rest" not in held.free


def test_clips_have_their_own_rest():
    clips = [seen("linear-oscillator", SPRING, rest, seed) for seed, rest in enumerate((0.25, 0.26))]
    pooled = fit_clips(clips, "linear-oscillator", shared=["stiffness"])
    assert abs(pooled.shared["stiffness"].value - 81.0) < 4 * pooled.shared["stiffness"].stderr
