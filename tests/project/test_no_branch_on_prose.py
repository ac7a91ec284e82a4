"""No code decides by a sentence: messages, notes and reasons are written for people and may be reworded at any time."""

import ast
import re
from collections.abc import Callable

import pytest

from tests._project import ROOT, python_files

# Names and attributes that hold sentences; `error_message` and `notes_of_fit` count as well. What a calibration fixed
# and assumed is told in sentences too.
PROSE = re.compile(
    r"(?:^|_)(message|note|reason|remedy|sentence|summary|headline|caveat|warning|verdict|description|explanation)s?"
    r"(?:_|$)|^(?:fixed|assumed)$"
)
NO_PROSE = re.compile(r"(?:^|_)(path|file|folder|name|kind|code|rank|id|frame|clip|unit)s?$")
ERRORS = ("error", "exception", "problem", "refusal", "failure")
TEXT_METHODS = ("startswith", "endswith", "split", "rsplit", "partition", "rpartition", "find", "rfind", "index")
TEXT_METHODS += ("count", "removeprefix", "removesuffix")
PARTS_OF_NAMES = ("_0", "damping", "damping_", "length", "length_", "gravity", "vertical", "vertical_", "pivot_", "v_")
PATTERN_FUNCTIONS = ("search", "match", "fullmatch", "findall", "split")


def is_prose(node: ast.AST, items: frozenset[str] = frozenset()) -> bool:
    """Whether an expression is a sentence by its name, an item of a list of such, or the text of an error."""
    match node:
        case ast.Name(id=name) if name in items:
            return True
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return bool(PROSE.search(name)) and not NO_PROSE.search(name)
        case ast.Subscript(value=value, slice=ast.Constant(value=str(key))):
            return is_prose(ast.Name(id=key), items) or is_prose(value, items)
        case ast.Subscript(value=value) | ast.Call(func=ast.Attribute(value=value, attr="lower" | "strip")):
            return is_prose(value, items)
        case ast.Call(func=ast.Name(id="str"), args=[ast.Name(id=name)]):
            return name in ERRORS or is_prose(ast.Name(id=name), items)
    return False


def items_of_prose(tree: ast.Module) -> frozenset[str]:
    """The names that loops and comprehensions give to the items of lists of sentences."""
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For | ast.comprehension)]
    return frozenset(loop.target.id for loop in loops if isinstance(loop.target, ast.Name) and is_prose(loop.iter))


def is_wording(node: ast.AST) -> bool:
    """Whether an expression is words, as literal text or a list of such; the empty text is none."""
    match node:
        case ast.Constant(value=str(text)):
            return bool(text)
        case ast.JoinedStr():
            return True
        case ast.Tuple(elts=items) | ast.List(elts=items) | ast.Set(elts=items):
            return any(is_wording(item) for item in items)
    return False


def compares_prose(node: ast.AST, items: frozenset[str]) -> bool:
    """Whether a node compares a sentence with words, cuts it, or searches in it."""
    match node:
        case ast.Compare(left=left, comparators=comparators):
            sides = [left, *comparators]
            return any(is_prose(side, items) for side in sides) and any(is_wording(side) for side in sides)
        case ast.Call(func=ast.Attribute(value=value, attr=method), args=[_, *_]) if method in TEXT_METHODS:
            return is_prose(value, items)
        case ast.Call(func=ast.Attribute(value=ast.Name(id="re"), attr=method), args=[_, subject, *_]):
            return method in PATTERN_FUNCTIONS and is_prose(subject, items)
        case ast.Match(subject=subject, cases=cases):
            wordings = [case.pattern.value for case in cases if isinstance(case.pattern, ast.MatchValue)]
            return is_prose(subject, items) and any(is_wording(wording) for wording in wordings)
    return False


def branches_on_prose(code: str) -> list[int]:
    """The lines of code that decide by a sentence."""
    tree = ast.parse(code)
    items = items_of_prose(tree)
    return [node.lineno for node in ast.walk(tree) if compares_prose(node, items)]


def roles_by_spelling(code: str) -> list[int]:
    """The lines of code that ask a name how it begins or ends in order to learn what the parameter does."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in ("startswith", "endswith")
        and any(isinstance(text, ast.Constant) and text.value in PARTS_OF_NAMES for text in node.args)
    ]


def places(lines_of: Callable[[str], list[int]]) -> list[str]:
    """The file and line of everything that a search finds in the three packages."""
    return [
        f"{path.relative_to(ROOT).as_posix()}:{line}"
        for path in python_files()
        for line in lines_of(path.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize(
    "code",
    [
        'if result.message.startswith("the vertical"): ...',
        'head, _, remedy = message.partition(". ")',
        'sentences = diagnosis.sentence.split(". ")',
        'if "does not converge" in fit.reason: ...',
        'if notes[0] == "no gap": ...',
        'kept = [text for text in calibration.assumed if not text.startswith("the vertical")]',
        'if str(error).endswith("is empty"): ...',
        'if re.search("more than", document["message"]): ...',
        'match reason:\n    case "too short": ...',
        'if error_message.lower().find("bound") >= 0: ...',
    ],
)
def test_branch_on_prose_is_found(code):
    assert branches_on_prose(code)


@pytest.mark.parametrize(
    "code",
    [
        'if result.status == "ok": ...',
        'if message == "" or not notes: ...',
        'report = f"{message}. {remedy}"',
        'if role is Role.DAMPING and name.startswith("--"): ...',
        'if source_path.suffix == ".mp4": ...',
        'text = "; ".join(notes)',
        "words = message.split()",
        'if "gravity" in known: ...',
    ],
)
def test_typed_decision_is_left_alone(code):
    assert not branches_on_prose(code)


def test_no_code_branches_on_prose():
    assert not places(branches_on_prose), "\n".join(places(branches_on_prose))


def test_role_by_spelling_is_found():
    assert roles_by_spelling('if name.startswith("damping"): ...')
    assert roles_by_spelling('if not parameter.name.endswith("_0"): ...')
    assert not roles_by_spelling('if name.startswith("."): ...')


def test_no_code_learns_the_role_of_a_parameter_from_its_spelling():
    assert not places(roles_by_spelling), "\n".join(places(roles_by_spelling))
