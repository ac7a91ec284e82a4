"""What only the command diagnose does: a limit in time, parts that are kept, and what was stopped."""

import importlib
import json
from dataclasses import replace
from functools import partial

import pytest

from iris_sysid import MODELS
from iris_sysid.cli._each import EachRequest, SearchArguments, prepared
from iris_sysid.cli.arguments import EquationArguments
from iris_sysid.pipeline.diagnose_each import NamedTable, diagnose_each
from iris_sysid.types import DiagnosticNote

PENDULUM = MODELS["pendulum"]

STOPPED = DiagnosticNote("stopped", "stopped after 60 s while refitting quadratic-drag")


@pytest.fixture
def given(monkeypatch):
    """The keywords of every search; each is stopped early."""
    module, seen = importlib.import_module("iris_sysid.diagnosis.diagnose"), []
    search = module.diagnose

    def stopped(clips, model, *, seconds=None, keep=(), **keywords):
        seen.append((seconds, keep))
        return replace(search(clips, model, **{**keywords, "effects": []}), notes=(STOPPED,))

    monkeypatch.setattr(module, "diagnose", stopped)
    return seen


OPTIONS = ["--seconds", 60, "--keep-component", "zero-wander", "--keep-component", "force-of-velocity"]
KEPT = ("zero-wander", "force-of-velocity")


def test_time_and_parts_to_keep_reach_the_search_and_what_was_stopped_is_said(given, angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "--model", "pendulum", *OPTIONS, "-o", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    assert given == [(60.0, KEPT)]
    assert "Note: Stopped after 60 s while refitting quadratic-drag." in outcome.out.splitlines()
    options = json.loads((tmp_path / "out" / "diagnosis.json").read_text("utf-8"))["origin"]["options"]
    assert (options["seconds"], options["keep_component"]) == (60.0, list(KEPT))


def test_what_was_stopped_is_said_beside_json(given, angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "--model", "pendulum", *OPTIONS, "--json", "-o", tmp_path / "out")
    assert f"note: {STOPPED.text}" in outcome.err.splitlines()
    assert json.loads(outcome.out)["notes"] == [STOPPED.text]


def test_every_clip_of_a_batch_has_the_limit(given, angles, tmp_path):
    request = EachRequest(EquationArguments("pendulum"), search=SearchArguments(seconds=60.0, keep_component=KEPT))
    (row,) = diagnose_each([NamedTable("swing", angles)], partial(prepared, request, (PENDULUM, ()), ()), tmp_path)
    assert given == [(60.0, KEPT)]
    assert (row["status"], row["equation"]) == ("good", "complete")


def test_search_without_a_limit_has_none(given, angles, tmp_path, cli):
    assert cli("diagnose", angles, "--model", "pendulum", "-o", tmp_path / "out").status == 0
    assert given == [(None, ())]
