"""What a rival predicts for one more clip, and what its free values can imitate there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitters.compose_effects import with_effects
from fitters.image_effects import view_of
from fitters.ode.simulation import linearisation
from iris_sysid.diagnosis.planning.changes import SetUpChange
from iris_sysid.diagnosis.planning.rivals import Rival
from iris_sysid.types import Array, Effect, Hold, OdeModel, Trajectory, View

HIGHEST = 0.95  # lag-1 correlation of the noise that is allowed for
MIN_VARIANCE = 1e-12  # relative variance below which a direction of today's values is known exactly
ROUNDING = 1e-10  # relative singular value below which columns are parallel
TOLERANCE = 1e-8
DIVERGED = 1e100  # in observed units, and per unit of a value: beyond, squares in units of the noise overflow
MAX_SAMPLES = 4000  # of a planned clip; more take longer and show nothing else
EXACT = 1e-12  # noise over motion of data without noise
OF_BODY = {"length": "length", "stiffness": "spring"}  # constants of the equation that a change of the body states


@dataclass(frozen=True, eq=False, slots=True)
class Design:
    """One more clip: times ``t_s`` (n,) s, its change, the noise of a sample (d,) and its lag-1 correlation.

    ``model`` is the equation without effects, ``view`` how its coordinates lie in the image, None where not known;
    ``inputs`` (n, m) or None, which go on between samples as ``hold`` says.
    """

    change: SetUpChange
    model: OdeModel
    t_s: Array
    noise: Array
    correlation: float
    view: View | None
    inputs: Array | None
    hold: Hold

    @classmethod
    def of(cls, change: SetUpChange, best: Rival, model: OdeModel, clip: Trajectory) -> Design:
        """The clip that a change gives, with the noise of today's fit of the best rival.

        Parameters
        ----------
        change
            Of the set-up.
        best
            The most probable rival.
        model
            The equation without effects.
        clip
            Today's.
        """
        fitted = best.fitted
        used = fitted.t_s[fitted.used]
        step = float(np.median(np.diff(used))) / change.faster
        count = round((used[-1] - fitted.t0_s) * change.longer / step) + 1
        every = max(int(np.ceil(count / MAX_SAMPLES)), 1)
        lag_one = float(np.clip(np.nan_to_num(fitted.correlation), 0.0, HIGHEST)) ** (1.0 / change.faster)
        correlation = lag_one**every
        # fewer samples, and clips of the same set-up, as one clip that tells as much of a slow signal
        fewer = _spread(lag_one) / _spread(correlation) / every / change.clips
        smallest = EXACT * np.maximum(np.nanmax(np.abs(fitted.predicted), axis=0), EXACT)
        noise = np.maximum(fitted.rms, smallest) * np.sqrt(fewer)
        t_s = fitted.t0_s + step * every * np.arange(-(-count // every))
        stated = view_of(clip, model) if clip.view is not None else None
        return cls(change, model, t_s, noise, correlation, stated, _inputs(clip, t_s, change.driven), clip.hold)

    def whitened(self, values: Array) -> Array:
        """Values (n, d, ...) in the observed unit as independent ones of unit variance (n d, ...)."""
        scaled = values / self.noise.reshape(1, -1, *(1,) * (values.ndim - 2))
        rest = (scaled[1:] - self.correlation * scaled[:-1]) / np.sqrt(1.0 - self.correlation**2)
        return np.concatenate([scaled[:1], rest]).reshape(-1, *values.shape[2:])


def _spread(correlation: float) -> float:
    """Variance of a slow sum of autocorrelated noise over that of white noise."""
    return (1.0 + correlation) / (1.0 - correlation)


def _inputs(clip: Trajectory, t_s: Array, driven: float) -> Array | None:
    """Today's inputs, times a factor, at times (n,) s of the new clip; from the beginning again where it is longer."""
    span = float(clip.t_s[-1] - clip.t_s[0])
    known = clip.inputs_at(clip.t_s[0] + np.mod(t_s - t_s[0], span))
    return None if known is None else driven * known


@dataclass(frozen=True, eq=False, slots=True)
class Roles:
    """The values of a rival in the new clip, and which of its free ones are ``shared`` with today's and which ``new``.

    ``factors`` are those on the shared ones.
    """

    values: Mapping[str, float]
    shared: tuple[str, ...]
    new: tuple[str, ...]
    factors: Mapping[str, float]
    effects: tuple[Effect, ...]


def roles(rival: Rival, change: SetUpChange, model: OdeModel, known_view: bool) -> Roles:
    """What becomes of each value of a rival when the set-up is changed.

    Parameters
    ----------
    rival
        With its fit to today's clip.
    change
        Of the set-up.
    model
        The equation without effects.
    known_view
        Whether it is known how the coordinates lie in the image: then a camera that stays has the same effects.
    """
    values = {**rival.values, **{name: start for name, start in change.start.items() if name in rival.values}}
    factors: dict[str, float] = {}
    new = [name for name in rival.fitted.free if name in model.initial_names]
    for parameter in model.parameters:
        factor = _factor(parameter.name, parameter.role, change)
        values[parameter.name] *= factor
        if parameter.name in rival.fitted.free and factor != 1.0:
            new.append(parameter.name)
    acting = tuple(each for each in rival.effects if each.name not in change.without and each.recurrence != "once")
    for effect in acting:
        own = [parameter.name for parameter in effect.parameters if parameter.name in rival.fitted.free]
        size = effect.factor(change.body)
        values[effect.parameters[0].name] *= size or 1.0
        factors[effect.parameters[0].name] = size or 1.0
        filmed = effect.image is not None and not known_view
        if size is None or effect.recurrence == "anew" or filmed:
            new += own
    kept = {*model.initial_names, *(each.name for each in model.parameters)}
    kept |= {parameter.name for effect in acting for parameter in effect.parameters}
    shared = [name for name in rival.fitted.free if name in kept and name not in new and _is_known(rival, name)]
    new = [name for name in rival.fitted.free if name in kept and name not in shared]
    return Roles(values, tuple(shared), tuple(new), {name: factors.get(name, 1.0) for name in shared}, acting)


def _factor(name: str, role: str, change: SetUpChange) -> float:
    """The factor on a value of the equation; what a heavier ball or a longer cord does to a loss is a guess."""
    if name in OF_BODY:
        return change.body.get(OF_BODY[name], 1.0)
    if role == "damping" and change.body:
        return change.body.get("radius", 1.0) / change.body.get("mass", 1.0) or 1.0
    return change.steeper if name == "acceleration" else 1.0


def _is_known(rival: Rival, name: str) -> bool:
    k = rival.fitted.free.index(name)
    return bool(np.isfinite(rival.fitted.covariance[k, k]) and rival.fitted.covariance[k, k] > 0)


@dataclass(frozen=True, eq=False, slots=True)
class PredictedClip:
    """What a rival predicts for the new clip, to first order in its free values.

    ``seen`` (n, d) in the observed unit; ``columns`` (n d, k) its change with each free value, shared ones first and
    in units of today's standard errors, whitened; ``priors`` (s, k) and ``off`` (s,) the rows of what today's clip
    says of the shared ones; ``basis`` (n d + s, r) spans what the free values can imitate. ``centre`` (n d,) is
    ``seen``, whitened; ``root`` (s, s) times its transpose is today's covariance of the shared values.
    """

    rival: Rival
    roles: Roles
    seen: Array
    columns: Array
    priors: Array
    off: Array
    basis: Array
    centre: Array
    root: Array

    def misfit(self, targets: Array) -> Array:
        """Chi-square (m,) of whitened data (n d, m), with the prior of today's clip, all free values fitted."""
        rest = targets - self.centre[:, None]
        stacked = np.concatenate([rest, np.repeat(-self.off[:, None], rest.shape[1], axis=1)])
        inside = self.basis.T @ stacked
        return np.asarray(np.sum(stacked**2, axis=0) - np.sum(inside**2, axis=0))

    def drawn(self, rng: np.random.Generator, count: int) -> Array:
        """Whitened data (n d, m) of m clips: the shared values drawn from today's errors, and noise."""
        size = self.priors.shape[0]
        moved = self.columns[:, :size] @ rng.standard_normal((size, count))
        return np.asarray(self.centre[:, None] + moved + rng.standard_normal((self.centre.size, count)))


def predicted_clip(rival: Rival, design: Design, moved: Array | None = None) -> PredictedClip | None:
    """Predict the new clip; None where the motion diverges.

    Parameters
    ----------
    rival
        With its fit to today's clip.
    design
        The new clip.
    moved
        (k,) a displacement of the free values, shared ones first and in units of today's errors, about which to
        linearise.
    """
    part = roles(rival, design.change, design.model, design.view is not None)
    composed = with_effects(design.model, part.effects, design.view) if part.effects else design.model
    names = (*part.shared, *part.new)
    root = _prior_root(rival, part)
    values = {name: value for name, value in part.values.items() if name in _names(composed)}
    off = np.zeros(len(part.shared))
    if moved is not None:
        off = moved[: len(part.shared)]
        steps = np.concatenate([root @ off, moved[len(part.shared) :]])
        values |= {name: values[name] + float(step) for name, step in zip(names, steps, strict=True)}
    seen, slopes = linearisation(
        composed, design.t_s, values, names, inputs=design.inputs, hold=design.hold, tolerance=TOLERANCE
    )
    if not (np.all(np.abs(seen) < DIVERGED) and np.all(np.abs(slopes) < DIVERGED)):  # NaN is not
        return None
    columns = design.whitened(slopes)
    count = len(part.shared)
    columns = np.hstack([columns[:, :count] @ root, columns[:, count:]])
    priors = np.hstack([np.eye(count), np.zeros((count, len(part.new)))])
    basis = _basis(np.concatenate([columns, priors]))
    return PredictedClip(rival, part, seen, columns, priors, off, basis, design.whitened(seen), root)


def _names(model: OdeModel) -> set[str]:
    return {*(parameter.name for parameter in model.parameters), *model.initial_names}


def _prior_root(rival: Rival, part: Roles) -> Array:
    """A root (s, s) of the covariance that today's clip gives the shared values, in the new clip's scale."""
    which = [rival.fitted.free.index(name) for name in part.shared]
    scale = np.array([part.factors[name] for name in part.shared])
    covariance = rival.fitted.covariance[np.ix_(which, which)] * np.outer(scale, scale)
    errors = np.sqrt(np.diag(covariance))
    if not which:
        return np.zeros((0, 0))
    variances, axes = np.linalg.eigh(covariance / np.outer(errors, errors))
    return np.asarray(errors[:, None] * axes * np.sqrt(np.maximum(variances, MIN_VARIANCE)))


def _basis(matrix: Array) -> Array:
    """Orthonormal basis (m, r) of the columns (m, k) of a matrix, each first scaled to length 1."""
    lengths = np.linalg.norm(matrix, axis=0)
    left, values, _ = np.linalg.svd(matrix[:, lengths > 0] / lengths[lengths > 0], full_matrices=False)
    return np.asarray(left[:, values > ROUNDING * max(values, default=1.0)])


def imitating(wrong: PredictedClip, target: Array, design: Design, steps: int) -> PredictedClip:
    """The wrong rival linearised where it imitates a target best, after Gauss-Newton steps that help.

    Parameters
    ----------
    wrong
        Its prediction from today's values.
    target
        (n d,) whitened.
    design
        The new clip.
    steps
        At most.
    """
    moved = np.concatenate([wrong.off, np.zeros(wrong.columns.shape[1] - wrong.off.size)])
    best, cost = wrong, float("inf")
    for _ in range(steps):
        stacked = np.concatenate([target - best.centre, -best.off])
        step = np.linalg.lstsq(np.concatenate([best.columns, best.priors]), stacked, rcond=ROUNDING)[0]
        cost = float(stacked @ stacked)
        trial = predicted_clip(wrong.rival, design, moved + step)
        if trial is None:
            break
        after = float(np.sum((target - trial.centre) ** 2) + np.sum(trial.off**2))
        if not after < cost:
            break
        moved, best = moved + step, trial
        if cost - after < 1e-2 * after:
            break
    return best
