"""The short form of the table of what breaks the program has no break in it."""

import re
import subprocess
import sys

import pytest

from tests._project import ROOT
from validation.torture import CLIPS, clip, what_came


@pytest.mark.parametrize("kind", CLIPS)
def test_clip_is_whole_before_it_is_damaged(tmp_path, kind):
    assert what_came(clip(tmp_path / f"a.{kind}", kind)) == "whole"


@pytest.mark.slow
def test_nothing_breaks_in_the_short_form():
    command = [sys.executable, "-m", "validation.torture", "--short"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    readers = re.findall(r"^\| (\S+) \| ([0-9]+) \| 0 \| 0 \| 0 \|$", done.stdout, re.MULTILINE)
    assert len(readers) == 13, done.stdout
    assert all(int(inputs) > 0 for _, inputs in readers)
    clips = re.findall(
        r"^\| \w+ \| (?:cut|a bit flipped) \| 8 \|.* ([0-9]+) \| ([0-9]+) \|$", done.stdout, re.MULTILINE
    )
    assert len(clips) == 2 * len(CLIPS)
    assert all(not_ours == "0" for _, not_ours in clips), done.stdout
    whole = r"^\| fit \| 0 \| 2 \| 2 \| same bytes \| stated, nothing half-written \| same bytes \| [0-9]+ \|$"
    assert re.search(whole, done.stdout, re.MULTILINE), done.stdout
