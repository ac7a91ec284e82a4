"""Read and write the JSON files of ``schemas``, and turn a fit into one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from iris_sysid.errors import DataError, UnknownNameError
from iris_sysid.io.files import json_text, read_file, write_atomic
from iris_sysid.io.schemas import (
    DOCUMENTS,
    Document,
    EstimateEntry,
    FitDocument,
    FittedQuantity,
    FittedSegment,
    IdentifiabilityEntry,
    LinearModelEntry,
    UsedSamples,
    ValidationEntry,
    why_null,
)
from iris_sysid.types import (
    Array,
    Estimate,
    FitResult,
    FitStatus,
    Quantity,
    Segment,
    Trajectory,
    Validation,
)

Kind = TypeVar("Kind", bound=Document)


def schema(name: str) -> dict[str, Any]:
    """The JSON Schema (2020-12) of the file of that name; UnknownNameError lists the names there are."""
    from iris_sysid.io.schemas.groundtruth import GROUND_TRUTH  # here: it takes longer to load than all the others

    kinds = {**DOCUMENTS, **GROUND_TRUTH}
    if name not in kinds:
        raise UnknownNameError(f"no file is named {name!r}; there are: {', '.join(kinds)}")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **kinds[name].model_json_schema()}


# --------------------------------------------------------------------------- files


def document_text(document: Document) -> str:
    """The document as JSON text: the same bytes for the same content."""
    return json_text(document.model_dump(by_alias=True))


def write_document(document: Document, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write a document as JSON by :func:`iris_sysid.io.files.write_atomic`."""
    return write_atomic(path, document_text(document), overwrite=overwrite)


def read_document(path: str | Path, kind: type[Kind]) -> Kind:
    """Read and check the JSON file at ``path`` as a document of class ``kind``; DataError names the first bad key."""
    data = read_file(path)
    try:
        return kind.model_validate_json(data.removeprefix(b"\xef\xbb\xbf"))
    except ValidationError as error:
        raise DataError(f"{path}: {_first_problem(error, kind)}") from error


def checked(kind: type[Kind], **values: Any) -> Kind:
    """Make a document of class ``kind`` from its ``values``; DataError names the first one that does not fit."""
    try:
        return kind.of(values)
    except ValidationError as error:
        raise DataError(_first_problem(error, kind)) from error


def _first_problem(error: ValidationError, kind: type[Document]) -> str:
    problem = error.errors(include_url=False, include_context=False)[0]
    where = ".".join(str(step) for step in problem["loc"])
    text = f"{where}: {problem['msg']}" if where else problem["msg"]
    if problem["type"] not in ("missing", "json_invalid"):
        text += f", not {problem['input']!r:.60}"
    if where == "version":
        text += "; it was written by another version of iris-sysid, use that one or make the file again"
    elif where == "document":
        text += f"; this is not the file that is wanted here ({kind.__name__.removesuffix('Document').lower()})"
    return text + (f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else "")


# --------------------------------------------------------------------------- fit.json


def entries_of(estimates: Mapping[str, Estimate], status: FitStatus | None = None) -> dict[str, EstimateEntry]:
    """Estimates by name as entries; the ``status`` of the fit says why a number is null. DataError names a bad one."""
    because = "" if status is None else f" (fit status {status}; see message)"
    entries = {}
    for name, estimate in estimates.items():
        try:
            entries[name] = EstimateEntry.model_validate(estimate).model_copy(
                update={"note": why_null(estimate, because)}
            )
        except ValidationError as error:
            raise DataError(f"{name}: {_first_problem(error, Document)}") from error
    return entries


def fit_document(result: FitResult, trajectory: Trajectory | None = None) -> FitDocument:
    """The content of fit.json, with the segments and geometry of the trajectory; NaN becomes null with a note.

    DataError when the trajectory is not the one that was fitted, or a value does not fit the schema.
    """
    if trajectory is not None and trajectory.n != result.used.size:
        raise DataError(f"the fit has {result.used.size} samples but the trajectory {trajectory.n}: not the one fitted")
    return checked(
        FitDocument,
        model=result.model.name,
        equation=result.model.equation,
        status=result.status,
        message=result.message,
        verdict=result.verdict,
        problems=result.problems,
        parameters=entries_of(result.estimates, result.status),
        free=result.free,
        covariance=result.covariance,
        budget=result.budget,
        **_goodness(result),
        samples=_samples(result, trajectory),
        segments=[] if trajectory is None else [_segment(segment, result) for segment in trajectory.segments],
        geometry={} if trajectory is None else entries_of(trajectory.geometry),
        intervals=result.intervals,
        identifiability=_identifiability(result),
        origin=plain_origin(result.origin or (trajectory.origin if trajectory else {})),
    )


def fit_json(result: FitResult, trajectory: Trajectory | None = None) -> str:
    """The text of fit.json for a ``result``, with the segments and geometry of the ``trajectory`` when given."""
    return document_text(fit_document(result, trajectory))


def write_fit(result: FitResult, trajectory: Trajectory, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write fit.json.

    Parameters
    ----------
    result
        The fit, failed or not.
    trajectory
        What was fitted.
    path
        File to write; missing folders are made.
    overwrite
        Replace a file that exists.
    """
    return write_document(fit_document(result, trajectory), path, overwrite=overwrite)


def plain_origin(origin: Mapping[str, Any]) -> dict[str, Any]:
    """The origin converted to JSON types; DataError when it holds anything else."""
    plain: dict[str, Any] = json.loads(json_text(origin))
    return plain


def _identifiability(result: FitResult) -> IdentifiabilityEntry | None:
    identifiability = result.identifiability
    if identifiability is None:
        return None
    own = {name: getattr(identifiability, name) for name in IdentifiabilityEntry.model_fields if name != "fisher"}
    return IdentifiabilityEntry.of({**own, "fisher": result.fisher})


def fitted_quantities(quantities: Sequence[Quantity], noise: Array, rms: Array) -> list[FittedQuantity]:
    """The observed quantities (d,) with the noise (d,) and the residual (d,) of each, in its unit."""
    rows = zip(quantities, noise, rms, strict=True)
    return [FittedQuantity.of({**asdict(quantity), "noise": own, "rms": rest}) for quantity, own, rest in rows]


def _goodness(result: FitResult) -> dict[str, Any]:
    observed = result.model.observed
    one_unit = len({quantity.unit for quantity in observed}) == 1
    return {
        "noise": _root_mean_square(result.noise) if one_unit else None,
        "rms": _root_mean_square(result.rms) if one_unit else None,
        "n": result.n,
        "quantities": fitted_quantities(observed, result.noise, result.rms),
    } | {name: getattr(result, name) for name in ("aic", "bic", "condition", "correlation", "t0_s")}


def _root_mean_square(parts: Array) -> float:
    return float(np.sqrt(np.mean(np.square(parts))))


def _samples(result: FitResult, trajectory: Trajectory | None) -> UsedSamples:
    used = np.flatnonzero(result.used)
    total = int(result.used.size)
    if used.size == 0:
        return UsedSamples(total=total)
    first, last = int(used[0]), int(used[-1])
    offset = None if trajectory is None else trajectory.first_frame
    return UsedSamples(
        total=total,
        first_sample=first,
        last_sample=last,
        first_frame=offset + first if offset is not None else None,
        last_frame=offset + last if offset is not None else None,
        first_s=float(result.t_s[first]),
        last_s=float(result.t_s[last]),
    )


def _segment(segment: Segment, result: FitResult) -> FittedSegment:
    return FittedSegment(
        **asdict(segment),
        start_s=float(result.t_s[segment.start]),
        stop_s=float(result.t_s[segment.stop - 1]),
        n_used=int(result.used[segment.start : segment.stop].sum()),
    )


def validation_entry(validation: Validation, record: str) -> ValidationEntry:
    """The validation as it is written to a file; ``record`` says what was simulated."""
    named = ValidationEntry.model_fields.keys() - {"linear", "record", "n"}
    values = {name: getattr(validation, name) for name in named}
    linear = None if validation.linear is None else LinearModelEntry.of(validation.linear)
    return ValidationEntry.of({**values, "linear": linear, "record": record, "n": validation.simulated.n})
