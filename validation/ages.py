"""Tables of the docs that are older than the code they measure: each says so in the line above it.

``python -m validation.ages`` lists the tables whose line is wrong, and ``--write`` corrects the lines. A table is old
when a file of what its page measures differs between its commit and the one that is checked out. Comments, docstrings,
and from which module a name is imported do not count: they do not change what the code does.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from validation.pages import PAGES, ROOT

FITS = ("fitters/components", "fitters/effects", "fitters/integrator", "fitters/models", "fitters/noise", "fitters/ode")
MEASURED: Mapping[str, tuple[str, ...]] = {
    "audit": ("validation/audit",),
    "benchmark": ("iris_sysid/benchmark",),
    "calibration": ("iris_sysid/calibration",),
    "diagnosis": ("iris_sysid/diagnosis", *FITS),
    "discovery": ("fitters/sindy",),
    "faults": ("trackers", "fitters/ode"),
    "fitting": ("fitters/ode", "fitters/integrator", "fitters/noise", "fitters/selection"),
    "ground_truth": ("trackers", "fitters", "iris_sysid/benchmark", "iris_sysid/pipeline"),
    "plans": ("iris_sysid/diagnosis", *FITS),
    "scaling": ("trackers", "fitters", "iris_sysid/benchmark", "iris_sysid/pipeline"),
    "torture": ("iris_sysid/io", "iris_sysid/video", "iris_sysid/cli"),
    "tracking": ("trackers",),
    "world": ("iris_sysid/diagnosis", *FITS),
}
PROGRAMS: Mapping[str, tuple[str, ...]] = {"reference_fits": ("validation/reference_*.py",)}  # share no code with it
NOTE = "; its code has changed since"
HEADER = re.compile(r"^\*`(?P<command>[^`]+)`.*?\bcommits? (?P<commit>[0-9a-f]{7,40})\b[^*\n]*\*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Header:
    """The line above a table: its page, its text, its commit, and the paths that the table measures."""

    page: Path
    text: str
    commit: str
    paths: tuple[str, ...]

    @property
    def says_old(self) -> bool:
        """Whether the line says that the table is old."""
        return NOTE in self.text

    @property
    def is_old(self) -> bool:
        """Whether it is; LookupError where the history does not have its commit."""
        return differs(self.commit, self.paths)

    @property
    def right(self) -> str:
        """The line as it should be."""
        plain = self.text.replace(NOTE, "")
        return f"{plain[:-1]}{NOTE}*" if self.is_old else plain


@cache
def differs(commit: str, paths: tuple[str, ...]) -> bool:
    """Whether files below some paths differ between a commit and the one checked out; LookupError without it."""
    git = ["git", "-C", str(ROOT)]
    known = subprocess.run([*git, "cat-file", "-e", f"{commit}^{{commit}}"], capture_output=True, check=False)
    if known.returncode:
        raise LookupError(f"the history has no commit {commit}")
    changed = subprocess.run(
        [*git, "diff", "--name-only", "--no-renames", commit, "HEAD", "--", *paths],
        capture_output=True, check=True, text=True,
    )  # fmt: skip
    return any(_code(commit, name) != _code("HEAD", name) for name in changed.stdout.splitlines())


def _code(commit: str, name: str) -> str:
    """What a file does at a commit; its text where it is no Python, empty where there is none."""
    shown = subprocess.run(["git", "-C", str(ROOT), "show", f"{commit}:{name}"], capture_output=True, check=False)
    text = shown.stdout.decode("utf-8", "replace")
    if not name.endswith(".py") or shown.returncode:
        return text
    bare = _Bare()
    tree = bare.visit(ast.parse(text))
    return f"{sorted(bare.imported)} {ast.dump(tree)}"


class _Bare(ast.NodeTransformer):
    """Takes docstrings and the names imported from modules out of a file, and keeps the names."""

    def __init__(self) -> None:
        self.imported: list[str] = []

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:  # the name is ast's
        self.imported += [f"{alias.name} as {alias.asname or alias.name}" for alias in node.names]

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if text else node


def headers(pages: Path = PAGES) -> Iterator[Header]:
    """The lines above all tables that state a commit."""
    for page in sorted(pages.glob("*.md")):
        for match in HEADER.finditer(page.read_text(encoding="utf-8")):
            program = re.search(r"validation\.(\w+)", match["command"])
            paths = PROGRAMS.get(program[1] if program else "", MEASURED[page.stem])
            yield Header(page, match[0], match["commit"], paths)


def main() -> None:
    """List the tables whose line is wrong, or correct the lines."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="correct the lines")
    options = parser.parse_args()
    for header in headers():
        if header.right != header.text:
            print(f"{header.page.name}: {header.right}")
            if options.write:
                text = header.page.read_text(encoding="utf-8")
                header.page.write_text(text.replace(header.text, header.right), encoding="utf-8")


if __name__ == "__main__":
    main()
