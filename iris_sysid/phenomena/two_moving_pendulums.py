"""Two balls on cords, released from both sides, that strike one another at the bottom."""

from __future__ import annotations

from iris_sysid.phenomena._pair import PAIR_PARAMETERS, observe_pair
from iris_sysid.types import BenchmarkClass, Phenomenon

PHENOMENON = Phenomenon(
    name="two-moving-pendulums",
    summary="two balls on cords swing and strike one another; the angle of each about the pivot that its arc shows",
    tracker="disc",
    model="pendulum-impact",
    observe=observe_pair,
    bodies=2,
    free=("vertical_1", "vertical_2"),
    settings=("arc_radius",),
    classes=(
        BenchmarkClass(
            "Two_Moving_Pendulums", ("pendulum_20", "pendulum_45", "pendulum_90"), 10, PAIR_PARAMETERS, dataset="iris"
        ),
    ),
)
