"""A sealed test record: no search reads it, each look is logged, and the frozen model simulates it."""

import json

import numpy as np
import pandas as pd
import pytest

from fitters.validation_record import cut_record
from iris_sysid import Quantity, Trajectory, fit, model_from_equation, read_trajectory, validate_fit
from iris_sysid.errors import DataError, FitError, OutputError
from iris_sysid.io.sealed_record import counted, log_look, log_of, looks_in, open_sealed, seal
from tests._motions import on_arc, pendulum_angle
from tests.cli.test_records import MODEL, NOISE, STEP_S, motor, output_of

N, KEPT = 300, 80
SEAL = f"iris-sysid sealed rig.csv --keep {KEPT} -o parts"
FIT = f'iris-sysid fit parts/estimation.csv --equation "{MODEL}" --hold zero -o fit.json'
LOOK = "iris-sysid sealed parts/test.sealed --fit fit.json"


def record(seed=0, n=N):
    u, w = motor(seed, n)
    t_s, unknown = np.arange(n) * STEP_S, np.full((n, 1), np.nan)
    given = {"input_quantities": (Quantity("u", "V"),), "inputs": u[:, None], "hold": "zero-order"}
    return Trajectory(t_s, (Quantity("w", "rad"),), w[:, None], unknown, np.ones(n, bool), **given)


@pytest.fixture
def rig(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    u, w = motor(0, N)
    rows = "\n".join(f"{k * STEP_S!r},{float(u[k])!r},{float(w[k])!r}" for k in range(N))
    (tmp_path / "rig.csv").write_text(f"t_s,u_V,w_rad\n{rows}\n")
    output_of(SEAL)
    output_of(FIT)
    return tmp_path


def test_the_estimation_record_ends_where_the_sealed_one_begins(rig):
    whole, estimation = read_trajectory("rig.csv"), read_trajectory("parts/estimation.csv")
    test, _ = open_sealed("parts/test.sealed", "0" * 64, "none")
    assert estimation.n == N - KEPT
    assert np.array_equal(np.concatenate([estimation.position, test.position]), whole.position)
    assert np.array_equal(np.concatenate([estimation.inputs, test.inputs]), whole.inputs)
    assert np.array_equal(np.concatenate([estimation.t_s, test.t_s]), whole.t_s)


def test_no_other_command_reads_a_sealed_record(rig):
    with pytest.raises(DataError, match="is sealed: iris-sysid sealed"):
        read_trajectory("parts/test.sealed")
    with pytest.raises(DataError, match="is sealed"):
        output_of(FIT.replace("parts/estimation.csv", "parts/test.sealed").replace("fit.json", "two.json"))
    assert not log_of("parts/test.sealed").exists()


@pytest.mark.parametrize("options", ["", "--initial 5", "--after parts/estimation.csv", "--initial 5 --after rig.csv"])
def test_a_look_simulates_the_frozen_model_and_is_logged(rig, options):
    if "rig.csv" in options:
        with pytest.raises(DataError, match="must follow it"):
            output_of(f"{LOOK} {options}")
    else:
        output_of(f"{LOOK} {options} -o look.json --validation-plot white.png")
        found = json.loads((rig / "look.json").read_text())["validation"]
        assert found["rms"][0] == pytest.approx(NOISE, rel=0.3)
        assert found["record"] == "test.sealed, 1 look by 1 model"
        assert (rig / "white.png").stat().st_size > 10_000
    assert [look.look for look in looks_in(log_of("parts/test.sealed"))] == [1]  # one that fails counts


def test_looks_by_the_same_model_count_as_looks_but_as_one_model(rig):
    output_of(LOOK)
    output_of(LOOK)
    output_of(f'{FIT.replace("fit.json", "two.json")} --set "k=1.9"')
    output_of(LOOK.replace("fit.json", "two.json"))
    assert counted(looks_in(log_of("parts/test.sealed"))) == "3 looks by 2 models"
    shown = output_of("iris-sysid sealed parts/test.sealed")
    assert "two.json" in shown
    assert "3 looks by 2 models" in shown


def test_a_diagnosis_is_simulated_with_the_effects_that_it_added(rig):
    u, w = motor(0, N)
    rows = "\n".join(f"{k * STEP_S!r},{float(u[k])!r},{float(w[k]) + 0.2!r}" for k in range(N))
    (rig / "moved.csv").write_text(f"t_s,u_V,w_rad\n{rows}\n")
    output_of(SEAL.replace("rig.csv", "moved.csv").replace("parts", "moved"))
    output_of(f'iris-sysid diagnose moved/estimation.csv --equation "{MODEL}" --hold zero -o found')
    assert json.loads((rig / "found" / "diagnosis.json").read_text())["added"]
    output_of(f"{LOOK.replace('parts', 'moved').replace('fit.json', 'found')} -o look.json")
    document = json.loads((rig / "look.json").read_text())
    assert document["validation"]["rms"][0] == pytest.approx(NOISE, rel=0.3)


# --------------------------------------------------------------------------- the log


def test_a_log_that_was_changed_is_refused_and_the_record_stays_closed(tmp_path):
    log = tmp_path / "test.sealed.looks"
    for model in ("a", "b", "c"):
        log_look(log, "r" * 64, model * 64, model)
    lines = log.read_bytes().splitlines(keepends=True)
    for changed in (lines[1:], [lines[0], lines[2]], [lines[0].replace(b"aaaa", b"bbbb"), *lines[1:]], [b"[]\n"]):
        log.write_bytes(b"".join(changed))
        with pytest.raises(DataError, match="restore the log"):
            log_look(log, "r" * 64, "d" * 64, "d")


def test_two_looks_at_once_are_refused_rather_than_lost(tmp_path):
    log = tmp_path / "test.sealed.looks"
    (tmp_path / "test.sealed.looks.lock").touch()
    with pytest.raises(OutputError, match="another look is being logged"):
        log_look(log, "r" * 64, "a" * 64, "a")
    assert not log.exists()


def test_a_record_that_was_looked_at_is_never_replaced(tmp_path):
    path = seal(record(), tmp_path / "test.sealed")
    open_sealed(path, "a" * 64, "a")
    with pytest.raises(OutputError, match="was looked at"):
        seal(record(1), path, overwrite=True)


@pytest.mark.parametrize("data", [b"", b"t_s,w_rad\n0,1\n", b"\x1f\x8b\x08\x00cut", None])
def test_a_file_that_is_no_sealed_record_is_refused(tmp_path, data):
    path = tmp_path / "test.sealed"
    if data is None:
        data = seal(record(), path).read_bytes()[:-20]
    path.write_bytes(data)
    with pytest.raises(DataError):
        open_sealed(path, "a" * 64, "a")


@pytest.mark.parametrize("options", ["", "--keep many", "--keep 99%", "--keep 2.5", "--keep 20% --fit fit.json"])
def test_what_cannot_be_sealed_is_said_before_anything_is_written(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    u, w = motor(0, N)
    rows = "\n".join(f"{k * STEP_S!r},{float(u[k])!r},{float(w[k])!r}" for k in range(N))
    (tmp_path / "rig.csv").write_text(f"t_s,u_V,w_rad\n{rows}\n")
    if options:
        with pytest.raises(DataError):
            output_of(f"iris-sysid sealed rig.csv {options} -o parts")
    else:
        assert "0 looks" in output_of("iris-sysid sealed rig.csv")
    assert not (tmp_path / "parts").exists()


# --------------------------------------------------------------------------- the window and the state that continues


def test_the_window_sets_the_state_and_is_not_scored():
    estimation, test = cut_record(record(), KEPT)
    fitted = fit(estimation, model_from_equation(MODEL, units={"w": "rad", "u": "V"}))
    wild = test.position.copy()
    wild[:5] += 1.0  # a state that is wrong at first: the error decays after the window
    wrong = test.with_(position=wild)
    assert validate_fit(fitted, wrong, initial=5).rms[0] > 5 * NOISE
    assert validate_fit(fitted, wrong, estimation, initial=5, continues=True).rms[0] == pytest.approx(NOISE, rel=0.3)
    with pytest.raises(DataError, match="leave"):
        validate_fit(fitted, test, initial=70)
    with pytest.raises(FitError):
        validate_fit(fitted, test, initial=1)


def test_sealed_record_of_x_and_z_takes_a_model_of_the_angle(cli, tmp_path):
    t_s = np.arange(0.0, 6.0, 0.02)
    place = on_arc(pendulum_angle(t_s, 0.4, 0.5), 0.5) + 3e-4 * np.random.default_rng(1).standard_normal((t_s.size, 2))
    table = tmp_path / "swing.csv"
    pd.DataFrame({"t_s": t_s, "x_m": place[:, 0], "z_m": place[:, 1]}).to_csv(table, index=False)
    assert cli("sealed", table, "--keep", "25%", "-o", tmp_path).status == 0
    frozen = ("fit", tmp_path / "estimation.csv", "--model", "pendulum", "-o", tmp_path / "frozen.json")
    assert cli(*frozen).status == 0
    looked = cli("sealed", tmp_path / "test.sealed", "--fit", tmp_path / "frozen.json", "--initial", "10")
    assert looked.status == 0, looked.err
    assert "sealed record theta: simulation error" in looked.out + looked.err
