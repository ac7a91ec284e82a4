"""A camera's focal length, principal point and distortion from views of a board, or what the views do not determine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.bundle_adjustment import (
    CameraFit,
    Points,
    fit_camera,
    free_parameters,
    information_of,
    inverse_of,
    matrix_of,
    normals,
    pose_of,
    projected,
    unlike,
)
from iris_sysid.calibration.distortion import CAMERA_PARAMETERS, undistort_px
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array, Estimate, frozen_array

MIN_VIEWS = 3
ALIKE_DIAGONALS = 0.005  # outlines this near, of the image's diagonal, are one view
OUTLIER_DEVIATIONS = 4.5
MAX_LEFT_OUT = 1 / 3
FULL_LENS = CAMERA_PARAMETERS[4:]
# Lenses that are tried; the one of least BIC is taken. p1 and p2 stay: without them the principal point takes up what
# they do, and its error bars are too short.
LENSES = (("k1", "k2", "p1", "p2"), FULL_LENS)
POOR_FOCAL = 0.05  # relative standard error above which the focal length counts as not determined
POOR_CENTRE = 0.05  # of the image's width
EXPECTED_NOISE_PX = 0.2
CELLS = 8  # fields on a side of the image; the share of fields with a corner is the coverage
USUAL_FOCAL = 0.8  # of the longer side: a field of view of 64 degrees
TILT_HELP = (
    "tilt the board by 20 to 40 degrees about both axes, differently in each view, and move it over the whole image"
)


@dataclass(frozen=True, eq=False, slots=True)
class FittedView:
    """One view in a calibration: its corners and what the fitted camera leaves of them.

    ``residual_px`` (n, 2) is seen - predicted; ``rms_px`` the root mean square distance, as OpenCV's per-view error.
    ``left_out`` says why a view was not used.
    """

    view: BoardView
    residual_px: Array
    rms_px: float
    left_out: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class CameraCalibration:
    """A camera as views of a board fix it.

    ``camera_matrix`` (3, 3) px and ``distortion`` (5,) k1, k2, p1, p2, k3 as OpenCV defines them; ``covariance`` (9, 9)
    of ``distortion.CAMERA_PARAMETERS``, zero where one was not fitted (``fitted`` names those that were).
    ``rms_px`` is the root mean square distance of the corners from where they should be, ``noise_px`` the standard
    deviation of a coordinate; ``clustering`` how strongly the corners' errors correlate within views (1: they do not).
    ``coverage`` is the part of the image within reach of corners; ``notes`` say what a user should know.
    """

    camera_matrix: Array
    distortion: Array
    covariance: Array
    image_size: tuple[int, int]
    rms_px: float
    noise_px: float
    fitted: tuple[str, ...]
    views: tuple[FittedView, ...] = ()
    clustering: float = 1.0
    coverage: float = math.nan
    notes: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        for name, shape in (("camera_matrix", (3, 3)), ("distortion", (5,)), ("covariance", (9, 9))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))

    @property
    def parameters(self) -> Array:
        """The nine parameters (9,), in the order of ``distortion.CAMERA_PARAMETERS``.

        Focal lengths and principal point are in px.
        """
        return np.concatenate([np.diag(self.camera_matrix)[:2], self.camera_matrix[:2, 2], self.distortion])

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Each parameter by name with its standard error; those not fitted are ``assumed``."""
        stderr = np.sqrt(np.diag(self.covariance))
        return {
            name: Estimate(
                value=float(value),
                stderr=float(error),
                unit="px" if k < 4 else "1",
                measurement_type="fitted" if name in self.fitted else "assumed",
                source=self.source,
            )
            for k, (name, value, error) in enumerate(zip(CAMERA_PARAMETERS, self.parameters, stderr, strict=True))
        }

    @property
    def used(self) -> tuple[FittedView, ...]:
        """The views that the camera was fitted to."""
        return tuple(view for view in self.views if not view.left_out)

    @property
    def left_out(self) -> dict[str, str]:
        """Why a view was not used, by its name."""
        return {view.view.name: view.left_out for view in self.views if view.left_out}


def calibrate_camera(
    views: Sequence[BoardView],
    board: Board,
    *,
    lens: Sequence[str] | None = None,
    drop_outliers: bool = True,
) -> CameraCalibration:
    """Fit a camera to views of a board by least squares of the reprojection error (Zhang 2000).

    Views that are nearly the same as another, and views whose corners do not agree with the rest, are left out and
    named: a view is an outlier when the logarithm of its rms lies more than 4.5 robust standard deviations above the
    median. Standard errors are those of least squares (as OpenCV's ``calibrateCameraExtended``), enlarged where the
    corners' errors correlate within views.

    Parameters
    ----------
    views
        Views from :func:`iris_sysid.calibration.board.detect.find_boards`, all of one camera at one zoom,
        focus and resolution.
    board
        The board they show.
    lens
        Distortion coefficients to fit, of k1, k2, p1, p2, k3. When not given, the set with the least BIC is taken.
    drop_outliers
        Leave views out that do not agree with the rest.

    Returns
    -------
    CameraCalibration
        With the residuals of every view, also of those left out.

    Raises
    ------
    CalibrationError
        When images differ in size, are fewer than three different ones, or do not fix the camera, as when all show
        the board in the same attitude; it names what is not determined.
    """
    lenses = LENSES if lens is None else (_checked_lens(lens),)
    image_size = _common_size(views)
    reasons = _near_duplicates(views, board, image_size)
    distinct = [view for view in views if view.name not in reasons]
    _check_count(len(views), len(distinct))
    points = {view.name: Points(view.points_m(board), np.asarray(view.corners_px)) for view in distinct}
    _check_attitudes(list(points.values()), image_size)
    if drop_outliers:
        reasons |= _outliers(points, image_size, lenses[-1])
    kept = [points[name] for name in points if name not in reasons]
    fits = [fit_camera(kept, image_size, coefficients) for coefficients in lenses]
    fit = min(fits, key=lambda fit: fit.bic)
    _check_determined(fit, image_size)
    return _calibration(fit, views, board, reasons)


def _checked_lens(lens: Sequence[str]) -> tuple[str, ...]:
    wrong = [name for name in lens if name not in FULL_LENS]
    if wrong:
        raise CalibrationError(f"no distortion coefficient is named {wrong[0]!r}; there are: {', '.join(FULL_LENS)}")
    if ("p1" in lens) != ("p2" in lens):
        raise CalibrationError("p1 and p2 are fitted together or not at all; name both or none")
    return tuple(name for name in FULL_LENS if name in lens)


def _common_size(views: Sequence[BoardView]) -> tuple[int, int]:
    if not views:
        raise CalibrationError("no view of the board was given; find some first")
    names = [view.name for view in views]
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise CalibrationError(f"two views are named {double!r}; give each image once")
    first = views[0]
    for view in views:
        if view.image_size != first.image_size:
            raise CalibrationError(
                f"images differ in size: {first.name} is {_size_text(first.image_size)} px, {view.name} is "
                f"{_size_text(view.image_size)} px; a camera is calibrated at one resolution, crop and orientation: "
                "leave out those of the other size"
            )
    return first.image_size


def _size_text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _near_duplicates(views: Sequence[BoardView], board: Board, image_size: tuple[int, int]) -> dict[str, str]:
    """Why a view adds nothing, by name: its outline lies where that of an earlier one does."""
    limit_px = ALIKE_DIAGONALS * math.hypot(*image_size)
    reasons: dict[str, str] = {}
    kept: list[tuple[str, Array]] = []
    for view in views:
        outline = view.outline_px(board)
        same = next((name for name, other in kept if np.abs(outline - other).max() < limit_px), None)
        if same is None:
            kept.append((view.name, outline))
        else:
            reasons[view.name] = f"nearly the same as {same}"
    return reasons


def _check_count(given: int, distinct: int) -> None:
    if distinct >= MIN_VIEWS:
        return
    few = "there is only 1 view" if distinct == 1 else f"there are only {distinct} different views"
    what = f"all {given} views are alike" if distinct == 1 and given > 1 else few
    raise CalibrationError(
        f"{what}, at least {MIN_VIEWS} are needed: focal length, principal point and distortion are not determined; "
        f"{TILT_HELP}, or calibrate the plane of motion alone, from one image: --one-image"
    )


def _check_attitudes(views: Sequence[Points], image_size: tuple[int, int]) -> None:
    """Refuse views that would not fix a usual camera; the errors of the fit itself assume that it came out right."""
    usual = np.array([USUAL_FOCAL * max(image_size)] * 2 + [(side - 1) / 2 for side in image_size] + [0.0] * 5)
    poses = np.array([pose_of(usual, points) for points in views])
    fit = information_of(usual, poses, views, free_parameters(()))
    _refuse_undetermined(fit, EXPECTED_NOISE_PX**2, image_size)


def _check_determined(fit: CameraFit, image_size: tuple[int, int]) -> None:
    _refuse_undetermined(fit, fit.noise_px**2 * fit.clustering, image_size)
    focal = fit.parameters[0] / max(image_size)
    if not 0.1 < focal < 50:
        raise CalibrationError(
            f"the views give a focal length of {fit.parameters[0]:.0f} px for an image {max(image_size)} px wide, "
            f"which no camera has; {TILT_HELP}"
        )


def _refuse_undetermined(fit: CameraFit, variance: float, image_size: tuple[int, int]) -> None:
    stderr = np.sqrt(variance * np.diag(fit.free @ inverse_of(fit.information.sum(axis=0)) @ fit.free.T))
    poor = []
    if stderr[0] > POOR_FOCAL * fit.parameters[0]:
        poor.append(f"the focal length ({fit.parameters[0]:.0f} ± {stderr[0]:.2g} px)")
    if stderr[2:4].max() > POOR_CENTRE * max(image_size):
        poor.append(f"the principal point (± {stderr[2:4].max():.2g} px)")
    if not poor:
        return
    axes = normals(fit.poses)
    apart = np.degrees(np.arccos(np.clip(axes @ axes.T, -1, 1))).max()
    raise CalibrationError(
        f"the {len(fit.poses)} views do not determine {' and '.join(poor)}: the board's attitude differs by at most "
        f"{apart:.2g} degrees between them; {TILT_HELP}"
    )


def _outliers(points: Mapping[str, Points], image_size: tuple[int, int], lens: Sequence[str]) -> dict[str, str]:
    """Why a view does not agree with the rest, by name; the worst is left out first, then the rest is fitted again."""
    reasons: dict[str, str] = {}
    while len(points) - len(reasons) > max(MIN_VIEWS, (1 - MAX_LEFT_OUT) * len(points)):
        names = [name for name in points if name not in reasons]
        fit = fit_camera([points[name] for name in names], image_size, lens)
        rms = np.array([rms_of(residual) for residual in fit.residuals])
        deviations = unlike(rms, 2 * min(map(len, fit.residuals)))
        worst = int(np.argmax(deviations))
        if deviations[worst] < OUTLIER_DEVIATIONS:
            break
        reasons[names[worst]] = (
            f"its corners are {rms[worst]:.2f} px off, those of the other views {np.median(rms):.2f} px "
            f"({deviations[worst]:.1f} robust standard deviations)"
        )
    return reasons


def rms_of(residual: Array) -> float:
    """Root mean square length of residuals (n, 2), px."""
    return float(np.sqrt(np.mean(np.sum(np.square(residual), axis=1))))


def _calibration(
    fit: CameraFit, views: Sequence[BoardView], board: Board, reasons: Mapping[str, str]
) -> CameraCalibration:
    used = [view for view in views if view.name not in reasons]
    image_size = views[0].image_size
    fitted = tuple(name for name, row in zip(CAMERA_PARAMETERS, fit.free, strict=True) if np.any(row != 0))
    coverage = covered_part(used)
    return CameraCalibration(
        camera_matrix=matrix_of(fit.parameters),
        distortion=fit.parameters[4:],
        covariance=fit.covariance,
        image_size=image_size,
        rms_px=rms_of(np.concatenate(fit.residuals)),
        noise_px=fit.noise_px,
        fitted=fitted,
        views=tuple(fitted_view(fit.parameters, view, board, reasons.get(view.name, "")) for view in views),
        clustering=fit.clustering,
        coverage=coverage,
        notes=_notes(fit, image_size, coverage),
        source=f"{len(used)} views of a {board.label} board of {board.square_m * 1000:g} mm squares",
    )


def fitted_view(parameters: Array, view: BoardView, board: Board, left_out: str = "") -> FittedView:
    """Put a view of a board into the pose that leaves least of its corners.

    Focal lengths and principal point are in px.

    Parameters
    ----------
    parameters
        Of the camera (9,).
    view, board
        What was seen, and of what.
    left_out
        Why the camera was not fitted to it, empty where it was.
    """
    points = Points(view.points_m(board), np.asarray(view.corners_px))
    pose = pose_of(parameters, points)
    residual = points.seen_px - projected(parameters, pose, points.board_m)[0]
    return FittedView(view, residual, rms_of(residual), left_out)


def _notes(fit: CameraFit, image_size: tuple[int, int], coverage: float) -> tuple[str, ...]:
    notes = []
    if coverage < 0.5:
        notes.append(f"corners cover only {100 * coverage:.0f} % of the image; distortion beyond them is extrapolated")
    if fit.clustering > 1:
        notes.append(
            f"errors of corners correlate within views, so standard errors are {math.sqrt(fit.clustering):.1f} times "
            "those of independent corners; is the board flat?"
        )
    width, height = image_size
    edges = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]], dtype=np.float64)
    try:
        undistort_px(edges, matrix_of(fit.parameters), fit.parameters[4:])
    except CalibrationError:
        notes.append("the lens model does not reach the corners of the image; positions there will be refused")
    return tuple(notes)


def covered_part(views: Sequence[BoardView]) -> float:
    """Part of the image's CELLS x CELLS fields that hold a corner of one of the ``views``."""
    width, height = views[0].image_size
    corners = np.concatenate([view.corners_px for view in views])
    column = np.clip((corners[:, 0] + 0.5) / width * CELLS, 0, CELLS - 1).astype(int)
    row = np.clip((corners[:, 1] + 0.5) / height * CELLS, 0, CELLS - 1).astype(int)
    return len(set(zip(column.tolist(), row.tolist(), strict=True))) / CELLS**2
