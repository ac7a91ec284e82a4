"""Terms without a named effect that the residual of a fit suggests, for any model, including the user's own.

A candidate is a small force along the fitted motion; :mod:`fitters.effect_sensitivity` gives the first-order response.
Candidates compete for the residual as in discovery, after projecting out what the fitted parameters can imitate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitters.effect_sensitivity import EffectMotion, motion_of
from fitters.sindy.library import unit_of
from fitters.sindy.refinement import blocks_of
from fitters.sindy.resampling import STABLE
from fitters.sindy.residual import called_for, share_called_for
from fitters.sindy.sparse_regression import Compressed, together
from iris_sysid.types import NORMAL_975, Array, DiscoveredTerm, Estimate, FitResult, OdeModel, Trajectory

# Powers of position and rate up to third order, without linear drag and cubic stiffness, which are named effects.
POWERS = ((1, 0), (2, 0), (1, 1), (0, 2), (2, 1), (1, 2), (0, 3))
LEVEL_POWERS = (0.5, 1.0, 2.0)  # powers of the level, for equations of first order
HEAT_POWERS = (1.0, 4.0)  # of a temperature: Newton's cooling and Stefan's radiation
RESAMPLED, SEED = 50, 0  # number of resampled data sets, the same each time
HIDDEN = 1e-3  # fraction of a candidate's response: a smaller remainder after projection is rounding


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A force on one highest derivative: position^``power`` rate^``times``, or the function ``name``."""

    equation: int
    power: float
    times: int
    name: str = ""

    def values(self, position: Array, rate: Array) -> Array:
        """Values (m,) along the motion."""
        if self.name:
            return np.sin(position) if self.name == "sin" else np.cos(position)
        return np.asarray(np.abs(position) ** self.power if self.power % 1 else position**self.power * rate**self.times)

    def text(self, name: str, rate: str) -> str:
        """The term as text, with the names or symbols of position and rate."""
        if self.name:
            return f"{self.name}({name})"
        powers = ((name, self.power), (rate, self.times))
        return " ".join(symbol if power == 1 else f"{symbol}^{power:g}" for symbol, power in powers if power)


def proposals(trajectories: Sequence[Trajectory], fits: Sequence[FitResult]) -> tuple[DiscoveredTerm, ...]:
    """Terms that the residual of fits requires, each chosen in at least half of the resampled data sets.

    Parameters
    ----------
    trajectories
        The clips.
    fits
        Fits of the same model, one a clip; their parameters stay free.

    Returns
    -------
    tuple of DiscoveredTerm
        The proposed terms, with coefficients to first order; empty when the residual requires none.
    """
    model = fits[0].model
    candidates = _candidates(model)
    rows = [
        _rows(fit, motion_of(fit, clip), candidates, (k, len(fits)))
        for k, (fit, clip) in enumerate(zip(fits, trajectories, strict=True))
    ]
    rows, candidates = _not_imitated(rows, candidates)
    chosen, price = called_for(rows, len(candidates))
    if not chosen:
        return ()
    shares = share_called_for(rows, len(candidates), price, np.random.default_rng(SEED), RESAMPLED)
    kept = tuple(k for k in chosen if shares[k] >= STABLE)
    values, covariance = together([part for clip in rows for part in clip]).without(len(candidates)).solved(kept)
    terms = zip(kept, values.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True)
    return tuple(_term(model, candidates[k], value, error, float(shares[k])) for k, value, error in terms)


def _not_imitated(
    rows: list[list[Compressed]], candidates: list[_Candidate]
) -> tuple[list[list[Compressed]], list[_Candidate]]:
    """The candidates that the fitted parameters cannot imitate completely."""
    total, first = together([part for clip in rows for part in clip]), len(candidates)
    before = np.linalg.norm(total.rows[:, :first], axis=0)
    after = np.linalg.norm(total.without(first).rows[:, :first], axis=0)
    seen = np.flatnonzero(after > HIDDEN * before)
    columns = [*seen, *range(first, total.size + 1)]
    fewer = [[Compressed(part.rows[:, columns], part.count) for part in clip] for clip in rows]
    return fewer, [candidates[k] for k in seen]


def _candidates(model: OdeModel) -> list[_Candidate]:
    made = []
    for k in range(model.degrees_of_freedom):
        if not model.second_order:
            made += [
                _Candidate(k, power, 0) for power in (HEAT_POWERS if model.states[k].unit == "K" else LEVEL_POWERS)
            ]
            continue
        made += [_Candidate(k, power, times) for power, times in POWERS]
        if model.states[k].unit == "rad":
            made += [_Candidate(k, 0, 0, name) for name in ("sin", "cos")]
    return made


def _rows(
    fit: FitResult, motion: EffectMotion, candidates: Sequence[_Candidate], where: tuple[int, int]
) -> list[Compressed]:
    """Compressed rows of one clip: a column a candidate, then those of the fitted parameters."""
    count, used = fit.model.degrees_of_freedom, fit.used
    scale = np.maximum(fit.rms, 1e-300)
    columns = []
    for candidate in candidates:
        position = motion.states[:, candidate.equation]
        rate = motion.states[:, count + candidate.equation] if fit.model.second_order else np.ones_like(position)
        force = np.zeros((len(position), count))
        force[:, candidate.equation] = candidate.values(position, rate)
        columns.append(np.nan_to_num(motion.answer(force)))
    target = fit.residual[used] / scale
    own = fit.jacobian.reshape(*target.shape, -1)
    wide = np.concatenate([np.stack(columns, axis=2), own], axis=2) / scale[:, None]
    return blocks_of(wide, target, fit, len(candidates), where)


def _term(model: OdeModel, candidate: _Candidate, value: float, error: float, share: float) -> DiscoveredTerm:
    state, order = model.states[candidate.equation], 2 if model.second_order else 1
    symbol = state.symbol or state.name
    base = "" if state.unit == "rad" else state.unit
    unit = unit_of(base, (1 - candidate.power - candidate.times) if base else 0, order - candidate.times)
    return DiscoveredTerm(
        equation=state.name + "'" * order,
        term=candidate.text(state.name, f"{state.name}'"),
        latex=candidate.text(rf"{symbol}", rf"\dot {{{symbol}}}"),
        parameter=f"{state.name}_{candidate.name or f'{candidate.power:g}_{candidate.times}'}",
        coefficient=Estimate(value, error, unit, ci95=(value - NORMAL_975 * error, value + NORMAL_975 * error)),
        inclusion=share,
        selected=True,
    )
