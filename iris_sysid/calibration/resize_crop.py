"""The same camera after its images were resized or cropped: what a calibration becomes then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iris_sysid.calibration.bundle_adjustment import matrix_of
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array


def resized_camera(camera: CameraCalibration, image_size: tuple[int, int]) -> CameraCalibration:
    """The ``camera`` of images resized as a whole to ``image_size`` (width, height) px, nothing cut off.

    Lengths grow by the ratio r of the sizes and ``cx' = r (cx + 1/2) - 1/2``: the origin is the centre of a pixel.
    Raises CalibrationError when the shape differs, for then something was cut off.
    """
    ratio = np.array(image_size, dtype=np.float64) / np.array(camera.image_size)
    # a whole number of px each way: half a px of rounding
    if not np.all(ratio > 0) or abs(ratio[0] - ratio[1]) > 0.51 / min(camera.image_size):
        raise CalibrationError(
            f"images of {camera.image_size[0]}x{camera.image_size[1]} px cannot be resized to "
            f"{image_size[0]}x{image_size[1]} px without cutting or stretching; calibrate at that resolution"
        )
    growth = np.array([*ratio, *ratio, 1, 1, 1, 1, 1])
    parameters = camera.parameters * growth
    parameters[2:4] += (ratio - 1) / 2
    return _changed(camera, parameters, growth, image_size, f"resized to {image_size[0]}x{image_size[1]} px")


def cropped_camera(camera: CameraCalibration, crop: tuple[int, int, int, int]) -> CameraCalibration:
    """The ``camera`` of images from which the part ``crop`` (x, y, width, height) px was cut out, not resized.

    Raises CalibrationError when the part does not lie in the image.
    """
    x, y, width, height = crop
    if min(x, y) < 0 or min(width, height) < 1 or x + width > camera.image_size[0] or y + height > camera.image_size[1]:
        raise CalibrationError(
            f"the part {x},{y},{width},{height} does not lie in an image of "
            f"{camera.image_size[0]}x{camera.image_size[1]} px; give x,y,width,height"
        )
    parameters = camera.parameters
    parameters[2:4] -= [x, y]
    return _changed(camera, parameters, np.ones(9), (width, height), f"cropped to {x},{y},{width},{height}")


def _changed(
    camera: CameraCalibration, parameters: Array, growth: Array, image_size: tuple[int, int], what: str
) -> CameraCalibration:
    return replace(
        camera,
        camera_matrix=matrix_of(parameters),
        covariance=camera.covariance * np.outer(growth, growth),
        image_size=image_size,
        views=(),
        source=f"{camera.source}, {what}",
    )
