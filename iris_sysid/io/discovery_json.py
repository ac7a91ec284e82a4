"""discovery.json: a discovered equation with its terms, as a checked document."""

from __future__ import annotations

from iris_sysid.io.json_documents import checked, entries_of, plain_origin
from iris_sysid.io.schemas import (
    DiscoveryDocument,
    EquationEntry,
    MatchEntry,
    NearestEntry,
    TermEntry,
    VerdictEntry,
    known_number,
    known_numbers,
)
from iris_sysid.types import DiscoveredTerm, Discovery, Match


def discovery_document(discovery: Discovery, sentence: str) -> DiscoveryDocument:
    """The content of discovery.json for a discovery, with the ``sentence`` that says what it is."""
    matched, nearest = discovery.matched, discovery.nearest
    return checked(
        DiscoveryDocument,
        sentence=sentence,
        verdict=VerdictEntry.of(discovery.verdict),
        status=discovery.status,
        message=discovery.message,
        equations=[
            EquationEntry(lhs=equation.lhs, rhs=equation.rhs, latex=equation.latex) for equation in discovery.equations
        ],
        terms=[term_entry(term) for term in discovery.terms],
        matched=None if matched is None else _match(matched),
        nearest=None
        if nearest is None
        else NearestEntry(
            model=nearest.model,
            missing=list(nearest.missing),
            extra=list(nearest.extra),
            parameters=entries_of(nearest.parameters),
            note=nearest.note,
        ),
        alternatives=list(discovery.alternatives),
        proposed=list(discovery.proposed),
        noise=[known_number(value) for fit in discovery.fits for value in fit.noise],
        rms=[known_number(value) for fit in discovery.fits for value in fit.rms],
        n=[fit.n for fit in discovery.fits],
        origin=plain_origin(discovery.origin),
    )


def term_entry(term: DiscoveredTerm) -> TermEntry:
    """A term as it is written to a file."""
    return TermEntry(
        equation=term.equation,
        term=term.term,
        coefficient=known_number(term.coefficient.value),
        ci95=known_numbers(term.coefficient.interval),
        inclusion=term.inclusion,
        selected=term.selected,
        stderr=known_number(term.coefficient.stderr),
        unit=term.coefficient.unit,
        latex=term.latex,
        parameter=term.parameter,
        effect=term.effect,
    )


def _match(match: Match) -> MatchEntry:
    return MatchEntry(
        model=match.model, parameters=entries_of(match.parameters), same=list(match.same), note=match.note
    )
