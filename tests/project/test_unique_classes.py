"""No two classes of the three packages share a name, so that a traceback and a search lead to the one that is meant."""

import ast
from collections import defaultdict
from functools import cache

from tests._project import ROOT, python_files

# Names that more than one class had when this test was written; the list only shrinks.
KNOWN = {
    "Background",
    "Component",
    "Pixels",
    "Rival",
    "Solution",
    "View",
    "_Linear",
}


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
    assert {name: files for name, files in classes().items() if len(files) > 1 and name not in KNOWN} == {}


def test_list_of_known_names_only_shrinks():
    assert {name for name in KNOWN if len(classes().get(name, [])) < 2} == set(), "delete these names"
