"""README and pages name only what there is: commands, options, names, make targets, modules, files, public names."""

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

README = ROOT / "README.md"
PAGES = [
    README,
    *(ROOT / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING", "SECURITY")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
TEXTS = {page: page.read_text("utf-8") for page in PAGES}
COMMANDS = typer.main.get_command(app).commands
FENCE = re.compile(r"^```([\w{}-]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMES = {"--model": MODELS, "--tracker": TRACKERS, "--phenomenon": PHENOMENA}
OWN_FILES = re.compile(r"(my_\w+|FILE)\.py:")  # names that the pages make up


def code_lines(text: str) -> list[str]:
    """Every line of a code block that is no Python, continued lines joined, and every piece of code in a sentence."""
    blocks = [block for language, block in FENCE.findall(text) if language in ("", "bash")]
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    pieces = re.findall(r"`([^`]+)`", FENCE.sub("", text))
    return [line.strip() for line in lines] + [piece.replace("\n", " ") for piece in pieces]


def lines_of(program: str) -> list[list[str]]:
    """The lines of all pages that call a program, split as a shell would, comments left out; each once."""
    lines = [line.removeprefix("$ ").removeprefix(".venv/bin/") for text in TEXTS.values() for line in code_lines(text)]
    calls = [line.partition(" > ")[0] for line in lines if line.startswith(f"{program} ")]
    return [shlex.split(call, comments=True) for call in dict.fromkeys(calls)]


def complete(call: list[str]) -> list[str]:
    """The arguments of a command, with an output where a sentence or table leaves it out."""
    needed = any("-o" in parameter.opts and parameter.required for parameter in COMMANDS[call[1]].params)
    return [*call[2:], *(["-o", "x"] if needed and not {"-o", "--output"} & set(call) else [])]


def is_whole(call: list[str]) -> bool:
    """Whether a call says what it works on: sentences also name a command alone, or with an option only."""
    takes_files = any(parameter.param_type_name == "argument" for parameter in COMMANDS[call[1]].params)
    return (
        not takes_files or (len(call) > 2 and not call[2].startswith("-")) or "--rows" in call or "--template" in call
    )


CALLS = [call for call in lines_of("iris-sysid") if re.fullmatch("[a-z]+", call[1])]
WHOLE = [call for call in CALLS if call[1] in COMMANDS and is_whole(call) and len(call) > 2 and "..." not in call]
PYTHON = [(page, code) for page in PAGES for language, code in FENCE.findall(TEXTS[page]) if language == "python"]


def of_page(value):
    return str(value.relative_to(ROOT)) if hasattr(value, "relative_to") else ""


def test_commands_named_exist():
    assert {call[1] for call in CALLS} <= set(COMMANDS)


@pytest.mark.parametrize("call", WHOLE, ids=" ".join)
def test_command_parses(call):
    COMMANDS[call[1]].make_context(call[1], complete(call)).close()


@pytest.mark.parametrize("call", WHOLE, ids=" ".join)
def test_command_names_what_is_registered(call):
    for option, value in pairwise(call):
        if option == "--phenomenon" and call[1] == "render":
            assert value in SCENES
        elif option in NAMES:
            assert value in {*NAMES[option], "auto"} or OWN_FILES.match(value) or value == "coasting"
        elif option == "--effect":
            assert value.partition("=")[0] in {*EFFECTS, *SCENES["pendulum"].effects} or OWN_FILES.match(value)


def test_every_command_is_shown_in_the_readme():
    shown = {call[1] for line in code_lines(TEXTS[README]) if (call := line.split()) and call[0] == "iris-sysid"}
    assert set(COMMANDS) - shown == {"demo"}


def test_first_screen_has_the_two_commands_and_a_figure():
    first = "\n".join(TEXTS[README].splitlines()[:30])
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


@pytest.mark.parametrize("page", PAGES, ids=of_page)
def test_links_lead_to_files(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", TEXTS[page]):
        if not re.match(r"[a-z]+:|#", target):
            assert (page.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=of_page)
def test_figures_are_images(page):
    for target in re.findall(r"!\[[^\]]*\]\(([^)\s]+)\)", TEXTS[page]):
        assert (page.parent / target).read_bytes().startswith((b"\x89PNG", b"GIF8", b"<?xml", b"\xff\xd8"))


@pytest.mark.parametrize("page", PAGES, ids=of_page)
def test_files_named_in_sentences_exist(page):
    folders = "examples|docs|validation|tests|iris_sysid|fitters|trackers"
    for name in re.findall(rf"`((?:{folders})/[^`\s]*)`", TEXTS[page]):
        assert (ROOT / name.partition("::")[0]).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=of_page)
def test_modules_named_in_sentences_exist(page):
    for name in re.findall(r"`((?:validation|iris_sysid|fitters|trackers)(?:\.\w+)+)", TEXTS[page]):
        module, _, attribute = name.rpartition(".")
        assert importlib.util.find_spec(name) or hasattr(importlib.import_module(module), attribute), name


def test_readme_has_python():
    assert any(page == README for page, _ in PYTHON)


@pytest.mark.parametrize(("page", "code"), PYTHON, ids=of_page)
def test_python_compiles_and_imports_what_is_public(page, code):
    compile(code, str(page), "exec")
    imports = re.findall(r"^(?:from \S+ import .*|import .*)$", code, re.MULTILINE)
    assert imports
    exec("\n".join(imports), {})
    ours = [line for line in imports if re.search(r"\b(iris_sysid|fitters|trackers)\b", line)]
    assert all(line.startswith("from iris_sysid import ") for line in ours), ours
    for line in ours:
        assert {name.strip() for name in line.removeprefix("from iris_sysid import ").split(",")} <= set(
            iris_sysid.__all__
        )
