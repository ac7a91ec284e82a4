"""The bob is a body, not a point: its own moment of inertia slows the swing."""

from __future__ import annotations

from fitters.effects._domain import swings
from fitters.effects._inertia import slowed
from iris_sysid.types import Effect, EffectExample, Parameter

EFFECT = Effect(
    name="finite-bob",
    summary="a bob of finite size: k = (2/5) (r / l)^2 for a ball at the distance l",
    equation=r"\ddot\theta_0\,\left(\frac{1}{1 + k} - 1\right)",
    source="Nelson and Olsson (1986), Am. J. Phys. 54, 112, section III",
    parameters=(Parameter("finite_bob", "1", "k", lower=-0.5, default=0.0),),
    component="force-of-position",
    applies=swings,
    plausibility=0.3,
    acceleration=slowed,
    alike="the length itself, unless it is known; time-scale",
    typical="a solid ball of 33 mm radius on 0.5 m: 0.0018; a uniform rod whose length is taken to its middle: 0.33",
    example=EffectExample("pendulum", size=0.05),
)
