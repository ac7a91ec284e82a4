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

    Its arguments are arrays, compared by their bytes, and numbers, all by position. A search fits hundreds of models to
    one record, whose noise, outliers and windows are the same for all of them.
    """
    answers: OrderedDict[Hashable, R] = OrderedDict()

    @wraps(function)
    def kept(*args: P.args, **kwargs: P.kwargs) -> R:
        key = tuple((each.shape, each.tobytes()) if isinstance(each, np.ndarray) else each for each in args)
        found = answers.pop(key) if key in answers else function(*args, **kwargs)
        answers[key] = found
        while len(answers) > KEPT:
            answers.popitem(last=False)
        return found

    return kept
