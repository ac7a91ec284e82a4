"""No two classes of the three packages share a name, so that a traceback and a search lead to the one that is meant."""

import ast
from collections import defaultdict
from functools import cache

from tests._project import ROOT, python_files


@cache
def classes() -> dict[str, list[str]]:
    """The files that define each class, by its name."""
    files = defaultdict(list)
    for path in python_files():
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.ClassDef):
                files[node.name].append(path.relative_to(ROOT).as_posix())
    return dict(files)


def test_class_names_are_unique():
    assert {name: files for name, files in classes().items() if len(files) > 1} == {}
