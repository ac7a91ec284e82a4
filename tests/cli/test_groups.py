"""A group of options is recorded and suggested by the names that its command takes."""

import importlib
from dataclasses import is_dataclass, replace
from typing import get_type_hints

import pytest

from iris_sysid.cli import COMMANDS, _command
from iris_sysid.cli._groups import as_typed, typed
from iris_sysid.cli.arguments import EquationArguments, RecordArguments


def groups_of(name):
    """The groups of options of a command; none where it has only options of its own."""
    module, _ = COMMANDS[name]
    function = getattr(importlib.import_module(f"iris_sysid.cli.{module}"), module)
    hints = get_type_hints(getattr(function, "__wrapped__", function), include_extras=True).values()
    return [kind for kind in hints if is_dataclass(kind)]


GROUPED = [name for name in COMMANDS if groups_of(name)]


@pytest.mark.parametrize("name", GROUPED)
def test_names_are_those_of_the_command(name):
    taken = {option for parameter in _command(name).params for option in parameter.opts}
    for group in groups_of(name):
        assert {f"--{option.replace('_', '-')}" for option in typed(group())} <= taken, group


def test_most_commands_with_many_options_have_them_in_groups():
    many = {name for name in COMMANDS if len(_command(name).params) > 14}
    assert many - set(GROUPED) == set()


def test_only_what_differs_from_its_default_is_typed_again():
    stated = EquationArguments(model="pendulum", known=["gravity=9.81", "length=50cm"])
    again = ["--model", "pendulum", "--set", "gravity=9.81", "--set", "length=50cm"]
    assert as_typed(stated, RecordArguments()) == again
    assert as_typed(replace(stated, known=[]), RecordArguments(hold="zero"), leave_out=("model",)) == ["--hold", "zero"]


def test_record_holds_every_option_and_null_for_an_empty_list():
    assert typed(RecordArguments(columns="t=a"), seed=0) == {
        "seed": 0,
        "columns": "t=a",
        "sample_time": None,
        "hold": "auto",
        "keep_clipped": False,
    }
    assert typed(EquationArguments())["set"] is None
