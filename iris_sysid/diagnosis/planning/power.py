"""The probability that one more clip leaves a single name: rivals refitted to drawn clips of each of them.

If A is true, B is distinguished where the chi-square of B, its free values fitted to today's clip and the new one, is
above that of A by the limit of the diagnosis. Without noise that difference is the non-centrality
lambda = |r - J (J'J)^-1 J'r|^2, with r the difference of the predictions in units of the noise and J what B's free
values can imitate; with noise it is close to a normal of mean lambda and variance 4 lambda. Here it is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.diagnosis.evidence import DECISIVE
from iris_sysid.diagnosis.planning.predicted_clip import Design, PredictedClip, imitating, predicted_clip
from iris_sysid.diagnosis.planning.rivals import Rival, probabilities_of
from iris_sysid.types import Array, Mask

DRAWS = 200
STEPS = 3  # of Gauss and Newton; they converge quadratically


@dataclass(frozen=True, eq=False, slots=True)
class Power:
    """``by_name`` the probability that only this name is left if it is the right one; ``overall`` that of any.

    ``clips`` are the predictions of the rivals.
    """

    overall: float
    by_name: dict[str, float]
    clips: tuple[PredictedClip, ...]


def power_of(rivals: Sequence[Rival], design: Design, rng: np.random.Generator, refined: bool = False) -> Power | None:
    """Draw clips of each rival and count those that leave only its name; None where a motion diverges.

    Parameters
    ----------
    rivals
        Two or more.
    design
        The new clip.
    rng
        Of the drawn clips.
    refined
        Refit each wrong rival to the right one's prediction first: slower, and right for large changes too.
    """
    clips = [predicted_clip(rival, design) for rival in rivals]
    known = tuple(clip for clip in clips if clip is not None)
    if len(known) < len(clips):
        return None
    above = np.array([rival.above for rival in rivals])
    weights = np.log(design.t_s.size) * design.change.clips
    priors = above + weights * np.array([len(clip.roles.new) for clip in known])
    shares = [
        float(np.mean(_told_apart(k, known, priors, design, rng, refined))) if len(known) > 1 else 1.0
        for k in range(len(known))
    ]
    overall = float(np.average(shares, weights=probabilities_of(above)))
    return Power(overall, {rival.name: share for rival, share in zip(rivals, shares, strict=True)}, known)


def _told_apart(
    right: int, clips: Sequence[PredictedClip], priors: Array, design: Design, rng: np.random.Generator, refined: bool
) -> Mask:
    """Whether (m,) the drawn clips of one rival leave no other one."""
    true = clips[right]
    drawn = true.drawn(rng, DRAWS)
    own = true.misfit(drawn) + priors[right]
    left = np.ones(DRAWS, dtype=np.bool_)
    for k, wrong in enumerate(clips):
        if k != right:
            fitted = imitating(wrong, true.centre, design, STEPS) if refined else wrong
            left &= fitted.misfit(drawn) + priors[k] - own > DECISIVE
    return left
