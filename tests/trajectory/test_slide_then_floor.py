"""A cup that leaves the board and runs on along the floor: the motion is the slide, however long the run is."""

import numpy as np

from iris_sysid.trajectory.segmentation import segment
from iris_sysid.types import Quantity, Trajectory

NOISE = 1e-4  # m


def test_slide_is_the_part_that_falls_though_the_run_on_the_floor_is_longer():
    t_s = np.arange(110) / 60
    angle, down, speed = np.radians(60), 6.5, 2.6  # rad, m/s^2, m/s at the foot
    slide_s = speed / down
    on_board = t_s < slide_s
    along = np.where(on_board, down * t_s**2 / 2, speed**2 / 2 / down)
    x = along * np.cos(angle)
    z = (speed**2 / 2 / down - along) * np.sin(angle)
    rolled = np.clip(t_s - slide_s, 0, None)
    x = x + 1.3 * rolled * np.exp(-rolled)
    position = np.column_stack([x, z]) + np.random.default_rng(0).normal(0, NOISE, (t_s.size, 2))
    world = Trajectory(
        t_s=t_s, quantities=(Quantity("x", "m"), Quantity("z", "m")), position=position,
        sigma=np.full((t_s.size, 2), NOISE), valid=np.ones(t_s.size, dtype=bool),
    )  # fmt: skip
    motion = next(part for part in segment(world, kind="slide").segments if part.label == "motion")
    assert motion.start < 5
    assert abs(t_s[motion.stop - 1] - slide_s) < 2.5 / 60
