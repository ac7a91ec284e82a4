"""Answers of functions of arrays that are asked again and again of the same record."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

KEPT = 16  # last answers of a function: of a few records

P = ParamSpec("P")
R = TypeVar("R")


def keeping_answers(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which keeps its last KEPT answers; they belong to all callers, who must not change them.

    Its arguments are numbers, and arrays compared by their bytes. A search fits hundreds of models to a record, whose
    noise, outliers and windows are the same for all of them.
    """
    answers: OrderedDict[Hashable, tuple[R]] = OrderedDict()

    @wraps(function)
    def kept(*args: P.args, **kwargs: P.kwargs) -> R:
        given = (*enumerate(args), *kwargs.items())
        key = tuple((name, _identity(each)) for name, each in given)
        answer = answers.pop(key, None)
        answers[key] = answer = answer or (function(*args, **kwargs),)
        while len(answers) > KEPT:
            answers.popitem(last=False)
        return answer[0]

    return kept


def _identity(value: object) -> object:
    """What is the same for equal arrays or numbers."""
    return (value.shape, value.dtype.str, value.tobytes()) if isinstance(value, np.ndarray) else value
