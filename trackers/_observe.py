"""Look at every frame of a clip once: background first, then the candidates of each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, TrackOptions
from trackers._background import Background, Bytes, Flags, noise_inflation, still_of
from trackers._foreground import Scene, cores, scene_of
from trackers._sighting import Glimpse, Lens
from trackers._uncover import usable_samples
from trackers._view import View

SAMPLES = 40  # frames from which the background is made
FEWER_SAMPLES, LARGE = 25, 4_000_000  # when a frame has so many pixels: they are kept in memory
MISSED_BY_LUMA = 0.1  # of what moves in colour: from here on colour is looked at too
FEWEST_COLOURED = 20  # px that must move in colour for a frame to count
REPORT_EVERY = 10  # frames between two calls of the progress function


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What was learnt from the sampled frames: the view, the scene that is searched, the lens that measures."""

    view: View
    scene: Scene
    lens: Lens
    numbers: tuple[int, ...] = ()

    @property
    def stack(self) -> Bytes:
        """The sampled pictures at full size; ``numbers`` are those of their frames."""
        return self.lens.background.stack

    def behind(self, usable: Flags) -> Stage:
        """The same stage with the background from those samples (k, h', w') that may be used."""
        small = self.view.smalls(self.stack)
        still = still_of(small, usable)
        background = Background(self.stack, usable, still if self.view.step == 1 else None)
        return replace(self, scene=scene_of(still), lens=replace(self.lens, background=background))


def stage_of(video: FrameSource, view: View) -> Stage:
    """Background, noise and bounds from frames sampled over the clip; TrackingError when there are too few."""
    samples = video.sample(SAMPLES if video.width * video.height < LARGE else FEWER_SAMPLES)
    if len(samples) < 3:
        raise TrackingError(
            f"the clip has {len(samples)} frame(s): motion shows against a background that takes at least 3"
        )
    if not view.chroma and luma_misses(view, samples):
        view = view.with_chroma()
    stack = np.stack([view.picture(frame) for frame in samples])
    small = view.smalls(stack)
    still = still_of(small)
    background = Background(stack, None, still if view.step == 1 else None)
    lens = Lens(background, view.step, view.left, view.top, noise_inflation(small, still))
    stage = Stage(view, scene_of(still), lens, tuple(frame.index for frame in samples))
    usable = usable_samples(small, still)
    if usable is not None:
        stage = stage.behind(usable)
    moving = [_covered(stage.scene, picture) for picture in small] if view.colour is not None else []
    return replace(stage, view=view.fitted(samples, moving))


def luma_misses(view: View, samples: Sequence[Frame]) -> bool:
    """Whether what moves in colour shows less in luma, or in a tenth of the frames much of it not at all.

    A green ball on a wall as bright as it is such a case: what luma shows of it is mostly shade, and its centre
    that of the lit side. Looking at colour takes longer.
    """
    coloured = view.with_chroma()
    stack = np.stack([coloured.small(coloured.picture(frame)) for frame in samples])
    still = still_of(stack)
    scene, luma_scene = scene_of(still), scene_of(still.channel(0))
    missed, clearer = [], []
    for picture in stack:
        coloured_excess = scene.excess(picture) > scene.strong
        strong = (coloured_excess[..., 1] | coloured_excess[..., 2]).astype(np.uint8)
        strong = cv2.morphologyEx(strong, cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
        if np.count_nonzero(strong) >= FEWEST_COLOURED:
            in_luma = _covered(luma_scene, np.ascontiguousarray(picture[..., 0]))
            missed.append(np.count_nonzero(strong > in_luma) / np.count_nonzero(strong))
            clearer.append(_clearer_in_colour(scene, picture, strong > 0))
    return bool(missed) and (float(np.percentile(missed, 90)) > MISSED_BY_LUMA or float(np.mean(clearer)) > 0.5)


def _clearer_in_colour(scene: Scene, picture: Bytes, moving: Flags) -> bool:
    """Whether chroma stands farther above its threshold than luma does, over most of what moves."""
    excess = scene.excess(picture)[moving].astype(np.float64) / scene.strong[moving]
    return float(np.median(excess[:, 1:].max(axis=1))) > float(np.median(excess[:, 0]))


def _covered(scene: Scene, picture: Bytes) -> Flags:
    """True where a body of the foreground lies, or within two pixels of it."""
    covered = np.zeros(picture.shape[:2], dtype=np.uint8)
    for core in cores(scene, picture):
        left, top, right, bottom = core.box
        covered[top:bottom, left:right] |= core.mask
    return cv2.dilate(covered, np.ones((5, 5), np.uint8)) > 0


def observe(video: FrameSource, stage: Stage, options: TrackOptions) -> list[Glimpse]:
    """The candidates of every frame, in one pass; ``options.progress`` is told how far it is."""
    glimpses: list[Glimpse] = []
    for frame in video.frames():
        glimpses.append(glimpse_of(stage, frame))
        if options.progress is not None and len(glimpses) % REPORT_EVERY == 0:
            options.progress(len(glimpses), video.n_expected)
    if options.progress is not None:
        options.progress(len(glimpses), video.n_expected)
    return glimpses


def glimpse_of(stage: Stage, frame: Frame) -> Glimpse:
    """The candidates of one frame."""
    picture = stage.view.picture(frame)
    small = stage.view.small(picture)
    things = cores(stage.scene, small)
    wanted = stage.view.wanted(frame)
    bodies = things if wanted is None else cores(stage.scene, small, wanted)
    return stage.lens.glimpse(frame.index, frame.t_s, picture, bodies, things)
