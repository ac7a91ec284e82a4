"""From a physics video to the parameters of its governing equation, with honest error bars.

Everything public is here; names are imported when first used, so that ``import iris_sysid`` is quick. The stub
``__init__.pyi`` lists them with their modules, for this file and for type checkers (SPEC 1).
"""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from typing import Any

from iris_sysid._version import __version__ as __version__

DISTRIBUTION = "iris-sysid"

# where each public name is defined
_HOME = {
    alias.name: node.module
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8")).body
    if isinstance(node, ast.ImportFrom) and node.module is not None
    for alias in node.names
    if alias.name != "__version__"
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'iris_sysid' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return list(__all__)
