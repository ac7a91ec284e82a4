"""Linear algebra on one thread: the matrices of a fit are so small that threads cost more time than they save."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]  # ships none

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def on_one_thread(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """A function that runs with one thread of BLAS, so that its sums do not depend on their number either."""

    @wraps(function)
    def limited(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@cache
def _libraries() -> ThreadpoolController:
    """The libraries of linear algebra in this process: they are searched for once, which takes a few ms."""
    import scipy.linalg  # noqa: F401  # is limited only when it is loaded

    return ThreadpoolController()
