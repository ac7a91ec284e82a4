"""Docstrings of functions that take or return arrays state the shape and the unit of each array."""

import ast
import re
from pathlib import Path

from tests._project import ROOT, python_files

STATED_AT_LEAST = 0.9  # share of those functions
ARRAY = re.compile(r"\b(Array|ndarray|NDArray|ArrayLike|Image)\b")
MASK = re.compile(r"\bMask\b")
AXIS = r"(?:\.\.\.|[a-z_0-9]+(?: [*+-] [a-z_0-9]+)*)"
SHAPE = re.compile(rf"\({AXIS},(?: {AXIS}(?:, {AXIS})*)?\)")  # (n,)  (n, 2)  (h, w, 3)  (..., 2)  (n * d, k)
SYMBOLS = r"px|m|s|rad|Hz|kg|N|deg|mm|ms"
NAMES = r"dimensionless|pixels?|metres?|seconds?|radians?|degrees?|hertz|grey levels?|units?"
COUNTS = r"frames?|counts?|ind(?:ex|ices)|booleans?|bytes"
UNIT = re.compile(rf"(?<!['\w])(?:{SYMBOLS}|1/s|m/s)(?!\w)|\b(?:{NAMES}|{COUNTS})\b|_(?:px|m|s|rad|hz|kg)\b")


def annotations_of(node: ast.FunctionDef) -> str:
    """The types of the arguments and of the result, as they are written."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    annotations = [*(argument.annotation for argument in arguments), node.returns]
    return " ".join(ast.unparse(annotation) for annotation in annotations if annotation is not None)


def functions_with_arrays(tree: ast.Module) -> list[ast.FunctionDef]:
    """The functions and methods without an underscore that take or return arrays."""
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    return [
        node
        for body in (tree.body, *(node.body for node in classes))
        for node in body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
        if ARRAY.search(annotations_of(node)) or MASK.search(annotations_of(node))
    ]


def states_shape_and_unit(node: ast.FunctionDef) -> bool:
    """Whether the docstring has a shape, and a unit; a function of masks alone needs no unit."""
    text = ast.get_docstring(node) or ""
    needs_no_unit = not ARRAY.search(annotations_of(node))
    return bool(SHAPE.search(text)) and (needs_no_unit or bool(UNIT.search(text)))


def stated_and_missing() -> tuple[list[str], list[str]]:
    """Locations of the functions whose docstring states shape and unit, and of those whose docstring does not."""
    stated: list[str] = []
    missing: list[str] = []
    for path in python_files():
        for node in functions_with_arrays(ast.parse(path.read_text(encoding="utf-8"))):
            (stated if states_shape_and_unit(node) else missing).append(place_of(path, node))
    return stated, missing


def place_of(path: Path, node: ast.FunctionDef) -> str:
    return f"{path.relative_to(ROOT).as_posix()}:{node.lineno} {node.name}"


def function(docstring: str, signature: str = "x_px: Array") -> ast.FunctionDef:
    (node,) = ast.parse(f'def shift({signature}) -> None:\n    """{docstring}"""').body
    assert isinstance(node, ast.FunctionDef)
    return node


def test_docstring_with_shape_and_unit_is_accepted():
    assert states_shape_and_unit(function("Shift positions (n, 2), in px."))
    assert states_shape_and_unit(function("Shift the ratios (n * d + j, k), dimensionless."))
    assert states_shape_and_unit(function("Invert the mask (h, w).", signature="valid: Mask"))


def test_docstring_without_shape_or_without_unit_is_missed():
    assert not states_shape_and_unit(function("Shift positions, in px."))
    assert not states_shape_and_unit(function("Shift the body's positions (n, 2)."))
    assert not states_shape_and_unit(function("Shift positions (if any), in px (Burg 1967, Durbin 1960)."))


def test_functions_with_arrays_are_found_by_their_annotations():
    code = "def a(x: Array): ...\ndef b(x: float): ...\ndef _c(x: Array): ...\nclass D:\n    def e(self) -> Mask: ..."
    assert [node.name for node in functions_with_arrays(ast.parse(code))] == ["a", "e"]


def test_docstrings_of_functions_with_arrays_state_shapes_and_units():
    stated, missing = stated_and_missing()
    assert len(stated) >= STATED_AT_LEAST * (len(stated) + len(missing)), "\n".join(missing)
