"""The targets of the Makefile do what they say."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests._project import ROOT

TARGETS = {
    *("demo", "test", "test-slow", "test-lowest", "test-versions", "lint", "format", "validation", "torture", "fuzz"),
    *("docs", "wheel", "sbom", "constraints", "clean"),
}
CONSTRAINTS = [
    "constraints.txt",
    "tests/constraints.txt",
    "docs/constraints.txt",
    "tests/fuzz/constraints.txt",
    ".ci/constraints.txt",
]
PIN = re.compile(r"[\w.-]+==[\w.!+]+( ; [\w\s'.<>=!]+)?( --hash=sha256:[0-9a-f]{64})+")
ROW = re.compile(r"^(\w+) +\S+ +\S+ +\S+ +\S+ +(-?[\d.]+)$", re.MULTILINE)  # parameter, ..., off in standard errors


def made(target, **variables):
    """Make a target with the Python that runs the tests, without setting anything up."""
    settings = [f"{name}={value}" for name, value in {"BIN": Path(sys.executable).parent, **variables}.items()]
    command = ["make", "--old-file", ".venv/ready", *settings, target]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, encoding="utf-8")


def test_makefile_has_the_documented_targets():
    text = (ROOT / "Makefile").read_text("utf-8")
    assert set(re.findall(r"^([a-z-]+):", text, re.MULTILINE)) == TARGETS


def test_ci_runs_the_linters_the_fast_and_the_slow_tests():
    text = (ROOT / ".ci" / "run").read_text("utf-8")
    assert re.findall(r"^make ([\w-]+)$", text, re.MULTILINE) == ["lint", "test", "test-slow"]
    assert "export CI=true" in text


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_constraints_pin_every_package_by_hash_and_name_no_address(name):
    lines = re.sub(r" *\\\n +", " ", (ROOT / name).read_text("utf-8")).splitlines()
    assert [line for line in lines if not PIN.fullmatch(line)] == []


def test_constraints_pin_what_pyproject_asks_for():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    asked = {
        "constraints.txt": project["project"]["dependencies"],
        "tests/constraints.txt": [*project["dependency-groups"]["dev"], *project["dependency-groups"]["test"]],
    }
    for name, requirements in asked.items():
        pinned = re.findall(r"^[\w.-]+", (ROOT / name).read_text("utf-8"), re.MULTILINE)
        names = [each for each in requirements if isinstance(each, str)]  # and groups that are in it
        assert {re.match(r"[\w.-]+", name)[0] for name in names} <= set(pinned)


@pytest.mark.slow
def test_make_demo_finds_the_hidden_drag_and_the_values_come_right(tmp_path):
    done = made("demo", DEMO=tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    assert "quadratic drag" in done.stdout
    off = dict(ROW.findall(done.stdout))  # of the second table, with the effect: it comes last
    assert set(off) == {"length", "damping", "quadratic_drag"}
    # three normal values: one in 700 beyond 3.5 by chance; without the effect the damping is off by hundreds
    assert all(abs(float(value)) < 3.5 for value in off.values()), off
    pages = re.findall(r"^open (.*)$", done.stdout, re.MULTILINE)
    assert [Path(page).is_file() for page in pages] == [True, True]
