"""Explain differences between clips and direct measurements: another definition of length or angle."""

from __future__ import annotations

import math
from collections.abc import Mapping

from iris_sysid.io.schemas import number
from iris_sysid.io.schemas.groundtruth import RegeneratedValue, ValueEntry
from iris_sysid.types import NORMAL_975, Estimate

ROPES = ("rope_length", "rope_length_1", "rope_length_2")
ROPE_NOTE = (
    "from clips it is the length of the equation, from the pivot to the ball's centre; a tape along the rope leaves "
    "out the ball's radius"
)
MISFIT = "the equation fits no clip to within the noise, so the value is only as good as the equation; see --diagnose"
MUCH_NEARER = 3.0  # times


def notes_on(
    name: str, regenerated: RegeneratedValue | None, difference: ValueEntry | None, by_hand: Mapping[str, Estimate]
) -> list[str]:
    """Notes on a parameter, and the likely cause where clips and direct measurement differ.

    Parameters
    ----------
    name
        As in parameters.json.
    regenerated
        From the clips.
    difference
        Regenerated minus direct value, where both exist.
    by_hand
        All direct measurements of the setting.

    Returns
    -------
    list of str
        Empty without a note.
    """
    notes = [ROPE_NOTE] if name in ROPES and regenerated is not None else []
    if regenerated is not None and any(clip.used and clip.status == "misfit" for clip in regenerated.clips.values()):
        notes.append(MISFIT)
    if regenerated is None or difference is None:
        return notes
    deviation, half = number(difference.value), number(difference.expanded_uncertainty)
    if not abs(deviation) > half:
        return notes
    statement = f"clips and direct value differ by {deviation:.3g} +- {half:.2g} {difference.unit} (95 %)"
    return [*notes, f"{statement}{_explained(name, regenerated, deviation, half, by_hand)}"]


def _explained(
    name: str, regenerated: RegeneratedValue, deviation: float, half: float, by_hand: Mapping[str, Estimate]
) -> str:
    """A clause that names the cause of a deviation; empty where no cause is known."""
    if name in ROPES and "ball_radius" in by_hand:
        radius = by_hand["ball_radius"]
        tolerance = math.hypot(half, NORMAL_975 * radius.stderr)
        explains = "explains it" if abs(deviation - radius.value) <= tolerance else "does not explain all of it"
        return f"; the ball's radius, {radius.value:.3g} {radius.unit}, {explains}"
    if name == "angle":
        complement = 90.0 - (number(regenerated.value) - deviation)
        if MUCH_NEARER * abs(number(regenerated.value) - complement) < abs(deviation):
            return (
                f"; 90 deg less the direct value, {complement:.3g} deg, is nearer: was it measured from the vertical?"
            )
    return ""
