"""List the validation, each a module that prints its own table."""

import ast
import pkgutil
from pathlib import Path

import validation

for info in pkgutil.iter_modules(validation.__path__):
    if not info.name.startswith("_"):
        source = (Path(validation.__path__[0]) / f"{info.name}.py").read_text(encoding="utf-8")
        summary = (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]
        print(f"python -m validation.{info.name:<12} {summary}")
