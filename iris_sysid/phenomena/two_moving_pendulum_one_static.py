"""A ball on a cord that strikes another, which hangs at rest beside it."""

from __future__ import annotations

from iris_sysid.phenomena._pair import PAIR_PARAMETERS, observe_pair
from iris_sysid.types import BenchmarkClass, Phenomenon

PHENOMENON = Phenomenon(
    name="two-moving-pendulum-one-static",
    summary="a ball on a cord strikes another that hangs at rest; the angle of each about the pivot that its arc shows",
    tracker="disc",
    model="pendulum-impact",
    observe=observe_pair,
    bodies=2,
    free=("vertical_1", "vertical_2"),
    settings=("arc_radius",),
    classes=(
        BenchmarkClass(
            "Two_Moving_Pendulum_One_Static",
            ("pendulum_20", "pendulum_45", "pendulum_90"),
            10,
            PAIR_PARAMETERS,
            dataset="iris",
        ),
    ),
)
