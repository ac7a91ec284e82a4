"""Docstrings tell the truth: no undocumented argument, no phantom one."""

import ast
import re
from pathlib import Path

import pytest

from tests._project import ROOT, python_files

LONG = 4  # functions of public modules with at least this many parameters carry a Parameters section

# The functions of a plugin are documented where their type is declared, with one contract for all; the options of a
# command say themselves what they are, in its help.
PLUGINS = ("trackers/", "fitters/models/", "fitters/effects/", "iris_sysid/phenomena/", "iris_sysid/cli/")


def public_functions(path: Path) -> list[tuple[str, ast.FunctionDef]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    bodies = [tree.body] + [node.body for node in classes]
    return [
        (f"{path.relative_to(ROOT)}:{node.name}", node)
        for body in bodies
        for node in body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    ]


def parameters_of(node: ast.FunctionDef) -> list[str]:
    arguments = node.args
    every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    every += [arguments.vararg] if arguments.vararg else []
    return [argument.arg for argument in every if argument.arg not in ("self", "cls")]


def documented(docstring: str) -> list[str] | None:
    """The names in the Parameters section; None when there is no such section."""
    match = re.search(r"^\s*Parameters\n\s*-+\n(.*?)(?=^\s*\w[\w ]*\n\s*-{3,}$|\Z)", docstring, re.M | re.S)
    if match is None:
        return None
    lines = match.group(1).splitlines()
    indent = min((len(line) - len(line.lstrip()) for line in lines if line.strip()), default=0)
    heads = [line.strip() for line in lines if line.strip() and len(line) - len(line.lstrip()) == indent]
    return [name.strip().lstrip("*") for head in heads for name in head.partition(" :")[0].split(",")]


FUNCTIONS = [item for path in python_files() for item in public_functions(path)]


@pytest.mark.parametrize(("where", "node"), FUNCTIONS, ids=[where for where, _ in FUNCTIONS])
def test_docstring_documents_exactly_the_arguments(where, node):
    docstring = ast.get_docstring(node)
    assert docstring, f"{where} has no docstring"
    names = documented(docstring)
    parameters = parameters_of(node)
    if names is None:
        elsewhere = "/_" in where or where.startswith(PLUGINS)
        assert elsewhere or len(parameters) < LONG, f"{where} takes {parameters} and has no Parameters section"
    else:
        assert sorted(names) == sorted(parameters), where


def test_documented_reads_grouped_names_and_stops_at_the_next_section():
    text = "Do.\n\nParameters\n----------\na, b\n    Both.\nc : int\n    One.\n\nReturns\n-------\nint\n    It."
    assert documented(text) == ["a", "b", "c"]
