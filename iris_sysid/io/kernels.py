"""Compile with numba and keep the machine code on disk: beside the package, or in the user's cache directory."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any, Literal

from numba import njit
from numba.core import event
from numba.core.types.misc import unliteral

from iris_sysid.io.compiling import CompileTime


class _Listener(event.Listener):  # type: ignore[misc]
    """Counts what numba compiles; loading kept machine code raises none of these events."""

    def __init__(self) -> None:
        self.time, self.depth, self.began_s = CompileTime(), 0, 0.0

    def on_start(self, event: Any) -> None:
        """Begin to count, unless a kernel is compiled for another one."""
        if self.depth == 0:
            self.began_s = time.perf_counter()
        self.depth += 1

    def on_end(self, event: Any) -> None:
        """Count up to here."""
        now = time.perf_counter()
        self.time.add(now - self.began_s)
        self.depth, self.began_s = self.depth - 1, now


event.register("numba:compile", _Listener())


def kernel(
    *signature: Any,
    inline: Literal["never", "always"] = "never",
    nogil: bool = False,
    error_model: Literal["numpy", "python"] = "numpy",
) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function with numba, and keep the machine code where a folder can be written, else in memory.

    Numba takes the folder of the source file if it can be written, otherwise the user's cache directory.

    Parameters
    ----------
    *signature
        Types of the arguments, where it is to be compiled when it is defined.
    inline
        Whether the text goes into each caller.
    nogil
        Let other threads run meanwhile.
    error_model
        ``numpy``: a division by zero gives inf or NaN; ``python``: it raises.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        compile_with = functools.partial(njit, *signature, error_model=error_model, nogil=nogil, inline=inline)
        try:
            return _once_a_type(compile_with(cache=True)(function))
        except RuntimeError:  # numba: no locator available, i.e. no folder in which to keep it
            return _once_a_type(compile_with()(function))

    return decorate


def _once_a_type(compiled: Any) -> Any:
    """Make numba compile a kernel once for each set of types, not again for each constant that another kernel gives it.

    A ball followed for the first time was compiled for 80 s; 10 of these were repeats.
    """
    template_for = compiled.get_call_template
    compiled.get_call_template = lambda given, named: template_for(
        tuple(unliteral(kind) for kind in given), {name: unliteral(kind) for name, kind in named.items()}
    )
    return compiled
