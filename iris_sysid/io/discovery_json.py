"""discovery.json: a discovered equation with its terms, as a checked document."""

from __future__ import annotations

from iris_sysid.io.json_documents import checked, plain_origin
from iris_sysid.io.schemas import DiscoveryDocument, TermEntry
from iris_sysid.types import DiscoveredTerm, Discovery


def discovery_document(discovery: Discovery, sentence: str) -> DiscoveryDocument:
    """The content of discovery.json for a discovery, with the ``sentence`` that says what it is."""
    named = ("verdict", "status", "message", "equations", "matched", "nearest", "alternatives", "proposed")
    return checked(
        DiscoveryDocument,
        **{name: getattr(discovery, name) for name in named},
        sentence=sentence,
        terms=[term_entry(term) for term in discovery.terms],
        noise=[value for fit in discovery.fits for value in fit.noise],
        rms=[value for fit in discovery.fits for value in fit.rms],
        n=[fit.n for fit in discovery.fits],
        origin=plain_origin(discovery.origin),
    )


def term_entry(term: DiscoveredTerm) -> TermEntry:
    """A term as it is written to a file."""
    named = ("equation", "term", "inclusion", "selected", "latex", "parameter", "effect")
    value = term.coefficient
    numbers = {"coefficient": value.value, "stderr": value.stderr, "ci95": value.interval, "unit": value.unit}
    return TermEntry.of({name: getattr(term, name) for name in named} | numbers)
