"""No reader raises anything but an IrisError, crashes or hangs, whatever its file holds."""

import os
import re
import subprocess
import sys

import pytest

from tests._project import ROOT
from tests.fuzz.corpus import corpus_of
from tests.fuzz.engines import mutated, unguided_modules
from tests.fuzz.targets import FUZZ_TARGETS

SECONDS = float(os.environ.get("IRIS_FUZZ_SECONDS", "15"))  # of all targets together


@pytest.mark.parametrize("name", FUZZ_TARGETS)
def test_reader_takes_its_seeds_and_what_broke_it_once(name):
    for data in corpus_of(name):
        FUZZ_TARGETS[name](data)


def test_edits_are_applied_in_turn():
    assert mutated(b"abcdef", [(1, 2, b"X", 2), (-1, 1, b"", 1), (99, 0, b"!", 1)]) == b"aXXde!"


def test_search_is_guided_by_the_readers_and_not_by_what_numba_compiles():
    unguided = set(unguided_modules())
    assert {"iris_sysid.trajectory.white_jerk_model", "fitters.integrator.dormand_prince"} <= unguided
    assert unguided.isdisjoint({"iris_sysid.io.csv_read", "iris_sysid.units", "fitters.own_model.expression"})


@pytest.mark.slow
def test_mutated_input_gives_results_and_stated_errors():
    command = [sys.executable, "-m", "tests.fuzz", "--engine", "hypothesis", "--seconds", str(SECONDS)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.findall(r"^(\S+) \| [1-9][0-9]* \| results and stated errors$", done.stdout, re.MULTILINE) == list(
        FUZZ_TARGETS
    )
