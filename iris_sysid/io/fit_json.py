"""fit.json of several clips, and of a model chosen from the bank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.io.json_documents import checked, entries_of, entry_of, fit_document, plain_origin
from iris_sysid.io.schemas import (
    CandidateEntry,
    ClipEntry,
    ClipsEntry,
    FitDocument,
    FittedQuantity,
    PopulationEntry,
    SelectionEntry,
    UsedSamples,
    VerdictEntry,
    known_number,
    known_numbers,
)
from iris_sysid.types import Array, FitResult, ModelChoice, PooledFit, Population, Trajectory


def pooled_document(pooled: PooledFit, tables: Sequence[str], trajectory: Trajectory) -> FitDocument:
    """The content of fit.json for several clips: shared values and means over clips are its parameters.

    Parameters
    ----------
    pooled
        The fit.
    tables
        Name of each clip's file.
    trajectory
        The first clip; its origin records the request.
    """
    free = list(pooled.estimates)
    means = [population.mean.stderr**2 for population in pooled.population.values()]
    covariance = np.zeros((len(free), len(free)))
    covariance[: len(pooled.shared), : len(pooled.shared)] = pooled.covariance
    covariance[len(pooled.shared) :, len(pooled.shared) :] = np.diag(means)
    usable = [clip for clip in pooled.clips if clip.usable]
    return checked(
        FitDocument,
        model=pooled.model.name,
        equation=pooled.model.equation,
        status=pooled.status,
        message=pooled.message,
        verdict=VerdictEntry.of(pooled.verdict),
        parameters=entries_of(pooled.estimates, pooled.status),
        free=free,
        covariance=[known_numbers(row) for row in covariance],
        budget={name: {key: known_number(part) for key, part in row.items()} for name, row in pooled.budget.items()},
        noise=_overall(usable, "noise"),
        rms=_overall(usable, "rms"),
        n=sum(clip.n for clip in usable),
        aic=known_number(pooled.aic),
        bic=known_number(pooled.bic),
        condition=None,
        correlation=None,
        t0_s=None,
        quantities=[
            FittedQuantity(
                name=quantity.name,
                unit=quantity.unit,
                symbol=quantity.symbol,
                noise=_mean_square(usable, "noise", k),
                rms=_mean_square(usable, "rms", k),
            )
            for k, quantity in enumerate(pooled.model.observed)
        ],
        samples=UsedSamples(total=sum(clip.used.size for clip in pooled.clips)),
        segments=[],
        geometry={},
        clips=_clips(pooled, tables),
        origin=plain_origin(trajectory.origin),
    )


def _clips(pooled: PooledFit, tables: Sequence[str]) -> ClipsEntry:
    return ClipsEntry(
        shared=list(pooled.shared),
        scatter={name: _population(population) for name, population in pooled.scatter.items()},
        population={name: _population(population) for name, population in pooled.population.items()},
        clips=[
            ClipEntry(
                table=table,
                status=clip.status,
                message=clip.message,
                parameters=entries_of(clip.estimates, clip.status),
                noise=_overall([clip], "noise"),
                rms=_overall([clip], "rms"),
                n=clip.n,
            )
            for table, clip in zip(tables, pooled.clips, strict=True)
        ],
    )


def _population(population: Population) -> PopulationEntry:
    return PopulationEntry(
        mean=entry_of(population.mean),
        between=entry_of(population.between),
        within=known_number(population.within),
        q=known_number(population.q),
        degrees=population.degrees,
        p_value=known_number(population.p_value),
    )


def _parts(fits: Sequence[FitResult], name: str) -> Array:
    return np.array([getattr(fitted, name) for fitted in fits])


def _mean_square(fits: Sequence[FitResult], name: str, column: int) -> float | None:
    return known_number(np.sqrt(np.mean(_parts(fits, name)[:, column] ** 2))) if fits else None


def _overall(fits: Sequence[FitResult], name: str) -> float | None:
    """Root mean square over all fits and quantities; None where the quantities differ in unit."""
    same_unit = bool(fits) and len({quantity.unit for quantity in fits[0].model.observed}) == 1
    return known_number(np.sqrt(np.mean(_parts(fits, name) ** 2))) if same_unit else None


def selection_document(choice: ModelChoice, origin: Trajectory) -> FitDocument:
    """The content of fit.json for a model chosen from the bank: the first of the ranking, and how it was chosen.

    Parameters
    ----------
    choice
        The ranking; its first fit must not have failed.
    origin
        The trajectory that was read; its origin records the request.
    """
    first = choice.nearest
    if first.fit is None:
        raise ValueError("a choice without any fit has no document")
    ranking = [
        CandidateEntry(
            model=candidate.model,
            observable=candidate.observable,
            heldout=known_number(candidate.heldout),
            residual=known_number(candidate.residual),
            bic=known_number(candidate.bic),
            adequate=candidate.adequate,
            note=candidate.note,
        )
        for candidate in choice.ranking
    ]
    entry = SelectionEntry(
        message=choice.message,
        chosen=None if choice.chosen is None else choice.chosen.model,
        heldout_margin=known_number(choice.heldout_margin),
        bic_margin=known_number(choice.bic_margin),
        ranking=ranking,
    )
    changes = {
        "verdict": VerdictEntry.of(choice.verdict),
        "selection": entry,
        "origin": plain_origin({**origin.origin, **first.fit.origin}),
    }
    return fit_document(first.fit).model_copy(update=changes)
