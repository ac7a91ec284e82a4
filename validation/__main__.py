"""List the programs of ``validation``: each is a module that prints its own tables."""

import ast
import pkgutil
from pathlib import Path

import validation

FOLDER = Path(validation.__file__).parent


def programs() -> dict[str, str]:
    """First line of the docstring of every program by its name; a package is a program that has a ``__main__``."""
    sources = {}
    for info in pkgutil.iter_modules([str(FOLDER)]):
        path = FOLDER / info.name / "__main__.py" if info.ispkg else FOLDER / f"{info.name}.py"
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        if "\ndef main(" in text:
            sources[info.name] = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    return sources


if __name__ == "__main__":
    for name, summary in programs().items():
        print(f"python -m validation.{name:<18} {summary}")
