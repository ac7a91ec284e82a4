"""Score tests: how much of a fit's residual each effect of the library would explain, without refitting.

With s the effect's sensitivity, J those of the fitted parameters and r the residual, all in units of the noise,
s' = s - J (J'J)^-1 J's is what the parameters cannot imitate, (s'r) / (s's') estimates the size to first order
(Rao 1948, Proc. Camb. Phil. Soc. 44, 50), and (s'r)^2 / (s's' r'r) is the fraction of the residual that it explains.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from types import MappingProxyType

import numpy as np

from fitters.compose_effects import unit_in
from fitters.effect_sensitivity import EffectMotion, motion_of, sensitivities
from fitters.effect_shapes import shapes_tried
from fitters.noise.autoregression import Autoregression, grid_positions, on_grid
from fitters.noise.sandwich_covariance import inverse_normal, middle, random_uncertainty
from iris_sysid.diagnosis.block_means import Residuals, block_means
from iris_sysid.diagnosis.measurement_errors import resolvable_size, stated_errors, unit_noise
from iris_sysid.types import Array, Effect, FitResult, OdeModel, Score, Trajectory, normal_isf

PARALLEL = 0.99  # cosine between projected sensitivities above which two effects are indistinguishable
MAX_NUMBERS = 20_000_000  # largest array of directions; beyond it, pairs use only the best shape of each effect
AT_ONCE = 4_000_000  # numbers in the directions that are computed together
SINGULAR = 1e-9  # fraction of the largest singular value: below it lie null directions of the fitted parameters
NOT_IMITATED = 1e-4  # fraction of a sensitivity that the fitted parameters must not be able to imitate


@dataclass(frozen=True, eq=False, slots=True)
class _Direction:
    """An effect in one shape: the part of its sensitivity that the parameters cannot imitate, and its length.

    ``unit`` (n * d + j,), the j priors last, is that part with length 1, ``component`` the residual's component along
    it, ``shifts`` (k,) the change of each fitted value per unit of the effect.
    """

    effect: str
    shape: tuple[float, ...]
    unit: Array
    length: float
    component: float
    shifts: Array

    @property
    def size(self) -> float:
        """The size of the effect, to first order."""
        return self.component / self.length

    def means(self, effect: Effect, t_s: Array) -> bool:
        """Whether the size in this shape means the effect, in a clip with samples at ``t_s`` (n,), s."""
        return not self.shape or effect.is_meant(t_s, (self.size, *self.shape))


@dataclass(frozen=True, eq=False, slots=True)
class _Residual:
    """A fit's residual in units of the noise, with its autocorrelation.

    ``values`` (n, d); ``priors`` (j,) those of the priors, each one more sample that no effect changes; ``basis``
    (n * d + j, k) orthonormal, spans what the k fitted values can imitate, ``solve`` (k, k) turns components along it
    into their values, ``free`` are their names; ``process`` is one autoregression a quantity;
    ``stated`` (n, d) the stated errors of the track, 0 where there are none; ``model`` what was fitted.
    """

    t_s: Array
    values: Array
    priors: Array
    basis: Array
    solve: Array
    free: tuple[str, ...]
    process: tuple[Autoregression, ...]
    stated: Array
    model: OdeModel

    @classmethod
    def of(cls, fitted: FitResult, noise: Array, stated: Array) -> _Residual:
        values = fitted.residual[fitted.used] / noise
        jacobian = fitted.informed_jacobian(noise)
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        jacobian = jacobian / scale
        shaped = jacobian[: values.size].reshape(*values.shape, -1)
        t_s = fitted.t_s[fitted.used]
        process = random_uncertainty(t_s, values, shaped, inverse_normal(jacobian)).noise
        basis, triangle = np.linalg.qr(jacobian)
        solve = np.linalg.pinv(triangle, rcond=SINGULAR) / scale[:, None]
        priors = fitted.prior_residual
        return cls(t_s, values, priors, basis, solve, tuple(fitted.free), process, stated / noise, fitted.model)

    @property
    def flat(self) -> Array:
        """Samples, then priors (n * d + j,)."""
        return np.concatenate([self.values.ravel(), self.priors])

    @property
    def total(self) -> float:
        """Sum of squares."""
        return max(float(np.sum(self.flat**2)), 1e-300)

    def directions(self, effect: str, shapes: Sequence[tuple[float, ...]], sensitivity: Array) -> list[_Direction]:
        """The directions of an effect's sensitivities (k, n, d), one a shape, that the parameters cannot imitate."""
        samples = sensitivity.reshape(len(shapes), -1)
        flat = np.hstack([samples, np.zeros((len(shapes), self.priors.size))])
        imitated = flat @ self.basis
        remainder = flat - imitated @ self.basis.T
        lengths, before = np.linalg.norm(remainder, axis=1), np.linalg.norm(flat, axis=1)
        shifts = -imitated @ self.solve.T
        visible = np.flatnonzero(np.isfinite(lengths) & (lengths > NOT_IMITATED * before))
        units = remainder[visible] / lengths[visible, None]
        rows = zip(visible, units, units @ self.flat, strict=True)
        return [
            _Direction(effect, shapes[int(k)], unit, float(lengths[k]), float(component), shifts[k])
            for k, unit, component in rows
        ]

    def score(self, effect: Effect, directions: Sequence[_Direction], tried: int) -> Score:
        """The score of an effect in its best shape, of those in which its size means the effect, if there are any.

        NaN where the parameters can imitate all shapes.
        """
        unit = unit_in(self.model, effect, effect.parameters[0].unit)
        hidden = Score(effect.name, np.nan, np.nan, unit, 0.0, self.total, 0.0, tried=tried)
        if not directions:
            return hidden
        meant = [each for each in directions if each.means(effect, self.t_s)]
        best = max(meant or directions, key=lambda direction: abs(direction.component))
        gain = min(best.component**2 / self.total, 1.0)
        degrees = max(best.unit.size - self.basis.shape[1] - 1, 1)
        return replace(
            hidden,
            size=best.size,
            stderr=float(np.sqrt(self.variance_along(best.unit))) / best.length,
            gain=gain,
            chi2=degrees * gain / max(1.0 - gain, 1e-12),
            degrees=degrees,
            shape=best.shape,
            resolvable_size=resolvable_size(best.length * self._at_samples(best.unit), self.stated),
            shifts=dict(zip(self.free, best.shifts.tolist(), strict=True)),
        )

    def variance_along(self, direction: Array) -> float:
        """Variance of the residual's component along a unit vector (n * d + j,): 1 for white noise of sigma."""
        positions = grid_positions(self.t_s)
        shaped = self._at_samples(direction)
        parts = [
            middle(on_grid(positions, shaped[:, [k]], 0.0), process.coefficients)[0, 0] * process.innovation_sd**2
            for k, process in enumerate(self.process)
        ]
        known = direction[self.values.size :]
        return float(sum(parts) + known @ known)

    def _at_samples(self, direction: Array) -> Array:
        """The part (n, d) of a direction (n * d + j,) that lies in the samples."""
        return direction[: self.values.size].reshape(self.values.shape)


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Two effects in the shapes that explain most of the residual, with their sizes to first order.

    ``gain`` is the part of the residual's sum of squares that they explain, in units of the noise.
    """

    gain: float
    sizes: tuple[float, float]
    shapes: tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True, eq=False, slots=True)
class Screen:
    """The score tests of one clip: how much of its residual every effect, in every shape tried, would explain.

    ``scores`` by effect are those of its best shape, ``placed`` those in each of the shapes that clips have in common.
    Of the m effects and shapes that the parameters cannot imitate: ``effects`` are their names, ``shapes`` their
    shapes, ``directions`` (m, n * d + j) s' of unit length, ``lengths`` (m,) those of s', and ``components`` (m,) the
    residual's components.
    """

    scores: Mapping[str, Score]
    placed: Mapping[str, Mapping[tuple[float, ...], Score]]
    effects: tuple[str, ...]
    shapes: tuple[tuple[float, ...], ...]
    directions: Array
    lengths: Array
    components: Array

    @property
    def visible(self) -> frozenset[str]:
        """The effects that the fitted parameters cannot imitate."""
        return frozenset(self.effects)

    def cosine(self, first: str, second: str) -> float:
        """Cosine between two effects in their best shapes; 0 where the parameters imitate one of them."""
        if not {first, second} <= self.visible:
            return 0.0
        return float(self.directions[self._best(first)] @ self.directions[self._best(second)])

    def _best(self, name: str) -> int:
        return max(self._rows(name), key=lambda k: abs(self.components[k]))

    def _rows(self, name: str) -> list[int]:
        return [k for k, effect in enumerate(self.effects) if effect == name]

    def pairs(self, names: Collection[str]) -> dict[tuple[str, str], Pair]:
        """The best shapes of each pair of these effects; pairs that are parallel in every shape are left out."""
        rows = {name: self._rows(name) for name in sorted(self.visible & set(names))}
        if self.directions.size > MAX_NUMBERS:
            rows = {name: [self._best(name)] for name in rows}
        pairs = {names: self._pair(rows[names[0]], rows[names[1]]) for names in combinations(rows, 2)}
        return {names: pair for names, pair in pairs.items() if pair is not None}

    def _pair(self, rows: Sequence[int], columns: Sequence[int]) -> Pair | None:
        cosine = self.directions[rows] @ self.directions[columns].T
        first, second = self.components[rows][:, None], self.components[columns][None, :]
        sine2 = 1.0 - cosine**2
        if not np.any(sine2 > 1.0 - PARALLEL**2):
            return None
        sine2 = np.where(sine2 > 1.0 - PARALLEL**2, sine2, np.inf)
        gain = (first**2 + second**2 - 2 * cosine * first * second) / sine2
        i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
        shares = np.array([first[i, 0] - cosine[i, j] * second[0, j], second[0, j] - cosine[i, j] * first[i, 0]])
        k, m = rows[int(i)], columns[int(j)]
        sizes = shares / sine2[i, j] / self.lengths[[k, m]]
        return Pair(float(gain[i, j]), (float(sizes[0]), float(sizes[1])), (self.shapes[k], self.shapes[m]))


def shapes_in_common(
    effects: Sequence[Effect], fits: Sequence[FitResult], trajectories: Sequence[Trajectory]
) -> dict[str, list[tuple[float, ...]]]:
    """By effect that acts at the same place in all clips, the shapes that any of several clips suggests."""
    placed = [effect for effect in effects if effect.has_one_place] if len(fits) > 1 else []
    shapes = {effect.name: dict[tuple[float, ...], None]() for effect in placed}
    for fitted, trajectory in zip(fits, trajectories, strict=True):
        t_s, observed = fitted.t_s[fitted.used], (fitted.predicted + fitted.residual)[fitted.used]
        given = trajectory.inputs_at(t_s)
        for effect in placed:
            shapes[effect.name] |= dict.fromkeys(shapes_tried(effect, fitted.model, t_s, observed, given))
    return {name: list(tried) for name, tried in shapes.items()}


def screen(
    effects: Sequence[Effect],
    fitted: FitResult,
    trajectory: Trajectory,
    common: Mapping[str, Sequence[tuple[float, ...]]] = MappingProxyType({}),
) -> Screen:
    """Score each effect against the residual of a fit.

    Parameters
    ----------
    effects
        Effects that apply to the fitted model.
    fitted
        The fit without them.
    trajectory
        What it was fitted to.
    common
        By effect, the shapes that this clip has in common with others; without them those that it suggests.
    """
    noise, stated = unit_noise(fitted, trajectory)[fitted.used], stated_errors(fitted, trajectory)[fitted.used]
    means = block_means(Residuals(fitted, trajectory, noise, stated))
    fitted, trajectory, noise = means.fitted, means.trajectory, means.noise
    residual = _Residual.of(fitted, noise, means.stated)
    forces = any(effect.acceleration is not None or effect.drive is not None for effect in effects)
    motion = motion_of(fitted, trajectory) if forces else None
    observed = (fitted.predicted + fitted.residual)[fitted.used]
    scores, placed, rows = {}, {}, []
    given = trajectory.inputs_at(residual.t_s)
    for effect in effects:
        shapes = common.get(effect.name) or shapes_tried(effect, fitted.model, residual.t_s, observed, given)
        directions_of = partial(_directions_of, effect, residual, noise, (fitted, trajectory, motion))
        visible = _visible_directions(effect, shapes, residual.t_s, directions_of)
        rows += visible
        tried = residual.t_s.size if effect.is_placed else len(shapes)  # the best of all, whatever the start
        scores[effect.name] = residual.score(effect, visible, tried)
        if effect.name in common:
            meant = [each for each in visible if each.means(effect, residual.t_s)]
            placed[effect.name] = {each.shape: residual.score(effect, [each], tried) for each in meant}
    return Screen(
        scores,
        placed,
        tuple(row.effect for row in rows),
        tuple(row.shape for row in rows),
        np.array([row.unit for row in rows]).reshape(len(rows), residual.flat.size),
        np.array([row.length for row in rows]),
        np.array([row.component for row in rows]),
    )


def _directions_of(
    effect: Effect,
    residual: _Residual,
    noise: Array,
    where: tuple[FitResult, Trajectory, EffectMotion | None],
    shapes: Sequence[tuple[float, ...]],
) -> list[_Direction]:
    """The directions of an effect in those of the shapes that the parameters cannot imitate."""
    if not shapes:  # e.g. no moment at which a record could have lost a frame
        return []
    return residual.directions(effect.name, shapes, sensitivities(effect, shapes, *where) / noise)


def _visible_directions(
    effect: Effect,
    shapes: Sequence[tuple[float, ...]],
    t_s: Array,
    directions_of: Callable[[Sequence[tuple[float, ...]]], list[_Direction]],
) -> list[_Direction]:
    """The shapes that the parameters cannot imitate; shapes near the best are added while one of them explains more."""
    directions, count = [], max(AT_ONCE // t_s.size, 1)
    for first in range(0, len(shapes), count):
        directions += directions_of(shapes[first : first + count])
        if len(shapes) * t_s.size > MAX_NUMBERS:
            directions = [replace(each, unit=each.unit.copy()) for each in _best_of(directions)]
    best = next(iter(_best_of(directions)), None)
    while best is not None and best.shape and effect.nearby is not None and effect.is_placed:
        nearby = directions_of(effect.nearby(t_s, best.shape))
        directions += nearby
        previous, best = best, _best_of([best, *nearby])[0]
        if best is previous:
            break
    return directions


def _best_of(directions: Sequence[_Direction]) -> list[_Direction]:
    """The best direction, or an empty list."""
    return sorted(directions, key=lambda direction: -abs(direction.component))[:1]


def critical_value(level: float, tries: int) -> float:
    """Standard errors above which a size is significant at a two-sided ``level``, Bonferroni for ``tries`` tests."""
    return normal_isf(level / 2 / tries)


def common_size(sizes: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The common value of independent sizes, each (value, standard error), and its standard error.

    Where the sizes differ by more than their errors, the error grows by the Birge ratio (Birge 1932, Phys. Rev. 40,
    207); it never shrinks, so that a test against zero is wrong no more often than it states. A size without an error
    says nothing; where none has one, the common value is NaN, and its error infinite.
    """
    known = np.array([size for size in sizes if size[1] > 0 and np.all(np.isfinite(size))]).reshape(-1, 2)
    if not len(known):
        return float("nan"), float("inf")
    weights = known[:, 1] ** -2.0
    mean = float(weights @ known[:, 0] / weights.sum())
    with np.errstate(over="ignore"):
        scatter = float(weights @ (known[:, 0] - mean) ** 2)
    return mean, float(np.sqrt(max(scatter / max(len(known) - 1, 1), 1.0) / weights.sum()))


def combined(scores: Sequence[Score]) -> Score:
    """Combine the scores of one effect in several clips to the score of a common size; a single score is unchanged.

    Its chi-square has one degree of freedom, as that of one clip: clips whose sizes contradict each other take from it.
    """
    first = scores[0]
    if len(scores) == 1:
        return first
    size, stderr = common_size([(score.size, score.stderr) for score in scores])
    total, degrees = sum(score.total for score in scores), sum(score.degrees for score in scores)
    gain = min(_common_gain(scores) / total, 1.0 - 1e-12)
    return replace(
        first,
        size=size,
        stderr=stderr if np.isfinite(stderr) else np.nan,
        gain=gain,
        total=total,
        chi2=degrees * gain / (1.0 - gain),
        degrees=degrees,
        resolvable_size=min(score.resolvable_size for score in scores),
    )


def in_one_shape(clips: Sequence[Screen], effect: str) -> tuple[Score, ...]:
    """The scores of one effect, one a clip: in the shape in which a common size explains most of all the clips.

    A clip in which an effect of that shape does not act says nothing of its size.
    """
    own = tuple(clip.scores[effect] for clip in clips)
    shapes = dict.fromkeys(shape for clip in clips for shape in clip.placed.get(effect, ()))
    silent = [replace(score, size=np.nan, stderr=np.nan, gain=0.0, chi2=0.0) for score in own]
    choices = [
        tuple(
            clip.placed[effect].get(shape, replace(none, shape=shape)) for clip, none in zip(clips, silent, strict=True)
        )
        for shape in shapes
    ]
    return max(choices, key=lambda scores: combined(scores).gain, default=own)


def _common_gain(scores: Sequence[Score]) -> float:
    """By how much a common size decreases the sum of squares of all clips: (sum L^2 s)^2 / sum L^2.

    L^2 is the squared length of an effect's sensitivity, which a score of size s tells by its gain L^2 s^2.
    """
    seen = [score for score in scores if score.stderr > 0 and score.size != 0]
    known = [(score.gain * score.total / score.size**2, score.size) for score in seen]
    if not any(square > 0 for square, _ in known):
        return 0.0
    return sum(square * size for square, size in known) ** 2 / sum(square for square, _ in known)
