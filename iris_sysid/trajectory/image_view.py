"""How the coordinates of a tracked body lie in the image, from its track and its calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iris_sysid.calibration.plane import to_pixels, to_plane
from iris_sysid.types import (
    FOCAL_PER_WIDTH,
    Array,
    Calibration,
    Estimate,
    PivotSource,
    Track,
    Trajectory,
    View,
    ViewKind,
    kind_of,
)

MIN_SAMPLES = 3  # samples that show where a motion is
STRAIGHT = 0.05  # scatter across a line over its length, above which a way is not along a line of the image
UNIT_LENGTH = (0.8, 1.25)  # way in the plane for a unit of a coordinate that is a length
STEP = 1e-3  # of the extent of the motion, for the derivatives of the map to the image


def image_view(
    trajectory: Trajectory, track: Track, calibration: Calibration, image_size: tuple[int, int] | None = None
) -> View | None:
    """How the quantities of a trajectory lie in the image; None where they are not positions in it.

    The map from the plane of motion to the image is taken as linear about the middle of the motion.

    Parameters
    ----------
    trajectory
        What was made of the track: an angle with its pivot in ``geometry``, a way along a line, or x and z.
    track
        The only body, with the samples of the trajectory, px.
    calibration
        Of the plane of motion.
    image_size
        Width and height, px; where neither it nor the calibration's is known, the picture lies about the motion.
    """
    kind = kind_of(trajectory.quantities)
    if kind is None or track.valid.size != trajectory.n:
        return None
    used = track.valid & trajectory.valid & trajectory.mask("motion")
    if used.sum() < MIN_SAMPLES:
        return None
    seen_px = track.xy_px[used]
    plane = to_plane(calibration, seen_px)[0]
    middle = (plane.min(axis=0) + plane.max(axis=0)) / 2
    extent = float(np.max(np.ptp(plane, axis=0)))
    if not extent > 0:  # a body that turns in place is read by its orientation
        return None
    slopes = _slopes_px(calibration, middle, STEP * extent)
    if kind == "angle":
        view = _about_pivot(trajectory, calibration, slopes)
    elif kind == "line":
        view = _along_line(trajectory.position[used, 0], plane, seen_px, slopes)
    else:
        origin = to_pixels(calibration, middle[None])[0] - slopes @ middle
        view = _view("plane", origin, slopes[:, 0], slopes[:, 1])
    return None if view is None else _in_picture(view, seen_px, calibration, image_size)


def _slopes_px(calibration: Calibration, at: Array, step: float) -> Array:
    """Derivatives (2, 2) of image points, px, by x and z in the plane; columns."""
    moved = at + step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    points = to_pixels(calibration, moved)
    return np.asarray(np.column_stack([points[0] - points[1], points[2] - points[3]]) / (2 * step))


def _view(kind: ViewKind, origin: Array, right: Array, up: Array, pivot: PivotSource = "marked") -> View | None:
    """A view whose picture is not known yet; None where the image of the plane is a line."""
    first, second, third = ((float(x), float(y)) for x, y in (origin, right, up))
    if not abs(float(np.linalg.det(np.array([right, up])))) > 0:
        return None
    return View(kind, first, second, third, size_px=(1.0, 1.0), axis_px=(0.0, 0.0), focal_px=1.0, pivot=pivot)


def _about_pivot(trajectory: Trajectory, calibration: Calibration, slopes: Array) -> View | None:
    geometry = trajectory.geometry
    if not {"pivot_x", "pivot_z", "arc_radius"} <= geometry.keys():
        return None
    pivot, radius = [geometry["pivot_x"].value, geometry["pivot_z"].value], geometry["arc_radius"]
    source: PivotSource = "arc" if radius.measurement_type == "fitted" else "arc-of-known-radius"
    if geometry["pivot_x"].measurement_type == "direct":
        source = "marked"
    origin = to_pixels(calibration, np.array([pivot]))[0]
    return _view("angle", origin, radius.value * slopes[:, 0], radius.value * slopes[:, 1], source)


def _along_line(way: Array, plane: Array, seen_px: Array, slopes: Array) -> View | None:
    """The view of a way (n,) along the line that positions (n, 2) in the plane follow; None where they follow none."""
    from_middle = way - way.mean()
    if not np.any(from_middle):
        return None
    direction = from_middle @ (plane - plane.mean(axis=0)) / (from_middle @ from_middle)
    across = plane - plane.mean(axis=0) - np.outer(from_middle, direction)
    length = float(np.ptp(way)) * float(np.hypot(*direction))
    one_unit = UNIT_LENGTH[0] < float(np.hypot(*direction)) < UNIT_LENGTH[1]
    if not one_unit or float(np.std(across)) > STRAIGHT * length:
        return None
    right = slopes @ direction
    return _view("line", seen_px.mean(axis=0) - way.mean() * right, right, np.array([right[1], -right[0]]))


def _in_picture(view: View, seen_px: Array, calibration: Calibration, image_size: tuple[int, int] | None) -> View:
    """The view with its picture, optical axis and focal length: as calibrated, or else those of a phone's camera."""
    size = image_size or calibration.image_size
    if size is None:
        return view.about(seen_px)
    matrix, (width, height) = calibration.camera_matrix, (float(size[0]), float(size[1]))
    axis, focal = ((width - 1) / 2, (height - 1) / 2), FOCAL_PER_WIDTH * width
    if has_camera(calibration):
        axis, focal = (float(matrix[0, 2]), float(matrix[1, 2])), float(matrix[0, 0])
    return replace(view, size_px=(width, height), axis_px=axis, focal_px=focal)


def focal_ratio(calibration: Calibration) -> dict[str, Estimate]:
    """The focal length over that of the view, as a measured constant of effects; empty where none was calibrated."""
    if not has_camera(calibration):
        return {}
    relative = float(np.sqrt(max(calibration.covariance[9, 9], 0.0))) / float(calibration.camera_matrix[0, 0])
    return {"focal_ratio": Estimate(1.0, relative, "1", "direct", f"calibration: {calibration.source}")}


def has_camera(calibration: Calibration) -> bool:
    """Whether the calibration knows the focal length and the optical axis."""
    return not np.array_equal(calibration.camera_matrix, np.eye(3))
