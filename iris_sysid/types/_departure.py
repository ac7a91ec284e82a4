"""The sample at which a body leaves its rest position."""

from __future__ import annotations

import numpy as np

from iris_sysid.types._arrays import Array

N_REST_SAMPLES = 5  # the rest position is the median of the first samples
DEPARTURE_SIGMAS = 10.0  # a displacement above this many standard deviations of the noise is motion
MIN_DISPLACEMENT_FRACTION = 0.01  # a displacement below this fraction of the largest is still rest


def departure(position: Array, noise: float) -> int:
    """First sample of the motion: its displacement from the rest position and every later one exceed the threshold.

    The rest position is the median of the first ``N_REST_SAMPLES`` positions (n, d), in any unit, which is that of the
    noise of one. A body that does not move has no such sample; the result is then the number of samples.
    """
    if len(position) <= N_REST_SAMPLES:
        return len(position)
    rest_position = np.median(position[:N_REST_SAMPLES], axis=0)
    displacement = np.sqrt(np.sum((position - rest_position) ** 2, axis=1))
    threshold = max(DEPARTURE_SIGMAS * noise, MIN_DISPLACEMENT_FRACTION * float(displacement.max()))
    moving = displacement > threshold
    stays_moving = moving & np.append(moving[1:], True)
    return int(np.argmax(stays_moving)) if stays_moving.any() else len(position)
