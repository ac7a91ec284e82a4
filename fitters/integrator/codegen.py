"""Functions compiled from source text; no other module does this.

Right-hand sides are composed from others (a model with an effect, a loop over columns), and numba wants them written
out: numbers and tuples only, one line a derivative. The text is made of numbers of states and parameters, never of
anything read from a file; every name in it must be an argument, assigned in the function, or given with its value.
"""

from __future__ import annotations

import ast
import keyword
from collections.abc import Callable, Mapping
from typing import Any

from iris_sysid.registry import parsed

BUILTINS = {"range": range}
ALLOWED = (
    ast.arguments, ast.arg, ast.Return, ast.Assign, ast.For, ast.If, ast.Expr, ast.Try, ast.ExceptHandler,
    ast.Name, ast.Load, ast.Store, ast.Constant, ast.Tuple, ast.Subscript, ast.Slice, ast.Call,
    ast.BinOp, ast.UnaryOp, ast.Compare, ast.operator, ast.unaryop, ast.cmpop,
)  # fmt: skip
ATTRIBUTES = {"shape"}


def generated(source: str, values: Mapping[str, Any]) -> Callable[..., Any]:
    """Make the function that a text defines.

    Parameters
    ----------
    source
        One ``def``, of assignments, loops, conditions, arithmetic, indices and calls.
    values
        By name: what it uses beside its arguments.

    Raises
    ------
    ValueError
        When the text holds anything else, or a name that nothing gives a value.
    """
    tree = parsed(source)
    if len(tree.body) != 1 or not isinstance(tree.body[0], ast.FunctionDef):
        raise ValueError("generated code must be one function")
    function = tree.body[0]
    _check(function, values)
    namespace: dict[str, Any] = {"__builtins__": BUILTINS, **values}
    exec(compile(tree, f"<generated {function.name}>", "exec"), namespace)
    made: Callable[..., Any] = namespace[function.name]
    return made


def row(name: str, count: int, index: str = "", first: int = 0) -> str:
    """Source of a tuple of items of an array: ``row("state", 2)`` is ``(state[0], state[1], )``.

    Parameters
    ----------
    name
        Of the array or tuple.
    count
        Number of items.
    index
        What follows the number inside the brackets, e.g. ``, c``.
    first
        Number of the first item.
    """
    return "(" + "".join(f"{name}[{k}{index}], " for k in range(first, first + count)) + ")"


def _check(function: ast.FunctionDef, values: Mapping[str, Any]) -> None:
    nodes = [node for node in ast.walk(function) if node is not function]
    known = {argument.arg for argument in function.args.args} | {*values, *BUILTINS}
    known |= {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    for name in (function.name, *known):
        if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("__"):
            raise ValueError(f"{name!r} cannot name anything in generated code")
    for node in nodes:
        if isinstance(node, ast.Attribute):
            if node.attr not in ATTRIBUTES:
                raise ValueError(f"generated code must not use .{node.attr}")
        elif not isinstance(node, ALLOWED):
            raise ValueError(f"generated code must not hold a {type(node).__name__}")
        elif isinstance(node, ast.Name) and node.id not in known:
            raise ValueError(f"generated code uses {node.id}, which has no value")
