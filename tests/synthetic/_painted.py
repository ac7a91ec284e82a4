"""Exact images of a scene, before noise and rounding."""

import numpy as np

from iris_sysid.synthetic.picture import Picture


def painted(stage, camera, look, times_s):
    """The planes of a stage as the camera sees it at some times, the middle of each exposure."""
    painter = Picture(stage, camera, look, np.random.default_rng(0))
    return [painter.at(t_s).copy() for t_s in times_s]
