"""A residual is split into the parts that were put into it: motions integrated by SciPy, readings changed by hand."""

import numpy as np
import pytest

from fitters.components import ClipResidual, marginal, split
from fitters.components.noisy_residual import NoisyResidual
from fitters.components.split import searched
from fitters.effect_sensitivity import motion_of
from fitters.ode import fit
from iris_sysid.registry import MODELS
from iris_sysid.types import Components, Trajectory
from validation.independent.motions import MOTIONS, integrate

T_S = np.arange(480) / 60
NOISE = 1e-3
VALUES = {"length": 0.5, "damping": 0.05, "x0": 0.8, "v0": 0.1}


def swing(force=None) -> np.ndarray:
    return integrate(MOTIONS["pendulum"], VALUES, T_S, force)[:, :1]


def residual_of(theta: np.ndarray, seed: int = 0) -> ClipResidual:
    seen = theta + NOISE * np.random.default_rng(seed).standard_normal(theta.shape)
    clip = Trajectory(T_S, MODELS["pendulum"].observed, seen, np.full_like(seen, np.nan), np.ones(T_S.size, dtype=bool))
    fitted = fit(clip, "pendulum")
    used = fitted.used
    jacobian = fitted.jacobian.reshape(int(used.sum()), 1, -1)
    noise = np.full((int(used.sum()), 1), fitted.noise[0])
    residual = NoisyResidual(T_S[used], fitted.residual[used], jacobian, noise)
    return ClipResidual(motion_of(fitted, clip), residual, fitted.predicted[used])


def parts_of(theta: np.ndarray, seed: int = 0) -> Components:
    found = split([residual_of(theta, seed)])
    assert found is not None
    return found


def quadratic(t, x, v, base):
    return -0.2 * np.abs(v) * v


def cubic(t, x, v, base):
    return -1.0 * x**3


def wander(t_s: np.ndarray) -> np.ndarray:
    return 0.02 * np.sin(2 * np.pi * 0.2 * t_s + 1.0)[:, None]


HIDDEN = {
    "force-of-velocity": lambda: swing(quadratic),
    "force-of-position": lambda: swing(cubic),
    "zero-wander": lambda: swing() + wander(T_S),
    "reading-of-position": lambda: swing() + 0.05 * swing() ** 2,
    "clock": lambda: integrate(MOTIONS["pendulum"], VALUES, T_S + 0.02 * (T_S > 4.0))[:, :1],
    "pulse": lambda: swing(lambda t, x, v, base: 4.0 * np.exp(-(((t - 3.0) / 0.03) ** 2))),
    "periodic-force": lambda: swing(lambda t, x, v, base: 1.0 * np.sin(2 * np.pi * 1.9 * t)),
}


@pytest.mark.parametrize("kind", HIDDEN)
def test_the_part_that_was_put_in_is_the_largest_or_said_to_be_similar(kind):
    found = parts_of(HIDDEN[kind]())
    first = found.parts[0]
    assert kind in (first.kind, *first.similar)
    assert first.share > 0.8
    assert first.probability > 0.9 or first.similar


def test_shares_and_noise_sum_to_one_where_parts_overlap():
    found = parts_of(swing(quadratic) + wander(T_S) + 0.05 * swing() ** 2)
    assert len(found.parts) >= 2
    assert all(0.0 <= part.share <= 1.0 for part in found.parts)
    assert all(part.share_range[0] <= part.share <= part.share_range[1] <= 1.0 for part in found.parts)
    assert sum(part.share for part in found.parts) + found.noise_share == pytest.approx(1.0)


def test_two_parts_are_both_found():
    found = parts_of(swing(quadratic) + wander(T_S))
    assert {"force-of-velocity", "zero-wander"} <= {kind for part in found.parts for kind in (part.kind, *part.similar)}


def test_noise_has_no_parts_in_at_least_nineteen_of_twenty_motions():
    assert sum(not parts_of(swing(), seed).parts for seed in range(20)) >= 19


def test_band_of_the_curve_holds_the_force_that_was_put_in():
    part = parts_of(swing(quadratic)).parts[0]
    curve = part.curve
    assert curve is not None
    assert curve.argument.unit == "rad/s"
    usual = np.abs(curve.at) < 0.7 * curve.at.max()
    hidden = -0.2 * np.abs(curve.at) * curve.at
    error = curve.values[:, 0] - hidden
    slope = error[usual] @ curve.at[usual] / (curve.at[usual] @ curve.at[usual])  # the model's own damping imitates it
    assert np.mean(np.abs(error - slope * curve.at)[usual] < 2.5 * curve.stderr[usual, 0]) > 0.8
    assert np.max(curve.stderr[usual]) < np.max(np.abs(hidden[usual]))


def test_curve_ends_where_the_motion_did():
    """A swing that dies out before it has gone as far to the other side."""
    theta = integrate(MOTIONS["pendulum"], {**VALUES, "damping": 1.5}, T_S, cubic)[:, :1]
    curve = next(part.curve for part in parts_of(theta).parts if part.kind == "force-of-position")
    assert curve.at.max() == pytest.approx(0.8, rel=0.02)
    assert curve.at.min() == pytest.approx(theta.min(), rel=0.05)
    assert theta.min() > -0.6


def test_moment_of_a_pulse_and_frequency_of_a_force_are_given():
    pulse = parts_of(HIDDEN["pulse"]()).named("pulse")
    assert pulse is not None
    assert pulse.at is not None
    assert pulse.at.value == pytest.approx(3.0, abs=0.2)
    force = parts_of(HIDDEN["periodic-force"]()).named("periodic-force")
    assert force is not None
    assert force.at is not None
    assert force.at.value == pytest.approx(1.9, abs=0.1)


@pytest.mark.parametrize("force", [lambda t, x, v, base: -2 * np.abs(v) * v, lambda t, x, v, base: -np.tanh(v / 0.01)])
def test_force_far_above_the_noise_is_no_error_of_the_reading(force):
    """Its residual is a fifth of the motion; a function of what is observed would contain the residual itself."""
    found = parts_of(swing(force))
    assert found.residual_rms > 0.1 * found.motion_rms
    assert found.parts[0].kind == "force-of-velocity"
    assert found.parts[0].share > 0.7


def test_values_beside_components_have_errors_that_cover_the_truth():
    clip = residual_of(swing() + wander(T_S))
    found = marginal(clip)
    assert found is not None
    shift, covariance = found
    length = clip.motion.values["length"]
    stderr = np.hypot(np.sqrt(covariance[0, 0]), shift[0])
    assert abs(length - VALUES["length"]) < 3 * stderr
    assert marginal(residual_of(swing())) is None


def test_a_set_that_comes_out_better_while_the_parts_are_written_does_not_take_the_place_of_the_first():
    found = searched([residual_of(swing(quadratic) + wander(T_S))])
    key = ("reading-of-position", "zero-wander")  # with the wrong one: exchanges of it are better
    found.search.evidence(key)
    found.search.found = {key: found.search.found[key]}
    assert {part.kind for part in found.components().parts} == set(key)
    assert found.search.top() != key
