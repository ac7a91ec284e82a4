"""The plan on real recordings: from one clip, the chance that another decides, and what that one leaves.

Balls of other weights and widths that were dropped from a bridge, as their source states them. Drag is what the
equation lacks: a name of drag, alone, is right. Which power of the speed it has is not known: the balls are near the
speed at which their drag falls (the drag crisis).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from iris_sysid import MODELS, FitError, SetUpChange, Trajectory, decide, plan
from iris_sysid.diagnosis.planning.plan import Proposal
from iris_sysid.diagnosis.planning.rivals import Question
from validation import pages
from validation.blind_independent import share
from validation.world_recordings import DRAG, LOCAL_GRAVITY, drops

# weight (oz) and circumference (cm) of balls.txt; without bowling and golf balls, whose drag does not show
BALLS = {
    "Baseball": (5.0, 22.25),
    "Blue Basketball": (18.0, 75.0),
    "Green Basketball": (16.0, 73.25),
    "Tennis Ball": (2.0, 20.75),
    "Whiffle Ball 1": (1.0, 22.8),
    "Orange Whiffle Ball": (1.5, 29.0),
}
FALLING = Question(MODELS["free-fall"], ("quadratic-drag", "linear-drag", "parameter-drift"), (), LOCAL_GRAVITY)


@dataclass(frozen=True, slots=True)
class Checked:
    """A clip that was planned from another: the power that was predicted, and the names that it left."""

    apparatus: str
    repeat: bool
    power: float
    left: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether one name is left, and it is one of drag."""
        return len(self.left) == 1 and self.left[0] in DRAG

    @property
    def wrong(self) -> bool:
        """Whether one name is left, and it is another."""
        return len(self.left) == 1 and self.left[0] not in DRAG


def balls() -> Iterator[Checked]:
    """From the first drop of each ball, the second one of each."""
    clips = {ball: drops(ball) for ball in BALLS}
    for today, (weight, width) in BALLS.items():
        changes = {
            ball: SetUpChange(ball, ball, body={"mass": other / weight, "radius": wide / width})
            for ball, (other, wide) in BALLS.items()
            if ball != today
        }
        new = {ball: clips[ball][1] for ball in BALLS}
        yield from checked("balls dropped from a bridge", FALLING, clips[today][0], changes, new, today)


def checked(
    apparatus: str,
    question: Question,
    today: Trajectory,
    changes: dict[str, SetUpChange],
    new: dict[str, Trajectory],
    same: str,
) -> Iterator[Checked]:
    """What each new clip was predicted to leave, and what it left.

    Parameters
    ----------
    apparatus
        In words.
    question
        The names.
    today
        The clip to plan from.
    changes, new
        By the name of the new clip.
    same
        The name of the clip that was made as today's.
    """
    planned = plan(question, today, changes=list(changes.values()))
    for proposal in planned.proposals:
        name = same if proposal.change.name == "repeat" else proposal.change.name
        yield Checked(apparatus, name == same, proposal.power, _left(question, today, new[name], proposal))


def _left(question: Question, today: Trajectory, new: Trajectory, proposal: Proposal) -> tuple[str, ...]:
    try:
        return decide(question, today, new, proposal.change).names
    except FitError:
        return ()


def table(outcomes: Sequence[Checked]) -> pd.DataFrame:
    """A line for each apparatus, repeats and changes apart, and by whether the plan called them likely to decide."""
    rows = []
    for apparatus in dict.fromkeys(each.apparatus for each in outcomes):
        for repeat in (True, False):
            for likely in (True, False):
                own = [each for each in outcomes if (each.apparatus, each.repeat) == (apparatus, repeat)]
                own = [each for each in own if (each.power > 0.5) == likely]
                rows += [_row(apparatus, repeat, likely, own)] if own else []
    return pd.DataFrame(rows)


def _row(apparatus: str, repeat: bool, likely: bool, own: Sequence[Checked]) -> dict[str, str]:
    return {
        "apparatus": apparatus,
        "new clip": "the same" if repeat else "changed",
        "plan": "likely to decide" if likely else "not likely",
        "predicted power": f"{100 * np.mean([each.power for each in own]):.0f} %",
        "drag alone is left": share([each.right for each in own]),
        "another name alone is left": share([each.wrong for each in own]),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("plan-recordings", options.write_docs):
        print(pages.markdown(table(list(balls()))))


if __name__ == "__main__":
    main()
