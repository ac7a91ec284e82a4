"""Records of inputs and outputs from files as benchmarks ship them: the commands and the Python of the guide."""

import json
import re
import shlex
import zlib

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread
from scipy.integrate import solve_ivp
from scipy.io import savemat
from typer.testing import CliRunner

from iris_sysid import (
    MODELS,
    Quantity,
    Trajectory,
    diagnose,
    fit,
    model_from_equation,
    read_trajectory,
    split_record,
    validate_fit,
)
from iris_sysid.cli import _records, app
from iris_sysid.errors import DataError, IrisError
from tests._project import ROOT

PAGE = (ROOT / "docs" / "guide" / "records.md").read_text("utf-8")
COMMANDS = [line for line in PAGE.splitlines() if line.startswith("iris-sysid ")]
PYTHON = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
(OUTPUT,) = re.findall(r"```text\n(.*?)\n```", PAGE, re.DOTALL)
MODEL = "w' = -k*w + b*u"
STEP_S, NOISE = 0.1, 1e-2
MATLAB = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


def motor(seed, n=240):
    """Input (n,) held in between and the noisy speed (n,) of w' = -2 w + 3 u, solved in closed form."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 4), 4)
    speed = [0.5]
    for value in u[:-1]:
        speed.append(1.5 * value + (speed[-1] - 1.5 * value) * np.exp(-2.0 * STEP_S))
    return u, np.array(speed) + NOISE * rng.standard_normal(n)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed, name in enumerate(("motor.csv", "motor2.csv")):
        u, w = motor(seed)
        rows = "\n".join(f"{k * STEP_S!r},{float(u[k])!r},{float(w[k])!r}" for k in range(u.size))
        (tmp_path / name).write_text(f"t_s,u_V,w_rad\n{rows}\n")
    u, w = motor(0)
    savemat("rig.mat", {"voltage": u[:, None], "speed": w[None, :], "Ts": STEP_S, "note": "a rig", "gains": [1.0, 2.0]})
    np.save("rig.npy", np.column_stack([u, w]))
    return tmp_path


def output_of(command):
    result = CliRunner().invoke(app, shlex.split(command)[1:])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_commands_of_the_guide_find_the_truth_and_write_the_validation(folder):
    fitted, diagnosed, _, _, _, looked = map(output_of, COMMANDS)
    assert "inputs between samples: held" in fitted
    assert float(re.search(r"^k\s+([\d.]+)", fitted, re.MULTILINE)[1]) == pytest.approx(2.0, rel=0.03)
    assert (folder / "white.png").stat().st_size > 10_000
    one, two = (json.loads((folder / name).read_text()) for name in ("motor.json", "rig.json"))
    assert one["validation"]["record"] == "motor2.csv"
    assert one["validation"]["rms"][0] == pytest.approx(NOISE, rel=0.2)
    assert one["validation"]["linear"]["order"] == 1
    assert two["validation"]["n"] == pytest.approx(0.3 * 240, abs=1)
    said = OUTPUT.splitlines()
    assert [line for line in fitted.splitlines() if line.startswith(("validation", "residual", "inputs"))] == said
    document = json.loads((folder / "diagnosis" / "diagnosis.json").read_text())
    assert document["validation"]["fit_percent"][0] > 95
    assert "Validation on a record that was not used" in (folder / "diagnosis" / "report.html").read_text("utf-8")
    assert "lie outside the 99 % bands" in diagnosed
    assert "1 look by 1 model" in looked
    assert float(re.search(r"simulation error ([\d.]+)", looked)[1]) == pytest.approx(NOISE, rel=0.3)


@pytest.mark.parametrize("code", PYTHON)
def test_python_of_the_guide_runs(folder, code, capsys):
    exec(compile(code, "records.md", "exec"), {"__name__": "guide"})
    assert capsys.readouterr().out


def test_the_figure_of_the_guide_is_what_its_command_draws(folder):
    output_of(COMMANDS[0])
    shown, drawn = (imread(path)[:, :, :3] for path in (ROOT / "docs" / "guide" / "records.png", "white.png"))
    assert shown.shape == drawn.shape
    assert np.mean(np.abs(shown - drawn)) < 0.01
    assert np.mean(shown < 0.9) > 0.02  # not a blank picture, which would be close to any


def test_draws_of_the_posterior_are_written_and_summarised(folder):
    pytest.importorskip("emcee")
    command = f'iris-sysid fit motor.csv --equation "{MODEL}" --hold zero --posterior draws.csv -o motor.json'
    (folder / "draws.csv").write_text("of another fit\n")
    with pytest.raises(IrisError, match=r"draws\.csv exists already; give another name, or --force"):
        output_of(command)
    said = output_of(f"{command} --force")
    draws = pd.read_csv("draws.csv")
    assert list(draws.columns)[2] == "w_0 [rad]"
    estimates = json.loads((folder / "motor.json").read_text())["parameters"]
    assert draws["k [1]"].std() == pytest.approx(estimates["k"]["stderr"], rel=0.2)
    assert "effective_draws" in said


# --------------------------------------------------------------------------- files


def test_mat_npy_and_csv_give_the_same_record(folder):
    columns = {"u[V]": "voltage", "w[rad]": "speed"}
    table, matlab = read_trajectory("motor.csv"), read_trajectory("rig.mat", columns)
    numpy = read_trajectory("rig.npy", {"t[0.1 s]": "row", "u[V]": "1", "w[rad]": "2"})
    for other in (matlab, numpy):
        assert np.array_equal(other.position, table.position)
        assert np.array_equal(other.inputs, table.inputs)
        assert other.t_s == pytest.approx(table.t_s)
        assert [q.unit for q in (*other.quantities, *other.input_quantities)] == ["rad", "V"]


def test_an_input_without_a_unit_is_an_input_and_only_the_time_need_be_stated(folder):
    (folder / "bare.csv").write_text("u,y\n" + "\n".join(f"{k % 3},{k}" for k in range(30)) + "\n")
    record = read_trajectory("bare.csv", {"t[0.5 s]": "row"})
    assert [q.name for q in record.input_quantities] == ["u"]
    assert [q.name for q in record.quantities] == ["y"]
    assert record.t_s[2] == pytest.approx(1.0)
    (folder / "own.csv").write_text("t_s,u,w_rad\n0,1,2\n1,1,3\n")
    assert read_trajectory("own.csv").inputs.tolist() == [[1.0], [1.0]]


def test_sample_time_is_an_option_of_the_commands(folder):
    u, w = motor(0)
    rows = "\n".join(f"{float(a)!r},{float(b)!r}" for a, b in zip(u, w, strict=True))
    (folder / "even.csv").write_text(f"u_V,w_rad\n{rows}\n")
    said = output_of(f'iris-sysid fit even.csv --sample-time 100ms --equation "{MODEL}" -o even.json')
    assert float(re.search(r"^k\s+([\d.]+)", said, re.MULTILINE)[1]) == pytest.approx(2.0, rel=0.02)


@pytest.mark.slow
def test_discover_and_plan_take_bare_tables_and_the_hold(folder):
    u, w = motor(0)
    rows = "\n".join(f"{float(a)!r},{float(b)!r}" for a, b in zip(u, w, strict=True))
    (folder / "even.csv").write_text(f"u_V,w_rad\n{rows}\n")
    said = output_of("iris-sysid discover even.csv --sample-time 100ms -o found.json")
    assert "inputs between samples: held" in said
    assert json.loads((folder / "found.json").read_text())["equations"]
    equation = f'--equation "{MODEL}"'
    output_of(f"iris-sysid diagnose even.csv --sample-time 100ms --hold zero {equation} -o diagnosis")
    told = [
        output_of(f"iris-sysid plan diagnosis even.csv --sample-time 100ms --name input-delay {end}")
        for end in ("--name nothing", "--name nothing --hold zero", "--name nothing --hold linear")
    ]
    assert told[0] == told[1] != told[2]


def test_structures_and_a_sampling_rate_of_a_mat_file_are_read(folder):
    u, w = motor(0)
    savemat("nested.mat", {"data": {"u": u, "y": w, "fs": 10.0}})
    record = read_trajectory("nested.mat", {"t": "t (s)", "u[V]": "data.u", "w[rad]": "data.y"})
    assert np.diff(record.t_s) == pytest.approx(STEP_S)


def test_named_fields_of_a_npy_file_are_its_columns(folder):
    u, w = motor(0)
    fields = np.zeros(u.size, dtype=[("voltage", "f4"), ("speed", "f8"), ("who", "U4")])
    fields["voltage"], fields["speed"] = u, w
    np.save("fields.npy", fields[["voltage", "speed"]])
    record = read_trajectory("fields.npy", {"t[0.1 s]": "row", "u[V]": "voltage", "w[rad]": "speed"})
    assert record.position[:, 0].tolist() == w.tolist()
    assert record.inputs[:, 0] == pytest.approx(u, abs=1e-6)
    np.save("fields.npy", fields)
    record = read_trajectory("fields.npy", {"t[0.1 s]": "row", "u[V]": "voltage", "w[rad]": "speed"})
    assert record.position[:, 0].tolist() == w.tolist()
    np.save("fields.npy", fields["who"])
    with pytest.raises(DataError, match=r"no columns of numbers \(arrays: <U4 \(240,\)\); save the columns as CSV"):
        read_trajectory("fields.npy", {"t[0.1 s]": "row"})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x93NUMPY\x01\x00", "cannot be read as a .npy file"),
        (b"\x89HDF\r\n\x1a\n" + bytes(200), "version 7.3, which is not read"),
        (
            b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\x0e\x00\x00\x00\xff\xff\x00\x00",
            "cannot be read as a",
        ),
    ],
)
def test_damaged_files_are_refused(folder, content, message):
    (folder / "bad.mat").write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_trajectory("bad.mat", {"t[1 s]": "row"})


def test_objects_are_never_unpickled(folder):
    np.save("objects.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match=r"cannot be read as a \.npy file: Object arrays cannot be loaded"):
        read_trajectory("objects.npy", {"t[1 s]": "row"})


def test_a_mat_file_that_unpacks_to_too_much_is_refused(folder, monkeypatch):
    monkeypatch.setattr("iris_sysid.io.array_files.MAX_BYTES", 10_000)
    packed = zlib.compress(bytes(20_000))
    (folder / "bomb.mat").write_bytes(MATLAB + (15).to_bytes(4, "little") + len(packed).to_bytes(4, "little") + packed)
    with pytest.raises(DataError, match="unpacks to more than"):
        read_trajectory("bomb.mat", {"t[1 s]": "row"})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--sample-time soon", "cannot read the sample time 'soon'"),
        ("--sample-time 1s --columns t=x", "both state the time"),
        ("--validate 99.9%", "leaves 240 to validate with and 0 to fit"),
        ("--validation-plot a.png", "draws what --validate simulates"),
        ("--posterior a.txt", "it will be a .csv file"),
        ("--hold cubic", "held: zero, linear, auto"),
    ],
)
def test_options_that_cannot_be_kept_are_refused(folder, options, message):
    with pytest.raises(IrisError, match=message):
        output_of(f'iris-sysid fit motor.csv --equation "{MODEL}" {options} -o x.json')


# --------------------------------------------------------------------------- the validation itself


def record_of(u, y, hold="zero-order"):
    unknown = np.full((y.size, 1), np.nan)
    ticks, valid = np.arange(y.size) * STEP_S, np.ones(y.size, bool)
    quantity, given = Quantity("w", "rad"), (Quantity("u", "V"),)
    return Trajectory(ticks, (quantity,), y[:, None], unknown, valid, given, u[:, None], hold=hold)


def test_residual_of_the_right_model_is_white_and_that_of_a_wrong_one_is_not():
    estimation, validation = split_record(record_of(*motor(3, 2000)), 0.5)
    right, wrong = (
        validate_fit(fit(estimation, model_from_equation(text)), validation) for text in (MODEL, "w' = -k*w")
    )
    assert right.coloured[0] < 0.1
    assert right.input_left[0, 0] < 0.1
    assert wrong.coloured[0] > 0.2
    assert wrong.inputs == ()
    bent = validate_fit(fit(estimation, model_from_equation("w' = -k*w*abs(w) + b*u")), validation)
    assert bent.input_left[0, 0] > 0.1


def test_linear_model_of_the_same_order_reaches_the_noise_of_a_linear_system_and_not_of_another():
    estimation, validation = split_record(record_of(*motor(4, 1200)), 0.4)
    linear = validate_fit(fit(estimation, model_from_equation(MODEL)), validation, estimation).linear
    assert linear.order == 1
    assert linear.rms[0] == pytest.approx(NOISE, rel=0.1)
    u, w = motor(4, 1200)
    estimation, validation = split_record(record_of(u, w + 0.4 * w**2), 0.4)
    assert validate_fit(fit(estimation, model_from_equation(MODEL)), validation, estimation).linear.rms[0] > 5 * NOISE


def test_correlations_agree_with_numpy_and_tell_which_comes_first():
    from fitters.validation_record import correlations

    rng = np.random.default_rng(0)
    u = rng.standard_normal((4000, 1))
    late = np.roll(u, 3, axis=0) + 0.1 * rng.standard_normal(u.shape)
    own, crossed = correlations(late, u, lags=10)
    assert own[0, 0] == pytest.approx(1.0)
    assert int(np.argmax(crossed[0, 0])) - 10 == 3
    expected = np.corrcoef(late[5:, 0], late[:-5, 0])[0, 1]
    assert own[0, 5] == pytest.approx(expected, abs=5e-3)


def test_bands_hold_99_percent_of_the_correlations_of_white_noise_with_a_slow_input():
    from fitters.validation_record import _input_bands, correlations

    rng, outside = np.random.default_rng(1), []
    for _ in range(200):
        u = np.repeat(rng.standard_normal((60, 1)), 10, axis=0)
        own, crossed = correlations(rng.standard_normal((600, 1)), u)
        outside.append(abs(crossed[0, 0]) > _input_bands(own, u, 600)[0, 0])
    assert np.mean(outside) == pytest.approx(0.01, abs=0.01)


@pytest.mark.slow
def test_effects_that_are_found_tell_the_hold_of_the_inputs_otherwise():
    """SciPy pushes a hardening spring by a force on a line; without the effect held inputs fit as well."""
    model, t_s = MODELS["driven-oscillator"], np.arange(1000) / 200
    force = 3 * np.sin(2 * np.pi * (0.5 + 0.25 * t_s) * t_s)

    def rates(t, state):
        z, v = state
        return [v, (np.interp(t, t_s, force) - 0.9 * v - 210 * z - 6e4 * z**3) / 0.35]

    z = solve_ivp(rates, (0, t_s[-1]), (0, 0), t_eval=t_s, rtol=1e-8, atol=1e-10, max_step=5e-3).y[:1].T
    z = z + 1.5e-4 * np.random.default_rng(1).standard_normal(z.shape)
    known = {"inputs": force[:, None], "input_quantities": (Quantity("u", "N"),), "hold": "zero-order"}
    clip = Trajectory(t_s, model.observed, z, np.full_like(z, np.nan), np.ones(t_s.size, bool), **known)

    def search(clips):
        return diagnose(clips, model, effects=["cubic-stiffness"])

    (clip,), found = _records.diagnosed([clip], search, "auto")
    assert (clip.hold, [effect.name for effect in found.added]) == ("linear", ["cubic-stiffness"])
    for name, value in {"mass": 0.35, "damping": 0.9, "stiffness": 210.0}.items():
        assert abs(found.final.estimates[name].value - value) < 3 * found.final.estimates[name].stderr, name
    assert _records.diagnosed([clip], search, "zero")[0] == [clip]
