"""The README names only what there is: commands, options, names, make targets, modules, files."""

import importlib.util
import re
import shlex
from itertools import pairwise

import pytest
import typer

import iris_sysid
from iris_sysid.cli import app
from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA, TRACKERS
from iris_sysid.synthetic.scene import SCENES
from tests._project import ROOT

README = (ROOT / "README.md").read_text("utf-8")
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMANDS = typer.main.get_command(app).commands
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMES = {"--model": MODELS, "--tracker": TRACKERS, "--phenomenon": PHENOMENA}


def code_lines() -> list[str]:
    """Every line of a code block that is no Python, continued lines joined, and every piece of code in a sentence."""
    blocks = [text for language, text in FENCE.findall(README) if language != "python"]
    lines = [line for text in blocks for line in text.replace("\\\n", " ").splitlines()]
    return [line.strip() for line in lines] + re.findall(r"`([^`\n]+)`", FENCE.sub("", README))


def lines_of(program: str) -> list[list[str]]:
    """The lines that call a program, split as a shell would, comments left out."""
    lines = [line.removeprefix("$ ").removeprefix(".venv/bin/") for line in code_lines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith(f"{program} ")]


def commands(text: list[str]) -> list[str]:
    """The arguments of a command that names no output in a table, with one."""
    needed = any("-o" in parameter.opts and parameter.required for parameter in COMMANDS[text[1]].params)
    return [*text[2:], *(["-o", "x"] if needed and "-o" not in text else [])]


CALLS = [call for call in lines_of("iris-sysid") if re.fullmatch("[a-z]+", call[1])]


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_command_parses(call):
    assert call[1] in COMMANDS
    COMMANDS[call[1]].make_context(call[1], commands(call)).close()


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_command_names_what_is_registered(call):
    for option, value in pairwise(call):
        if option == "--phenomenon" and call[1] == "render":
            assert value in SCENES
        elif option in NAMES:
            assert value in {*NAMES[option], "auto"} or ".py:" in value
        elif option == "--effect":
            assert value.partition("=")[0] in {*EFFECTS, *SCENES["pendulum"].effects}


def test_every_command_is_shown():
    shown = {call[1] for call in CALLS} | ({"demo"} if lines_of("make") else set())
    assert shown == set(COMMANDS)


def test_first_screen_has_the_two_commands_and_a_picture():
    first = "\n".join(README.splitlines()[:30])
    assert "make demo" in first
    assert "make test" in first
    assert re.search(r"!\[[^\]]+\]\([^)]+\.png\)", first)


@pytest.mark.parametrize("call", lines_of("make"), ids=" ".join)
def test_make_target_exists(call):
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert call[1] in targets


@pytest.mark.parametrize("call", lines_of("python"), ids=" ".join)
def test_python_command_exists(call):
    if call[1] == "-m":
        assert importlib.util.find_spec(call[2]) is not None
    else:
        assert (ROOT / call[1]).is_file()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
        if not re.match(r"[a-z]+:|#", target):
            assert (page.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_figures_are_pictures(page):
    for target in re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", page.read_text("utf-8")):
        assert (page.parent / target).read_bytes().startswith((b"\x89PNG", b"GIF8", b"<svg", b"\xff\xd8"))


def test_files_named_in_sentences_exist():
    for name in re.findall(r"`((?:examples|docs|benchmarks|tests|iris_sysid|fitters|trackers)/[^`\s]*)`", README):
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("code", [text for language, text in FENCE.findall(README) if language == "python"])
def test_python_in_the_readme_imports_what_there_is(code):
    compile(code, "README.md", "exec")
    imports = re.findall(r"^(?:from \S+ import .*|import .*)$", code, re.MULTILINE)
    assert imports
    exec("\n".join(imports), {})


def test_names_imported_from_the_package_are_public():
    for names in re.findall(r"^from iris_sysid import (.*)$", README, re.MULTILINE):
        assert {name.strip() for name in names.split(",")} <= set(iris_sysid.__all__)
