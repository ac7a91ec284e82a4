"""Checks of the trajectory and of the user's settings that all phenomena share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from iris_sysid.errors import DataError
from iris_sysid.types import Estimate, Mask, Trajectory


def only_body(world: Sequence[Trajectory], name: str) -> Trajectory:
    """The first trajectory, of x and z in one unit; DataError when there is none."""
    if not world:
        raise DataError(f"{name} needs the trajectory of one body, but none was given")
    body = world[0]
    if len(body.quantities) < 2 or body.quantities[0].unit != body.quantities[1].unit:
        have = ", ".join(f"{quantity.name} in {quantity.unit}" for quantity in body.quantities)
        raise DataError(f"{name} needs x and z in the same unit, but the trajectory has {have}")
    return body


def only_measured(world: Sequence[Trajectory], name: str, quantity: str) -> Trajectory:
    """The first trajectory, which must hold one quantity of that name; DataError when it does not."""
    if not world:
        raise DataError(f"{name} needs the trajectory of one body, but none was given")
    body = world[0]
    if [quantity.name for quantity in body.quantities] != [quantity]:
        have = ", ".join(f"{quantity.name} in {quantity.unit}" for quantity in body.quantities)
        raise DataError(f"{name} needs {quantity}, but the trajectory has {have}")
    return body


def as_tracked(name: str, quantity: str, world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the only quantity of a body as the tracker gives it; the motion is that of its segments.

    What may be stated are constants of the model: ``settings`` is not used. DataError when the motion has fewer than
    five samples.
    """
    body = only_measured(world, name, quantity)
    in_motion(body, 5)
    return body


def in_motion(body: Trajectory, fewest: int) -> Mask:
    """The valid samples (n,) of the motion; DataError when there are fewer than ``fewest``."""
    used = body.valid & body.mask("motion")
    if used.sum() < fewest:
        raise DataError(
            f"the motion has {int(used.sum())} samples, at least {fewest} are needed; "
            "is the clip cut too short, or is the body seen in too few frames?"
        )
    return used


def stated(settings: Mapping[str, Estimate], *names: str) -> dict[str, Estimate]:
    """The named settings that the user gave."""
    return {name: settings[name] for name in names if name in settings}


def stated_length(settings: Mapping[str, Estimate], names: Sequence[str], unit: str) -> Estimate | None:
    """The first of the named lengths that the user gave, or None; positive and in the unit of the positions."""
    for name in names:
        if name not in settings:
            continue
        length = settings[name]
        if length.unit not in (unit, ""):
            raise DataError(f"{name} is given in {length.unit}, but positions are in {unit}: give the scale as well")
        if not length.value > 0:
            raise DataError(f"{name} = {length.value:g} {unit}: a length must be above zero")
        return length
    return None
