"""What effects with hidden states share: where they act, a force against the state, ways that the motion shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._domain import falls, moves_on_a_line
from iris_sysid.types import Array, OdeModel, Parameter


def is_driven_on_a_line(model: OdeModel) -> bool:
    """Whether a known input drives something along one coordinate: only then a memory differs from a start."""
    return moves_on_a_line(model) and bool(model.inputs) and not falls(model)


def against_the_state(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, ...],
    hidden: tuple[float],
) -> float:  # fmt: skip
    """-c z: the size of the effect times its hidden state, against it."""
    return -params[0] * hidden[0]


def ways_of(observed: Array, shares: Sequence[float]) -> list[tuple[float, ...]]:
    """Shares of how far the motion reaches that are longer than the way in a sample, each with that reach.

    ``observed`` (n, d) and the ways, in the same unit; NaN samples are left out.
    """
    known = observed[np.isfinite(observed).all(axis=1), 0]
    span = float(np.ptp(known))
    step = float(np.quantile(np.abs(np.diff(known)), 0.9)) if known.size > 1 else 0.0
    return [(share * span, span) for share in shares if share * span > step]


def reach_parameter(name: str) -> Parameter:
    """How far the motion reaches: a memory that reaches farther is a spring."""
    return Parameter(
        name, "{x}", "X", lower=1e-12, default=1.0, constant=True, role="shape", source="taken from the motion"
    )
