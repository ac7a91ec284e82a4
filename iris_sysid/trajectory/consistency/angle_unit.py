"""Angles in degrees under a name that says rad: a pendulum that swings by more than a turn, or is a few mm long."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from iris_sysid.trajectory.consistency.path_shape import turning_values
from iris_sysid.types import Array, Doubt, Estimate, OdeModel, Trajectory

TURNING_POINTS = 4  # three swings to and fro
CENTRED = 0.1  # of a swing: how far the middles of swings differ that are about one point of rest
MIN_LENGTH_M = 5e-3  # length of a pendulum that anyone films or measures
REMEDY = "if they are, name the unit: theta_deg in the table's header, or theta[deg] among the columns"


def with_degrees_doubt(trajectory: Trajectory, model: OdeModel) -> Trajectory:
    """The trajectory with a doubt where it swings to and fro by more than a turn, which gravity does not allow.

    Only a model that moves by gravity, and observes angles in rad, is concerned.
    """
    if any(doubt.kind == "degrees" for doubt in trajectory.doubts) or not _hangs(model):
        return trajectory
    names = [quantity.name for quantity in trajectory.quantities]
    for quantity in model.observed:
        if quantity.unit == "rad" and quantity.name in names:
            values = trajectory.position[trajectory.valid, names.index(quantity.name)]
            swing = _swing(np.array(turning_values(values)[:TURNING_POINTS]))
            if swing > 2 * math.pi:
                text = f"{quantity.name} swings to and fro by {swing:.3g} rad, more than a turn: are these degrees?"
                return trajectory.with_(doubts=(Doubt("degrees", text, REMEDY), *trajectory.doubts))
    return trajectory


def short_pendulum_doubt(estimates: Mapping[str, Estimate], model: OdeModel) -> tuple[Doubt, ...]:
    """A doubt where a fitted pendulum is shorter than 5 mm, none otherwise."""
    length = estimates.get("length")
    if not _hangs(model) or length is None or length.unit != "m" or not 0 < length.value < MIN_LENGTH_M:
        return ()
    return (Doubt("degrees", f"the pendulum would be {length.value:.3g} m long: are its angles in degrees?", REMEDY),)


def _hangs(model: OdeModel) -> bool:
    return bool(model.with_role("gravity")) and any(quantity.unit == "rad" for quantity in model.observed)


def _swing(extremes: Array) -> float:
    """The smallest of the first swings between extremes (m,) that are all about one middle; 0 without such."""
    if extremes.size < TURNING_POINTS:
        return 0.0
    swings, middles = np.abs(np.diff(extremes)), (extremes[1:] + extremes[:-1]) / 2
    return float(swings.min()) if np.ptp(middles) < CENTRED * swings.min() else 0.0
