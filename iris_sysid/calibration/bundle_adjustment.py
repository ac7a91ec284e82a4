"""Least squares of a camera's parameters and of the pose of each view, with their covariance.

Parameters of the camera are those of :data:`iris_sysid.calibration.distortion.CAMERA_PARAMETERS`, nine numbers. A pose
is a rotation vector and a translation, six numbers: board to camera.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.distortion import CAMERA_PARAMETERS
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array

POLISHING_STEPS = 20
FIXED = {"k1": cv2.CALIB_FIX_K1, "k2": cv2.CALIB_FIX_K2, "k3": cv2.CALIB_FIX_K3}


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Corners of one view: ``board_m`` (n, 2) on the board and ``seen_px`` (n, 2) in the image.

    ``errors`` (n,) are theirs relative to the usual error; empty where all are alike.
    """

    board_m: Array
    seen_px: Array
    errors: Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if not self.errors.size:
            object.__setattr__(self, "errors", np.ones(len(self.board_m)))

    @property
    def rows(self) -> Array:
        """The relative errors of the coordinates (2 n,), x and y of a corner in turn."""
        return np.repeat(self.errors, 2)

    @property
    def space_m(self) -> Array:
        """The corners (n, 3) in the board's own space, on its plane. In m."""
        return np.column_stack([self.board_m, np.zeros(len(self.board_m))])


@dataclass(frozen=True, eq=False, slots=True)
class CameraFit:
    """Camera ``parameters`` (9,), ``poses`` (v, 6), residuals (n, 2) of each view, and what the data fix.

    ``free`` (9, p) has one column a fitted parameter; ``information`` (v, p, p) is that of each view about the fitted
    ones after its pose is allowed for, for corners of variance 1; ``gradients`` (v, p) its part of the score.
    """

    parameters: Array
    poses: Array
    residuals: tuple[Array, ...]
    free: Array
    information: Array
    gradients: Array

    @property
    def squares(self) -> float:
        """Sum of squared residuals, px^2."""
        return float(sum(np.sum(np.square(residual)) for residual in self.residuals))

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom: measured coordinates minus fitted parameters."""
        return 2 * sum(map(len, self.residuals)) - self.poses.size - self.free.shape[1]

    @property
    def noise_px(self) -> float:
        """Standard deviation of a corner's coordinate, px, from the residual."""
        return float(np.sqrt(self.squares / self.degrees_of_freedom))

    @property
    def bic(self) -> float:
        """Bayesian information criterion for corners of equal, unknown variance (Schwarz 1978)."""
        n = 2 * sum(map(len, self.residuals))
        return float(n * np.log(self.squares / n) + self.free.shape[1] * np.log(n))

    @property
    def clustering(self) -> float:
        """Ratio of the fitted parameters' variance to that for independent corner errors; 1 or above.

        With S the information, S_v its part from view v and g_v that view's score, independent errors give
        ``sum g_v' S^-1 g_v`` the mean ``s^2 (p - sum tr (S^-1 S_v)^2)``. A larger value, beyond twice its scatter,
        means that the errors of a view's corners are correlated: a bent board, or a wrong lens model. (The ratio of
        the cluster-robust to the usual covariance, Liang and Zeger 1986, as one number: views are few.)
        """
        total = self.information.sum(axis=0)
        shares = np.linalg.solve(total, self.information)
        p, views = total.shape[0], len(self.poses)
        expected = self.noise_px**2 * (p - np.trace(shares @ shares, axis1=1, axis2=2).sum())
        observed = float(np.einsum("vi,vi->", self.gradients, np.linalg.solve(total, self.gradients.T).T))
        ratio = observed / expected if expected > 0 else 1.0
        return ratio if ratio > 1 + 2 * np.sqrt(2 / max(p * (views - 1), 1)) else 1.0

    @property
    def covariance(self) -> Array:
        """Of the nine parameters (9, 9), the clustering allowed for; zero where one is not fitted.

        In px^2 for focal lengths and principal point; distortion is dimensionless.
        """
        variance = self.noise_px**2 * self.clustering
        inverse: Array = variance * self.free @ inverse_of(self.information.sum(axis=0)) @ self.free.T
        return inverse


def matrix_of(parameters: Array) -> Array:
    """Camera matrix (3, 3) of the nine ``parameters``.

    Its entries are in px; ``parameters`` (9,): focal lengths and principal point in px, distortion dimensionless.
    """
    fx, fy, cx, cy = parameters[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def inverse_of(information: Array) -> Array:
    """Inverse of a symmetric matrix of very unequal entries; infinite where the ``information`` fixes nothing.

    ``information`` (p, p), in one per product of two parameters' units.
    """
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    # 1e-13: rounding of the eigenvalues of a matrix with ones on its diagonal
    values = np.where(values > 1e-13, values, 1e-30)
    return (vectors / values) @ vectors.T / np.outer(size, size)


def free_parameters(lens: Sequence[str]) -> Array:
    """One column a fitted parameter (9, p): the focal length, the principal point, those named in ``lens``.

    Pixels are square: fx and fy are one parameter.

    Entries are dimensionless: 0 or 1.
    """
    unit = np.eye(9)
    distortion = (unit[CAMERA_PARAMETERS.index(name)] for name in lens)
    return np.column_stack([unit[0] + unit[1], unit[2], unit[3], *distortion])


# --------------------------------------------------------------------------- one view


def projected(parameters: Array, pose: Array, board_m: Array) -> tuple[Array, Array, Array]:
    """Pixels (n, 2) of points of the board's plane, and their derivatives.

    Parameters
    ----------
    parameters
        Of the camera (9,).
    pose
        Rotation vector and translation (6,).
    board_m
        Points (n, 2) on the board, m.

    Returns
    -------
    pixels
        (n, 2).
    by_pose
        (2 n, 6), the coordinates of a point after one another.
    by_camera
        (2 n, 9).
    """
    space = np.column_stack([board_m, np.zeros(len(board_m))])
    pixels, slopes = cv2.projectPoints(space, pose[:3], pose[3:], matrix_of(parameters), parameters[4:])[:2]
    slopes = np.asarray(slopes, np.float64)
    return np.asarray(pixels, np.float64).reshape(-1, 2), slopes[:, :6], slopes[:, 6:15]


def pose_of(parameters: Array, points: Points) -> Array:
    """Pose (6,) in which a camera with these ``parameters`` sees the ``points`` with least squares.

    Rotation vector in rad, translation in m; ``parameters`` (9,): focal lengths and principal point in px, distortion
    dimensionless.
    """
    try:
        success, rotation, translation = cv2.solvePnP(
            points.space_m, points.seen_px, matrix_of(parameters), parameters[4:], flags=cv2.SOLVEPNP_IPPE
        )[:3]
    except cv2.error as error:
        raise CalibrationError(f"the corners fit no board in space ({error.err}); mark them again") from error
    if not success:
        raise CalibrationError("the corners fit no board in space; was the board flat and are the corners in order?")
    pose = np.concatenate([np.ravel(rotation), np.ravel(translation)]).astype(np.float64)
    return _polished_pose(parameters, points, pose)


def _polished_pose(parameters: Array, points: Points, pose: Array) -> Array:
    damping, rows = 1e-6, points.rows
    pixels, slopes, _ = projected(parameters, pose, points.board_m)
    slopes, residual = slopes / rows[:, None], (points.seen_px - pixels).ravel() / rows
    for _ in range(POLISHING_STEPS):
        best = float(residual @ residual)
        normal = slopes.T @ slopes
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slopes.T @ residual)
        pixels, trial_slopes, _ = projected(parameters, pose + step, points.board_m)
        trial = (points.seen_px - pixels).ravel() / rows
        if trial @ trial > best:
            damping *= 100
            continue
        pose, slopes, residual, damping = pose + step, trial_slopes / rows[:, None], trial, damping / 10
        if best - trial @ trial < 1e-14 * best:
            break
    return pose


def rotation_of(pose: Array) -> Array:
    """Rotation matrix (3, 3) of a ``pose`` (6,): the board's axes, as columns, in the camera's.

    A ``pose`` is a rotation vector in rad and a translation in m.
    """
    return np.asarray(cv2.Rodrigues(pose[:3])[0], np.float64)


def normals(poses: Array) -> Array:
    """The way (v, 3) each board's back looks, seen from the camera, of ``poses`` (v, 6).

    Unit vectors; a pose is a rotation vector in rad and a translation in m.
    """
    return np.array([rotation_of(pose)[:, 2] for pose in poses]).reshape(-1, 3)


# --------------------------------------------------------------------------- all views


def information_of(parameters: Array, poses: Array, views: Sequence[Points], free: Array) -> CameraFit:
    """What views say about the camera at given values, with the poses eliminated (Schur complement).

    Focal lengths are in px, translations in m, rotations in rad.

    Parameters
    ----------
    parameters
        Of the camera (9,).
    poses
        Of the views (v, 6).
    views
        Their corners.
    free
        Which parameters are fitted (9, p).
    """
    residuals, information, gradients = [], [], []
    for pose, points in zip(poses, views, strict=True):
        pixels, by_pose, by_camera = projected(parameters, pose, points.board_m)
        residual = points.seen_px - pixels
        own = _without(by_camera @ free, by_pose)
        residuals.append(residual)
        information.append(own.T @ own)
        gradients.append(own.T @ residual.ravel())
    return CameraFit(parameters, poses, tuple(residuals), free, np.array(information), np.array(gradients))


def _without(columns: Array, nuisance: Array) -> Array:
    """The columns less what the nuisance columns can explain."""
    basis = np.linalg.qr(nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300))[0]
    return columns - basis @ (basis.T @ columns)


def fit_camera(views: Sequence[Points], image_size: tuple[int, int], lens: Sequence[str]) -> CameraFit:
    """Fit camera and poses by OpenCV's calibration, then go on to convergence in double precision.

    Parameters
    ----------
    views
        Corners of at least three views.
    image_size
        (width, height) px.
    lens
        Names of the distortion coefficients that are fitted; the others are zero.

    Raises
    ------
    CalibrationError
        When no camera explains the views.
    """
    free = free_parameters(lens)
    parameters, poses = _started(views, image_size, lens)
    fit = information_of(parameters, poses, views, free)
    for _ in range(POLISHING_STEPS):
        parameters = fit.parameters + free @ _newton_step(fit)
        poses = np.array(
            [_polished_pose(parameters, points, pose) for pose, points in zip(fit.poses, views, strict=True)]
        )
        trial = information_of(parameters, poses, views, free)
        if not trial.squares < fit.squares:
            break
        done = fit.squares - trial.squares < 1e-10 * fit.squares
        fit = trial
        if done:
            break
    return fit


def _newton_step(fit: CameraFit) -> Array:
    information = fit.information.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(size, size)
    return np.asarray(np.linalg.lstsq(scaled, fit.gradients.sum(axis=0) / size, rcond=1e-12)[0] / size)


def _started(views: Sequence[Points], image_size: tuple[int, int], lens: Sequence[str]) -> tuple[Array, Array]:
    flags = cv2.CALIB_FIX_ASPECT_RATIO | sum(flag for name, flag in FIXED.items() if name not in lens)
    flags |= 0 if "p1" in lens else cv2.CALIB_ZERO_TANGENT_DIST
    board = [points.space_m.astype(np.float32) for points in views]
    seen = [points.seen_px.astype(np.float32).reshape(-1, 1, 2) for points in views]
    try:
        with _one_thread():
            _, matrix, distortion, rotations, translations = cv2.calibrateCamera(
                board, seen, image_size, np.eye(3), np.zeros(5), flags=flags
            )
    except cv2.error as error:
        raise CalibrationError(
            f"no camera explains these views ({error.err}); were they all taken by one camera with one zoom?"
        ) from error
    parameters = np.concatenate([np.diag(matrix)[:2], matrix[:2, 2], np.ravel(distortion)[:5]])
    poses = [np.concatenate([np.ravel(r), np.ravel(t)]) for r, t in zip(rotations, translations, strict=True)]
    return parameters.astype(np.float64), np.array(poses, np.float64)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One OpenCV thread: with several, calibrateCamera sums in another order each time, and its last digits differ."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


def unlike(values: NDArray[np.float64], samples: int) -> Array:
    """How many robust standard deviations each view's log ``values`` lies above the median; at least sampling error.

    ``values`` (v,) and the result (v,) are dimensionless.

    ``samples`` is the number of residuals behind each.
    """
    logs = np.log(np.maximum(values, 1e-12))
    centre = np.median(logs)
    # 1.4826: MAD to standard deviation of a normal; log of a standard deviation scatters by 1/sqrt(2 dof)
    spread = np.hypot(1.4826 * np.median(np.abs(logs - centre)), 1 / np.sqrt(2 * max(samples - 6, 1)))
    return np.asarray((logs - centre) / spread)
