"""How results show themselves: a console gets three lines at most, a notebook a picture and a table."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from iris_sysid.types._numbers import Estimate, Quantity

WIDEST = 150  # characters of a line
MAX_VALUE_LETTERS = 60


class Brief:
    """A dataclass whose fields are shown shortly: shapes of arrays, names of a mapping, number of items."""

    __slots__ = ()

    def __repr__(self) -> str:
        parts = (f"{field.name}={_short(getattr(self, field.name))}" for field in fields(self))  # type: ignore[arg-type]  # of subclasses
        return "\n  ".join(textwrap.wrap(f"{type(self).__name__}({', '.join(parts)})", WIDEST, max_lines=3))


class Shown:
    """A result that a notebook shows with its picture and its table."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        from iris_sysid import to_html  # the front door: pictures are drawn by packages above this one

        return to_html(self)  # type: ignore[arg-type]  # of subclasses


def text_of(*lines: str) -> str:
    """The lines that are not empty, each cut at a width that a console has."""
    return "\n  ".join(textwrap.shorten(line, WIDEST, placeholder=" ...") for line in lines if line)


def with_units(quantities: Iterable[Quantity]) -> str:
    """Names with their units, e.g. ``x (m), z (m)``."""
    return ", ".join(f"{quantity.name} ({quantity.unit})" for quantity in quantities)


def values_of(estimates: Mapping[str, Estimate]) -> str:
    """Names with their values, e.g. ``length = 0.5 ± 0.001 m``."""
    return ", ".join(f"{name} = {estimate}" for name, estimate in estimates.items())


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"<{value.dtype} {value.shape}>"
    if isinstance(value, Mapping):
        return f"{{{textwrap.shorten(', '.join(map(str, value)), MAX_VALUE_LETTERS, placeholder=' ...')}}}"
    if isinstance(value, (tuple, list)) and len(repr(value)) > MAX_VALUE_LETTERS:
        return f"<{len(value)} items>"
    shown = repr(value) if not callable(value) else getattr(value, "__qualname__", type(value).__name__)
    return shown if len(shown) <= MAX_VALUE_LETTERS else f"<{type(value).__name__}>"
