"""A pendulum at rest, struck by another that is released from the left, until both come to rest."""

from __future__ import annotations

from dataclasses import replace

from iris_sysid.synthetic.effects import FORCES
from iris_sysid.synthetic.scene import Scene
from iris_sysid.synthetic.scenes._pair import PARAMETERS, PUBLISHED, SCATTER, accepted, pair_stage, same_angles

SCENE = Scene(
    name="two-moving-pendulum-one-static",
    summary="a ball on a cord released from the left strikes another that hangs at rest",
    folder="Two_Moving_Pendulum_One_Static",
    duration_s=20.0,
    parameters=tuple(
        replace(parameter, default=0.0) if parameter.name == "theta_2_0" else parameter for parameter in PARAMETERS
    ),
    settings={f"pendulum_{degrees}": same_angles(degrees, both=False) for degrees in (20, 45, 90)},
    stage=pair_stage,
    effects=accepted(FORCES),
    scatter=SCATTER,
    published=PUBLISHED,
)
