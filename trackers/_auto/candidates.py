"""The trackers and settings that suit a clip, each as a function that follows its bodies."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
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
from trackers._frames.arrays import Bytes

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
    bodies = [replace(body_like(kind, scene), name=str(k)) for k, kind in enumerate(kinds, start=1)]
    return follow_appearance(video, scene.view, bodies, options)


def _count(kind: ObjectClass) -> int:
    """How many objects of a kind are usually seen at once."""
    return max(1, round(len(kind.seen) / len(kind.samples)))


def body_like(kind: ObjectClass, scene: SampledScene) -> Body:
    """A body that looks like the objects of a kind, seen in the samples of a scene."""
    of_sample: dict[int, Place] = {sighting.sample: (sighting.x, sighting.y) for sighting in kind.seen}
    radius = max(MIN_RADIUS, LEARNED * float(kind.typical("inscribed")))
    shown = [scene.images[k] for k in of_sample]
    return Body("1", BodyAppearance.learned(shown, list(of_sample.values()), radius, scene.still), {})


def way_by_marks(video: FrameSource, scene: SampledScene, options: TrackOptions) -> TrackingStrategy:
    """Following the bodies at the marks; DataError when not every body is, or a mark is not in the clip."""
    marks = marks_by_body(options.marks)
    if len(marks) < options.bodies:
        raise DataError(f"{options.bodies} bodies were requested, but {len(marks)} are marked; mark each, or none")
    left, top, right, bottom = scene.view.box
    for mark in options.marks:
        if not (left <= mark.x_px < right and top <= mark.y_px < bottom):
            place = f"{mark.body}={mark.x_px:g},{mark.y_px:g}@{mark.frame}"
            raise DataError(f"the mark {place} does not lie in the region x={left}..{right}, y={top}..{bottom}")
    bodies = partial(_marked_bodies, video, scene, marks)
    return TrackingStrategy(LED, lambda: follow_appearance(video, scene.view, bodies(), options))


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
        if not (0 <= mark.x_px < size[0] and 0 <= mark.y_px < size[1]):
            raise DataError(f"the mark {mark.body}={mark.x_px:g},{mark.y_px:g}@{mark.frame} does not lie in the image")


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
