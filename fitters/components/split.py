"""Split the residual of a fit into additive components, before any effect is named.

The components are compared as sets: by their restricted likelihood, each weighed by the prior odds of its components.
Sets that explain the data about equally well are kept: components that the data cannot distinguish are reported as
such, not guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from fitters.components.bases import Basis, Scale, bases_of
from fitters.components.layout import ClipResidual, Layout
from fitters.components.likelihood import Products
from fitters.components.sets import CLOSE, Key, SetSearch
from fitters.components.shares import Shares, explained, shares_of
from iris_sysid.types import SIDES, Array, Component, ComponentCurve, ComponentKind, Components, Estimate

MAX_SAMPLES = 2000  # of all clips; beyond, every second (third, ...) sample is used
MIN_SAMPLES = 8  # beyond the fitted values
MAX_COMPONENTS = 4
CORRELATIONS = (0.0, 0.3, 0.6, 0.85)  # of the noise from sample to sample: longer memories are a component
LOG_ODDS = -float(np.log(50.0))  # of a component before the data; ten of them give a false one in 2 % of cases
PRIOR_COMMON, PRIOR_RARE = 3.0, 0.01  # plausibility of a component before the data: judgement, no measurement
LINEAR = (0.03, 3.0, 0.3)  # of the residual to which they hold: at least, times residual over motion, at most
FAR = 0.05  # residual over motion from which the fitted motion is not the one whose velocity counts
NEGLIGIBLE = 1e-3  # relative strength of a direction of a curve that the fitted values imitate
AS_WELL = 0.9  # of what a component explains: another one that explains as much can take its place


def split(clips: Sequence[ClipResidual]) -> Components | None:
    """The components of the residual of one fit, or of several clips' together.

    Where the residual is a good part of the motion, the components are estimated twice: the second time their
    functions are those of the motion that the first one found, not of the fitted one.

    Parameters
    ----------
    clips
        The residuals, all of one model.

    Returns
    -------
    Components or None
        None where there are too few samples.
    """
    clips = [thinned(clip, len(clips)) for clip in clips]
    if sum(clip.residual.values.size - clip.residual.jacobian.shape[2] for clip in clips) < MIN_SAMPLES:
        return None
    found = searched(clips)
    rms, motion = _sizes(clips)
    if rms > FAR * motion:
        found = searched([_along(clip, course) for clip, course in zip(clips, found.courses(), strict=True)])
    return found.components()


def searched(clips: Sequence[ClipResidual]) -> Split:
    """The sets of components of some clips, for the likeliest correlation of the noise."""
    scale = Scale.of(
        [clip.motion for clip in clips], [clip.predicted for clip in clips], [clip.rates for clip in clips]
    )
    by_clip = [bases_of(clip.motion, clip.predicted, clip.rates, scale) for clip in clips]
    layout = Layout.of(by_clip, clips)
    odds = {kind: LOG_ODDS + float(np.log(_plausibility(kind, scale))) for kind in layout.groups}
    searches = {rho: SetSearch(layout.products(rho, tolerance(clips)), layout.groups, odds) for rho in CORRELATIONS}
    rho = max(searches, key=lambda rho: searches[rho].evidence(()))
    searches[rho].run(MAX_COMPONENTS)
    better = max(searches, key=lambda each: searches[each].evidence(searches[rho].top()))
    if better != rho:
        searches[better].run(MAX_COMPONENTS)
    return Split(layout, searches[better], searches[0.0].products, better, by_clip[0], scale.repeats)


def tolerance(clips: Sequence[ClipResidual]) -> float:
    """The fraction of the residual to which the components, a linear response, hold."""
    rms, motion = _sizes(clips)
    least, factor, most = LINEAR
    return float(np.clip(factor * rms / max(motion, 1e-300), least, most))


def _plausibility(kind: str, scale: Scale) -> float:
    """How plausible a component is before the data, over the others.

    Everything that moves is slowed down. A force that depends on the place, or a reading that does, makes sense about
    a rest position or a pivot, less so on a fall that passes each place once; what has no velocity of its own, a level,
    has no other force.
    """
    if kind == "force-of-position" and not scale.has_speed:
        return PRIOR_COMMON
    if kind == "clock" and not scale.repeats:  # only what repeats shows whether it comes late
        return PRIOR_RARE**2
    if kind in ("force-of-position", "reading-of-position", "reading-of-velocity") and not scale.repeats:
        return PRIOR_RARE
    return PRIOR_COMMON if kind == "force-of-velocity" else 1.0


def _along(clip: ClipResidual, course: Array) -> ClipResidual:
    """The clip with what was found (n, d) of its residual added to the motion, where states are observed.

    Forces depend on the motion as it was. An error of the reading stays a function of what is predicted: one of what is
    observed would contain the residual itself.
    """
    motion, count = clip.motion, clip.motion.model.degrees_of_freedom
    states = motion.states.copy()
    spline = CubicSpline(clip.residual.t_s, course)
    inside = np.clip(motion.grid, clip.residual.t_s[0], clip.residual.t_s[-1])
    names = [state.name for state in motion.model.states]
    for k, quantity in enumerate(motion.model.observed):
        if motion.model.observe is None and quantity.name in names[:count]:
            place = names.index(quantity.name)
            states[:, place] += spline(inside)[:, k]
            if motion.model.second_order:
                states[:, count + place] += spline.derivative()(inside)[:, k]
    return replace(clip, motion=replace(motion, states=states))


def thinned(clip: ClipResidual, clips: int) -> ClipResidual:
    """Every second (third, ...) sample of a long clip."""
    step = -(-clip.residual.t_s.size * clips // MAX_SAMPLES)
    if step <= 1:
        return clip
    rows = np.arange(0, clip.residual.t_s.size, step)
    thin = replace(clip.motion, at_samples=clip.motion.at_samples[rows])
    return ClipResidual(thin, clip.residual.at(rows), clip.predicted[rows])


# The result ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class Split:
    """A finished search: the columns, the sets compared, the correlation of the noise, the bases of the first clip."""

    layout: Layout
    search: SetSearch
    plain: Products
    rho: float
    bases: Sequence[Basis]
    turns: bool

    def courses(self) -> list[Array]:
        """What the best set adds to the motion of each clip (n, d), without what the fitted values imitate."""
        columns, mean, _ = self.search.variances(self.search.top()).coefficients(self.search.products)
        weights = np.zeros(self.layout.count)
        weights[columns] = mean
        found = []
        for clip, responses, places in zip(self.layout.clips, self.layout.responses, self.layout.places, strict=True):
            course = (responses @ weights[places]) / clip.residual.noise
            jacobian = (clip.residual.jacobian / clip.residual.noise[:, :, None]).reshape(course.size, -1)
            scaled = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
            imitated = scaled @ np.linalg.lstsq(scaled, course.ravel(), rcond=None)[0]
            found.append((course - imitated.reshape(course.shape)) * clip.residual.noise)
        return found

    def components(self) -> Components:
        """The components with their shares and curves."""
        search = self.search
        explanations = search.explanations()
        shares = [self._shares(key) for key, _ in explanations]
        best, share_of, explained = explanations[0][0], shares[0].share, shares[0].total
        factor = explained / max(sum(share_of.values()), 1e-300)  # a share below zero was set to zero
        rms, motion = _sizes(self.layout.clips)
        parts = [self._component(_kind(name), best, factor * share, shares, rms) for name, share in share_of.items()]
        return Components(
            tuple(sorted(parts, key=lambda part: -part.share)),
            1.0 - explained,
            rms,
            rms * float(np.sqrt(1.0 - explained)),
            motion,
            self.layout.clips[0].motion.model.observed[0].unit,
            self.rho,
            tuple((tuple(map(_kind, key)), probability) for key, probability in explanations),
            self.turns,
        )

    def _shares(self, key: Key) -> Shares:
        """The shares of a set, the likeliest component first."""
        order: list[str] = []
        while len(order) < len(key):
            rest = [kind for kind in key if kind not in order]
            order.append(max(rest, key=lambda kind: self.search.evidence([*order, kind])))
        ordered = tuple(order)
        return shares_of(self.plain, self.search.products, ordered, self.search.variances(ordered))

    def _component(
        self, kind: ComponentKind, best: Key, share: float, shares: Sequence[Shares], rms: float
    ) -> Component:
        """A component of the best set, which is given: while its parts are compared another one may come out better."""
        basis = next(each for each in self.bases if each.kind == kind)
        return Component(
            kind,
            share,
            (
                min(share, *(each.low.get(kind, 0.0) for each in shares)),
                max(share, *(each.high.get(kind, 0.0) for each in shares)),
            ),
            rms * float(np.sqrt(share)),
            self.search.probability(kind),
            self._curve(basis, best),
            self._at(basis, best),
            self._similar(kind, best),
        )

    def _similar(self, kind: ComponentKind, best: Key) -> tuple[ComponentKind, ...]:
        """The kinds that can take the place of one in the best set: as likely, or explaining nearly as much."""
        found, rest = [], [each for each in best if each != kind]
        whole, without = (self._explained(tuple(key)) for key in (best, rest))
        for other in [each for each in self.search.free if each not in best]:
            key = tuple(sorted([*rest, other]))
            below = self.search.evidence(best) - self.search.evidence(key)
            if below < CLOSE or self._explained(key) - without > AS_WELL * (whole - without):
                found.append((below, other))
        return tuple(_kind(other) for _, other in sorted(found))

    def _explained(self, key: Key) -> float:
        """The fraction of the residual's variance that a set explains."""
        self.search.evidence(key)
        return explained(self.plain, self.search.products, self.search.variances(tuple(sorted(key))))

    def _at(self, basis: Basis, best: Key) -> Estimate | None:
        """The moment of a pulse, or the frequency of a periodic force, within half of a step of what was tried."""
        if basis.choices is None:
            return None
        choices = np.unique(basis.choices)
        value = float(choices[self.search.found[best].chosen[basis.kind]])
        step = float(np.median(np.diff(choices))) if choices.size > 1 else value
        return Estimate(value, 0.5 * step, "s" if basis.kind == "pulse" else "Hz", "fitted", "components")

    def _curve(self, basis: Basis, best: Key) -> ComponentCurve | None:
        """The component over its argument, without the directions that the fitted values imitate."""
        if basis.curve is None or basis.at is None:
            return None
        products, variances = self.search.products, self.search.variances(best)
        columns, mean, covariance = variances.coefficients(products)
        group = variances.groups[best.index(basis.kind)][: basis.curve.shape[2]]
        inside = np.flatnonzero(np.isin(columns, group))
        values, vectors = np.linalg.eigh(products.information[np.ix_(group, group)])
        kept = vectors[:, values > NEGLIGIBLE**2 * values[-1]]
        curve = basis.curve / self.layout.scales[basis.kind] @ (kept @ kept.T)
        spread = np.einsum("gfk,kl,gfl->gf", curve, covariance[np.ix_(inside, inside)], curve)
        return ComponentCurve(
            basis.argument, basis.at, basis.quantities, curve @ mean[inside], np.sqrt(np.maximum(spread, 0.0))
        )


def _kind(name: str) -> ComponentKind:
    """The kind of that name."""
    return next(kind for kind in SIDES if kind == name)


def _sizes(clips: Sequence[ClipResidual]) -> tuple[float, float]:
    """Root mean squares of the residual, and of the motion about its middle, of the first quantity."""
    residual = np.concatenate([clip.residual.values[:, 0] for clip in clips])
    motion = np.concatenate([clip.predicted[:, 0] - clip.predicted[:, 0].mean() for clip in clips])
    return float(np.sqrt(np.mean(residual**2))), float(np.sqrt(np.mean(motion**2)))
