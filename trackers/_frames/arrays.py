"""Array types of images, and constants of robust statistics, that all trackers share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]  # (h, w) or (h, w, channels), grey levels
Bytes = NDArray[np.uint8]  # the same as bytes; masks are 0 or 1
Flags = NDArray[np.bool_]
Box = tuple[int, int, int, int]  # left, top, right (exclusive), bottom (exclusive), px

MAD_TO_SD = 1.4826  # median absolute deviation to standard deviation of a normal distribution
QUANTISATION_SD = float(1.0 / np.sqrt(12.0))  # of a rounded grey level
