"""The examples run as they are, and print what they promise."""

import os
import re
import subprocess
import sys

import pytest

from tests._project import ROOT

EXAMPLES = {
    "one_clip.py": [
        r"^ +value +stderr +unit$",
        r"^length +0\.(499|500)\d* +0\.0000\d* +m$",
        r"^gravity +9\.80665\d* .* m/s\^2$",
        r"^report: one-clip.report.report\.html$",
    ],
    "one_table.py": [
        r"^length +0\.(39|40)\d* +0\.000\d* +m$",
        r"^misfit ",
        r"^Adding quadratic drag \(0\.1[45]\d* ± 0\.\d+ 1/rad",
    ],
}


def test_every_example_is_run():
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_prints_what_it_promises(name, tmp_path):
    environment = {**os.environ, "PYTHONWARNINGS": "error", "PYTHONIOENCODING": "utf-8", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(ROOT / "examples" / name)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    for line in EXAMPLES[name]:
        assert re.search(line, done.stdout, re.MULTILINE), f"{line!r} is not in\n{done.stdout}"
    pages = re.findall(r"^report: (.*)$", done.stdout, re.MULTILINE)
    assert all((tmp_path / page).is_file() for page in pages)
