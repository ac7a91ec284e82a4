"""Bodies that all pull at one another in proportion to their distance, as the IRIS benchmark has the hitting cones."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from fitters.integrator.codegen import generated
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.errors import FitError
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory, picklable

# One line a body, so that the right-hand side holds numbers and tuples only, as numba needs.
_SOURCE = """
def rhs(t, state, params):
    coupling, damping = params
    together = {together}
    return ({velocities}, {accelerations})
"""


def contact_chain(bodies: int) -> OdeModel:
    """Make the chain of that number of ``bodies``; it observes z1, z2, ... FitError for fewer than two."""
    if bodies < 2:
        raise FitError(f"a contact chain needs at least 2 bodies, not {bodies}")
    names = [str(k + 1) for k in range(bodies)]
    positions = tuple(Quantity(f"z{name}", "m", f"z_{{{name}}}") for name in names)
    velocities = tuple(Quantity(f"v{name}", "m/s", f"v_{{{name}}}") for name in names)
    return OdeModel(
        name="contact-chain",
        summary=f"{bodies} bodies that all pull at one another in proportion to their distance",
        equation=r"\ddot z_i + \zeta\,\dot z_i + \kappa\,\sum_j (z_i - z_j) = 0",
        source="IRIS benchmark, table of equations (multi-body contact)",
        states=(*positions, *velocities),
        parameters=(
            Parameter("coupling", "1/s^2", r"\kappa", lower=-1e4, upper=1e6, default=0.0),
            Parameter("damping", "1/s", r"\zeta", lower=-1e2, upper=1e4, default=0.0, role="damping"),
        ),
        observed=positions,
        rhs=_rhs(bodies),
        guess=_guess(bodies),
        first_integral=_energy,
        dissipative=("damping",),
    )


@picklable
@functools.cache
def _rhs(bodies: int) -> Callable[..., tuple[float, ...]]:
    """z_i'' = -damping z_i' - coupling (bodies z_i - sum of all z)."""
    lines = [f"-damping * state[{bodies + k}] - coupling * ({bodies} * state[{k}] - together)" for k in range(bodies)]
    source = _SOURCE.format(
        together=" + ".join(f"state[{k}]" for k in range(bodies)),
        velocities=", ".join(f"state[{bodies + k}]" for k in range(bodies)),
        accelerations=", ".join(lines),
    )
    return generated(source, {})


@picklable
@functools.cache
def _guess(bodies: int) -> Callable[[Trajectory], Mapping[str, float]]:
    def guess(trajectory: Trajectory) -> Mapping[str, float]:
        """Take each body's acceleration regressed on its distance from all others and its speed; the median counts."""
        columns = [samples(trajectory, f"z{k + 1}") for k in range(bodies)]
        t_s = columns[0][0]
        total = np.sum([values for _, values in columns], axis=0)
        values, pairs = {}, []
        for k, (_, own) in enumerate(columns):
            pull = (total - bodies * own)[:, None]
            (coupling, friction), half_width_s = weak_regression(t_s, own, pull)
            start = start_of(t_s, own, half_width_s)
            values[f"z{k + 1}_0"], values[f"v{k + 1}_0"] = float(start[0]), float(start[1])
            pairs.append((coupling, -friction))
        finite = [pair for pair in pairs if np.all(np.isfinite(pair))]
        coupling, damping = np.median(finite, axis=0) if finite else (0.0, 0.0)
        return {**values, "coupling": float(coupling), "damping": float(np.clip(damping, -1.0, 50.0))}

    return guess


def _energy(states: Array, params: Array) -> Array:
    """Sum of v^2 / 2 and of coupling (z_i - z_j)^2 / 2 over all pairs, in m^2/s^2."""
    bodies = states.shape[1] // 2
    pairs = sum((states[:, i] - states[:, j]) ** 2 for i, j in combinations(range(bodies), 2))
    return np.asarray(np.sum(states[:, bodies:] ** 2, axis=1) / 2 + params[0] * pairs / 2)


MODEL = replace(
    contact_chain(3),
    typical="bodies that share their motion within a second: coupling of some 10 1/s^2",
    example=ModelExample(
        {
            "coupling": 3.0,
            "damping": 0.4,
            "z1_0": -0.3,
            "z2_0": 0.0,
            "z3_0": 0.1,
            "v1_0": 1.5,
            "v2_0": 0.0,
            "v3_0": 0.1,
        },
        samples=600,
        rate_hz=60.0,
    ),
)
