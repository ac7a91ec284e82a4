"""The terms of a discovered equation as a feature library of pysindy. Imports pysindy: import it in a function."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pysindy import AxesArray
from pysindy.feature_library.base import BaseFeatureLibrary, x_sequence_or_item

from iris_sysid.types import Array, OdeModel


class TermLibrary(BaseFeatureLibrary):  # type: ignore[misc]  # pysindy ships no types
    """Features by name, each a slope of ``model`` with one of its parameters at one and the others at zero.

    ``places`` holds for each name the state whose slope it is and the index of the parameter, None for none.
    """

    def __init__(self, model: OdeModel, names: Sequence[str], places: Sequence[tuple[int, int | None]]) -> None:
        self.model, self.names, self.places = model, names, places

    @x_sequence_or_item  # type: ignore[untyped-decorator]
    def fit(self, x_full: Any, y: Any = None) -> TermLibrary:
        """Note the sizes: nothing is estimated."""
        self.n_features_in_, self.n_output_features_ = x_full[0].shape[-1], len(self.names)
        return self

    @x_sequence_or_item  # type: ignore[untyped-decorator]
    def transform(self, x_full: Any) -> list[Any]:
        """The features (n, f) of states and inputs (n, s + m), in the units of the terms."""
        return [AxesArray(self._features(np.asarray(x)), {"ax_sample": 0, "ax_coord": 1}) for x in x_full]

    def get_feature_names(self, input_features: Any = None) -> list[str]:
        """The names of the features."""
        return list(self.names)

    def _features(self, x: Array) -> Array:
        count = len(self.model.states)
        state, inputs = tuple(x[:, :count].T), tuple(x[:, count:].T)
        columns = [self._slopes(state, inputs, parameter)[row] for row, parameter in self.places]
        return np.column_stack([np.broadcast_to(column, len(x)) for column in columns])

    def _slopes(self, state: tuple[Array, ...], inputs: tuple[Array, ...], parameter: int | None) -> Any:
        params = tuple(float(k == parameter) for k in range(len(self.model.parameters)))
        return self.model.rhs(0.0, state, params, inputs) if inputs else self.model.rhs(0.0, state, params)
