"""Calibrate the plane of motion by the four corners of a rectangle in it: a board, a sheet of paper, a table's top."""

from __future__ import annotations

import numpy as np

from iris_sysid.calibration.homography import fit_homography, slopes_at_zero
from iris_sysid.calibration.pixel_scale import NO_LENS
from iris_sysid.calibration.plane import UNKNOWN_SCALE, with_scale
from iris_sysid.calibration.vertical import upright
from iris_sysid.errors import CalibrationError
from iris_sysid.types import N_VALUES, Array, Calibration

MIN_SIDES = 10.0  # sides of a rectangle in standard errors of its corners: below that nothing is linear


def plane_from_rectangle(
    corners_px: Array,
    width_m: float,
    height_m: float,
    *,
    corner_stderr_px: float = 0.5,
    width_stderr_m: float = 0.0,
    height_stderr_m: float = 0.0,
) -> Calibration:
    """Calibrate by four marked corners of a rectangle that lies in the plane of motion.

    The homography takes the corners to the rectangle exactly: four points fix its eight numbers (Hartley and Zisserman
    2004, section 4.1). The errors of the corners are those stated, for no corner is left over to test them.

    Parameters
    ----------
    corners_px
        (4, 2), px, one after the other around the rectangle in either direction; the first side is the width.
    width_m, height_m
        Its sides, m.
    corner_stderr_px
        Standard error of each marked coordinate, px.
    width_stderr_m, height_stderr_m
        Standard errors of the sides, m.

    Returns
    -------
    Calibration
        Origin at the rectangle's middle, z up as in the image there. Budget: ``corners``, ``width``, ``height``.

    Raises
    ------
    CalibrationError
        When a side is not a length, or the corners do not form a convex quadrilateral of some size.
    """
    sides, stderr = np.array([width_m, height_m]), np.array([width_stderr_m, height_stderr_m])
    if not (np.isfinite(sides).all() and (sides > 0).all() and (stderr >= 0).all() and (stderr < sides).all()):
        raise CalibrationError(
            f"the sides must be above zero and known better than to themselves, not {width_m:g} ± {width_stderr_m:g} m "
            f"and {height_m:g} ± {height_stderr_m:g} m"
        )
    corners_px = np.asarray(corners_px, dtype=np.float64).reshape(4, 2)
    # z runs up, y down: what is clockwise in the image starts at the upper left of the world, the rest at the lower
    up = _turn(corners_px, corner_stderr_px)
    corners = np.array([[-1, up], [1, up], [1, -up], [-1, -up]]) / 2 * sides
    to_image, covariance = fit_homography(corners, corners_px)

    def numbers(change: Array) -> Array:
        """The nine entries from px to m after a change of those from m to px (8) and of the relative sides (2)."""
        changed = to_image + np.append(change[:8], 0.0).reshape(3, 3)
        homography = np.diag([1 + change[8], 1 + change[9], 1]) @ np.linalg.inv(changed)
        return np.asarray(homography / homography[2, 2]).ravel()

    corner_variance = corner_stderr_px**2 * covariance[:8, :8]
    steps = np.append(1e-2 * np.sqrt(np.diag(corner_variance)), [1e-4, 1e-4])
    slopes = np.zeros((N_VALUES, 10))
    slopes[:9] = slopes_at_zero(numbers, steps)
    relative = slopes[:, 8:] * (stderr / sides)
    plane = with_scale(
        Calibration(
            scale=UNKNOWN_SCALE,
            homography=numbers(np.zeros(10)).reshape(3, 3),
            budget={
                "corners": slopes[:, :8] @ corner_variance @ slopes[:, :8].T,
                "width": np.outer(relative[:, 0], relative[:, 0]),
                "height": np.outer(relative[:, 1], relative[:, 1]),
            },
            centre_px=(float(corners_px[:, 0].mean()), float(corners_px[:, 1].mean())),
            fixed=("scale", "tilt"),
            assumed=(NO_LENS,),
            source=f"four corners of a rectangle of {width_m:g} m by {height_m:g} m",
        )
    )
    return upright(plane, "image")


def _turn(corners_px: Array, stderr_px: float) -> float:
    """1 where the corners follow one another clockwise in the image, -1 otherwise; CalibrationError unless convex."""
    sides = np.roll(corners_px, -1, axis=0) - corners_px
    after = np.roll(sides, -1, axis=0)
    turns = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    if not (np.all(turns > 0) or np.all(turns < 0)):
        raise CalibrationError(
            "the four corners are not those of a rectangle seen by a camera: mark them one after the other around it"
        )
    # the distance of each corner from the diagonal beside it tells the quadrilateral from a triangle
    heights = np.abs(turns) / np.linalg.norm(sides + after, axis=1)
    if heights.min() < MIN_SIDES * stderr_px:
        raise CalibrationError(
            f"the four corners are known to {stderr_px:.2g} px and only {heights.min():.1f} px across; enlarge the "
            "image, or mark a larger rectangle"
        )
    return float(np.sign(turns[0]))
