"""Which models an effect makes sense for."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import OdeModel, Sensor, kind_of

FILMED: frozenset[Sensor] = frozenset({"camera", "unknown"})
CONTACT: frozenset[Sensor] = frozenset({"encoder", "gauge"})
GAUGE: frozenset[Sensor] = frozenset({"gauge"})  # what has no place in an image is read by one


def moves(model: OdeModel) -> bool:
    """Whether the model is of second order: something with a velocity of its own."""
    return model.second_order


def has_speed(model: OdeModel) -> bool:
    """Whether something moves, and its velocity is a state: of a model of second order, or of one of speeds."""
    return model.has_velocity


def has_one_speed(model: OdeModel) -> bool:
    """The same with one degree of freedom: along a line, or about an axis."""
    return model.has_velocity and model.degrees_of_freedom == 1


def moves_on_a_line(model: OdeModel) -> bool:
    """Whether the model is of second order with one degree of freedom."""
    return model.second_order and model.degrees_of_freedom == 1


def slides(model: OdeModel) -> bool:
    """Whether the model is of a body that moves along a board or a bench, where s is the way."""
    return moves_on_a_line(model) and model.states[0].name == "s"


def swings(model: OdeModel) -> bool:
    """Whether the model is of second order in one angle."""
    return moves_on_a_line(model) and model.states[0].unit == "rad"


def is_pulled_back(model: OdeModel) -> bool:
    """Whether something may pull back to the zero of the one coordinate: not along a board, not where a body falls."""
    falls = model.states[0].unit == "m" and bool(model.with_role("gravity"))
    return moves_on_a_line(model) and not slides(model) and not falls


def has_rest_force(model: OdeModel) -> bool:
    """Whether something does pull back where nothing moves, and no input turns it."""
    if not is_pulled_back(model) or model.inputs:
        return False
    still = np.eye(len(model.states))[0]  # away from zero, where nothing moves
    with np.errstate(all="ignore"):
        slopes = model.rhs(0.0, tuple(still), tuple(np.ones(len(model.parameters))))
    return bool(slopes[1] != 0.0)


def falls(model: OdeModel) -> bool:
    """Whether the model is of a body that falls or is thrown: along lengths, under gravity, and on no board."""
    return moves(model) and model.states[0].unit == "m" and bool(model.with_role("gravity")) and not slides(model)


def rubs(model: OdeModel) -> bool:
    """Whether the model is of something that may rub on a support: not of a body in flight."""
    return has_speed(model) and not falls(model)


def hangs(model: OdeModel) -> bool:
    """Whether the model is of one angle that swings under gravity."""
    return swings(model) and bool(model.with_role("gravity"))


def hangs_freely(model: OdeModel) -> bool:
    """Whether the model is of something that may hang on a cord: one angle under gravity, and nothing turns it."""
    return hangs(model) and not model.inputs


def drains(model: OdeModel) -> bool:
    """Whether the model is of first order in quantities of one kind that go down: levels or a brightness, not heat."""
    units = {state.unit for state in model.states}
    return not model.second_order and not model.of_speeds and len(units) == 1 and units != {"K"}


def any_model(model: OdeModel) -> bool:
    """Every model."""
    return True


def lies_in_image(model: OdeModel) -> bool:
    """Whether what is observed may be a place in an image: an angle about a pivot, a way along a line, or x and z."""
    return kind_of(model.observed) is not None


def several_bodies(model: OdeModel) -> bool:
    """Whether what is observed is of several bodies: not one quantity, and not x and z of one."""
    return not on_a_line(model) and kind_of(model.observed) is None


def on_a_line(model: OdeModel) -> bool:
    """Whether one quantity is observed."""
    return len(model.observed) == 1
