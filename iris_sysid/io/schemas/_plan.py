"""What to measure next (plan.json): after a diagnosis, and before any clip."""

from __future__ import annotations

from typing import Literal

from iris_sysid.io.schemas._parts import Document, Number, Part


class ChangeEntry(Part):
    """A change of the set-up; what is not named stays as it is."""

    name: str
    text: str
    """What to do, in words."""
    longer: float = 1.0
    """Factor on the length of the clip."""
    faster: float = 1.0
    """Factor on the frame rate."""
    start: dict[str, float] = {}
    """New initial values by name, in the model's units."""
    body: dict[str, float] = {}
    """Factors on the body's mass, radius, cord length, or the stiffness of its spring."""
    steeper: float = 1.0
    """Factor on the acceleration of an incline."""
    driven: float = 1.0
    """Factor on the inputs."""
    without: list[str] = []
    """Effects that cannot act in the new clip."""
    clips: int = 1
    """How many such clips are made."""


class ProposalEntry(Part):
    """One more clip, and what it is predicted to tell."""

    change: ChangeEntry
    power: Number
    """Probability that a single name is left, and the right one; null where one name is left already."""
    by_name: dict[str, float]
    """That probability for each name, if it is the right one."""
    stderr: dict[str, Number]
    """Random standard errors with today's clip and the new one, in the unit of today's estimate."""
    cost: float


class NeedEntry(Part):
    """One way to a smaller standard error; ``source`` is empty where the systematic errors may stay."""

    clips: int
    """How many more, as today's."""
    source: str
    factor: float
    """On today's error of the source."""


class PrecisionEntry(Part):
    """What a value needs to be known to a standard error; no way where none was found."""

    parameter: str
    stderr: float
    """Wanted, in the unit of the parameter."""
    ways: list[NeedEntry]


class PlanDocument(Document):
    """The changes of the set-up, best first."""

    document: Literal["plan"] = "plan"
    version: Literal[1] = 1
    probabilities: dict[str, float]
    """Of the names in question today."""
    stderr: dict[str, Number]
    """Today's random standard errors."""
    advice: list[str]
    proposals: list[ProposalEntry]
    precision: list[PrecisionEntry] = []
    decision: dict[str, float] | None = None
    """The probabilities of the names with a clip that was filmed since."""


class LimitsDocument(Document):
    """The smallest size of an effect that half of the clips show; rows of ``sizes`` are starts, columns lengths."""

    document: Literal["detection-limits"] = "detection-limits"
    version: Literal[1] = 1
    effect: str
    unit: str
    varied: str
    """The initial value that ``starts`` holds."""
    starts: list[float]
    seconds: list[float]
    sizes: list[list[Number]]
    """Null where no clip shows it."""
