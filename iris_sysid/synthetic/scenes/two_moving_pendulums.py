"""Two pendulums released together from both sides, colliding at the bottom."""

from __future__ import annotations

from iris_sysid.synthetic.effects import FORCES
from iris_sysid.synthetic.scene import Scene
from iris_sysid.synthetic.scenes._pair import PARAMETERS, PUBLISHED, SCATTER, accepted, pair_stage, same_angles

SCENE = Scene(
    name="two-moving-pendulums",
    summary="two balls on cords released from both sides, colliding at the bottom",
    folder="Two_Moving_Pendulums",
    duration_s=6.0,
    parameters=PARAMETERS,
    settings={f"pendulum_{degrees}": same_angles(degrees, both=True) for degrees in (20, 45, 90)},
    stage=pair_stage,
    effects=accepted(FORCES),
    scatter={**SCATTER, "theta_2_0": 0.004},
    published=PUBLISHED,
)
