"""Tanks, a circuit, a ship and a rocket by SciPy's own integration: fits find the physics from the data alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.stats
from scipy.integrate import solve_ivp

from fitters.ode import FitOptions, fit
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

G = 9.80665
NOISE = 3e-3  # of the motion's standard deviation
EXPERIMENTS = 40
LEVEL = 1e-4  # at which a coverage is not 95 %


@dataclass(frozen=True)
class Case:
    """What is measured of ``slopes(t, state, u)`` from ``start``, at times ``every_s`` apart, and the values to find.

    The input is held for ``held`` samples and lies between ``low`` and ``high``; without bounds there is none.
    """

    model: str
    slopes: Callable
    start: tuple[float, ...]
    measured: int
    every_s: float
    samples: int
    truth: dict
    low: float = 0.0
    high: float = 0.0
    held: int = 20


AREA, HOLE, FLOW = 28e-4, 0.071e-4, 3.3e-6  # m^2, m^2, m^3/s at 1 V
R, L, C = 30.0, 0.4, 20e-6  # Ohm, H, F
DENSITY, SURFACE, MASS = 1.225, 0.45 * np.pi * 0.05**2, 4.0  # kg/m^3, m^2 with the coefficient of drag, kg


def out(level, hole=HOLE):
    return hole * np.sqrt(2 * G * max(level, 0.0))


def one_tank(t, state, u):
    return ((FLOW * u - out(state[0])) / AREA,)


def two_tanks(t, state, u):
    upper, lower = state
    return (FLOW * u - out(upper)) / AREA, (out(upper) - out(lower, 0.8 * HOLE)) / AREA


def circuit(t, state, u):
    """Charge and current."""
    return state[1], (u - R * state[1] - state[0] / C) / L


def over_capacity(t, state, u):
    """The voltage of the capacitor and its rate."""
    _, current_rate = circuit(t, (C * state[0], C * state[1]), u)
    return state[1], current_rate / C


def ship(t, state, u):
    roll, speed = state
    return speed, -0.16 * (roll + 0.02) - 0.015 * speed - 0.4 * speed * abs(speed)


def rocket(t, state, u):
    """In the standard atmosphere as ISO 2533 has it, not in an exponential one."""
    height, speed = state
    density = DENSITY * (1.0 - 2.25577e-5 * height) ** 4.25588
    return speed, -G - density * SURFACE / 2 / MASS * speed * abs(speed)


def root(hole):
    return hole / AREA * np.sqrt(2 * G)


CASES = [
    Case("pumped-tank", one_tank, (0.15,), 0, 0.5, 800, {"outflow": root(HOLE), "pump": FLOW / AREA}, 0.5, 5.0),
    Case(
        "two-tanks", two_tanks, (0.05, 0.15), 1, 0.5, 1200,
        {"upper_outflow": root(HOLE), "lower_outflow": root(0.8 * HOLE), "pump": FLOW / AREA}, 0.5, 5.0,
    ),
    Case(
        "rlc-circuit", over_capacity, (1.0, 0.0), 0, 5e-4, 800,
        {"resonance": 1 / np.sqrt(L * C), "decay": R / L}, -5.0, 5.0,
    ),
    Case(
        "ship-roll", ship, (0.35, 0.0), 0, 0.2, 600,
        {"roll_rate": 0.4, "damping": 0.015, "eddies": 0.4, "heel": -0.02},
    ),
    Case("rocket-coast", rocket, (200.0, 150.0), 0, 0.05, 200, {"drag": DENSITY * SURFACE / 2 / MASS}),
]  # fmt: skip
each = pytest.mark.parametrize("case", CASES, ids=lambda case: case.model)


def motion(case, seed):
    """What is measured (n, 1) without noise, and the input (n, 1), held; None without one."""
    count = case.samples // case.held
    levels = np.random.default_rng(seed).uniform(case.low, case.high, count)
    state, seen = np.array(case.start), []
    times = np.arange(case.held + 1) * case.every_s
    for level in levels:
        solved = solve_ivp(case.slopes, (0.0, times[-1]), state, "DOP853", times, args=(level,), rtol=1e-9, atol=1e-11)
        seen.append(solved.y[case.measured, :-1])
        state = solved.y[:, -1]
    return np.concatenate(seen)[:, None], np.repeat(levels, case.held)[:, None] if case.high > case.low else None


def fitted(case, values, inputs, seed, **more):
    model = MODELS[case.model]
    noisy = values + NOISE * np.std(values) * np.random.default_rng(seed).standard_normal(values.shape)
    t_s, unknown, valid = (
        case.every_s * np.arange(len(values)),
        np.full_like(values, np.nan),
        np.ones(len(values), bool),
    )
    given = () if inputs is None else (model.inputs, inputs)
    return fit(Trajectory(t_s, model.observed, noisy, unknown, valid, *given, hold="zero-order"), model, **more)


@each
@pytest.mark.parametrize("seed", range(3))
def test_fit_from_the_data_alone_finds_the_physics(case, seed):
    values, inputs = motion(case, seed)
    result = fitted(case, values, inputs, seed)
    assert result.status == "ok", result.message
    for name, value in case.truth.items():
        found = result.estimates[name]
        assert abs(found.value - value) < 4.5 * found.stderr, name
        assert found.stderr < 0.1 * abs(value), name
    assert result.rms[0] == pytest.approx(NOISE * np.std(values), rel=0.15)


@pytest.mark.slow
@each
def test_intervals_cover_what_the_physics_has(case):
    values, inputs = motion(case, 0)
    hits = dict.fromkeys(case.truth, 0)
    for seed in range(EXPERIMENTS):
        found = fitted(case, values, inputs, 100 + seed, options=FitOptions(unseen_drag=False)).estimates
        for name, value in case.truth.items():
            low, high = found[name].interval
            hits[name] += low <= value <= high
    for name, count in hits.items():
        assert scipy.stats.binomtest(count, EXPERIMENTS, 0.95).pvalue > LEVEL, (name, count)
