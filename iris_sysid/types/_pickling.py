"""Pickling of what pickle alone refuses: read-only mappings, and functions that were made from other functions.

A process pool sends models, trajectories and results as pickles. A function that a maker returned is sent as a call of
the maker, so that it is compiled once in each process; one that a user wrote where no other process finds it (a
lambda, a function in a function or a notebook) is sent by value.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from dataclasses import fields
from types import FunctionType, MappingProxyType
from typing import Any

RECIPE = "made_by"
NOWHERE = ("<locals>", "<lambda>")
OWN_FILE = "_own_file_"  # beginning of the names of the modules that users' files are run as


def picklable(maker: Callable[..., Any]) -> Callable[..., Any]:
    """Let the function that a maker at the top of a module returns be pickled: as a call with the same arguments."""

    @functools.wraps(maker)
    def make(*arguments: Any) -> Any:
        function = maker(*arguments)
        if isinstance(function, FunctionType) and _is_nowhere(function) and not hasattr(function, RECIPE):
            setattr(function, RECIPE, (make, arguments))
        return function

    return make


class Portable:
    """A frozen dataclass that is pickled, and copied, as a call of its class: checked and made read-only again."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        """The class and its arguments."""
        given = (field.name for field in fields(self) if field.init)  # type: ignore[arg-type]  # of subclasses
        return type(self), tuple(_portable(getattr(self, name)) for name in given)


class _Call:
    """Stands in a pickle for what a call returns."""

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.function, self.arguments = function, arguments

    def __reduce__(self) -> tuple[Any, ...]:
        return self.function, tuple(_portable(argument) for argument in self.arguments)


def _portable(value: Any) -> Any:
    """The value as pickle takes it."""
    if isinstance(value, MappingProxyType):
        return dict(value)
    if isinstance(value, tuple) and type(value) is tuple:
        return tuple(_portable(item) for item in value)
    if isinstance(value, functools.partial):
        return _Call(functools.partial, (value.func, *value.args)) if not value.keywords else value
    if not isinstance(value, FunctionType):
        return value
    if hasattr(value, RECIPE):
        return _Call(*getattr(value, RECIPE))
    return _by_value(value) if _is_nowhere(value) or value.__module__.startswith(("__main__", OWN_FILE)) else value


def _by_value(function: FunctionType) -> _Call:
    from numba import cloudpickle

    own = sys.modules.get(function.__module__)  # None where it came by value itself: it is sent on alike
    if own is not None and function.__module__.startswith(OWN_FILE):  # with the functions of its file that it calls
        cloudpickle.register_pickle_by_value(own)
    return _Call(_function_of, (cloudpickle.dumps(function),))


@functools.lru_cache(maxsize=256)
def _function_of(content: bytes) -> Any:
    """The same function for the same bytes, so that it is compiled once."""
    from numba import cloudpickle

    return cloudpickle.loads(content)


def _is_nowhere(function: FunctionType) -> bool:
    """Whether no import finds the function."""
    return any(mark in function.__qualname__ for mark in NOWHERE) or function.__code__.co_filename.startswith("<")
