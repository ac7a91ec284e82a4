"""Round bodies in a vertical plane: gravity, a floor, a pile that stands until it is struck, impacts with friction.

Small fixed steps with impulses, as rigid-body simulators do (Guendelman, Bridson and Fedkiw, SIGGRAPH 2003). The
state recorded at each step is, by definition, the truth of the clip.
"""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array, Mask

STEP_S = 5e-4
WAKING_SPEED = 0.05  # m/s, of a body that strikes one at rest
SAGGING_M = 2e-3  # a body falls once one that carried it has moved this far
STATIC_SPEED = 0.15  # m/s; slower contacts do not bounce

compiled = kernel(nogil=True)


class Pile(NamedTuple):
    """Bodies: positions and velocities (n, 2) m, angles and spins (n,) rad, radii (n,) m, masses (n,).

    Those not ``awake`` (n,) stand still where they are, ``home`` (n, 2); body i falls when one that carries it,
    ``carried_by[i]`` (n,), is gone. ``woken_at`` (n,) step at which each was struck, -1 until then.
    """

    position: Array
    velocity: Array
    angle: Array
    spin: Array
    radius: Array
    mass: Array
    awake: Mask
    home: Array
    carried_by: Mask
    woken_at: NDArray[np.int64]


class Material(NamedTuple):
    """Constants common to all bodies: restitution, friction coefficient, rolling loss 1/s, gravity m/s^2."""

    restitution: float
    friction: float
    rolling: float
    gravity: float


def pile_of(position: Array, radius: Array, mass: Array) -> Pile:
    """A pile at rest of bodies with centres (n, 2) m, radii and masses (n,): each stands on lower ones it touches."""
    count = len(radius)
    apart = np.linalg.norm(position[:, np.newaxis] - position, axis=-1)
    touching = apart < radius[:, np.newaxis] + radius + 1e-4
    lower = position[:, np.newaxis, 1] > position[:, 1] + 0.2 * radius
    still = (np.zeros(count), np.zeros(count))
    asleep, never = np.zeros(count, dtype=np.bool_), np.full(count, -1)
    moving = (position.copy(), np.zeros((count, 2)), *still)
    return Pile(*moving, radius, mass, asleep, position.copy(), touching & lower, never)


@compiled
def run(pile: Pile, material: Material, steps: int) -> tuple[Array, Array]:
    """Positions (steps + 1, n, 2) and angles (steps + 1, n), a step every 0.5 ms; the pile is changed.

    Parameters
    ----------
    pile
        At the start.
    material
        Contact constants of the bodies.
    steps
        Number of steps.
    """
    count = len(pile.radius)
    positions, angles = np.empty((steps + 1, count, 2)), np.empty((steps + 1, count))
    positions[0], angles[0] = pile.position, pile.angle
    for step in range(1, steps + 1):
        for body in range(count):
            if pile.awake[body]:
                pile.velocity[body, 1] -= material.gravity * STEP_S
            pile.position[body] += pile.velocity[body] * STEP_S
            pile.angle[body] += pile.spin[body] * STEP_S
        for a in range(count):
            for b in range(a + 1, count):
                if pile.awake[a] or pile.awake[b]:
                    _meet(pile, material, a, b, step)
        _land_all(pile, material)
        _wake_unsupported(pile)
        positions[step], angles[step] = pile.position, pile.angle
    return positions, angles


@compiled
def _meet(pile: Pile, material: Material, a: int, b: int, step: int) -> None:
    """If two bodies overlap: move them apart, and let them bounce."""
    x, z = pile.position[b, 0] - pile.position[a, 0], pile.position[b, 1] - pile.position[a, 1]
    distance = np.sqrt(x * x + z * z)
    overlap = pile.radius[a] + pile.radius[b] - distance
    if overlap <= 0:
        return
    x, z = x / distance, z / distance
    closing = -(x * (pile.velocity[b, 0] - pile.velocity[a, 0]) + z * (pile.velocity[b, 1] - pile.velocity[a, 1]))
    for body in (a, b):
        if closing > WAKING_SPEED and not pile.awake[body]:
            pile.awake[body] = True
            pile.woken_at[body] = step
    # a body that is not awake does not move
    inverse_a, inverse_b = pile.awake[a] / pile.mass[a], pile.awake[b] / pile.mass[b]
    share = 0.5 * overlap / (inverse_a + inverse_b)
    pile.position[a, 0] -= share * inverse_a * x
    pile.position[a, 1] -= share * inverse_a * z
    pile.position[b, 0] += share * inverse_b * x
    pile.position[b, 1] += share * inverse_b * z
    if closing > 0:
        bounce = material.restitution if closing > STATIC_SPEED else 0.0
        impulse = (1 + bounce) * closing / (inverse_a + inverse_b)
        _push(pile, material, a, b, (x, z), impulse)


@compiled
def _push(pile: Pile, material: Material, a: int, b: int, normal: tuple[float, float], impulse: float) -> None:
    """Apply an impulse along the normal, and friction across it, which sets the bodies spinning."""
    inverse_a, inverse_b = pile.awake[a] / pile.mass[a], pile.awake[b] / pile.mass[b]
    x, z = normal
    slip = -z * (pile.velocity[b, 0] - pile.velocity[a, 0]) + x * (pile.velocity[b, 1] - pile.velocity[a, 1])
    slip -= pile.spin[a] * pile.radius[a] + pile.spin[b] * pile.radius[b]
    rubbing = -np.sign(slip) * min(material.friction * impulse, abs(slip) / (3 * (inverse_a + inverse_b)))
    push_x, push_z = impulse * x - rubbing * z, impulse * z + rubbing * x
    pile.velocity[a, 0] -= push_x * inverse_a
    pile.velocity[a, 1] -= push_z * inverse_a
    pile.velocity[b, 0] += push_x * inverse_b
    pile.velocity[b, 1] += push_z * inverse_b
    pile.spin[a] -= 2 * rubbing * inverse_a / pile.radius[a]
    pile.spin[b] -= 2 * rubbing * inverse_b / pile.radius[b]


@compiled
def _land_all(pile: Pile, material: Material) -> None:
    """Contact with the floor: bodies bounce, and friction slows sliding and rolling."""
    for body in range(len(pile.radius)):
        below = pile.radius[body] - pile.position[body, 1]
        if below <= 0 or not pile.awake[body]:
            continue
        pile.position[body, 1] += below
        falling = -pile.velocity[body, 1]
        if falling > 0:
            pile.velocity[body, 1] = material.restitution * falling if falling > STATIC_SPEED else 0.0
        slip = pile.velocity[body, 0] + pile.spin[body] * pile.radius[body]
        change = min(material.friction * material.gravity * STEP_S, abs(slip) / 3) * np.sign(slip)
        slower = max(0.0, 1 - material.rolling * STEP_S)
        pile.velocity[body, 0] = slower * (pile.velocity[body, 0] - change)
        pile.spin[body] = slower * (pile.spin[body] - 2 * change / pile.radius[body])


@compiled
def _wake_unsupported(pile: Pile) -> None:
    """Bodies whose support has moved away begin to fall."""
    for body in range(len(pile.radius)):
        if pile.awake[body]:
            continue
        for under in range(len(pile.radius)):
            if pile.carried_by[body, under]:
                x = pile.position[under, 0] - pile.home[under, 0]
                z = pile.position[under, 1] - pile.home[under, 1]
                if x * x + z * z > SAGGING_M**2:
                    pile.awake[body] = True
