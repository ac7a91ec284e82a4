"""Effects of a camera act on points of the picture: how coordinates go there and come back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from iris_sysid.types import Array, Effect, OdeModel, Quantity, Sensor, Trajectory, View, kind_of

ROUNDS = 2  # of the fixed point for pivot and lever; each gains the size of the fault, a few percent


def offered(effects: Iterable[Effect], model: OdeModel, clips: Sequence[Trajectory]) -> list[Effect]:
    """The effects that make sense for the model, that all sensors can have, and that not all clips have measured.

    Parameters
    ----------
    effects
        Registered effects, or others.
    model
        The governing equation.
    clips
        What it is fitted to.
    """
    sensors = {sensor_of(clip, model) for clip in clips}
    possible = [effect for effect in effects if sensors <= effect.sensors and effect.applies(model)]
    return [effect for effect in possible if not all(effect.measured & clip.geometry.keys() for clip in clips)]


def sensor_of(clip: Trajectory, model: OdeModel) -> Sensor:
    """What measured the quantities that the model observes; what has no place in an image is read as a gauge is."""
    return clip.sensor if kind_of(model.observed) is not None else "gauge"


def view_of(clip: Trajectory, model: OdeModel) -> View | None:
    """How the quantities that the model observes lie in the image of a clip.

    Where the clip does not say, :meth:`View.assumed` of its valid samples; None where they have no place in an image.

    Parameters
    ----------
    clip
        With the model's observed quantities.
    model
        The governing equation.
    """
    if clip.view is not None and clip.view.shows(model.observed):
        return clip.view
    names = {quantity.name for quantity in clip.quantities}
    if kind_of(model.observed) is None or not {quantity.name for quantity in model.observed} <= names:
        return None
    columns = [clip.column(quantity.name) for quantity in model.observed]
    return View.assumed(model.observed, clip.position[clip.valid][:, columns])


def through(effect: Effect, model: OdeModel, view: View | None) -> Effect:
    """The effect as one on what the model observes; as it is where it does not act on the image.

    Parameters
    ----------
    effect
        Applies to the model.
    model
        Says what is observed.
    view
        How that lies in the image; None for :meth:`View.assumed` of the motion itself, each time it is requested.
    """
    if effect.image is None:
        return effect
    return replace(effect, image=None, observe=partial(_seen, effect, model.observed, view))


def _seen(
    effect: Effect,
    quantities: tuple[Quantity, ...],
    view: View | None,
    t_s: Array,
    observed: Array,
    velocity: Array,
    params: Array,
) -> Array:
    """What the picture shows (n, d) of ``observed`` (n, d); the pivot of an angle is seen through the same camera."""
    assert effect.image is not None
    seen_by = partial(_seen_points, effect.image, t_s, params)
    view = view or View.assumed(quantities, observed)
    if view.kind == "angle" and view.measured:
        view = _before_the_fault(seen_by, view, observed)
    points, pivot = seen_by(view, observed)
    return view.coordinates(points, pivot, near=observed)


def _seen_points(
    image: Callable[[Array, Array, Array, View], Array], t_s: Array, params: Array, view: View, observed: Array
) -> tuple[Array, Array]:
    """Points (n, 2) px at which the picture shows coordinates (n, d), and the pivot (2,) px that it shows."""
    points = image(t_s, view.points_px(observed), params, view)
    resting = image(t_s[:2], np.tile(view.origin_px, (min(t_s.size, 2), 1)), params, view)[0]
    return points, view.pivot_px(points, resting)


def _before_the_fault(seen_by: Callable[[View, Array], tuple[Array, Array]], view: View, observed: Array) -> View:
    """The view without the fault: with that pivot and lever which the camera shows where they were measured."""
    faultless = view
    for _ in range(ROUNDS):
        points, pivot = seen_by(faultless, observed)
        lever = float(np.mean(np.hypot(*(points - pivot).T)))
        faultless = view.corrected(faultless, pivot, lever)
    return faultless
