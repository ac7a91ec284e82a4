"""fit.json of several clips, and of a model chosen from the bank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.io.json_documents import checked, entries_of, fit_document, fitted_quantities, plain_origin
from iris_sysid.io.schemas import (
    CandidateEntry,
    ClipEntry,
    ClipsEntry,
    FitDocument,
    PopulationEntry,
    SelectionEntry,
    UsedSamples,
    VerdictEntry,
)
from iris_sysid.types import Array, FitResult, ModelChoice, PooledFit, Trajectory


def pooled_document(pooled: PooledFit, tables: Sequence[str], trajectory: Trajectory) -> FitDocument:
    """The content of fit.json for several clips: shared values and means over clips are its parameters.

    ``tables`` names each clip's file; the origin of the first clip's trajectory records the request.
    """
    free = list(pooled.estimates)
    means = [population.mean.stderr**2 for population in pooled.population.values()]
    covariance = np.zeros((len(free), len(free)))
    covariance[: len(pooled.shared), : len(pooled.shared)] = pooled.covariance
    covariance[len(pooled.shared) :, len(pooled.shared) :] = np.diag(means)
    usable = [clip for clip in pooled.clips if clip.usable]
    observed = pooled.model.observed
    return checked(
        FitDocument,
        model=pooled.model.name,
        equation=pooled.model.equation,
        status=pooled.status,
        message=pooled.message,
        verdict=pooled.verdict,
        parameters=entries_of(pooled.estimates, pooled.status),
        free=free,
        covariance=covariance,
        budget=pooled.budget,
        noise=_overall(usable, "noise"),
        rms=_overall(usable, "rms"),
        n=sum(clip.n for clip in usable),
        aic=pooled.aic,
        bic=pooled.bic,
        condition=None,
        correlation=None,
        t0_s=None,
        quantities=fitted_quantities(
            observed, *(_by_quantity(usable, name, len(observed)) for name in ("noise", "rms"))
        ),
        samples=UsedSamples(total=sum(clip.used.size for clip in pooled.clips)),
        segments=[],
        geometry={},
        clips=_clips(pooled, tables),
        origin=plain_origin(trajectory.origin),
    )


def _clips(pooled: PooledFit, tables: Sequence[str]) -> ClipsEntry:
    return ClipsEntry(
        shared=list(pooled.shared),
        scatter={name: PopulationEntry.of(population) for name, population in pooled.scatter.items()},
        population={name: PopulationEntry.of(population) for name, population in pooled.population.items()},
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


def _parts(fits: Sequence[FitResult], name: str) -> Array:
    return np.array([getattr(fitted, name) for fitted in fits])


def _by_quantity(fits: Sequence[FitResult], name: str, count: int) -> Array:
    """Root mean square over all fits of each of ``count`` quantities, in its unit; NaN without any fit."""
    return np.sqrt(np.mean(_parts(fits, name) ** 2, axis=0)) if fits else np.full(count, np.nan)


def _overall(fits: Sequence[FitResult], name: str) -> float | None:
    """Root mean square over all fits and quantities; None where the quantities differ in unit."""
    same_unit = bool(fits) and len({quantity.unit for quantity in fits[0].model.observed}) == 1
    return float(np.sqrt(np.mean(_parts(fits, name) ** 2))) if same_unit else None


def selection_document(choice: ModelChoice, origin: Trajectory) -> FitDocument:
    """The content of fit.json for a model chosen from the bank: the first of the ranking, and how it was chosen.

    That fit must not have failed; the origin of the trajectory that was read records the request.
    """
    first = choice.nearest
    if first.fit is None:
        raise ValueError("a choice without any fit has no document")
    entry = SelectionEntry(
        message=choice.message,
        chosen=None if choice.chosen is None else choice.chosen.model,
        heldout_margin=choice.heldout_margin,
        bic_margin=choice.bic_margin,
        ranking=[CandidateEntry.of(candidate) for candidate in choice.ranking],
    )
    changes = {
        "verdict": VerdictEntry.of(choice.verdict),
        "selection": entry,
        "origin": plain_origin({**origin.origin, **first.fit.origin}),
    }
    return fit_document(first.fit).model_copy(update=changes)
