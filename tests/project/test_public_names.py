"""What is public: one list, which the API reference, the type checker and dir() share."""

import re

import pytest
import typer

import iris_sysid
from iris_sysid import cli
from tests._project import ROOT

REFERENCE = (ROOT / "docs" / "reference" / "api.md").read_text("utf-8")
DOCUMENTED = re.findall(r"^\.\. (?:auto\w+|py:data):: iris_sysid\.(\w+)$", REFERENCE, re.MULTILINE)


def test_api_reference_and_public_names_are_the_same():
    assert sorted(DOCUMENTED) == list(iris_sysid.__all__)


def test_dir_shows_the_public_names_and_nothing_else():
    assert dir(iris_sysid) == list(iris_sysid.__all__)


@pytest.mark.parametrize("name", iris_sysid.__all__)
def test_public_name_can_be_imported_and_is_documented(name):
    value = getattr(iris_sysid, name)
    if callable(value) and name != "Array":
        assert value.__doc__


def test_table_of_commands_says_what_the_commands_say():
    commands = typer.main.get_command(cli.app).commands
    assert {name: command.get_short_help_str(300) for name, command in commands.items()} == {
        name: sentence for name, (_, sentence) in cli.COMMANDS.items()
    }


def test_every_file_of_a_command_is_in_the_table():
    files = {path.stem for path in (ROOT / "iris_sysid" / "cli").glob("*.py")}
    modules = {module for module, _ in cli.COMMANDS.values()}
    assert {file for file in files if not file.startswith("_")} - {"arguments"} == modules
