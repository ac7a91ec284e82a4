"""The examples run as they are, and print what they promise."""

import os
import re
import subprocess
import sys

import pytest

from tests._project import ROOT, recording

EXAMPLES = {
    "one_clip.py": [
        r"^ +value +stderr +unit$",
        r"^length +0\.(499|500)\d* +0\.0000\d* +m$",
        r"^gravity +9\.80665\d* .* m/s\^2$",
        r"^report: one-clip.report.report\.html$",
    ],
    "hidden_effect.py": [
        r"^length +0\.(499|500|501)\d* ",
        r"(?i)\bcoulomb friction\b.*\(0\.1[45]\d* ± 0\.00\d* rad/s\^2",  # named, or in a group with the best of it
        r"^hidden was: coulomb-friction 0\.15$",
        r"^report: hidden-effect.diagnosis.report\.html$",
    ],
    "one_table.py": [
        r"^length +0\.(39|40)\d* +0\.00\d* +m$",
        r"^usable: length good to .*equation incomplete: it explains 99",
        r"(?i)\bquadratic drag \(0\.1[45]\d* ± 0\.\d+ 1/rad",
    ],
}
ON_MEASURED_DATA = "two_tanks.py"


def started(folder, name, *arguments):
    environment = {**os.environ, "PYTHONWARNINGS": "error", "PYTHONIOENCODING": "utf-8", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(ROOT / "examples" / name), *map(str, arguments)]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, encoding="utf-8")


def test_every_example_is_run():
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == {*EXAMPLES, ON_MEASURED_DATA}


def test_tanks_without_their_file_say_where_it_is(tmp_path):
    for arguments in ((), ("none.csv",)):
        done = started(tmp_path, ON_MEASURED_DATA, *arguments)
        assert done.returncode == 1
        assert done.stderr.startswith(
            "usage: two_tanks.py tanque.csv [folder]; the file is at https://doi.org/10.4121/"
        )
        assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_tanks_lack_a_gain_that_changes_and_then_predict_the_other_record_better_than_was_published(tmp_path):
    done = started(tmp_path, ON_MEASURED_DATA, recording("cascaded_tanks") / "tanque.csv")
    assert done.returncode == 0, done.stderr
    assert "Gain change (" in done.stdout
    errors = {name: float(error) for name, error in re.findall(r"^  (\S.*): ([\d.]+) V, ", done.stdout, re.MULTILINE)}
    assert errors["real-tanks"] < 0.191 < errors["two-tanks"]


RENDERS = ("one_clip.py", "hidden_effect.py")  # a clip first: minutes


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in RENDERS else n for n in EXAMPLES])
def test_example_prints_what_it_promises(name, tmp_path):
    done = started(tmp_path, name)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    for line in EXAMPLES[name]:
        assert re.search(line, done.stdout, re.MULTILINE), f"{line!r} is not in\n{done.stdout}"
    pages = re.findall(r"^report: (.*)$", done.stdout, re.MULTILINE)
    assert all((tmp_path / page).is_file() for page in pages)
