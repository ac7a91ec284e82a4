"""A cup on an arm that turns against a torque: the arm's angle, over full turns, about its direction of rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from iris_sysid.phenomena._motion import in_motion, only_measured
from iris_sysid.types import BenchmarkClass, Estimate, Phenomenon, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the angle phi, anticlockwise from the right, as it was tracked; the fit estimates the direction of rest.

    Parameters
    ----------
    world
        One trajectory of phi in rad, segmented.
    settings
        Not used; ``rest`` is a constant of the model.

    Returns
    -------
    Trajectory
        ``phi``; the motion is the longest stretch between rests.

    Raises
    ------
    DataError
        When the motion has fewer than five samples.
    """
    body = only_measured(world, "rotating-cone", "phi")
    in_motion(body, 5)
    return body


PHENOMENON = Phenomenon(
    name="rotating-cone",
    summary="a cup on an arm that turns to and fro about its direction of rest; the angle of the arm",
    tracker="orientation",
    model="angular-oscillator",
    observe=observe,
    motion="oscillation",
    free=("rest",),
    measures="angle",
    classes=(
        BenchmarkClass(
            "Rotation",
            ("slow", "mid", "fast"),
            10,
            {"stiffness": "angular_stiffness", "damping": "angular_damping"},
            dataset="iris",
        ),
    ),
)
