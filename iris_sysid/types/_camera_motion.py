"""How the camera of a clip moved, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.types._arrays import Array, frozen_array


def mapped(motion: Array, xy_px: Array) -> Array:
    """Positions (n, 2), px, taken through one affine map (2, 3) each, or all through the same one.

    ``motion`` is (n, 2, 3) or (2, 3).
    """
    return np.asarray(np.einsum("...ij,...j->...i", motion[..., :2], xy_px) + motion[..., 2])


@dataclass(frozen=True, eq=False, slots=True)
class CameraMotion:
    """The image of the still background in each frame, against one frame of reference: the first.

    ``frame`` (n,) numbers of the frames, ascending; ``to_frame`` (n, 2, 3) takes a position in px of the reference to
    px of each frame; ``covariance`` (n, 6, 6) is that of its six numbers, row by row, about ``centre_px`` (2,) of the
    reference: of ``A`` and ``b`` in ``A (x - centre) + b``.
    """

    frame: NDArray[np.int64]
    to_frame: Array
    covariance: Array
    centre_px: Array

    def __post_init__(self) -> None:
        frame = np.array(self.frame, dtype=np.int64)
        if frame.ndim != 1 or np.any(np.diff(frame) <= 0):
            raise DataError("frame must hold the numbers of the frames, ascending")
        frame.flags.writeable = False
        n = frame.size
        for name, value in (
            ("frame", frame),
            ("to_frame", frozen_array(self.to_frame, (n, 2, 3), "to_frame")),
            ("covariance", frozen_array(self.covariance, (n, 6, 6), "covariance")),
            ("centre_px", frozen_array(self.centre_px, (2,), "centre_px")),
        ):
            object.__setattr__(self, name, value)

    def of(self, frame: NDArray[np.int64]) -> Array:
        """The maps (m, 2, 3), px, of the frames with these numbers (m,); where one is not known, of the one before."""
        return np.asarray(self.to_frame[self._rows(frame)])

    def sigma(self, frame: NDArray[np.int64], xy_px: Array) -> Array:
        """Standard error (m, 2), px, that the motion leaves in positions (m, 2) px of the reference in those frames."""
        rows = self._rows(frame)
        offset = np.column_stack([xy_px - self.centre_px, np.ones(len(xy_px))])
        parts = self.covariance[rows].reshape(-1, 2, 3, 2, 3)
        of_frame = np.einsum("ni,naibj,nj->nab", offset, parts, offset)
        back = np.linalg.inv(self.to_frame[rows][:, :, :2])
        of_reference = back @ of_frame @ back.transpose(0, 2, 1)
        return np.asarray(np.sqrt(np.maximum(np.diagonal(of_reference, axis1=1, axis2=2), 0.0)))

    def _rows(self, frame: NDArray[np.int64]) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.frame, frame, side="right") - 1, 0, self.frame.size - 1)
