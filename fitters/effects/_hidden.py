"""What effects with hidden states share: where they act, and how far the motion reaches."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import falls, moves_on_a_line
from iris_sysid.types import Array, OdeModel, Parameter


def is_driven_on_a_line(model: OdeModel) -> bool:
    """Whether a known input drives something along one coordinate: only then a memory differs from a start."""
    return moves_on_a_line(model) and bool(model.inputs) and not falls(model)


def reach(observed: Array) -> tuple[float, float]:
    """How far the motion reaches, and how far it moves in one sample, both in the observed unit.

    ``observed`` (n, d), in that unit; NaN samples are left out.
    """
    known = observed[np.isfinite(observed).all(axis=1), 0]
    return float(np.ptp(known)), float(np.quantile(np.abs(np.diff(known)), 0.9)) if known.size > 1 else 0.0


def reach_parameter(name: str) -> Parameter:
    """How far the motion reaches: a memory that reaches farther is a spring."""
    return Parameter(
        name, "{x}", "X", lower=1e-12, default=1.0, constant=True, role="shape", source="taken from the motion"
    )
