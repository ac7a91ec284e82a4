"""What effects on a known input share: on which of several inputs they act, and powers of its size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from fitters.effects._domain import on_a_line
from fitters.effects._powers import MIN_BASE, SCALE
from iris_sysid.types import Array, OdeModel, Parameter, picklable


def is_driven(model: OdeModel) -> bool:
    """Whether the model has a known input."""
    return bool(model.inputs)


def tells_one_reading(model: OdeModel) -> bool:
    """Whether a known input tells what the one sensor should read."""
    return is_driven(model) and on_a_line(model)


def which_parameter(name: str) -> Parameter:
    """The number of the input on which an effect acts."""
    source = "number of the input, from 0; a diagnosis tries each"
    return Parameter(name, "1", "j", lower=0.0, default=0.0, constant=True, source=source)


@picklable
def on_one_input(change: Callable[..., Array]) -> Callable[[Array, Array, Array], Array]:
    """The ``drive`` of an effect on one input, whose number is its last parameter; the first if there is none such.

    ``change(t_s (n,), given (n,), *params)`` returns what acts (n,) of that input, in its unit.
    """

    def drive(t_s: Array, inputs: Array, params: Array) -> Array:
        *own, which = params
        column = round(which)
        column = column if 0 <= column < inputs.shape[1] else 0
        acting = np.array(inputs, dtype=np.float64)
        acting[:, column] = change(t_s, np.ascontiguousarray(acting[:, column]), *own)
        return acting

    return drive


def each(t_s: Array, inputs: Array) -> list[tuple[float, ...]]:
    """The number of each input, to be tried. ``t_s`` (n,), s; ``inputs`` (n, m), in their units."""
    return [(float(k),) for k in range(inputs.shape[1])]


def largest_parameter(name: str, source: str) -> Parameter:
    """The largest size of an input, on which the share of a power counts."""
    return replace(SCALE, name=name, unit="1", symbol="u_1", source=source)


@picklable
def powers_of_each(powers: Sequence[float]) -> Callable[[Array, Array], list[tuple[float, ...]]]:
    """The ``trials`` of some powers of each input: the power, its largest size, and its number."""

    def trials(t_s: Array, inputs: Array) -> list[tuple[float, ...]]:
        sizes = [float(size) + MIN_BASE for size in np.nanmax(np.abs(inputs), axis=0)]
        return [(exponent, size, float(k)) for (k, size), exponent in product(enumerate(sizes), powers)]

    return trials
