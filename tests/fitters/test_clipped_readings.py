"""Readings at the end of a sensor's range: found where the motion goes on beyond it, and only there."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from fitters.noise.clipped_readings import clippings
from iris_sysid import Quantity, Trajectory, fit, model_from_equation, without_clipped, write_trajectory
from iris_sysid.cli import app
from tests._project import recording

EQUATION = "x'' = -k*x - c*x' + b*u"
TRUTH = {"k": 9.0, "c": 0.6, "b": 3.0}


def series(t_s, values):
    values = np.asarray(values, dtype=float)[:, None]
    return Trajectory(t_s, (Quantity("x", "V"),), values, np.full_like(values, np.nan), np.ones(t_s.size, bool))


@pytest.fixture(scope="module")
def record():
    """x'' = -9 x - 0.6 x' + 3 u, read with noise by a converter that ends at 0.6 V."""
    t_s = np.arange(1500) / 50
    given = lambda t: np.sin(1.3 * t) + 0.7 * np.sin(2.6 * t + 1.0)  # noqa: E731
    rates = lambda t, s: [s[1], -9 * s[0] - 0.6 * s[1] + 3 * given(t)]  # noqa: E731
    x = solve_ivp(rates, (0, t_s[-1]), [0.1, 0.0], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    read = np.minimum(x + 5e-3 * np.random.default_rng(0).standard_normal(t_s.size), 0.6)
    return series(t_s, read).with_(input_quantities=(Quantity("u", "V"),), inputs=given(t_s)[:, None])


def test_clipped_samples_do_not_bend_the_fit(record):
    model, whole = model_from_equation(EQUATION), without_clipped(record)
    (found,) = clippings(record)
    assert (found.limit, np.array_equal(found.samples, record.position[:, 0] == 0.6)) == (0.6, True)
    assert 0.05 < found.samples.mean() < 0.4
    freed, bent = fit(whole, model), fit(record, model)
    for name, value in TRUTH.items():
        assert abs(freed.estimates[name].value - value) < 4 * freed.estimates[name].stderr
    assert freed.rms[0] == pytest.approx(5e-3, rel=0.1)
    assert bent.rms[0] > 4 * freed.rms[0]
    assert str(found) in freed.notes
    assert without_clipped(whole) is whole


def test_commands_leave_clipped_samples_out_and_say_so(record, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_trajectory(record, tmp_path / "record.csv")
    command = ["fit", "record.csv", "--equation", EQUATION, "--hold", "linear", "-o"]
    done, kept = (CliRunner().invoke(app, [*command, *end]) for end in (["a.json"], ["b.json", "--keep-clipped"]))
    said = "x is clipped at 0.6 V, the end of the sensor's range"
    assert (done.exit_code, kept.exit_code) == (0, 0)
    assert said in done.output
    assert said in (tmp_path / "a.json").read_text()
    assert said not in kept.output
    assert "--keep-clipped" in kept.output  # the next command has it too


def exponential(step=0.0):
    u = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 10), 400)
    values = [0.3]
    for each in u[:-1]:
        values.append(each + (values[-1] - each) * np.exp(-0.1))
    return np.round(np.array(values) / step) * step if step else np.array(values)


def swing(step, noise=0.0, n=2000):
    t_s = np.linspace(0.0, 20.0, n)
    values = np.sin(1.1 * t_s) + 0.5 * np.sin(2.3 * t_s + 1.0) + noise * np.random.default_rng(1).standard_normal(n)
    return np.round(values / step) * step


def stopped():
    """A speed that dry friction brings to zero, and that starts again."""
    t_s = np.linspace(0.0, 10.0, 1000)
    return np.maximum(np.sin(2 * t_s), 0.0)


def released():
    """A pendulum held at its largest angle before it is let go."""
    return np.concatenate([np.ones(50), np.cos(np.linspace(0.0, 20.0, 950))])


@pytest.mark.parametrize(
    "values",
    [exponential(), exponential(1e-2), exponential(0.1), stopped(), released(), *(swing(s) for s in (5e-3, 0.05, 0.2))],
)
def test_rest_slow_limits_and_steps_are_no_clipping(values):
    assert clippings(series(np.arange(values.size) * 0.01, values)) == ()


@pytest.mark.parametrize(("step", "noise"), [(1e-6, 0.0), (5e-3, 2e-3), (0.05, 0.01), (1e-6, 0.01)])
def test_both_ends_are_found(step, noise):
    values = np.clip(swing(step, noise), -0.75, 0.75)
    high, low = clippings(series(np.arange(values.size) * 0.01, values))
    assert (high.limit, low.limit) == (0.75, -0.75)
    assert np.array_equal(high.samples, values == 0.75)


def test_the_sensor_of_the_cascaded_tanks_ends_at_10_volts():
    table = np.genfromtxt(recording("cascaded_tanks") / "tanque.csv", delimiter=",", skip_header=1)
    for column, count in ((2, 47), (3, 37)):
        (found,) = clippings(series(4.0 * np.arange(1024), table[:, column]))
        assert (found.limit, int(found.samples.sum())) == (pytest.approx(10.0, abs=1e-3), count)
