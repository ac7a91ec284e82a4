"""What a model of the bank lacks, as terms: discovery on the residual of its fit.

The model's own terms are kept whatever else is chosen; all other candidates of the library compete to explain what its
fit leaves. A term that a named effect covers says so, the others are proposals that the diagnosis has no name for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]  # ships none

from fitters.sindy_bank import key_of, structures
from fitters.sindy_library import CUBE, DRAG, DRY, ONE, RATE, Library, library_of, turnover_of
from fitters.sindy_refine import Refined, folds_of, refined
from fitters.sindy_sparse import Compressed, Kept, predictive_price, significant, together
from fitters.sindy_weak import pieces_of
from iris_sysid.errors import FitError
from iris_sysid.types import NORMAL_975, DiscoveredTerm, Estimate, Trajectory

# The effect that adds this term to the acceleration.
NAMED = {
    ONE: "constant-force",
    CUBE: "cubic-stiffness",
    RATE: "linear-drag",
    DRAG: "quadratic-drag",
    DRY: "coulomb-friction",
}
ROUNDS = 4


def lacking(
    trajectories: Trajectory | Sequence[Trajectory], model: str, *, resampled: int = 100, seed: int = 0
) -> tuple[DiscoveredTerm, ...]:
    """Terms that the residual of a bank model's fit calls for, with coefficients, intervals and inclusion.

    Parameters
    ----------
    trajectories
        One or several clips of what the model observes.
    model
        Name of a model of the bank whose equation the library can express.
    resampled
        Number of resampled data sets for the inclusion.
    seed
        Of the resampling.

    Returns
    -------
    tuple of DiscoveredTerm
        Every term that the model lacks; ``selected`` are those proposed. :func:`effect_of` names the effect, if any.

    Raises
    ------
    FitError
        When the model is not among those that the library can express for these quantities, or cannot be fitted.
    DataError
        As :func:`fitters.sindy.discover`.
    """
    clips = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    plain = library_of(clips[0].quantities, clips[0].input_quantities)
    rates = np.concatenate([piece.rates for clip in clips for piece in pieces_of(clip, plain)])
    library = library_of(clips[0].quantities, clips[0].input_quantities, turnover_of(rates))
    own = _own_terms(library, model)
    with threadpool_limits(limits=1, user_api="blas"):
        extra: Kept = ()
        for _ in range(ROUNDS):
            found = refined(clips, library, tuple(sorted((*own, *extra))), {})
            if not found.usable:
                raise FitError(f"{model} cannot be fitted to this: {found.fits[0].message}")
            chosen = _beyond(found, own)
            if chosen == extra:
                break
            extra = chosen
        return _proposals(library, found, own, extra, np.random.default_rng(seed), resampled)


def effect_of(library: Library, term: DiscoveredTerm) -> str:
    """The named effect that covers a term; empty where none does."""
    code = next(one.code for one in library.terms if one.parameter.name == term.parameter)
    return NAMED.get(code, "")


def _own_terms(library: Library, model: str) -> Kept:
    for one in structures(library):
        if one.model.name == model:
            return tuple(k for k in range(len(library.terms)) if key_of(library, k) in one.sometimes)
    names = ", ".join(sorted(one.model.name for one in structures(library)))
    quantities = ", ".join(variable.quantity.name for variable in library.variables)
    raise FitError(f"{model!r} is no model of {quantities} that the library can express; there are: {names or 'none'}")


def _ordered(found: Refined, own: Kept) -> list[int]:
    """Columns with the candidates first, then the model's own terms and the initial states."""
    size = found.parts[0][0].size
    return [*(k for k in range(found.terms) if k not in own), *own, *range(found.terms, size), size]


def _rearranged(part: Compressed, order: list[int]) -> Compressed:
    return Compressed(part.rows[:, order], part.count)


def _beyond(found: Refined, own: Kept) -> Kept:
    """The candidates that what is left calls for, at the price that held-out prediction sets."""
    order, first = _ordered(found, own), found.terms - len(own)
    folds = [_rearranged(together(group), order) for group in folds_of(found.parts)]
    chosen = significant(together(folds).without(first), predictive_price(folds, first))
    return tuple(sorted(order[k] for k in chosen))


def _proposals(
    library: Library, found: Refined, own: Kept, extra: Kept, rng: np.random.Generator, resampled: int
) -> tuple[DiscoveredTerm, ...]:
    order, first = _ordered(found, own), found.terms - len(own)
    folds = [_rearranged(together(group), order) for group in folds_of(found.parts)]
    price, times = predictive_price(folds, first), np.zeros(found.terms)
    blocks = [_rearranged(part, order) for clip in found.parts for part in clip]
    for _ in range(resampled):
        drawn = together([blocks[k] for k in rng.integers(len(blocks), size=len(blocks))]).without(first)
        for k in significant(drawn, price):
            times[order[k]] += 1
    terms = []
    for k in order[:first]:
        kept = tuple(sorted({*own, *extra, k}))
        values, covariance = found.total.solved(kept)
        place = kept.index(k)
        value, error = float(values[place]), float(np.sqrt(covariance[place, place]))
        term = library.terms[k]
        interval = (value - NORMAL_975 * error, value + NORMAL_975 * error)
        terms.append(
            DiscoveredTerm(
                equation=library.variables[term.equation].left,
                term=term.text,
                latex=term.latex or "1",
                parameter=term.parameter.name,
                coefficient=Estimate(value, error, term.parameter.unit, ci95=interval),
                inclusion=float(times[k] / max(resampled, 1)),
                selected=k in extra,
            )
        )
    return tuple(terms)
