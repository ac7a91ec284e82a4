"""Discover the governing equation: sparse regression proposes it, trajectory fits select and refine it.

1. The weak form of every candidate equation gives rows to pysindy's stepwise sparse regression; the prediction of
   held-out rows decides the number of terms.
2. The proposed equation is fitted to the trajectories by the ODE engine. About that fit, all candidates compete again
   on the sensitivities of the trajectory; the price of a term is chosen by prediction of held-out parts of the clips.
   The new choice is fitted again, until the choice does not change.
3. Blocks of time and clips are resampled, which gives each term the probability that it is included. A term that fewer
   than half of the resampled data sets include is removed again (stability selection).
4. The result is compared with the bank, see :mod:`fitters.sindy.model_matching`.

All numbers come from the trajectory fit, none from the regression.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitters.input_hold import residual_over_noise
from fitters.sindy.library import (
    DIFFERENCE,
    INPUT,
    LINEAR,
    ONE,
    RATE,
    SIN,
    Library,
    kind_of,
    library_of,
    turnover_of,
)
from fitters.sindy.model import model_of
from fitters.sindy.model_matching import match
from fitters.sindy.model_structure import terms_of
from fitters.sindy.refinement import Refined, added_alone, as_good, disposed, refined
from fitters.sindy.resampling import inclusion, stable
from fitters.sindy.residual import beyond
from fitters.sindy.sparse_regression import Kept, predicted_best, proposed
from fitters.sindy.weak_form import Piece, Rows, pieces_of, rows_of
from iris_sysid.errors import DataError, FitError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.types import (
    NORMAL_975,
    Array,
    DiscoveredEquation,
    DiscoveredTerm,
    Discovery,
    Estimate,
    FitStatus,
    Match,
    Trajectory,
)

NOTHING: Mapping[str, Estimate] = MappingProxyType({})
BETTER = 0.5  # of the residual of an equation of first order, below which one of second order is taken
ALIKE = 3.84  # chi-squared, one degree of freedom, 95 %: choices that differ by less are indistinguishable


@on_one_thread
def discover(
    trajectories: Trajectory | Sequence[Trajectory],
    *,
    quantities: Sequence[str] = (),
    known: Mapping[str, Estimate] = NOTHING,
    residual_of: str | None = None,
    resampled: int = 100,
    seed: int = 0,
) -> Discovery:
    """Find the equation that trajectories obey, with error bars, and its name in the bank.

    Parameters
    ----------
    trajectories
        One or several clips of the same quantities, of any lengths; only valid samples in motion are used. Angles and
        positions have equations of second order; other quantities of first, and of second where that does not fit.
    quantities
        Names of the quantities to find equations for; by default all.
    known
        Constants of the bank's models by name, e.g. gravity, with their errors.
    residual_of
        Name of a model of the bank whose terms are kept: further terms explain only the residual of its fit.
    resampled
        Number of resampled data sets for the inclusion probabilities.
    seed
        Seed of the resampling.

    Returns
    -------
    Discovery
        Equations, every candidate with coefficient, interval and inclusion, and the matching model of the bank.
        A discovery whose fit is not good has a ``status`` other than ok and a message.

    Raises
    ------
    DataError
        When there are too few samples, a quantity does not move, is unknown, or differs between clips.
    FitError
        When no proposed equation could be fitted, or the model of ``residual_of`` does not describe these quantities.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, discover, simulate
    >>> spring, t_s = MODELS["linear-oscillator"], np.arange(300) / 60
    >>> z = simulate(spring, t_s, {"stiffness": 20.0, "damping": 0.3, "z_0": 0.2, "vz_0": 0.0}).observed
    >>> z += 1e-4 * np.random.default_rng(0).standard_normal(z.shape)
    >>> clip = Trajectory(t_s, spring.observed, z, np.full_like(z, np.nan), np.ones(300, bool))
    >>> [term.term for term in discover(clip).selected]
    ['z', "z'"]
    """
    clips = _clips(trajectories, quantities)
    constants = {**clips[0].geometry, **known}

    def found(moving: bool) -> Discovery:
        library, pieces = _library_and_pieces(clips, moving)
        rng = np.random.default_rng(seed)
        if residual_of is None:
            return _discovered(clips, library, _starts(pieces, library), constants, rng, resampled)
        own = terms_of(library, residual_of)
        choice, shares = beyond(clips, library, own, rng, resampled)
        return _discovery(library, choice, own, shares, [], *_compared(clips, library, choice, constants))

    discovery = found(moving=False)
    amounts = all(kind_of(quantity) == "amount" for quantity in clips[0].quantities)
    if amounts and residual_of is None and discovery.status == "misfit":  # a unit as V tells no order
        with suppress(FitError):
            second = found(moving=True)
            if residual_over_noise(second.fits) < BETTER * residual_over_noise(discovery.fits):
                discovery = second
    return replace(discovery, origin=_origin(clips))


def _library_and_pieces(clips: Sequence[Trajectory], moving: bool) -> tuple[Library, list[Piece]]:
    """The candidates, and the stretches of motion; ``moving`` as for :func:`fitters.sindy.library.library_of`."""
    observed = clips[0].quantities, clips[0].input_quantities
    library = library_of(*observed, moving=moving)
    pieces = [piece for clip in clips for piece in pieces_of(clip, library)]
    if not pieces:
        raise DataError("no stretch of motion without a gap is long enough to discover an equation in")
    return library_of(*observed, turnover_of(np.concatenate([piece.rates for piece in pieces])), moving), pieces


def _discovered(
    clips: Sequence[Trajectory],
    library: Library,
    starts: Sequence[tuple[Kept, Mapping[str, float]]],
    constants: Mapping[str, Estimate],
    rng: np.random.Generator,
    resampled: int,
) -> Discovery:
    choice = disposed(clips, library, starts)
    if not choice.usable:
        raise FitError(f"no equation of the library could be fitted: {choice.fits[0].message}")
    choice, shares = stable(clips, library, choice, rng, resampled)
    named, alike, matched, nearest = _named(clips, library, choice, constants)
    if named is not choice:
        shares = inclusion(named, rng, resampled)
    return _discovery(library, named, starts[0][0], shares, alike, matched, nearest)


# --------------------------------------------------------------------------- what is asked


def _clips(trajectories: Trajectory | Sequence[Trajectory], quantities: Sequence[str]) -> list[Trajectory]:
    clips = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    if not clips:
        raise DataError("there is no trajectory: give at least one")
    clips = [_only(clip, quantities) for clip in clips]
    first = _columns(clips[0])
    for number, clip in enumerate(clips[1:], start=2):
        if _columns(clip) != first:
            raise DataError(
                f"clip {number} has {', '.join(_columns(clip))} but clip 1 {', '.join(first)}: "
                "clips of one discovery must have the same quantities, in the same units"
            )
    return clips


def _columns(clip: Trajectory) -> list[str]:
    return [quantity.column for quantity in (*clip.quantities, *clip.input_quantities)]


def _only(clip: Trajectory, names: Sequence[str]) -> Trajectory:
    if not names:
        return clip
    indices = [clip.column(name) for name in names]
    return clip.with_(
        quantities=tuple(clip.quantities[k] for k in indices),
        position=clip.position[:, indices],
        sigma=clip.sigma[:, indices],
        smoothed=None,
    )


def _origin(clips: Sequence[Trajectory]) -> dict[str, Any]:
    """Origin of the first clip, with the sources of all clips where there are several."""
    origin = dict(clips[0].origin)
    if len(clips) > 1:
        origin["clips"] = [{key: clip.origin.get(key) for key in ("source", "sha256")} for clip in clips]
    return origin


# --------------------------------------------------------------------------- proposals


def _starts(pieces: list[Piece], library: Library) -> list[tuple[Kept, dict[str, float]]]:
    """Proposed choices with coefficients: pysindy's, all smooth terms, then single terms."""
    rows = rows_of(pieces, library)
    choices = [proposed(row) for row in rows]
    best = [path[predicted_best(row, path)] for row, path in zip(rows, choices, strict=True)]
    smooth = [_smooth(library, equation) for equation in range(len(rows))]
    single = [path[min(1, len(path) - 1)] for path in choices]
    return [_start(library, rows, choice) for choice in (best, smooth, single)]


def _smooth(library: Library, equation: int) -> NDArray[np.intp]:
    """The terms of an equation that make every motion one that an integrator can follow, whatever their size."""
    codes = [library.terms[k].code for k in library.of_equation(equation)]
    own = (ONE, SIN if SIN in codes else LINEAR, RATE, DIFFERENCE, INPUT)
    return np.flatnonzero([code in own for code in codes])


def _start(library: Library, rows: Sequence[Rows], choice: Sequence[Any]) -> tuple[Kept, dict[str, float]]:
    kept: list[int] = []
    start: dict[str, float] = {}
    for equation, (equation_rows, indices) in enumerate(zip(rows, choice, strict=True)):
        terms = [library.of_equation(equation)[k] for k in indices]
        solved = np.linalg.lstsq(equation_rows.right[:, indices], equation_rows.left, rcond=1e-10)[0]
        start |= {library.names[k]: float(value) for k, value in zip(terms, solved, strict=True)}
        kept += terms
    return tuple(sorted(kept)), start


# --------------------------------------------------------------------------- a name


def _named(
    clips: Sequence[Trajectory], library: Library, choice: Refined, constants: Mapping[str, Estimate]
) -> tuple[Refined, list[Kept], Match | None, Match | None]:
    """Match with the bank; of indistinguishable choices, prefer one that the bank has."""
    alike = as_good(choice, library, ALIKE)
    matched, nearest = _compared(clips, library, choice, constants)
    for other in alike if matched is None else ():
        values = choice.total.solved(other)[0]
        start = {library.names[k]: float(value) for k, value in zip(other, values, strict=True)}
        second = refined(clips, library, other, start)
        count = max(choice.count, second.count)
        if second.criterion(count) > choice.criterion(count) + ALIKE:
            continue
        named, _ = _match(library, second, constants)
        if named is not None:
            return second, as_good(second, library, ALIKE), named, None
    return choice, alike, matched, nearest


def _compared(
    clips: Sequence[Trajectory], library: Library, choice: Refined, constants: Mapping[str, Estimate]
) -> tuple[Match | None, Match | None]:
    """The model of the bank with this structure, and the nearest one with its own fit."""
    matched, nearest = _match(library, choice, constants)
    if nearest is not None and not nearest.missing:
        nearest = _alone(clips, library, choice, nearest, constants)
    return matched, nearest


def _alone(
    clips: Sequence[Trajectory], library: Library, choice: Refined, nearest: Match, constants: Mapping[str, Estimate]
) -> Match:
    """The nearest model's parameters from its own terms alone, and how much larger the residual then is."""
    kept = terms_of(library, nearest.model)
    values = choice.total.solved(kept)[0]
    alone = refined(clips, library, kept, dict(zip((library.names[k] for k in kept), values.tolist(), strict=True)))
    again = _match(library, alone, constants)[0] if alone.usable else None
    if again is None or again.model != nearest.model:
        return nearest
    pairs = zip(alone.fits, choice.fits, strict=True)
    ratio = float(np.sqrt(np.mean([np.mean((reduced.rms / full.rms) ** 2) for reduced, full in pairs])))
    return replace(nearest, parameters=again.parameters, note=f"its residual is {ratio:.3g} times as large")


def _match(library: Library, choice: Refined, known: Mapping[str, Estimate]) -> tuple[Match | None, Match | None]:
    values, errors = _values(library, choice)
    before = np.sqrt(np.diag(choice.covariance))
    grown = errors[list(choice.kept)] / np.where(before > 0, before, 1.0)
    found = match(library, choice.kept, values, errors, choice.covariance * np.outer(grown, grown), known)
    quantile = max((_half_width(value) for value in _stated(library, choice).values()), default=NORMAL_975)
    return tuple(None if one is None else _with_quantile(one, quantile) for one in found)  # type: ignore[return-value]


def _half_width(value: Estimate) -> float:
    """Half of an interval in standard errors: the quantile of its distribution."""
    low, high = value.interval
    quantile = (high - low) / (2.0 * value.stderr) if value.stderr > 0 else NORMAL_975
    return quantile if np.isfinite(quantile) else NORMAL_975


def _with_quantile(found: Match, quantile: float) -> Match:
    """The match with the intervals of what was estimated as wide as those of the coefficients."""
    made = {
        name: replace(one, ci95=(one.value - quantile * one.stderr, one.value + quantile * one.stderr))
        if one.measurement_type == "fitted"
        else one
        for name, one in found.parameters.items()
    }
    return replace(found, parameters=made)


def _values(library: Library, choice: Refined) -> tuple[Array, Array]:
    """Coefficients (k,) and standard errors: from the fit for chosen terms, as if added for the others."""
    values, errors = added_alone(choice)
    values[list(choice.kept)] = choice.coefficients
    errors[list(choice.kept)] = np.sqrt(np.diag(choice.covariance))
    for k, one in _stated(library, choice).items():
        errors[k] = one.stderr
    return values, errors


def _stated(library: Library, choice: Refined) -> dict[int, Estimate]:
    """The estimates of the chosen terms, of one clip, as its fit states them: with what the equation may lack."""
    if len(choice.fits) != 1:
        return {}
    stated = {k: choice.fits[0].estimates[library.names[k]] for k in choice.kept}
    return {k: one for k, one in stated.items() if np.isfinite(one.stderr)}


# --------------------------------------------------------------------------- the result


def _discovery(
    library: Library,
    choice: Refined,
    first: Kept,
    shares: Array,
    alike: Sequence[Kept],
    matched: Match | None,
    nearest: Match | None,
) -> Discovery:
    values, errors = _values(library, choice)
    stated = _stated(library, choice)
    terms = tuple(
        DiscoveredTerm(
            equation=library.variables[term.equation].left,
            term=term.text,
            latex=term.latex or "1",
            parameter=term.parameter.name,
            coefficient=Estimate(
                float(values[k]),
                float(errors[k]),
                term.parameter.unit,
                ci95=stated[k].interval
                if k in stated
                else (float(values[k] - NORMAL_975 * errors[k]), float(values[k] + NORMAL_975 * errors[k])),
            ),
            inclusion=float(shares[k]),
            selected=k in choice.kept,
            effect=library.effect(k),
        )
        for k, term in enumerate(library.terms)
    )
    chosen = [library.names[k] for k in choice.kept]
    status: FitStatus = next((fitted.status for fitted in choice.fits if fitted.status != "ok"), "ok")
    return Discovery(
        equations=tuple(_equation(library, k, terms) for k in range(len(library.variables))),
        terms=terms,
        proposed=tuple(library.names[k] for k in first),
        model=model_of(library, chosen),
        fits=choice.fits,
        matched=matched,
        nearest=nearest,
        alternatives=tuple(_exchange(library, choice.kept, other) for other in alike),
        status=status,
        message=next((fitted.message for fitted in choice.fits if fitted.status != "ok"), ""),
    )


def _equation(library: Library, equation: int, terms: Sequence[DiscoveredTerm]) -> DiscoveredEquation:
    """The equation with its coefficients as numbers."""
    own = [terms[k] for k in library.of_equation(equation) if terms[k].selected]
    variable = library.variables[equation]
    text = " ".join(_signed(term.coefficient, term.term if term.term != "1" else "", " ") for term in own)
    latex = " ".join(_signed(term.coefficient, term.latex if term.latex != "1" else "", r"\,") for term in own)
    right = text.removeprefix("+ ") or "0"
    return DiscoveredEquation(variable.left, right, f"{variable.left_latex} = {latex.removeprefix('+ ') or '0'}")


def _signed(coefficient: Estimate, term: str, between: str) -> str:
    digits = f"{abs(coefficient.value):.{_digits(coefficient)}g}"
    return f"{'-' if coefficient.value < 0 else '+'} {digits}{between if term else ''}{term}"


def _digits(coefficient: Estimate) -> int:
    """Significant digits, to the second one of the standard error."""
    if not coefficient.stderr > 0 or not np.isfinite(coefficient.stderr) or coefficient.value == 0:
        return 6
    return int(np.clip(2 + np.floor(np.log10(abs(coefficient.value) / coefficient.stderr)) + 1, 2, 9))


def _exchange(library: Library, kept: Kept, other: Kept) -> str:
    """Say which term can be exchanged for which other, e.g. ``theta in place of sin(theta) in theta''``."""
    gone = [library.terms[k] for k in kept if k not in other]
    come = [library.terms[k] for k in other if k not in kept]
    pairs = zip(gone, come, strict=True)
    return ", ".join(
        f"{new.text} in place of {old.text} in {library.variables[old.equation].left}" for old, new in pairs
    )
