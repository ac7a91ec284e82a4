"""calibration.json: a calibration with everything that is known about its errors, written and read back exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from iris_sysid.calibration.pixel_scale import check_homography, from_osp, scale_part
from iris_sysid.calibration.plane import to_plane
from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.io.archives import member_of
from iris_sysid.io.files import origin_of
from iris_sysid.io.json_documents import checked, read_document, write_document
from iris_sysid.io.osp_tracker import read_osp
from iris_sysid.io.schemas import CalibrationDocument, number
from iris_sysid.types import N_VALUES, Array, Calibration

# smallest eigenvalue of a correlation matrix, of its largest, that rounding of its entries can make
ROUNDING = 1e-6


def write_calibration(calibration: Calibration, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write calibration.json.

    Parameters
    ----------
    calibration
        What to write.
    path
        File to write; missing folders are made.
    overwrite
        Replace a file that exists.

    Returns
    -------
    Path
        The path as given.

    Raises
    ------
    CalibrationError
        When it cannot be used, e.g. a homography without an inverse.
    OutputError
        As :func:`iris_sysid.io.files.write_atomic`.
    """
    return write_document(calibration_document(calibration), path, overwrite=overwrite)


def calibration_document(calibration: Calibration) -> CalibrationDocument:
    """The content of calibration.json, checked; CalibrationError when the ``calibration`` cannot be used."""
    check_homography(calibration.homography)
    names = CalibrationDocument.model_fields.keys() - {"document", "version", "origin"}
    return checked(
        CalibrationDocument, **{name: getattr(calibration, name) for name in names}, origin=origin_of(None, {})
    )


def read_calibration(path: str | Path) -> Calibration:
    """Read calibration.json, or the axes of a ``.trk`` or ``.trz`` file of Open Source Physics Tracker.

    A file with homography and scale alone is a calibration too; the scale's standard error is then its budget. Raises
    DataError for a file that is not one of these, CalibrationError for one that does not fix metres per pixel.
    """
    path = Path(path)
    if member_of(path)[0].suffix.lower() in (".trk", ".trz"):
        return from_osp(read_osp(path))
    document = read_document(path, CalibrationDocument)
    scale = document.scale.estimate()
    if not scale.value > 0:
        raise DataError(f"{path}: scale.value must be above zero, not {document.scale.value}")
    if not 0 <= scale.stderr < math.inf:
        raise DataError(f"{path}: scale.stderr must be zero or above, not {document.scale.stderr}")
    homography = np.array(document.homography)
    check_homography(homography)
    budget = {name: _checked_part(part, name, path) for name, part in document.budget.items()}
    if not budget and scale.stderr:
        budget = {"scale": scale_part(homography, scale.stderr / scale.value)}
    calibration = Calibration(
        homography=homography,
        scale=scale,
        unit=document.unit,
        source=document.source,
        camera_matrix=_checked_camera(np.array(document.camera_matrix), path),
        distortion=np.array(document.distortion),
        budget=budget,
        image_size=document.image_size,
        centre_px=document.centre_px,
        notes=tuple(document.notes),
        doubts=tuple(entry.doubt() for entry in document.doubts),
        rms_px=number(document.rms_px),
        vertical_source=document.vertical_source,
        fixed=tuple(document.fixed),
        assumed=tuple(document.assumed),
    )
    _check_use(calibration, path)
    return calibration


def _checked_camera(matrix: Array, path: Path) -> Array:
    (fx, skew, _), (below, fy, _), last = matrix
    if not (fx > 0 and fy > 0) or skew or below or last.tolist() != [0, 0, 1]:
        raise DataError(f"{path}: camera_matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx and fy above zero")
    return matrix


def _checked_part(rows: Sequence[Sequence[float]], name: str, path: Path) -> Array:
    """A covariance (18, 18): symmetric, and no variance of anything below zero; DataError otherwise."""
    if len(rows) != N_VALUES or any(len(row) != N_VALUES for row in rows):
        raise DataError(f"{path}: budget.{name} must have {N_VALUES} rows of {N_VALUES} numbers")
    part = np.array(rows)
    size = np.sqrt(np.maximum(np.diag(part), 0.0))
    scaled = part / np.outer(*[np.where(size > 0, size, 1.0)] * 2)
    if not np.allclose(scaled, scaled.T, atol=ROUNDING) or np.linalg.eigvalsh(scaled).min() < -ROUNDING * N_VALUES:
        raise DataError(f"{path}: budget.{name} is not a covariance: it must be symmetric and positive semidefinite")
    return part


def _check_use(calibration: Calibration, path: Path) -> None:
    """Try it where it was made, so that a lens or plane that cannot be is refused when it is read."""
    centre = np.array([calibration.centre_px], dtype=np.float64)
    try:
        with np.errstate(all="ignore"):
            position, by_px, _ = to_plane(calibration, centre)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    if not (np.all(np.isfinite(position)) and np.all(np.isfinite(by_px))):
        raise CalibrationError(f"{path}: it maps its own centre_px, {calibration.centre_px}, nowhere; make it again")
