"""The models without physics simulate records of their own kind, and say where they diverge."""

import numpy as np
import pytest

from iris_sysid import Quantity, Trajectory
from validation.black_boxes import linear, narx, sindy_with_inputs
from validation.driven_benchmarks import held_record

STEP_S = 0.05
NAMES = Quantity("u", "V"), Quantity("y", "1")


def record(following, seed, n=400, smooth=False):
    """A record of random inputs, held or a sum of sines, through a difference equation of the second order."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 5), 5)
    if smooth:
        frequency, phase = rng.uniform(0.3, 3.0, (4, 1)), rng.uniform(0, 6, (4, 1))
        u = np.sin(frequency * np.arange(n) * STEP_S + phase).sum(axis=0)
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = following(y[k - 1], y[k - 2], u[k - 1])
    return held_record(0.0, STEP_S, u, y, NAMES)


def bent(one, two, u):
    return 1.5 * one - 0.6 * two + 0.1 * u + 0.05 * one * u


def straight(one, two, u):
    return 1.5 * one - 0.6 * two + 0.1 * u


def slow(one, two, u):
    return 1.96 * one - 0.97 * two + 0.01 * u


def error(box, clip, first=10):
    return np.sqrt(np.mean((box(clip, first) - clip.position[:, 0])[first:] ** 2)) / np.std(clip.position)


def test_the_narx_is_exact_for_a_polynomial_and_the_linear_model_is_not():
    estimation, test = record(bent, 0), record(bent, 1)
    assert error(narx(estimation, 2), test) < 1e-6
    assert error(linear(estimation, 2), test) > 0.02
    assert error(linear(record(straight, 0), 2), record(straight, 1)) < 1e-4


def test_sindy_with_inputs_simulates_a_damped_oscillator():
    assert error(sindy_with_inputs(record(slow, 0, smooth=True)), record(slow, 1, smooth=True)) < 0.1


def test_no_sample_after_the_first_ones_is_used():
    estimation, test = record(bent, 0), record(bent, 1)
    hidden = test.position.copy()
    hidden[10:] = 1e3
    for box in (narx(estimation, 2), linear(estimation, 2), sindy_with_inputs(estimation)):
        np.testing.assert_allclose(box(test.with_(position=hidden), 10)[10:], box(test, 10)[10:])


def test_a_simulation_that_runs_away_is_nan():
    estimation = record(bent, 0)
    driven = np.full((400, 1), 40.0)  # far outside: the product with the input makes it unstable
    clip = Trajectory(
        estimation.t_s, NAMES[1:], estimation.position, estimation.sigma, estimation.valid, NAMES[:1], driven
    )
    assert np.isnan(narx(estimation, 2)(clip, 10)[-1])


@pytest.mark.parametrize("test", [False, True])
def test_a_part_of_the_drives_holds_no_row_of_the_other(tmp_path, monkeypatch, test):
    from validation import driven_benchmarks

    rows = [",".join(f"{k}.{j}" for j in range(4)) + "," for k in range(500)]
    (tmp_path / "drives.csv").write_text("\n".join(['"u11","u12","z11","z12",', *rows]) + "\n,,,,\n\n")
    monkeypatch.setattr(driven_benchmarks, "DRIVES", tmp_path / "drives.csv")
    first, second = driven_benchmarks.drives(test)
    numbers = np.arange(400, 500) if test else np.arange(400)
    np.testing.assert_allclose(first.inputs[:, 0], numbers)
    np.testing.assert_allclose(second.position[:, 0], numbers + 0.3)
    np.testing.assert_allclose(first.t_s, numbers * 0.02)
