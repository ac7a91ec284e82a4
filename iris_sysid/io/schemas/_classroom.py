"""What one group of a class measured."""

from __future__ import annotations

from typing import Literal

from pydantic import JsonValue

from iris_sysid.io.schemas._parts import Document, DoubtEntry, EstimateEntry, Number, VerdictEntry
from iris_sysid.types import Estimate, FitStatus


class GroupDocument(Document):
    """One group's clip or table, measured (group.json)."""

    document: Literal["group"] = "group"
    version: Literal[1] = 1
    group: str
    source: str
    """Name of its file."""
    model: str
    equation: str
    """The governing equation, LaTeX."""
    status: FitStatus | Literal["failed"]
    message: str
    """What to make of the status, with the remedy."""
    verdict: VerdictEntry | None = None
    parameters: dict[str, EstimateEntry] = {}
    """Fitted parameters, constants, initial states and derived quantities, by name."""
    free: list[str] = []
    """Names of those that were fitted."""
    budget: dict[str, dict[str, Number]] = {}
    """Standard error of each parameter from each source."""
    evidence: dict[str, EstimateEntry] = {}
    """What the motion itself shows, by which groups are compared: period, radius of the arc, direction of gravity."""
    track_doubts: list[DoubtEntry] = []
    origin: dict[str, JsonValue]

    @property
    def usable(self) -> bool:
        """Whether there are estimates at all."""
        return self.verdict is not None and self.verdict.word != "failed"

    def estimate(self, name: str) -> Estimate | None:
        """A parameter as an Estimate; None where it has none of that name."""
        entry = self.parameters.get(name)
        return None if entry is None or entry.value is None else entry.estimate()
