"""Files and Python use the same words, and files that were written before they did are read."""

import json
from dataclasses import fields

import numpy as np
import pytest

from iris_sysid import MODELS, DataError, Diagnosis, Discovery, FitResult, Trajectory, diagnose, select_model
from iris_sysid.io.fit_json import selection_document
from iris_sysid.io.json_documents import document_text, read_document
from iris_sysid.io.schemas import CandidateEntry, DiagnosisDocument, DiscoveryDocument, FitDocument
from iris_sysid.report.diagnosis_page import diagnosis_document
from iris_sysid.types import Errors, Identifiability, Limit, Match, ModelCandidate
from tests._motions import pendulum_angle

T_S = np.arange(150) / 50
OF_FILES = {"document", "version", "origin", "sentence"}  # every file has them, or some
# what a file writes out of another object: of the trajectory that was fitted, of the fits of a discovery, of its clips
FROM_BESIDE = {
    FitDocument: {"equation", "quantities", "samples", "segments", "geometry", "clips", "selection", "validation"},
    DiscoveryDocument: {"n", "noise", "rms"},
    DiagnosisDocument: {"further_clips", "validation", "validation_before"},
}
# what files had before the residual was split into parts
FORMER = {"missing_force": {"t_s": [0.0], "force": [[0.1]], "form": None}, "remaining_force": None}


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
        (Errors, DiagnosisDocument.model_fields["before"]),
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


@pytest.fixture(scope="module")
def clip():
    theta = pendulum_angle(T_S, 0.5, damping=0.3) + 1e-3 * np.random.default_rng(0).standard_normal(T_S.size)
    observed = MODELS["pendulum"].observed
    return Trajectory(T_S, observed, theta[:, None], np.full((T_S.size, 1), np.nan), np.ones(T_S.size, dtype=bool))


@pytest.fixture(scope="module")
def written(clip):
    return diagnosis_document(diagnose(clip, "pendulum", effects=["quadratic-drag"]), [clip])


def test_diagnosis_with_the_missing_force_of_earlier_files_is_read(written, tmp_path):
    old = json.loads(document_text(written)) | FORMER
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(old))
    assert read_document(path, DiagnosisDocument) == written
    path.write_text(json.dumps(old | {"missing": None}))
    with pytest.raises(DataError, match="missing: Extra inputs are not permitted"):
        read_document(path, DiagnosisDocument)


def test_diagnosis_of_version_1_is_read(written, tmp_path):
    old = json.loads(document_text(written)) | FORMER
    errors = {name: old.pop(name) for name in ("before", "after", "noise_floor", "unit")}
    for part in (errors["before"], errors["after"]):
        del part["weighed"]
    old |= {"version": 1, "error": errors}
    old["base"]["version"] = old["final"]["version"] = 1
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(old))
    again = read_document(path, DiagnosisDocument)
    assert again.before.heldout == written.before.heldout
    assert (again.noise_floor, again.unit, again.base) == (written.noise_floor, "rad", written.base)


def test_fit_of_version_1_is_read(clip, tmp_path):
    written = selection_document(select_model(clip, ["pendulum", "linear-pendulum"]), clip)
    old = json.loads(document_text(written)) | {"version": 1}
    for candidate in old["selection"]["ranking"]:
        candidate["reading"] = candidate.pop("observable")
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(old))
    assert read_document(path, FitDocument) == written
