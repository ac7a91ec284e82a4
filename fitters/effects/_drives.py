"""What effects on a known input share: which of several inputs they act on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fitters.effects._domain import on_a_line
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
