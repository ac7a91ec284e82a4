"""Draw a case: a motion, what is hidden in it at a stated multiple of the smallest detectable size, and its noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from validation.independent.effects import HIDDEN, HiddenEffect
from validation.independent.motions import MOTIONS, Array, Motion, Values, integrate
from validation.independent.noise import NOISES, whitened

DETECTABLE = 4.0  # standard errors of a size beside all fitted values: about 5 % over the library and its shapes
FACTORS = (2.0, 8.0)  # of the detectable size
STEP = 1e-4  # relative, of a value whose effect on the observation is wanted
MAX_CHANGE = 0.3  # of the motion's own spread: beyond, the effect is no small correction
ATTEMPTS = 20
ALIKE = 1.0  # chi-square between two effects, fitted values free, below which no analysis can tell which one is there
SEALED = 1_000_000  # seeds from here on are scored once and never looked at while code is written


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A table with its truth.

    ``t_s`` (n,) s; ``observed`` (n, d) in the motion's units, with noise; ``clean`` (n, d) without. ``hidden`` is None
    for a clean case, ``size`` its size, ``factor`` that over the smallest detectable one. ``alike`` are the library's
    names of other hidden effects that would have given these data, to within ALIKE.
    """

    seed: int
    motion: Motion
    values: Values
    noise: str
    t_s: Array
    observed: Array
    clean: Array
    hidden: HiddenEffect | None = None
    size: float = 0.0
    factor: float = 0.0
    shape: Mapping[str, float] = field(default_factory=dict)
    alike: frozenset[str] = frozenset()

    @property
    def noise_rms(self) -> float:
        """Root mean square of the noise that this case has, rounding and outliers included."""
        return float(np.sqrt(np.mean((self.observed - self.clean) ** 2)))


def draw_case(
    seed: int,
    *,
    hidden: Sequence[HiddenEffect] = HIDDEN,
    clean: bool = False,
    noises: Sequence[str] = tuple(NOISES),
    alike: bool = True,
) -> Case:
    """A random case; the same seed gives the same case.

    Parameters
    ----------
    seed
        Of everything random.
    hidden
        One of these is hidden, unless the case is ``clean``.
    clean
        Hide nothing.
    noises
        Kinds of noise to draw from.
    alike
        Find the effects that would have given the same data: takes longer than all the rest. Without, there are none.
    """
    rng = np.random.default_rng(seed)
    for _ in range(ATTEMPTS):
        kind = noises[int(rng.integers(len(noises)))]
        effect = hidden[int(rng.integers(len(hidden)))]
        motion = MOTIONS[effect.motions[int(rng.integers(len(effect.motions)))]]
        if clean:
            motion = list(MOTIONS.values())[int(rng.integers(len(MOTIONS)))]
        case = _clean_case(seed, motion, kind, rng) if clean else _hidden_case(seed, motion, effect, kind, rng, alike)
        if case is not None:
            return case
    raise ArithmeticError(f"seed {seed} gives no case in {ATTEMPTS} attempts")


def _clean_case(seed: int, motion: Motion, kind: str, rng: np.random.Generator) -> Case:
    values, t_s = motion.draw(rng), motion.times()
    clean = integrate(motion, values, t_s)[:, : motion.size]
    return Case(seed, motion, values, kind, t_s, NOISES[kind](clean, motion.noise, rng), clean)


def _hidden_case(
    seed: int, motion: Motion, effect: HiddenEffect, kind: str, rng: np.random.Generator, alike: bool
) -> Case | None:
    values, t_s = motion.draw(rng), motion.times()
    shape = effect.shape(motion, t_s, rng)
    factor = float(np.exp(rng.uniform(*np.log(FACTORS))))
    sign = 1.0 if effect.brakes else float(rng.choice([-1.0, 1.0]))
    try:
        unit = smallest_detectable(motion, values, t_s, effect, shape, kind)
        size = sign * factor * unit
        undisturbed = effect.show(motion, values, t_s, 0.0, shape)
        clean = effect.show(motion, values, t_s, size, shape)
    except (ArithmeticError, ValueError):
        return None
    spread = float(np.std(undisturbed, axis=0).max())
    if not np.all(np.isfinite(clean)) or np.max(np.abs(clean - undisturbed)) > MAX_CHANGE * 4 * spread:
        return None
    observed = NOISES[kind](clean, motion.noise, rng)
    others = _alike(motion, values, t_s, effect, clean - undisturbed, kind) if alike else frozenset()
    return Case(seed, motion, values, kind, t_s, observed, clean, effect, size, factor, shape, others)


def draw_clips(seed: int, count: int) -> list[Case]:
    """``count`` clean cases of one motion, each with its own values and noise; the same seed gives the same cases."""
    rng = np.random.default_rng(seed)
    motion = list(MOTIONS.values())[int(rng.integers(len(MOTIONS)))]
    kind = list(NOISES)[int(rng.integers(len(NOISES)))]
    return [_clean_case(seed, motion, kind, rng) for _ in range(count)]


def _alike(
    motion: Motion, values: Values, t_s: Array, effect: HiddenEffect, change: Array, kind: str
) -> frozenset[str]:
    """Library's names of the effects without a shape of their own that change what is observed as ``change`` does."""
    fitted = np.stack([_slope(motion, values, t_s, name, kind) for name in motion.ranges], axis=1)
    target = whitened(change, kind, motion.noise).ravel()
    names: set[str] = set()
    for other in HIDDEN:
        shape = other.shape(motion, t_s, np.random.default_rng(0))
        if other.name == effect.name or other.own_form or set(shape) - {"start"} or motion.model not in other.motions:
            continue
        try:
            step = _step_of(motion, values, t_s, other, shape)
            shown = other.show(motion, values, t_s, step, shape) - other.show(motion, values, t_s, 0.0, shape)
        except (ArithmeticError, ValueError):
            continue
        columns = np.column_stack([fitted, whitened(shown, kind, motion.noise).ravel()])
        columns /= np.linalg.norm(columns, axis=0)
        rest = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
        names |= other.right if float(rest @ rest) < ALIKE else set()
    return frozenset(names)


def smallest_detectable(
    motion: Motion, values: Values, t_s: Array, effect: HiddenEffect, shape: Mapping[str, float], kind: str
) -> float:
    """The size that stands DETECTABLE standard errors off zero beside all values that a fit of the motion has.

    By differences of the generator itself; raises ArithmeticError where the fitted values can imitate the effect.

    Parameters
    ----------
    motion, values, t_s
        The undisturbed motion.
    effect, shape
        What is hidden.
    kind
        Of the noise.
    """
    fitted = np.stack([_slope(motion, values, t_s, name, kind) for name in motion.ranges], axis=1)
    step = _step_of(motion, values, t_s, effect, shape)
    shown = effect.show(motion, values, t_s, step, shape) - effect.show(motion, values, t_s, 0.0, shape)
    along = whitened(shown / step, kind, motion.noise).ravel()
    rest = along - fitted @ np.linalg.lstsq(fitted, along, rcond=None)[0]
    length = float(np.linalg.norm(rest))
    if not length > 1e-3 * float(np.linalg.norm(along)):
        raise ArithmeticError("the fitted values imitate this effect")
    return DETECTABLE / length


def _slope(motion: Motion, values: Values, t_s: Array, name: str, kind: str) -> Array:
    """What is observed changes by this (n d,) with one value, in units of the noise."""
    step = STEP * max(abs(values[name]), 1e-2)
    sides = [integrate(motion, {**values, name: values[name] + sign * step}, t_s)[:, : motion.size] for sign in (1, -1)]
    return np.asarray(whitened((sides[0] - sides[1]) / (2 * step), kind, motion.noise).ravel())


def _step_of(motion: Motion, values: Values, t_s: Array, effect: HiddenEffect, shape: Mapping[str, float]) -> float:
    """A size whose effect is about the noise: small for the motion, large for the integrator."""
    size, undisturbed = 1e-3, effect.show(motion, values, t_s, 0.0, shape)
    for _ in range(60):
        change = effect.show(motion, values, t_s, size, shape) - undisturbed
        ratio = float(np.max(np.abs(change))) / motion.noise
        if 0.3 < ratio < 10.0:
            return size
        size *= float(np.clip(2.0 / max(ratio, 1e-6), 1e-2, 1e2))
    raise ArithmeticError("no size shows this effect")
