"""How large a fitted effect is beside the motion that it acts on."""

from __future__ import annotations

import numpy as np

from fitters.effect_sensitivity import acted_on, force_along, rates
from fitters.image_effects import through, view_of
from fitters.ode import simulate
from iris_sysid.types import Array, Effect, FitResult, OdeModel, Trajectory

SAMPLES = 300  # along the motion that tell it


def relative_size(effect: Effect, fitted: FitResult, model: OdeModel, trajectory: Trajectory) -> float:
    """The root mean square of an effect over that of the forces, or of the motion where it acts on a reading.

    Of the model's own force and of the whole acceleration the larger one counts: a body that coasts has no force of
    its own, and one at its terminal speed is not accelerated.

    Parameters
    ----------
    effect
        One of those of the fit.
    fitted
        With the effect: its motion is the one that counts.
    model
        Without effects.
    trajectory
        What was fitted to.
    """
    values = {name: estimate.value for name, estimate in fitted.estimates.items()}
    sizes = np.array([values[parameter.name] for parameter in effect.parameters])
    if effect.acceleration is not None:
        return _of_force(effect, sizes, fitted, model, trajectory)
    if effect.drive is not None:
        known = trajectory.inputs_at(fitted.t_s[fitted.used])
        change = 0.0 if known is None else effect.drive(fitted.t_s[fitted.used], known, sizes) - known
        return _rms(np.asarray(change)) / max(float(np.std(known)) if known is not None else 0.0, 1e-300)
    seen_through = through(effect, fitted.model, view_of(trajectory, fitted.model))
    t_s, seen = fitted.t_s[fitted.used], fitted.predicted[fitted.used]
    if seen_through.observe is None or t_s.size < 2:
        return 0.0
    change = seen_through.observe(t_s, seen, np.gradient(seen, t_s, axis=0), sizes) - seen
    return _rms(change) / max(float(np.std(seen)), 1e-300)


def _of_force(effect: Effect, sizes: Array, fitted: FitResult, model: OdeModel, trajectory: Trajectory) -> float:
    values = {name: estimate.value for name, estimate in fitted.estimates.items()}
    used = np.flatnonzero(fitted.used)
    inputs = None if trajectory.inputs is None or not trajectory.input_quantities else trajectory.inputs[used]
    states = simulate(fitted.model, fitted.t_s[used], values, inputs=inputs, hold=trajectory.hold)[0]
    count = used.size if effect.memory is not None else SAMPLES  # a memory follows the motion from sample to sample
    some = np.unique(np.linspace(0, used.size - 1, count).astype(np.intp))
    t_s, states = fitted.t_s[used][some], states[some]
    base = rates(model, t_s, states, values, None if inputs is None else inputs[some])
    own_force = acted_on(effect, model, t_s, states, base, values)
    force = sizes[0] * force_along(effect, sizes, model, t_s, states, own_force)
    total = rates(fitted.model, t_s, states, values, None if inputs is None else inputs[some])
    own = max(_rms(each[:, fitted.model.forced_states]) for each in (base, total))
    return _rms(force) / own if own > 0 else 0.0


def _rms(values: Array) -> float:
    with np.errstate(over="ignore"):  # infinite where a motion diverges
        return float(np.sqrt(np.nanmean(values**2)))
