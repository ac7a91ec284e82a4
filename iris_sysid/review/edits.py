"""What a person can change in a review, as it is sent by the page and written to the log."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from iris_sysid.errors import DataError
from iris_sysid.io.schemas import Part
from iris_sysid.types import DoubtKind

Pointer = Literal["mouse", "pen", "touch", "keys"]
# px of the screen, standard error of a click: half a cursor's width, a finger's tip (type B, GUM 4.3)
POINTER_ERROR: dict[Pointer, float] = {"mouse": 1.5, "pen": 1.5, "touch": 6.0, "keys": 1.0}
MIN_SIGMA_PX = 0.2  # px of the clip: no person tells the centre of a body better, however far it is enlarged

BodyName = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[^\x00-\x1f\x7f]+$")]
FrameNumber = Annotated[int, Field(ge=0, le=10**9)]
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Zoom = Annotated[float, Field(gt=0, le=1e4)]


class _Click(Part):
    """Something placed by a pointer: its error is that of the pointer over the zoom."""

    zoom: Zoom = 1.0
    """px of the screen for one px of the clip."""
    pointer: Pointer = "mouse"

    @property
    def sigma_px(self) -> float:
        """Standard error of each coordinate, px of the clip."""
        return max(MIN_SIGMA_PX, POINTER_ERROR[self.pointer] / self.zoom)


class Place(_Click):
    """The body is at x, y px in that frame; ``at_rest``: and in all frames around it in which it is not found."""

    kind: Literal["place"] = "place"
    body: BodyName
    frame: FrameNumber
    x: Coordinate
    y: Coordinate
    at_rest: bool = False


class Delete(Part):
    """The body is not to be seen in these frames, both included."""

    kind: Literal["delete"] = "delete"
    body: BodyName
    first: FrameNumber
    last: FrameNumber


class SplitTrack(Part):
    """From that frame on, the track is that of another body."""

    kind: Literal["split"] = "split"
    body: BodyName
    frame: FrameNumber
    name: BodyName


class Swap(Part):
    """From that frame on, the names of two bodies are exchanged."""

    kind: Literal["swap"] = "swap"
    body: BodyName
    other: BodyName
    frame: FrameNumber


class Drop(Part):
    """There is no such body."""

    kind: Literal["drop"] = "drop"
    body: BodyName


class Confirm(Part):
    """The track is right in these frames, or against a doubt about all of it."""

    kind: Literal["confirm"] = "confirm"
    body: BodyName
    first: FrameNumber
    last: FrameNumber
    doubts: tuple[DoubtKind, ...] = ()


class SearchRegion(Part):
    """The tracker looks for bodies in x, y, width, height px only; null: in the whole image."""

    kind: Literal["region"] = "region"
    roi: (
        tuple[
            Annotated[int, Field(ge=0, le=10**5)],
            Annotated[int, Field(ge=0, le=10**5)],
            Annotated[int, Field(ge=1, le=10**5)],
            Annotated[int, Field(ge=1, le=10**5)],
        ]
        | None
    )


class ScaleBar(_Click):
    """Two points in px whose distance is a length, as typed: ``0.84m`` or ``84.0+-0.2cm``."""

    kind: Literal["scale"] = "scale"
    ends: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    length: Annotated[str, Field(min_length=1, max_length=60)]


class BoardCorners(_Click):
    """Four corners in px around a rectangle of known size, its first side first.

    ``size`` is as typed: two sides, ``0.2m x 0.125m``, or squares of a board, ``8x5 of 25mm``.
    """

    kind: Literal["board"] = "board"
    corners: tuple[Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate]
    size: Annotated[str, Field(min_length=1, max_length=80)]


class Ignore(_Click):
    """The object at x, y px in that frame is not a body, but e.g. a hand."""

    kind: Literal["ignore"] = "ignore"
    frame: FrameNumber
    x: Coordinate
    y: Coordinate


class Point(Part):
    """A marked point of the scene in px; null takes it away."""

    kind: Literal["point"] = "point"
    name: Literal["pivot", "launch"]
    at: tuple[Coordinate, Coordinate] | None


class PlumbLine(Part):
    """Two points of a plumb line in px, upper end first; null takes it away."""

    kind: Literal["plumb"] = "plumb"
    ends: tuple[Coordinate, Coordinate, Coordinate, Coordinate] | None


class Mark(_Click):
    """Where the body is, a mark for the tracker, as ``--mark 1=x,y@frame``."""

    kind: Literal["mark"] = "mark"
    body: BodyName
    frame: FrameNumber
    x: Coordinate
    y: Coordinate


class ChoosePhenomenon(Part):
    """What moves in the clip."""

    kind: Literal["phenomenon"] = "phenomenon"
    name: Annotated[str, Field(min_length=1, max_length=80)]


class Tracked(Part):
    """A tracker followed the bodies anew; its tracks are in that file of the folder."""

    kind: Literal["tracked"] = "tracked"
    file: Annotated[str, Field(pattern=r"^review-track-[0-9]{1,6}\.csv$")]


Edit = Annotated[
    Place
    | Delete
    | SplitTrack
    | Swap
    | Drop
    | Confirm
    | SearchRegion
    | ScaleBar
    | BoardCorners
    | Ignore
    | Point
    | PlumbLine
    | Mark
    | ChoosePhenomenon
    | Tracked,
    Field(discriminator="kind"),
]
_EDIT: TypeAdapter[Edit] = TypeAdapter(Edit)


def parse_edit(content: object) -> Edit:
    """Read an edit from what JSON holds; the text of the DataError names the first key that does not fit."""
    try:
        return _EDIT.validate_python(content, strict=False)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"])) or "edit"
        raise DataError(f"no edit: {where}: {first['msg']}, not {first['input']!r:.60}") from error
