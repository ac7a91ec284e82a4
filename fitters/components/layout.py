"""The columns of all components in all clips, and their sums with the residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from fitters.components.bases import Basis
from fitters.components.likelihood import Columns, Products
from fitters.components.noisy_residual import NoisyResidual
from fitters.effect_sensitivity import EffectMotion
from iris_sysid.types import Array


@dataclass(frozen=True, eq=False, slots=True)
class ClipResidual:
    """The residual of one clip's fit: its motion, and the residual with its noise; ``predicted`` (n, d)."""

    motion: EffectMotion
    residual: NoisyResidual
    predicted: Array

    @property
    def rates(self) -> Array:
        """Rates (n, d) of what is predicted, 1/s."""
        t_s = self.residual.t_s
        return np.asarray(CubicSpline(t_s, self.predicted).derivative()(t_s))


@dataclass(frozen=True, eq=False, slots=True)
class Layout:
    """The columns of all components of all clips: ``responses`` (n, d, k) of each clip, and which columns they are."""

    clips: tuple[ClipResidual, ...]
    responses: tuple[Array, ...]
    places: tuple[Columns, ...]
    count: int
    groups: dict[str, list[Columns]]
    scales: dict[str, float]

    @classmethod
    def bare(cls, clips: Sequence[ClipResidual]) -> Layout:
        """No columns: the residuals as noise."""
        responses = tuple(np.zeros((*clip.residual.values.shape, 0)) for clip in clips)
        return cls(tuple(clips), responses, tuple(np.zeros(0, dtype=np.intp) for _ in clips), 0, {}, {})

    @classmethod
    def of(cls, by_clip: Sequence[Sequence[Basis]], clips: Sequence[ClipResidual]) -> Layout:
        """The columns of the bases of each clip that all clips have."""
        kinds = [basis.kind for basis in by_clip[0] if all(basis.kind in {b.kind for b in bases} for bases in by_clip)]
        groups: dict[str, list[Columns]] = {}
        scales: dict[str, float] = {}
        parts: list[list[Array]] = [[] for _ in clips]
        places: list[list[Columns]] = [[] for _ in clips]
        count = 0
        for kind in kinds:
            bases = [next(basis for basis in each if basis.kind == kind) for each in by_clip]
            if bases[0].choices is not None and len(clips) > 1:
                continue  # a moment or a frequency of one clip is not that of another
            size = _mean_square(bases, clips)
            if not size > 0:
                continue
            scales[kind] = size
            own: list[Columns] = []
            for k, basis in enumerate(bases):
                if k == 0 or not basis.shared:
                    own.append(np.arange(count, count + basis.columns.shape[2]))
                    count += basis.columns.shape[2]
                parts[k].append(basis.columns / size)
                places[k].append(own[-1])
            groups[kind] = _rivals(bases[0], np.concatenate(own))
        every = tuple(np.concatenate(part, axis=2) for part in parts)
        return cls(tuple(clips), every, tuple(np.concatenate(place) for place in places), count, groups, scales)

    def products(self, rho: float, tolerance: float = 0.0) -> Products:
        """Sums over all clips for noise of one correlation; components are right to ``tolerance`` of the residual."""
        information, along = np.zeros((self.count, self.count)), np.zeros(self.count)
        squares, degrees, log_scale, volume = 0.0, 0, 0.0, 0.0
        for clip, responses, places in zip(self.clips, self.responses, self.places, strict=True):
            white = clip.residual.whitened(responses, rho)
            information[np.ix_(places, places)] += white.information
            along[places] += white.components
            squares, degrees = squares + white.squares, degrees + white.degrees
            log_scale, volume = log_scale + white.log_scale, volume + white.volume
        floor = tolerance**2 * squares / degrees
        return Products(information, along, squares, degrees, log_scale, volume, floor)


def _mean_square(bases: Sequence[Basis], clips: Sequence[ClipResidual]) -> float:
    """Root mean square over samples of a component with unit coefficients, in units of the noise."""
    squares = [
        float(np.sum((basis.columns / clip.residual.noise[:, :, None]) ** 2))
        for basis, clip in zip(bases, clips, strict=True)
    ]
    rivals = 1 if bases[0].choices is None else np.unique(bases[0].choices).size
    return float(np.sqrt(sum(squares) / rivals / sum(clip.residual.t_s.size for clip in clips)))


def _rivals(basis: Basis, columns: Columns) -> list[Columns]:
    if basis.choices is None:
        return [columns]
    return [columns[basis.choices == choice] for choice in np.unique(basis.choices)]
