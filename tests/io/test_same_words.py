"""Files and Python use the same words, and files that were written before they did are read."""

from dataclasses import fields

import numpy as np
import pytest

from iris_sysid import Diagnosis, Discovery, FitResult
from iris_sysid.io.schemas import CandidateEntry, DiagnosisDocument, DiscoveryDocument, FitDocument
from iris_sysid.types import Identifiability, Limit, Match, ModelCandidate, PredictionErrors

T_S = np.arange(150) / 50
OF_FILES = {"document", "version", "origin", "sentence"}  # every file has them, or some
# what a file writes out of another object: of the trajectory that was fitted, of the fits of a discovery, of its clips
FROM_BESIDE = {
    FitDocument: {"equation", "quantities", "samples", "segments", "geometry", "clips", "selection", "validation"},
    DiscoveryDocument: {"n", "noise", "rms"},
    DiagnosisDocument: {"further_clips", "validation", "validation_before"},
}


def words_of(kind):
    return {field.name for field in fields(kind)} | {
        name for base in kind.__mro__ for name, value in vars(base).items() if isinstance(value, property)
    }


@pytest.mark.parametrize(
    ("kind", "document"),
    [(FitResult, FitDocument), (Diagnosis, DiagnosisDocument), (Discovery, DiscoveryDocument)],
)
def test_every_key_of_a_file_is_an_attribute(kind, document):
    assert set(document.model_fields) - OF_FILES - FROM_BESIDE[document] - words_of(kind) == set()


@pytest.mark.parametrize(
    ("kind", "part"),
    [
        (Identifiability, FitDocument.model_fields["identifiability"]),
        (Limit, DiagnosisDocument.model_fields["ruled_out"]),
        (PredictionErrors, DiagnosisDocument.model_fields["before"]),
        (Match, DiscoveryDocument.model_fields["nearest"]),
        (ModelCandidate, CandidateEntry),
    ],
    ids=lambda item: getattr(item, "__name__", ""),
)
def test_every_key_of_a_part_is_an_attribute(kind, part):
    entry = part if part is CandidateEntry else entry_of(part.annotation)
    assert set(entry.model_fields) - words_of(kind) <= {"fisher"}  # of the fit itself


def entry_of(annotation):
    """The class of the entries that a field holds, alone, in a list, or beside None."""
    inner = [part for part in getattr(annotation, "__args__", ()) if part is not type(None)]
    return entry_of(inner[0]) if inner else annotation
