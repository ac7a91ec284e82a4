"""The judgement of a track by evidence that needs no truth: good, or doubtful with reasons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from iris_sysid.types._verdict import Doubt


@dataclass(frozen=True, slots=True)
class TrackQuality:
    """How far a track can be trusted: ``doubts`` is empty where there is no evidence against it.

    ``evidence`` holds the shares and ratios that were judged, by name; 1 is best where it is a share.
    """

    doubts: tuple[Doubt, ...] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)

    @property
    def doubtful(self) -> bool:
        """Whether some evidence says that the track may not be that of the body."""
        return bool(self.doubts)

    def with_doubts(self, *doubts: Doubt) -> TrackQuality:
        """The same evidence with further ``doubts``."""
        return replace(self, doubts=(*self.doubts, *doubts))


@dataclass(frozen=True, slots=True)
class TrackMark:
    """A click: that body is at (x, y) px in the frame of that number in the file."""

    body: str
    x_px: float
    y_px: float
    frame: int
