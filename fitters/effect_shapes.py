"""The shapes in which an effect is tried: values of its parameters after the size, at which nothing tells them."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from iris_sysid.types import Array, Effect, OdeModel


def shapes_tried(
    effect: Effect, model: OdeModel, t_s: Array, observed: Array, inputs: Array | None = None
) -> list[tuple[float, ...]]:
    """The shapes of an effect to try in a clip; one without values where it has only a size.

    Parameters
    ----------
    effect
        What the model may lack.
    model
        The governing equation.
    t_s
        (n,) s.
    observed
        (n, d) in the units of what the model observes.
    inputs
        (n, m) in their units; None where nothing drives the motion.
    """
    if effect.trials is None:
        return [()]
    tested = _places(effect, model, t_s, observed) if effect.drive is None or inputs is None else inputs
    return list(effect.trials(t_s, tested))


def _places(effect: Effect, model: OdeModel, t_s: Array, observed: Array) -> Array:
    """What an effect with a force takes as the places (n, d) that it acts at: of speeds they are the integral."""
    if effect.acceleration is None or not model.of_speeds:
        return observed
    speeds = [k for k, quantity in enumerate(model.observed) if quantity.unit == model.states[0].unit]
    return np.asarray(cumulative_trapezoid(observed[:, speeds], t_s, axis=0, initial=0))
