"""The force that a model lacks: its estimate without a formula for it, and the simple form that it has, if any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitters.compose_effects import with_effect
from fitters.effect_sensitivity import Motion, force_along, motion_of, rates
from fitters.latent_force.form import form_of
from fitters.latent_force.gaussian_process import LatentForce, latent_force
from fitters.latent_force.linear_response import NoisyResidual
from fitters.latent_force.open_effects import POWER, SIZE, open_effect
from fitters.ode import FitRequest
from iris_sysid.diagnosis.block_means import Residuals, block_means
from iris_sysid.diagnosis.measurement_errors import unit_noise
from iris_sysid.diagnosis.refit import fit_from
from iris_sysid.types import Array, Effect, FitResult, ForceForm, MissingForce, OdeModel, Trajectory

FEWEST = 8  # samples below which there is nothing to estimate
POWERS = (0.1, 6.0)  # where the refit of an exponent may start
STEP = 1e-4  # relative change of a parameter


def missing_force(
    clip: FitRequest, fitted: FitResult, effects: Sequence[Effect] = (), with_effects: FitResult | None = None
) -> MissingForce | None:
    """Estimate the force that a fitted model lacks, with its error.

    Parameters
    ----------
    clip
        The request of the fit, for its trajectory.
    fitted
        The fit of the model.
    effects
        Effects that were added to it; their force is given beside the estimate.
    with_effects
        The fit with these effects, for their sizes.

    Returns
    -------
    MissingForce or None
        None where there are too few samples, or where the motion forgets its initial state too fast for its linear
        response.
    """
    means = _means(fitted, clip.trajectory)
    motion = motion_of(means.fitted, means.trajectory)
    if motion.inverse is None or motion.at_samples.size < FEWEST or not np.all(np.isfinite(motion.inverse)):
        return None
    residual = _noisy_residual(means, motion)
    if not (np.all(np.isfinite(residual.jacobian)) and np.all(residual.noise > 0)):
        return None
    force = latent_force(motion, residual)
    return _described(fitted, motion, force, _sized(effects, with_effects))


def missing_forces(
    clip: FitRequest, base: FitResult, final: FitResult, effects: Sequence[Effect], unexplained: bool
) -> tuple[MissingForce | None, MissingForce | None]:
    """The force that the model lacks, and the one that it still lacks with the effects that were added.

    Parameters
    ----------
    clip
        The request of both fits.
    base, final
        The fits without and with the effects.
    effects
        Those that were added.
    unexplained
        Whether the residual of ``final`` is above the noise: only then the second force is estimated, and its form; it
        is the first one where no effect was added.
    """
    lacking = missing_force(clip, base, effects, final)
    if effects:
        remaining = missing_force(clip, final) if unexplained else None
        return lacking, None if remaining is None else with_form(clip, final, remaining)
    described = None if lacking is None else with_form(clip, base, lacking)
    return described, described


def with_form(clip: FitRequest, fitted: FitResult, missing: MissingForce) -> MissingForce:
    """The missing force with its form, where it is significant and has a simple one; exponents come from a refit.

    Parameters
    ----------
    clip, fitted
        As for :func:`missing_force`.
    missing
        Its result.
    """
    if not missing.significant:
        return missing
    means = _means(fitted, clip.trajectory)
    motion = motion_of(means.fitted, means.trajectory)
    form = form_of(motion, _noisy_residual(means, motion), missing.rho, missing.noise_variance)
    return missing if form is None else replace(missing, form=_refitted(clip, fitted, motion, form))


def _refitted(clip: FitRequest, fitted: FitResult, motion: Motion, form: ForceForm) -> ForceForm:
    """The form with the exponent of a refit: the linear response to a strong force is not accurate enough for it.

    Without an exponent where the refit fails.
    """
    effect = open_effect(form.kind, motion)
    if effect is None or form.shape is None:
        return form
    model = with_effect(fitted.model, effect)
    values = {name: fitted.estimates[name].value for name in fitted.free}
    start = {SIZE: form.size, POWER: float(np.clip(form.shape.value, *POWERS))}
    refit = fit_from(clip, model, {**values, **start})
    power = refit.estimates[POWER] if refit.usable else None
    known = power is not None and np.isfinite(power.stderr) and power.stderr > 0
    return replace(form, shape=power if known else None)


def _means(fitted: FitResult, trajectory: Trajectory) -> Residuals:
    noise = unit_noise(fitted, trajectory)[fitted.used]
    return block_means(Residuals(fitted, trajectory, noise, np.zeros_like(noise)))


def _noisy_residual(means: Residuals, motion: Motion) -> NoisyResidual:
    fitted = means.fitted
    jacobian = fitted.jacobian.reshape(*means.noise.shape, -1)
    return NoisyResidual(motion.grid[motion.at_samples], fitted.residual[fitted.used], jacobian, means.noise)


def _sized(effects: Sequence[Effect], fitted: FitResult | None) -> list[tuple[Effect, Array]]:
    """The effects that are forces, each with the fitted values (p,) of its parameters."""
    if fitted is None:
        return []
    return [
        (effect, np.array([fitted.estimates[parameter.name].value for parameter in effect.parameters]))
        for effect in effects
        if effect.acceleration is not None
    ]


def _described(
    fitted: FitResult, motion: Motion, force: LatentForce, effects: Sequence[tuple[Effect, Array]]
) -> MissingForce:
    """The result, freed of what the fitted parameters can imitate."""
    model, nodes, count = fitted.model, force.t_s, fitted.model.degrees_of_freedom
    states, slopes = (_at(nodes, motion.grid, values) for values in (motion.states, motion.slopes))
    basis = _imitated(model, motion, nodes, states, fitted.free)
    visible = np.eye(force.mean.size) - basis @ basis.T
    variance = np.einsum("ij,jk,ik->i", visible, force.covariance, visible)
    parts = [values[0] * force_along(effect, values, model, nodes, states, slopes) for effect, values in effects]
    return MissingForce(
        t_s=nodes,
        quantities=model.states[:count],
        units=tuple(_rate_of(quantity.unit) for quantity in model.states[-count:]),
        position=states[:, :count],
        velocity=states[:, count:] if model.second_order else slopes,
        force=_by_freedom(visible @ force.mean, count),
        stderr=_by_freedom(np.sqrt(np.maximum(variance, 0.0)), count),
        log_odds=force.log_odds,
        rho=force.rho,
        noise_variance=force.noise_variance,
        whole=bool(nodes[-1] >= motion.grid[-1] - 1e-9 * (motion.grid[-1] - motion.grid[0])),
        by_effects=_by_freedom(visible @ np.sum(parts, axis=0).T.ravel(), count) if parts else None,
    )


def _by_freedom(values: Array, count: int) -> Array:
    """Values (f * k,), degree of freedom by degree, as (k, f)."""
    return np.asarray(values.reshape(count, -1).T)


def _at(nodes: Array, grid: Array, values: Array) -> Array:
    return np.column_stack([np.interp(nodes, grid, column) for column in values.T])


def _rate_of(unit: str) -> str:
    """The unit of a rate of change: that of rad/s is rad/s^2."""
    return f"{unit[:-2]}/s^2" if unit.endswith("/s") else f"{unit}/s"


def _imitated(model: OdeModel, motion: Motion, nodes: Array, states: Array, free: Sequence[str]) -> Array:
    """Orthonormal basis (f * k, p) of the forces at the nodes that changes of the fitted parameters make."""
    inputs = None if motion.inputs is None else _at(nodes, motion.grid, motion.inputs)
    columns = [np.zeros(nodes.size * model.degrees_of_freedom)]
    for parameter in model.parameters:
        if parameter.name in free:
            value = motion.values[parameter.name]
            step = STEP * (abs(value) or 1.0)
            sides = [
                rates(model, nodes, states, {**motion.values, parameter.name: value + sign * step}, inputs)
                for sign in (1, -1)
            ]
            columns.append((sides[0] - sides[1])[:, -model.degrees_of_freedom :].T.ravel() / (2 * step))
    table = np.column_stack(columns)
    left, strength, _ = np.linalg.svd(table / np.maximum(np.linalg.norm(table, axis=0), 1e-300), full_matrices=False)
    return np.asarray(left[:, strength > STEP * max(float(strength[0]), 1e-300)])
