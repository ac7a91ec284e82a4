"""The state of a review after its edits, and the way back and forth through them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.calibration.pixel_scale import scale_bar
from iris_sysid.calibration.rectangle import plane_from_rectangle
from iris_sysid.errors import DataError
from iris_sysid.registry import PHENOMENA
from iris_sysid.review.corrected_tracks import Tracks, corrected, with_edits_of, without_ignored
from iris_sysid.review.edits import (
    BoardCorners,
    ChoosePhenomenon,
    Confirm,
    Edit,
    Ignore,
    Mark,
    PlumbLine,
    Point,
    ScaleBar,
    SearchRegion,
    Tracked,
)
from iris_sysid.review.log import Entry
from iris_sysid.review.request import ReviewRequest
from iris_sysid.types import Calibration, TrackMark
from iris_sysid.units import LENGTH_EXAMPLE, LENGTHS, Measure, parse_measure

SQUARES = re.compile(r"(?P<n>[1-9]\d{0,2}) ?[x×] ?(?P<m>[1-9]\d{0,2}) +of +(?P<side>.+)")
SIDES = re.compile(r"(?<=[a-z\)]) *[x×] *")  # after a unit, or the bracket of an error
SIZE_EXAMPLE = "0.2m x 0.125m, or 8x5 of 25mm for squares of a board"
TrackReader = Callable[[str], Tracks]  # the tracks in a file of the folder


@dataclass(frozen=True, eq=False, slots=True)
class ReviewState:
    """Tracks and request after some edits; ``confirmed`` are body, first and last frame of what was found right."""

    request: ReviewRequest
    tracks: Tracks = ()
    confirmed: tuple[tuple[str, int, int], ...] = ()


def after(state: ReviewState, edit: Edit, read_tracks: TrackReader) -> ReviewState:
    """The state after an edit; IrisError says why it cannot be made."""
    match edit:
        case Tracked():
            tracks = with_edits_of(read_tracks(edit.file), state.tracks)
            return replace(state, tracks=without_ignored(tracks, state.request.ignored))
        case Ignore():
            request = _with_request(state.request, edit)
            return replace(state, request=request, tracks=without_ignored(state.tracks, request.ignored[-1:]))
        case Confirm():
            confirmed = (*state.confirmed, (edit.body, edit.first, edit.last))
            first, last = _joined([part[1:] for part in confirmed if part[0] == edit.body], edit)
            tracks = corrected(state.tracks, edit.model_copy(update={"first": first, "last": last}))
            return replace(state, tracks=tracks, confirmed=confirmed)
        case SearchRegion() | ScaleBar() | BoardCorners() | Point() | PlumbLine() | Mark() | ChoosePhenomenon():
            return replace(state, request=_with_request(state.request, edit))
    return replace(state, tracks=corrected(state.tracks, edit))


def _joined(parts: Sequence[tuple[int, ...]], edit: Confirm) -> tuple[int, int]:
    """First and last frame of all that is confirmed around the frames of an edit without a frame between."""
    first, last = edit.first, edit.last
    for _ in parts:
        near = [part for part in parts if part[0] <= last + 1 and part[1] >= first - 1]
        first, last = min(part[0] for part in near), max(part[1] for part in near)
    return first, last


RequestEdit = SearchRegion | ScaleBar | BoardCorners | Ignore | Point | PlumbLine | Mark | ChoosePhenomenon


def _with_request(request: ReviewRequest, edit: RequestEdit) -> ReviewRequest:
    geometry, tracking = request.geometry, request.tracking
    match edit:
        case SearchRegion():
            return replace(request, tracking=replace(tracking, roi=edit.roi))
        case ScaleBar():
            length = parse_measure(edit.length, LENGTHS, LENGTH_EXAMPLE)
            bar = scale_bar(
                edit.ends[:2],
                edit.ends[2:],
                length.value,
                point_stderr_px=edit.sigma_px,
                length_stderr_m=length.stderr,
            )
            return replace(request, calibration=bar, geometry=replace(geometry, scale_from_gravity=None))
        case BoardCorners():
            plane = _plane(edit)
            return replace(request, calibration=plane, geometry=replace(geometry, scale_from_gravity=None))
        case Ignore():
            mark = TrackMark("", edit.x, edit.y, edit.frame)
            return replace(request, ignored=(*request.ignored, mark))
        case Point():
            marks = {name: at for name, at in geometry.marks_px.items() if name != edit.name}
            marks |= {} if edit.at is None else {edit.name: edit.at}
            return replace(request, geometry=replace(geometry, marks_px=marks))
        case PlumbLine():
            return replace(request, geometry=replace(geometry, plumb_px=edit.ends))
        case Mark():
            mark = TrackMark(edit.body, edit.x, edit.y, edit.frame)
            others = [old for old in tracking.marks if (old.body, old.frame) != (mark.body, mark.frame)]
            return replace(request, tracking=replace(tracking, marks=(*others, mark)))
        case ChoosePhenomenon():
            return replace(request, phenomenon=PHENOMENA[edit.name])


def _plane(edit: BoardCorners) -> Calibration:
    """The plane of motion by the four corners and the size as typed."""
    squares = SQUARES.fullmatch(edit.size.strip())
    if squares is None:
        texts = SIDES.split(edit.size.strip())
        if len(texts) != 2:
            raise DataError(f"the size must be like {SIZE_EXAMPLE}, not {edit.size!r}")
        width, height = (parse_measure(text, LENGTHS, LENGTH_EXAMPLE) for text in texts)
    else:
        side = parse_measure(squares["side"], LENGTHS, LENGTH_EXAMPLE)
        width, height = (Measure(int(squares[n]) * side.value, int(squares[n]) * side.stderr, "m") for n in ("n", "m"))
    return plane_from_rectangle(
        np.reshape(edit.corners, (4, 2)),
        width.value,
        height.value,
        corner_stderr_px=edit.sigma_px,
        width_stderr_m=width.stderr,
        height_stderr_m=height.stderr,
    )


class History:
    """The edits made, and the state after those that are not undone.

    Attributes
    ----------
    state
        After the edits that count.
    version
        Number of changes so far: every edit, undo and redo is one.
    """

    def __init__(self, start: ReviewState, read_tracks: TrackReader) -> None:
        self.state = start
        self.version = 0
        self._start, self._read = start, read_tracks
        self._edits: list[Edit] = []
        self._count = 0  # edits that count; those after are undone

    @property
    def edits(self) -> list[Edit]:
        """The edits that count, the first one first."""
        return self._edits[: self._count]

    @property
    def can_undo(self) -> bool:
        """Whether there is an edit to undo; the first tracks are not one, as nothing would be left."""
        return self._count > 0 and not (self._count == 1 and isinstance(self._edits[0], Tracked))

    @property
    def can_redo(self) -> bool:
        """Whether an edit was undone, and none made since."""
        return self._count < len(self._edits)

    def tried(self, entry: Entry) -> ReviewState:
        """The state that an entry leads to; nothing changes. IrisError says why it cannot be made."""
        if entry.what == "edit" and entry.edit is not None:
            return after(self.state, entry.edit, self._read)
        if entry.what == "undo":
            if not self.can_undo:
                raise DataError("there is nothing to undo")
            return self._replayed(self._edits[: self._count - 1])
        if entry.what == "redo":
            if not self.can_redo:
                raise DataError("there is nothing to redo")
            return after(self.state, self._edits[self._count], self._read)
        return self.state

    def made(self, entry: Entry, state: ReviewState) -> None:
        """Take over the ``state`` that :meth:`tried` gave for the ``entry``."""
        if entry.what == "edit" and entry.edit is not None:
            self._edits = [*self.edits, entry.edit]
            self._count += 1
        self._count += {"undo": -1, "redo": 1}.get(entry.what, 0)
        self.version += entry.what != "save"
        self.state = state

    def _replayed(self, edits: Iterable[Edit]) -> ReviewState:
        state = self._start
        for edit in edits:
            state = after(state, edit, self._read)
        return state
