"""Heavy packages are imported only where they are used: what each quick command leaves alone."""

import subprocess
import sys

import pytest

from tests._project import ROOT

HEAVY = {"numba", "scipy", "cv2", "av", "pandas", "lmfit", "matplotlib", "jinja2", "rich", "pysindy", "sklearn"}


def loaded(*arguments: str, among: set[str] = HEAVY) -> set[str]:
    """The packages among the heavy ones that a command has imported when it ends, whether it succeeds or not."""
    code = (
        f"import sys; sys.argv = ['iris-sysid', *{arguments!r}]\n"
        "import contextlib, io, iris_sysid.cli\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "    iris_sysid.cli.main()\n"
        f"print(*sorted(set({sorted(among)!r}) & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "arguments",
    [
        ("list",),
        ("schema", "fit"),
        ("fit", "none.csv", "--model", "pendulum", "-o", "none.json"),
        ("diagnose", "none.csv", "--model", "pendulum", "-o", "none"),
        ("discover", "none.csv", "-o", "none.json"),
        ("smooth", "none.csv", "-o", "smoothed.csv"),
        ("calibrate", "none.mp4", "--board", "9x6", "--square", "25mm", "-o", "none.json"),
        ("gt", "none", "-o", "none.json"),
        ("benchmark", "none", "-o", "tables"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_command_that_computes_nothing_loads_nothing_heavy(arguments):
    assert loaded(*arguments) == set()


@pytest.mark.parametrize("command", ["", "run", "diagnose"])
def test_help_loads_no_arrays_either(command):
    light = {"rich", "pydantic"} if command else set()
    assert loaded(*command.split(), "--help", among=HEAVY | {"numpy", "pydantic"}) <= light


def test_clip_that_cannot_be_read_is_reported_before_trackers_and_fitters_are_loaded():
    assert loaded("run", "none.mp4", "--phenomenon", "pendulum", "-o", "none") <= {"av", "cv2"}


def test_import_of_the_package_loads_nothing_heavy():
    code = f"import sys, iris_sysid; print(*sorted(set({sorted(HEAVY | {'numpy'})!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == []


def test_suggestions_of_a_residual_import_neither_pysindy_nor_the_statistics_of_scipy():
    code = "import sys, fitters.sindy.proposals; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert {"pysindy", "sklearn", "scipy.stats"} & set(done.stdout.split()) == set()
