"""Own models in ten minutes: the commands and the Python of the guide, on motions that SciPy integrates."""

import re
import shlex

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from iris_sysid import Quantity, Trajectory, read_trajectory, validate_fit, write_trajectory
from iris_sysid.cli import app
from iris_sysid.errors import IrisError
from tests._project import ROOT

PAGE = (ROOT / "docs" / "guide" / "own_model.md").read_text("utf-8")
COMMANDS = [line for line in PAGE.splitlines() if line.startswith("iris-sysid ")]
PYTHON = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def table(path, quantity, t_s, values, noise, inputs=None):
    seen = (values + noise * np.random.default_rng(0).standard_normal(t_s.size))[:, None]
    clip = Trajectory(t_s, (quantity,), seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool))
    if inputs is not None:
        clip = clip.with_(input_quantities=(Quantity("u", "V"),), inputs=inputs[:, None])
    write_trajectory(clip, path)


def motor(inputs):
    """The speed (n,) after each tenth of a second of w' = -2 w + 3 u, with u held in between."""
    speed = [0.5]
    for u in inputs[:-1]:
        speed.append(1.5 * u + (speed[-1] - 1.5 * u) * np.exp(-0.2))
    return np.array(speed)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t_s = np.arange(400) / 60
    rates = lambda t, s: [s[1], -9.81 / 0.5 * np.sin(s[0]) - 0.15 * s[1]]  # noqa: E731
    for name, start in (("swing.csv", [1.2, 0.3]), ("swing2.csv", [0.5, -0.2])):
        theta = solve_ivp(rates, (0, t_s[-1]), start, "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
        table(name, Quantity("theta", "rad"), t_s, theta, 2e-3)
    for seed, name in enumerate(("motor.csv", "motor2.csv")):
        u = np.repeat(np.random.default_rng(seed).uniform(-1, 1, 50), 4)
        table(name, Quantity("w", "rad"), np.arange(200) / 10, motor(u), 1e-2, u)
    return tmp_path


def output_of(command):
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_commands_of_the_guide_find_the_truth(folder):
    swing, diagnosed, driven = map(output_of, COMMANDS)
    assert float(re.search(r"^L\s+([\d.]+)", swing, re.MULTILINE)[1]) == pytest.approx(0.5, rel=2e-3)
    assert (folder / "fit.png").stat().st_size > 10_000
    assert (folder / "diagnosis" / "report.html").exists()
    assert "good" in diagnosed
    assert float(re.search(r"^k\s+([\d.]+)", driven, re.MULTILINE)[1]) == pytest.approx(2.0, rel=0.02)
    assert float(re.search(r"fit ([\d.]+) %", driven)[1]) > 95


@pytest.mark.parametrize("code", PYTHON)
def test_python_of_the_guide_runs(folder, code, capsys):
    exec(compile(code, "own_model.md", "exec"), {"__name__": "guide"})
    assert capsys.readouterr().out


def test_hold_decides_how_inputs_go_on_between_samples(folder):
    from iris_sysid import fit, model_from_equation

    model = model_from_equation("w' = -k*w + b*u")
    clip = read_trajectory("motor.csv")
    held, drawn = (fit(clip.with_(hold=hold), model) for hold in ("zero-order", "linear"))
    assert held.estimates["k"].value == pytest.approx(2.0, abs=4 * held.estimates["k"].stderr)
    assert drawn.rms[0] > 2 * held.rms[0]
    found = validate_fit(held, read_trajectory("motor2.csv").with_(hold="zero-order"))
    assert found.rms[0] == pytest.approx(1e-2, rel=0.2)
    assert found.fit_percent[0] == pytest.approx(100 * (1 - 1e-2 / np.std(motor_record())), abs=1)


def test_a_delayed_input_in_the_text_is_fitted_diagnosed_and_planned(folder):
    from iris_sysid import SetUpChange, diagnose, model_from_equation, plan
    from iris_sysid.diagnosis.planning.rivals import Question

    t_s, tau = np.arange(900) / 30, 0.15
    given = lambda t: np.sin(1.3 * max(t, 0.0)) + 0.5 * np.sin(2.9 * max(t, 0.0) + 1.0)  # noqa: E731
    rates = lambda t, s: [s[1], -9 * s[0] - 0.3 * s[1] - 0.4 * abs(s[1]) * s[1] + 3 * given(t - tau)]  # noqa: E731
    x = solve_ivp(rates, (0, t_s[-1]), [0.1, 0.0], "DOP853", t_s, rtol=1e-10, atol=1e-12, max_step=0.02).y[0]
    table("late.csv", Quantity("x", "m"), t_s, x, 2e-3, np.array([given(t) for t in t_s]))
    text = "x'' = -k*x - c*x' + b*u(t - tau)"
    fitted = output_of(f'iris-sysid fit late.csv --equation "{text}" --hold linear -o late.json')
    assert re.search(r"^tau +0\.1\d* .* s ", fitted, re.MULTILINE)
    record, effects = read_trajectory("late.csv"), ("quadratic-drag", "coulomb-friction", "input-delay")
    found = diagnose(record, model_from_equation(text), effects=effects)
    assert [effect.name for effect in found.added] == ["quadratic-drag"]
    delay = found.final.estimates["tau"]
    assert abs(delay.value - tau) < 4 * delay.stderr < 0.01
    question = Question(model_from_equation(text), ("quadratic-drag", "coulomb-friction"))
    planned = plan(question, record, changes=[SetUpChange("drive-2", "drive it harder", driven=2.0)])
    assert planned.proposals[0].power > 0.9


def motor_record():
    return read_trajectory("motor2.csv").position[:, 0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ('--model pendulum --equation "x\' = 1"', "give --model or --equation, not both"),
        ("--model pendulum --bound L=0:1", "--bound is about the parameters of --equation"),
        ('--equation "x\' = 2x"', "column 7 .*operator is missing before x"),
        ('--equation "theta\' = k" --bound k=1', "cannot read the bounds 'k=1'"),
        ('--equation "theta\' = k" --bound m=1:2', "bounds: the equation has no 'm'; it has k"),
        ('--equation "theta\' = k" --hold cubic', "inputs between samples are held: zero, linear, auto"),
        ("--model auto --validate swing2.csv", "--hold, --validate and --posterior need the name of a model"),
    ],
)
def test_options_that_cannot_be_kept_are_refused(folder, options, message):
    with pytest.raises(IrisError, match=message):
        output_of(f"iris-sysid fit swing.csv {options} -o x.json")
