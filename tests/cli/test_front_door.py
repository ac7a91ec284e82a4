"""What every user meets: help, version, the verdict and its exit status, options by name, the next command."""

import platform
import re
import subprocess
import sys
from importlib.abc import MetaPathFinder

import numpy as np
import pandas as pd
import pytest

from iris_sysid import __main__ as program
from iris_sysid import cli as command_line
from iris_sysid.cli._terminal import NOT_GOOD
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import DiagnosisDocument
from tests._documents import read_fit


@pytest.fixture(scope="module")
def kinked(angles, tmp_path_factory):
    """A table of a swing whose second half runs by another equation."""
    table = tmp_path_factory.mktemp("kinked") / "kinked swing.csv"
    swing = pd.read_csv(angles)
    late = swing["t_s"] > swing["t_s"].median()
    swing.loc[late, "theta_rad"] = 0.3 * np.cos(7.0 * swing["t_s"])
    swing.to_csv(table, index=False)
    return table


@pytest.mark.parametrize("arguments", [["-h"], ["fit", "-h"], ["list", "-h"]])
def test_short_help_is_help(arguments, cli):
    assert cli(*arguments).out == cli(*arguments[:-1], "--help").out


def test_version_is_that_of_the_package(cli):
    outcome = cli("--version")
    assert (outcome.status, outcome.out.split()[0]) == (0, "iris-sysid")
    assert outcome.out.split()[1][0].isdigit()


def test_completion_knows_the_commands(cli, monkeypatch):
    monkeypatch.setenv("_IRIS_SYSID_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "iris-sysid dia")
    monkeypatch.setenv("COMP_CWORD", "1")
    assert cli().out.split() == ["diagnose"]


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("run clip.mp4 --phenomenon pe", ["pendulum"]),
        ("class clips --phenomenon dro", ["dropping-ball"]),
        ("fit a.csv --model li", ["linear-oscillator", "linear-pendulum"]),
        ("fit a.csv --model = li", ["linear-oscillator", "linear-pendulum"]),  # as bash splits --model=li
        ("fit a.csv --hold = z", ["zero"]),
        ("diagnose a.csv --model au", ["auto"]),
        ("track clip.mp4 --tracker di", ["disc"]),
        ("render --effect quad", ["quadratic-drag="]),
        ("fit a.csv --hold z", ["zero"]),
        ("diagnose a.csv --sensor g", ["gauge"]),
    ],
)
def test_completion_knows_the_values_of_options(cli, monkeypatch, typed, completed):
    monkeypatch.setenv("_IRIS_SYSID_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", f"iris-sysid {typed}")
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split())))
    assert cli().out.split() == completed


def test_help_lists_every_command_in_one_group(cli):
    grouped = [name for names in command_line.GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(command_line.COMMANDS)
    shown = cli("--help").out
    assert [title for title in command_line.GROUPS if f"\n{title}:\n" in shown] == list(command_line.GROUPS)
    assert command_line.OTHERS not in shown


@pytest.mark.parametrize("command", command_line.COMMANDS)
def test_help_says_what_to_write_rather_than_a_type_of_python(command, cli):
    text = cli(command, "--help").out
    assert not re.findall(r"--\S+ <(?:list|str|int|float|path)", text)


def test_command_without_a_group_is_not_lost_from_the_help(cli, monkeypatch):
    monkeypatch.setattr(command_line, "GROUPS", {"One clip": ("run",)})
    assert f"\n{command_line.OTHERS}:\n" in cli("--help").out
    assert "  diagnose  " in cli("--help").out


def test_interrupt_is_said_in_one_line(cli, monkeypatch, angles, tmp_path):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("fitters.ode.fit", interrupted)
    outcome = cli("fit", angles, "--model", "pendulum", "-o", tmp_path / "fit.json")
    assert outcome.status == command_line.INTERRUPTED
    assert outcome.err.splitlines()[-1].startswith("iris-sysid: interrupted; no file is half-written")
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "fit.json").exists()


def test_interrupt_of_the_imports_is_said_in_one_line(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "iris_sysid.cli")
    monkeypatch.setattr(sys, "meta_path", [InterruptedImport(), *sys.meta_path])
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == command_line.INTERRUPTED
    assert capsys.readouterr().err == "iris-sysid: interrupted before anything began\n"


class InterruptedImport(MetaPathFinder):
    """Ctrl-C while the command line is imported."""

    def find_spec(self, name, path, target=None):
        if name == "iris_sysid.cli":
            raise KeyboardInterrupt


def test_strict_ends_with_its_own_status_unless_the_verdict_is_good(kinked, angles, tmp_path, cli):
    command = ["--model", "pendulum", "--strict", "-o", tmp_path / "fit.json", "--force"]
    bad, good = cli("fit", kinked, *command), cli("fit", angles, *command)
    assert (bad.status, good.status) == (NOT_GOOD, 0)
    assert "\nequation incomplete: it explains " in bad.out
    assert good.out.startswith("usable: length good to ")
    assert good.out.splitlines()[1].startswith("equation complete: it explains ")


def test_verdict_on_screen_is_that_of_the_file(kinked, tmp_path, cli):
    outcome = cli("fit", kinked, "--model", "pendulum", "-o", tmp_path / "fit.json")
    assert outcome.status == 0
    verdict = read_fit(tmp_path / "fit.json").verdict
    number, equation, *_ = outcome.out.splitlines()
    assert number.startswith("usable: " if verdict.word == "good" else f"{verdict.word}: ")
    assert equation.startswith(verdict.equation.completeness().text)
    assert verdict.reasons[0].remedy in equation


def test_next_command_quotes_the_real_paths_and_repeats_what_was_known(kinked, tmp_path, cli):
    outcome = cli("fit", kinked, "--model", "pendulum", "--set", "gravity=9.8", "-o", tmp_path / "fit.json")
    assert outcome.err.splitlines()[-1] == (
        f"next: iris-sysid diagnose '{kinked}' --model pendulum --set gravity=9.8 -o {tmp_path / 'diagnosis'}"
    )


def test_fit_that_is_not_determined_names_the_options(angles, tmp_path, cli):
    outcome = cli("fit", angles, "--model", "pendulum", "--free", "gravity", "-o", tmp_path / "fit.json")
    assert "--set length=VALUE or --set gravity=VALUE" in outcome.err
    assert outcome.out.startswith("doubtful: ")
    assert "fixed=" not in outcome.out + outcome.err


def test_folder_of_run_is_diagnosed_without_further_options(pendulum_clip, tmp_path, cli):
    assert cli("run", pendulum_clip, "--phenomenon", "pendulum", "-o", tmp_path / "run").status == 0
    outcome = cli("diagnose", tmp_path / "run", "-o", tmp_path / "run" / "diagnosis")
    assert outcome.status == 0, outcome.err
    document = read_document(tmp_path / "run" / "diagnosis" / "diagnosis.json", DiagnosisDocument)
    assert document.base.model == "pendulum"
    assert set(document.base.free) >= set(read_fit(tmp_path / "run" / "fit.json").free)


def test_table_alone_is_asked_for_its_model(angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "-o", tmp_path / "diagnosis")
    assert outcome.status == 2
    assert "only a folder of run can do without" in " ".join(outcome.err.split())


def test_diagnosis_chooses_the_model_when_asked(angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "--model", "auto", "-o", tmp_path / "diagnosis")
    assert outcome.status == 0, outcome.err
    assert "model: pendulum" in outcome.err
    document = read_document(tmp_path / "diagnosis" / "diagnosis.json", DiagnosisDocument)
    assert document.base.model == "pendulum"


def test_python_m_is_the_program():
    call = [sys.executable, "-m", "iris_sysid", "--version"]
    outcome = subprocess.run(call, capture_output=True, text=True, timeout=60)
    assert (outcome.returncode, outcome.stdout.split()[0]) == (0, "iris-sysid")


THREADS = """
import threading
from iris_sysid.cli import main

def reserved_mb():
    status = open("/proc/self/status").read()
    return int(status.split("VmSize:")[1].split()[0]) / 1024

def hold():
    piece = bytearray(1000)
    begun.wait(), ended.wait()

try:
    main()
except SystemExit:
    begun, ended, before = threading.Barrier(9), threading.Barrier(9), reserved_mb()
    for _ in range(8):
        threading.Thread(target=hold).start()
    begun.wait()
    print(reserved_mb() - before)
    ended.wait()
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="a pool of memory for each thread is glibc's way")
def test_threads_of_the_program_share_pools_of_memory():
    """A pool reserves 64 MB of addresses and a thread's stack 8 MB: 576 MB for eight threads with a pool each."""
    call = [sys.executable, "-c", THREADS, "--version"]
    outcome = subprocess.run(call, capture_output=True, text=True, timeout=60)
    assert float(outcome.stdout.split()[-1]) < 300, outcome.stdout + outcome.stderr
