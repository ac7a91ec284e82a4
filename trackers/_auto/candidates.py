"""The trackers and settings that suit a clip, each as a function that follows its bodies."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import FrameSource, Track, TrackMark, TrackOptions
from trackers._auto.appearance import search_image
from trackers._auto.body_appearance import BodyAppearance
from trackers._auto.follow_appearance import Body, follow_appearance
from trackers._auto.marked_size import MIN_RADIUS, size_at
from trackers._auto.scene import Place, SampledScene
from trackers._auto.survey import ObjectClass
from trackers._frames.arrays import Box, Bytes

LEARNED = 0.8  # of the inscribed radius at the size of the search, which includes the blurred outline
LED = "marks"  # the way whose paths are bound to the marks


@dataclass(frozen=True, eq=False, slots=True)
class TrackingStrategy:
    """One way to follow the bodies of a clip: its name, and the function that does it.

    ``against`` are the names of evidence that it brings with it, of :data:`trackers._auto.verdict.OF_WAYS`.
    """

    name: str
    follow: Callable[[], list[Track]]
    against: tuple[str, ...] = ()


def ways_by_looks(video: FrameSource, scene: SampledScene, options: TrackOptions) -> list[TrackingStrategy]:
    """Following the likeliest objects that move, by appearance: as many of each kind as are seen at once."""
    kinds = [kind for kind in scene.kinds for _ in range(min(_count(kind), options.bodies))]
    return [
        TrackingStrategy(
            f"appearance-{start + 1}",
            partial(_by_looks, video, scene, kinds[start : start + options.bodies], options),
            ("guessed",),
        )
        for start in range(len(kinds) - options.bodies + 1)
    ]


def _by_looks(
    video: FrameSource, scene: SampledScene, kinds: Sequence[ObjectClass], options: TrackOptions
) -> list[Track]:
    """The tracks of one body of each of the kinds."""
    appearances = [BodyAppearance.learned(*sightings_of(kind, scene), scene.still) for kind in kinds]
    bodies = [Body(str(k), appearance, {}) for k, appearance in enumerate(appearances, start=1)]
    return follow_appearance(video, scene.view, bodies, options)


def _count(kind: ObjectClass) -> int:
    """How many objects of a kind are usually seen at once."""
    return max(1, round(len(kind.seen) / len(kind.samples)))


def sightings_of(kind: ObjectClass, scene: SampledScene) -> tuple[list[Bytes], list[Place], float]:
    """The samples (h, w, 3) that show objects of a kind, where (x, y) they are in them, and their radius, all in px."""
    of_sample: dict[int, Place] = {sighting.sample: (sighting.x, sighting.y) for sighting in kind.seen}
    radius = max(MIN_RADIUS, LEARNED * float(kind.typical("inscribed")))
    return [scene.images[k] for k in of_sample], list(of_sample.values()), radius


def way_by_marks(video: FrameSource, scene: SampledScene, options: TrackOptions) -> TrackingStrategy:
    """Following the bodies at the marks; DataError when not every body is, or a mark is not in the clip."""
    marks = marks_by_body(options.marks)
    if len(marks) < options.bodies:
        raise DataError(f"{options.bodies} bodies were requested, but {len(marks)} are marked; mark each, or none")
    left, top, right, bottom = scene.view.box
    for mark in options.marks:
        _check_inside(mark, scene.view.box, f"the region x={left}..{right}, y={top}..{bottom}")
    return TrackingStrategy(LED, partial(_at_marks, video, scene, marks, options))


def _at_marks(
    video: FrameSource, scene: SampledScene, marks: dict[str, list[TrackMark]], options: TrackOptions
) -> list[Track]:
    """The tracks of the bodies at the marks."""
    return follow_appearance(video, scene.view, _marked_bodies(video, scene, marks), options)


def marks_by_body(marks: Sequence[TrackMark]) -> dict[str, list[TrackMark]]:
    """The marks of each body, in the order in which bodies are first named."""
    of_body: dict[str, list[TrackMark]] = defaultdict(list)
    for mark in marks:
        of_body[mark.body].append(mark)
    return dict(of_body)


def check_marks(marks: Sequence[TrackMark], frames: Collection[int], size: tuple[int, int]) -> None:
    """DataError for a mark that is in none of the ``frames``, or not in an image of that ``size`` (px)."""
    known = {int(number) for number in frames} if marks else set()
    for mark in marks:
        if mark.frame not in known:
            raise DataError(f"there is a mark in frame {mark.frame}, which is not in the clip, or not in the part read")
        _check_inside(mark, (0, 0, *size), "the image")


def _check_inside(mark: TrackMark, box: Box, where: str) -> None:
    """DataError for a mark that is not in a box (left, top, right, bottom), px."""
    left, top, right, bottom = box
    if not (left <= mark.x_px < right and top <= mark.y_px < bottom):
        raise DataError(f"the mark {mark.body}={mark.x_px:g},{mark.y_px:g}@{mark.frame} does not lie in {where}")


def _marked_bodies(video: FrameSource, scene: SampledScene, marks: dict[str, list[TrackMark]]) -> list[Body]:
    """The bodies at the marks, learned from the marked frames."""
    wanted = {mark.frame for of_body in marks.values() for mark in of_body}
    images: dict[int, Bytes] = {}
    for frame in video.frames():
        if frame.index in wanted:
            images[frame.index] = search_image(scene.view, frame)
        if len(images) == len(wanted):
            break
    check_marks([mark for of_body in marks.values() for mark in of_body], images, (video.width, video.height))
    return [_marked_body(scene, name, of_body, images) for name, of_body in marks.items()]


def _marked_body(scene: SampledScene, name: str, marks: Sequence[TrackMark], images: dict[int, Bytes]) -> Body:
    """The body at some marks: its appearance is that at the marks, its size that of the region that moves."""
    places = [scene.view.in_search(mark.x_px, mark.y_px) for mark in marks]
    shown = [images[mark.frame] for mark in marks]
    radii = [size_at(image, place, scene.images) for image, place in zip(shown, places, strict=True)]
    known = {mark.frame: (mark.x_px, mark.y_px) for mark in marks}
    return Body(name, BodyAppearance.learned(shown, places, float(np.median(radii)), scene.still), known)
