"""Two bodies, each on its own spring, joined by another spring; their masses may differ."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._oscillator import rest_position
from fitters.models._reading import shifted
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float, float, float], params: tuple[float, ...]
) -> tuple[float, float, float, float]:
    """Give z_i'' = -damping_i z_i' - stiffness_i z_i - coupling_i (z_i - z_j)."""
    z_1, z_2, v_1, v_2 = state
    stiffness_1, stiffness_2, damping_1, damping_2, coupling_1, coupling_2, _, _ = params
    return (
        v_1,
        v_2,
        -damping_1 * v_1 - stiffness_1 * z_1 - coupling_1 * (z_1 - z_2),
        -damping_2 * v_2 - stiffness_2 * z_2 - coupling_2 * (z_2 - z_1),
    )


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the places of rest from both bodies' weak forms with a constant force; the rest about them."""
    t_s, z_1 = samples(trajectory, "z1")
    _, z_2 = samples(trajectory, "z2")
    rows, forces = [], []
    for own, other, sign in ((z_1, z_2, 1), (z_2, z_1, -1)):
        terms = np.column_stack([-own, other - own, np.ones_like(own)])
        (stiffness, coupling, force, _), _ = weak_regression(t_s, own, terms)
        rows.append([stiffness + coupling, -coupling][::sign])
        forces.append(force)
    rests = np.zeros(2)
    if np.all(np.isfinite(rows)) and np.linalg.det(rows) > 0:
        rests = np.clip(np.linalg.solve(rows, forces), [z_1.min(), z_2.min()], [z_1.max(), z_2.max()])
    columns = [trajectory.column("z1"), trajectory.column("z2")]
    position = trajectory.position.copy()
    position[:, columns] -= rests
    about = guess_about_rest(trajectory.with_(position=position, smoothed=None))
    return {**about, "rest_1": float(rests[0]), "rest_2": float(rests[1])}


def guess_about_rest(trajectory: Trajectory) -> Mapping[str, float]:
    """Take each body's acceleration regressed on its position, its distance from the other body and its speed."""
    t_s, z_1 = samples(trajectory, "z1")
    _, z_2 = samples(trajectory, "z2")
    values = {}
    for body, own, other in (("1", z_1, z_2), ("2", z_2, z_1)):
        (stiffness, coupling, friction), half_width_s = weak_regression(t_s, own, np.column_stack([-own, other - own]))
        if not np.isfinite(stiffness):  # too few samples: take the clip for a quarter of a period
            stiffness, coupling, friction = (np.pi / 2 / (t_s[-1] - t_s[0])) ** 2, 0.0, 0.0
        start = start_of(t_s, own, half_width_s)
        values[f"stiffness_{body}"], values[f"coupling_{body}"] = float(stiffness), float(coupling)
        values[f"damping_{body}"] = float(np.clip(-friction, -1.0, 50.0))
        values[f"z{body}_0"], values[f"v{body}_0"] = float(start[0]), float(start[1])
    return values


def energy(states: Array, params: Array) -> Array:
    """Energy over the two masses' common scale, m^2/s^4: the couplings are to one another as the inverse masses.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    z, v = states[:, :2], states[:, 2:]
    own_energy = v**2 / 2 + params[:2] * z**2 / 2
    stretched = (z[:, 0] - z[:, 1]) ** 2 / 2
    return np.asarray(params[5] * own_energy[:, 0] + params[4] * own_energy[:, 1] + params[4] * params[5] * stretched)


MODEL = OdeModel(
    name="coupled-oscillators",
    summary="two bodies, each on its own spring, joined by a spring; coupling_1 / coupling_2 is the mass of 2 over 1",
    equation=r"\ddot z_i + \zeta_i\,\dot z_i + \alpha_i\,z_i + \kappa_i\,(z_i - z_j) = 0",
    source="Landau and Lifshitz, Mechanics, section 23; Schmidt and Lipson (2009), Science 324, 81, air track",
    states=(
        Quantity("z1", "m", "z_1"),
        Quantity("z2", "m", "z_2"),
        Quantity("v1", "m/s", "v_1"),
        Quantity("v2", "m/s", "v_2"),
    ),
    parameters=(
        Parameter("stiffness_1", "1/s^2", r"\alpha_1", lower=-1e6, upper=1e9),
        Parameter("stiffness_2", "1/s^2", r"\alpha_2", lower=-1e6, upper=1e9),
        Parameter("damping_1", "1/s", r"\zeta_1", lower=-1e2, upper=1e4, role="damping"),
        Parameter("damping_2", "1/s", r"\zeta_2", lower=-1e2, upper=1e4, role="damping"),
        Parameter("coupling_1", "1/s^2", r"\kappa_1", lower=-1e6, upper=1e9),
        Parameter("coupling_2", "1/s^2", r"\kappa_2", lower=-1e6, upper=1e9),
        rest_position("rest_1", "m", r"z_{r1}"),
        rest_position("rest_2", "m", r"z_{r2}"),
    ),
    observed=(Quantity("z1", "m", "z_1"), Quantity("z2", "m", "z_2")),
    rhs=rhs,
    observe=partial(shifted, 2, 6),
    guess=guess,
    first_integral=energy,
    dissipative=("damping_1", "damping_2"),
    typical="0.2 kg on a spring of 10 N/m: 50 1/s^2",
    example=ModelExample(
        {
            "stiffness_1": 7.8,
            "stiffness_2": 3.1,
            "damping_1": 0.04,
            "damping_2": 0.05,
            "coupling_1": 78.0,
            "coupling_2": 32.0,
            "z1_0": 0.0,
            "z2_0": -0.14,
            "v1_0": -0.1,
            "v2_0": 0.0,
        },
        samples=500,
        rate_hz=60.0,
    ),
)
