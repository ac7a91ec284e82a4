"""A component of a residual as an effect of one's own: its curve is the form, its size a factor that is fitted.

What a component shows and no formula fits can so be added to an equation, and the error after is reported for it too.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import (
    SIDES,
    Array,
    Component,
    ComponentCurve,
    ComponentKind,
    Components,
    Effect,
    OdeModel,
    Parameter,
    picklable,
)

Points = tuple[float, ...]


def kept_effects(components: Components | None, kinds: Sequence[ComponentKind], model: OdeModel) -> list[Effect]:
    """The components of these kinds as effects.

    Parameters
    ----------
    components
        Of the residual of the model.
    kinds
        Which to keep.
    model
        One coordinate must be observed: the curve of a component is that of one.

    Raises
    ------
    DataError
        When there is no such component, or none with a curve.
    """
    parts = {} if components is None else {part.kind: part for part in components.parts}
    effects = []
    for kind in kinds:
        part = parts.get(kind)
        if part is None:
            there = f"its components are {', '.join(parts)}" if parts else "it has no components"
            raise DataError(f"the residual has no component {kind!r}; {there}")
        if part.curve is None or model.degrees_of_freedom > 1 or len(model.observed) > 1:
            raise DataError(f"the component {kind!r} has no curve over one coordinate, so it cannot be kept")
        effects.append(_effect(part, part.curve))
    return effects


def _effect(part: Component, curve: ComponentCurve) -> Effect:
    at, values = tuple(curve.at.tolist()), tuple(curve.values[:, 0].tolist())
    acts = {"acceleration": _force(part.kind, at, values)} if SIDES[part.kind] == "force" else {}
    seen = {} if acts else {"observe": _reading(part.kind, at, values)}
    return Effect(
        name=f"kept-{part.kind}",
        summary=f"the component {part.kind} as the residual has it",
        equation=r"s\,c(\cdot)",
        source="the curve of the component, between its points on straight lines",
        parameters=(Parameter(f"kept_{part.kind.replace('-', '_')}", "1", "s", default=0.0),),
        component=part.kind,
        applies=_any,
        cause="physics" if acts else "clock" if part.kind == "clock" else "measurement",
        **acts,
        **seen,
    )


def _any(model: OdeModel) -> bool:
    return True


@picklable
@functools.lru_cache(maxsize=64)
def _force(kind: ComponentKind, at: Points, values: Points) -> Callable[..., float]:
    """The acceleration of a component at its argument; numba compiles it."""
    places, sizes = np.array(at), np.array(values)
    if kind == "force-of-velocity":
        return lambda t, position, velocity, speed, base, params: params[0] * np.interp(velocity, places, sizes)
    if kind == "force-of-position":
        return lambda t, position, velocity, speed, base, params: params[0] * np.interp(position, places, sizes)
    if kind == "own-force-drift":
        return lambda t, position, velocity, speed, base, params: params[0] * base * np.interp(t, places, sizes)
    return lambda t, position, velocity, speed, base, params: params[0] * np.interp(t, places, sizes)


@picklable
@functools.lru_cache(maxsize=64)
def _reading(kind: ComponentKind, at: Points, values: Points) -> Callable[[Array, Array, Array, Array], Array]:
    """What is read (n, 1) with a component, from the times (n,) s, what a right sensor reads, and its rate (n, 1)."""

    def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
        along = {"reading-of-position": observed, "reading-of-velocity": velocity}.get(kind, t_s[:, None])
        change = np.interp(along, at, values)
        return np.asarray(observed + params[0] * (velocity * change if kind == "clock" else change))

    return observe
