"""No two functions or blocks of the three packages share more than ten lines of code."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from tests._project import ROOT, python_files

MAX_SHARED = 10  # lines of code that two places may share, without docstrings, comments, imports and blank lines


@dataclass(frozen=True, slots=True, order=True)
class CodeLine:
    """A line of code without its indentation, and where it stands."""

    file: str
    number: int
    text: str


def code_lines(code: str, file: str) -> list[CodeLine]:
    """The lines of a file that are code: no blank lines, comments, docstrings and imports."""
    left_out = {number for node in ast.walk(ast.parse(code)) if is_left_out(node) for number in lines_of(node)}
    numbered = enumerate((line.strip() for line in code.splitlines()), start=1)
    return [
        CodeLine(file, number, text)
        for number, text in numbered
        if text and not text.startswith("#") and number not in left_out
    ]


def is_left_out(node: ast.AST) -> bool:
    """Whether a statement is an import, or a text that stands alone, as docstrings do."""
    is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    return is_text or isinstance(node, ast.Import | ast.ImportFrom)


def lines_of(node: ast.AST) -> range:
    return range(node.lineno, node.end_lineno + 1)


def shared_runs(files: list[list[CodeLine]], most: int) -> Iterator[tuple[CodeLine, CodeLine, int]]:
    """Pairs of positions that share more than ``most`` lines: the first line of each, and how many lines they share."""
    windows = defaultdict(list)
    for k, lines in enumerate(files):
        for start in range(len(lines) - most):
            windows[tuple(line.text for line in lines[start : start + most + 1])].append((k, start))
    pairs = {pair for places in windows.values() for pair in combinations(places, 2)}
    for first, second in sorted(pairs):
        if (earlier(first), earlier(second)) in pairs:
            continue
        count = 1
        while (later(first, count), later(second, count)) in pairs:
            count += 1
        yield files[first[0]][first[1]], files[second[0]][second[1]], most + count


def earlier(place: tuple[int, int]) -> tuple[int, int]:
    return place[0], place[1] - 1


def later(place: tuple[int, int], lines: int) -> tuple[int, int]:
    return place[0], place[1] + lines


def lines_from(path: Path) -> list[CodeLine]:
    return code_lines(path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix())


def test_two_functions_that_share_lines_are_found():
    steps = "\n".join(f"    step_{k}()  # as above" for k in range(4))
    drawn = code_lines(f'import numpy\n\ndef a():\n    """Do."""\n{steps}\n    end()', "first.py")
    filled = code_lines(f"def b():\n\n{steps}\n    # here too\n    stop()", "second.py")
    ((first, second, count),) = shared_runs([drawn, filled], most=3)
    assert (first.file, first.number, second.file, second.number, count) == ("first.py", 5, "second.py", 3, 4)
    assert not list(shared_runs([drawn, filled], most=4))


def test_no_two_functions_share_more_than_ten_lines():
    runs = shared_runs([lines_from(path) for path in python_files()], MAX_SHARED)
    pairs = [
        f"{first.file}:{first.number} and {second.file}:{second.number}: {count} lines" for first, second, count in runs
    ]
    assert not pairs, "\n".join(pairs)
