"""From the rows that a detector finds, frame by frame, to its detections with their probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array, Detections
from trackers.detectors._weights import INTERCEPTS, WEIGHTS


@dataclass(eq=False, slots=True)
class DetectionRows:
    """What a detector of that name has found so far: rows of x, y, standard error and radius, px.

    ``size`` are width and height of the image, px.
    """

    detector: str
    size: tuple[int, int]
    _frames: list[tuple[int, float]] = field(default_factory=list)
    _numbers: list[int] = field(default_factory=list)
    _rows: list[Sequence[float]] = field(default_factory=list)
    _looks: list[Sequence[float]] = field(default_factory=list)
    _evidence: list[Mapping[str, float]] = field(default_factory=list)

    @property
    def diagonal(self) -> float:
        """Of the image, px."""
        return float(np.hypot(*self.size))

    def begin(self, number: int, t_s: float) -> None:
        """The next frame, in which all detections are that are added."""
        self._frames.append((number, t_s))

    def add(self, place: Sequence[float], looks: Sequence[float], evidence: Mapping[str, float]) -> None:
        """A detection: x, y, standard error and radius in px, its appearance, and the evidence for its being a body."""
        self._numbers.append(self._frames[-1][0])
        self._rows.append(place)
        self._looks.append(looks)
        self._evidence.append(evidence)

    def detections(self) -> Detections:
        """All that was found.

        Raises
        ------
        TrackingError
            When there was no frame.
        """
        if not self._frames:
            raise TrackingError("the clip gave no frames; is the part between --start and --stop empty?")
        rows = np.array(self._rows, dtype=np.float64).reshape(len(self._rows), 4)
        evidence = {
            name: np.array([found[name] for found in self._evidence], dtype=np.float64)
            for name in WEIGHTS[self.detector]
        }
        return Detections(
            frames=np.array([number for number, _ in self._frames], dtype=np.int64),
            t_s=np.array([t_s for _, t_s in self._frames]),
            size=self.size,
            frame=np.array(self._numbers, dtype=np.int64),
            xy_px=rows[:, :2],
            sigma_px=rows[:, 2],
            radius_px=rows[:, 3],
            probability=probability_of(self.detector, evidence),
            looks=np.array(self._looks, dtype=np.float64).reshape(len(rows), -1 if len(rows) else 0),
            evidence=evidence,
        )


def probability_of(detector: str, evidence: Mapping[str, Array]) -> Array:
    """Probability (n,) that detections are of bodies, by logistic regression on their evidence (n,).

    The weights are fitted to marked clips by ``python -m validation.detection_odds``.
    """
    odds = INTERCEPTS[detector] + sum(weight * evidence[name] for name, weight in WEIGHTS[detector].items())
    return np.asarray(1 / (1 + np.exp(-np.clip(odds, -30, 30))), dtype=np.float64)
