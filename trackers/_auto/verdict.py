"""How far a track can be trusted: the probability that it is on its body, and the words for the evidence against it.

The probability that a track is on its body at a moment that shows the body is ``(1 - m) (1 - c) / (1 + exp(-(b - sum_k
w_k e_k)))``: ``m`` is the share of the samples that show the body in which the track misses it, ``c`` that in which the
track shows other colours, ``e_k`` the other evidence of :mod:`trackers._auto.evidence`. It is a logistic regression
(D. R. Cox, J. R. Stat. Soc. B 20 (1958) 215) with weights ``w_k >= 0``: evidence against a track never
makes it likelier.
``b`` and ``w_k`` are fitted to marked clips by ``python -m validation.track_verdict``, which writes
:mod:`trackers._auto.verdict_weights`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from iris_sysid.types import Doubt, DoubtKind, Track, TrackMark, TrackQuality
from trackers._auto.evidence import evidence_against, missed_marks, rival, samples_missed
from trackers._auto.scene import SampledScene
from trackers._auto.verdict_weights import DOUBTFUL, INTERCEPT, WEIGHTS

Said = tuple[DoubtKind, str, str]  # kind, finding and remedy of a doubt
PROBABILITY = "probability"  # its name among the evidence
OF_WAYS = ("guessed", "beside")  # known by appearance only; other objects go farther
OFF = ("missed", "other colours")  # shares of the samples in which the track is not on the body
HELD_SHARE = 0.5  # of the frames with the body: more often in a hand is not a free motion, even if it is followed well
MAX_REASONS = 3
MIN_PART = 0.25  # of all the evidence against a track: weaker evidence is not reported
# what helps where marks do not: a body that covers much of its own way is seen in no frame as a whole before it
BY_TEMPLATE = "if it does not turn: --tracker template --roi x,y,width,height, its box in the first frame of the clip"
BY_MARK = "check the overlay, and mark the body where it is lost: --mark {body}=x,y@frame"
AT_PLACE = "if that is the body: --mark {body}={x:.0f},{y:.0f}@{frame}"
HELD: Said = (
    "held",
    "a hand, or another object that reaches in from the edge, touches it in {share:.0%} of its frames",
    "mark the free body: --mark {body}=x,y@frame, or cut it off: --start",
)
# kind, finding and remedy of each evidence: share of it, extent in radii, place and frame of an object
WORDS: Mapping[str, Said] = {
    "other colours": (
        "another-body",
        "the track shows something else in {share:.0%} of the sampled frames",
        BY_MARK,
    ),
    "faint": ("faint", "the tracked object barely differs from its surroundings", BY_MARK),
    "kinks": ("jumps", "its path is broken by more than a radius in {share:.0%} of the frames", BY_MARK),
    "barely moves": ("ambiguous", "it moves by {radii:.1f} radii only", BY_MARK),
    "held": HELD,
    "at the edge": HELD,
    "ragged": ("another-body", "the moving object is ragged, as people are", BY_MARK),
    "nothing moves": ("another-body", "in {share:.0%} of the sampled frames nothing moves where the track is", BY_MARK),
    "scenery": (
        "another-body",
        "it is in several places where nothing moves, in {share:.0%} of the sampled frames",
        BY_MARK,
    ),
    "missed": (
        "missed",
        "the body is lost in frame {frame}, and in {share:.0%} of the sampled frames that show it",
        "mark it there: --mark {body}=x,y@{frame}",
    ),
    "rival": (
        "ambiguous",
        "what is at ({x:.0f}, {y:.0f}) px in frame {frame} moves too and looks more like a body",
        AT_PLACE,
    ),
    "disc not followed": (
        "ambiguous",
        "a disc that changes its size, at ({x:.0f}, {y:.0f}) px in frame {frame}, is not followed",
        "if that is the body: --tracker disc",
    ),
    "two on one": (
        "another-body",
        "body {body} is tracked at one place with another in {share:.0%} of their frames",
        "mark each: --mark {body}=x,y@frame, or request fewer --bodies",
    ),
    "lost together": (
        "ambiguous",
        "all bodies are lost together for some frames: names may change there",
        "mark each body before and after: --mark 1=x,y@frame --mark 2=x,y@frame",
    ),
    "guessed": (
        "ambiguous",
        "tracked by appearance only: no body was followed well before the still background",
        "check the overlay, and mark it: --mark {body}=x,y@frame",
    ),
    "beside": (
        "ambiguous",
        "other objects move farther; this one looks most like a body",
        "check the overlay, and mark it: --mark {body}=x,y@frame",
    ),
}


def probability_of(against: Mapping[str, float]) -> float:
    """The probability that a track is on its body, by the evidence against it."""
    taken = sum(weight * against[name] for name, weight in WEIGHTS.items())
    return float(np.prod([1 - against[name] for name in OFF]) / (1 + np.exp(taken - INTERCEPT)))


def largest_probability(way: Collection[str]) -> float:
    """The probability of a track against which nothing speaks but that ``way``, some of :data:`OF_WAYS`."""
    return probability_of(dict.fromkeys([*WEIGHTS, *OFF], 0.0) | dict.fromkeys(way, 1.0))


def _parts(against: Mapping[str, float]) -> dict[str, float]:
    """What each evidence takes from the logarithm of the odds, or of the probability."""
    parts = {name: weight * against[name] for name, weight in WEIGHTS.items()}
    return parts | {name: -float(np.log(max(1 - against[name], 1e-9))) for name in OFF}


def judged(
    track: Track,
    scene: SampledScene,
    others: Sequence[Track] = (),
    marks: Sequence[TrackMark] = (),
    way: Collection[str] = (),
) -> TrackQuality:
    """The quality of a track: its evidence with the probability, and its doubts where that is small.

    Parameters
    ----------
    track, scene, others
        As of :func:`trackers._auto.evidence.evidence_against`.
    marks
        What the user knows: a track that misses a mark is not on its body; beside marks no other object is a rival.
    way
        Which of :data:`OF_WAYS` the way of following the body brings with it.
    """
    against = evidence_against(track, scene, others) | {name: float(name in way) for name in OF_WAYS}
    if marks or "guessed" in way:
        against["lost together"] = 0.0  # marks and appearance identify the bodies
    if marks:
        against |= dict.fromkeys(("rival", "disc not followed", *OF_WAYS), 0.0)
    missed = missed_marks(track, marks)
    probability = 0.0 if missed else probability_of(against)
    doubts = [] if probability >= DOUBTFUL else _reasons(track, scene, others, against, bool(marks))
    held = against["at the edge" if track.hand is None else "held"]
    if held > HELD_SHARE and not any(doubt.kind == "held" for doubt in doubts):
        doubts.append(_said("held", held, track, {}))
    if missed:
        finding = f"the track misses the mark in frame {missed[0].frame}"
        doubts = [Doubt("off-marks", finding, "add marks nearby, or --roi"), *doubts]
    return TrackQuality(tuple(doubts), {PROBABILITY: probability, **against})


def _reasons(
    track: Track, scene: SampledScene, others: Sequence[Track], against: Mapping[str, float], marked: bool
) -> list[Doubt]:
    """What speaks most against a track, in words, the strongest first."""
    parts = {name: part for name, part in _parts(against).items() if part > 0}
    strongest = sorted(parts, key=lambda name: -parts[name])[:MAX_REASONS]
    least = MIN_PART * sum(parts.values())
    reasons = []
    for name in [name for k, name in enumerate(strongest) if k == 0 or parts[name] > least]:
        reason = _said(name, against[name], track, _where(name, track, scene, others))
        if marked and WORDS[name][2] is BY_MARK:
            reason = replace(reason, remedy=BY_TEMPLATE)
        reasons.append(reason)
    return reasons


def _said(name: str, share: float, track: Track, where: Mapping[str, float]) -> Doubt:
    """An evidence of that share in words."""
    kind, finding, remedy = WORDS[name]
    known = {"share": share, "radii": 1 / share - 1, "body": track.body, **where}
    return Doubt(kind, finding.format(**known), remedy.format(**known))


def _where(name: str, track: Track, scene: SampledScene, others: Sequence[Track]) -> dict[str, float]:
    """Frame, and x and y in px, of the object that an evidence is about, where it is about one."""
    if name == "missed":
        return {"frame": scene.frames[samples_missed(track, scene, others)[0]].index}
    if name == "disc not followed":
        number, disc = next(iter(scene.receding.items()))
        return {"frame": number, "x": disc.x, "y": disc.y}
    kind = rival(scene, track, others)[1] if name == "rival" else None
    if kind is None:
        return {}
    sighting = kind.seen[len(kind.seen) // 2]
    x, y = scene.view.in_frame(sighting.x, sighting.y)
    return {"frame": scene.frames[sighting.sample].index, "x": x, "y": y}
