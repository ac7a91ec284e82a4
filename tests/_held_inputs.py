"""Records under an input that keeps its values between jumps, integrated by SciPy from jump to jump."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

from iris_sysid import Quantity, Trajectory
from iris_sysid.types import Array


def states_under(
    rates: Callable[[Array, float], Sequence[float]],
    start: Sequence[float],
    inputs: Array,
    each: int,
    step_s: float,
    **solver: object,
) -> Array:
    """States (n, s) every ``step_s`` under inputs (n,) that jump every ``each`` samples; ``rates(state, input)``."""
    states, inside = [np.array(start)], np.arange(1, each + 1) * step_s
    for held in inputs[::each]:
        solved = solve_ivp(
            lambda t, state, held=held: rates(state, held), (0, each * step_s), states[-1], t_eval=inside, **solver
        )
        states += list(solved.y.T)
    return np.array(states[: inputs.size])


def held_record(quantity: Quantity, seen: Array, driver: Quantity, inputs: Array, step_s: float) -> Trajectory:
    """The trajectory of what is seen (n,) of a quantity under held inputs (n,)."""
    seen = seen[:, None]
    return Trajectory(
        np.arange(inputs.size) * step_s, (quantity,), seen, np.full_like(seen, np.nan), np.ones(inputs.size, bool),
        input_quantities=(driver,), inputs=inputs[:, None], hold="zero-order",
    )  # fmt: skip
