"""What effects on a known input share: which of several inputs they act on."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, OdeModel, Parameter


def is_driven(model: OdeModel) -> bool:
    """Whether the model has a known input."""
    return bool(model.inputs)


def which_parameter(name: str) -> Parameter:
    """The number of the input on which an effect acts."""
    source = "number of the input, from 0; a diagnosis tries each"
    return Parameter(name, "1", "j", lower=0.0, default=0.0, constant=True, source=source)


def chosen(inputs: Array, which: float) -> tuple[Array, int]:
    """A copy of the inputs (n, m) in their units, and the column that is meant; the first where there are fewer."""
    column = round(which)
    return np.array(inputs, dtype=np.float64), column if 0 <= column < inputs.shape[1] else 0


def each(t_s: Array, inputs: Array) -> list[tuple[float, ...]]:
    """The number of each input, to be tried. ``t_s`` (n,), s; ``inputs`` (n, m), in their units."""
    return [(float(k),) for k in range(inputs.shape[1])]
