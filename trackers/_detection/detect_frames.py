"""Look at every frame of a clip once: background first, then the candidates of each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, TrackOptions, with_progress
from trackers._background.background_samples import usable_samples
from trackers._background.median import Background, Bytes, Flags, Still, noise_inflation, still_of
from trackers._detection.detection import THINNEST_BODY, Glimpse, Lens
from trackers._detection.foreground import Scene, cores, scene_of
from trackers._detection.search_window import Attention, watch_of
from trackers._detection.subpixel_centroid import filled_round
from trackers._frames.sampled_frames import Samples
from trackers._frames.working_image import View

SAMPLES = 40  # frames from which the background is made, fewer of a large clip
MISSED_BY_LUMA = 0.1  # of what moves in colour: from here on colour is looked at too
SHADED = 0.3  # of the body's area is added to it by luma: its shadow
VIVID = 4.0  # times what is noise: so far from the background must its colour be
MOSTLY = 0.5  # of the frames
LARGE_ENOUGH, SPECKS = 12.0, 10  # px, inscribed radius at half the usual size; % of what moves that may be smaller
AROUND = np.ones((5, 5), np.uint8)  # px about what moves: two more than its edge
FEWEST_COLOURED = 20  # px that must move in colour for a frame to count
REPORT_EVERY = 10  # frames between two calls of the progress function


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What was learnt from the sampled frames: the view, the scene that is searched, the lens that measures."""

    view: View
    scene: Scene
    lens: Lens
    stack: Samples
    smalls: Bytes

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the frames that were sampled: ``stack`` at full size, ``smalls`` (k, h', w') as searched."""
        return tuple(frame.index for frame in self.stack.frames)

    def behind(self, usable: Flags) -> Stage:
        """The same stage with the background from those samples (k, h', w') that may be used."""
        still = still_of(self.smalls, usable)
        return replace(
            self, scene=scene_of(still), lens=replace(self.lens, background=background_of(self.stack, still, usable))
        )

    def attention(self) -> Attention:
        """What looks for bodies in the frames of the clip, one after the other."""
        return Attention(self.view, self.scene, watch_of(self.stack, self.scene, self.lens.background.usable))


def background_of(samples: Samples, still: Still, usable: Flags | None) -> Background:
    """The background at full size, where ``still`` is that at the size that is searched."""
    step = samples.view.step
    if step == 1:
        return Background(samples, usable, still)
    return Background(samples, usable, None, {step: Background(samples.reduced(step), usable, still)})


def stage_of(video: FrameSource, view: View, coarse: bool = False) -> Stage:
    """Background, noise and bounds from frames sampled over the clip; TrackingError when there are too few.

    With ``coarse`` a large picture whose bodies are large is searched at half the usual size.
    """
    samples = video.sample(SAMPLES)
    if len(samples) < 3:
        raise TrackingError(
            f"the clip has {len(samples)} frame(s): motion shows against a background that takes at least 3"
        )
    if coarse and view.step > 1 and _shows_large(half := replace(view, coarser=2), samples):
        view = half
    smalls = np.stack([view.with_chroma().searched(frame) for frame in samples])
    if view.chroma or luma_misses(smalls[:: 1 if view.step == 1 else 2]):  # fewer tell as much of large pictures
        view = view.with_chroma()
    else:
        smalls = np.ascontiguousarray(smalls[..., 0])
    stack, still = Samples(samples, view), still_of(smalls)
    lens = Lens(background_of(stack, still, None), view, noise_inflation(smalls, still))
    stage = Stage(view, scene_of(still), lens, stack, smalls)
    usable = usable_samples(smalls, still)
    if usable is not None:
        stage = stage.behind(usable)
    moving = [_covered(stage.scene, picture) for picture in smalls] if view.colour is not None else []
    return replace(stage, view=view.fitted(samples, moving))


def _shows_large(view: View, samples: Sequence[Frame]) -> bool:
    """Whether what moves is large at the size at which this view is searched, all but a few specks."""
    stack = np.stack([view.with_chroma().searched(frame) for frame in samples])
    scene = scene_of(still_of(stack))
    moving = [core.inscribed for picture in stack for core in cores(scene, picture) if not core.held]
    bodies = [inscribed for inscribed in moving if inscribed > THINNEST_BODY]
    return len(bodies) > MOSTLY * len(stack) and float(np.percentile(bodies, SPECKS)) > LARGE_ENOUGH


def luma_misses(stack: Bytes) -> bool:
    """Whether colour must be looked at too: where luma shows a body badly, not at all, or with its shadow.

    A green ball on a wall as bright as it is such a case: what luma shows of it is mostly shade, and its centre
    that of the lit side. A ball whose shadow on the wall touches it is another: luma shows both as one. Looking at
    colour takes longer. ``stack`` (k, h, w, 3) are sampled pictures.
    """
    still = still_of(stack)
    scene, luma_scene = scene_of(still), scene_of(still.channel(0))
    seen = [one for picture in stack if (one := _in_colour(scene, luma_scene, picture)) is not None]
    if not seen:
        return False
    missed, in_luma, in_colour, shaded = np.array(seen).T
    if np.percentile(missed, 90) > MISSED_BY_LUMA or np.mean(in_colour > in_luma) > MOSTLY:
        return True
    vivid = len(seen) > MOSTLY * len(stack) and np.median(in_colour) > VIVID
    return bool(vivid and np.median(shaded) > SHADED)


def _in_colour(scene: Scene, luma_scene: Scene, picture: Bytes) -> tuple[float, float, float, float] | None:
    """What moves in colour: the share that luma misses, how far it stands out in luma and colour, what luma adds.

    None where nothing does.
    """
    excess = scene.excess(picture) > scene.strong
    strong = cv2.morphologyEx((excess[..., 1] | excess[..., 2]).astype(np.uint8), cv2.MORPH_OPEN, AROUND)
    area = np.count_nonzero(strong)
    if area < FEWEST_COLOURED:
        return None
    in_luma = _covered(luma_scene, np.ascontiguousarray(picture[..., 0]))
    whole = filled_round(in_luma.astype(np.uint8), strong)
    beside = np.count_nonzero(whole > cv2.dilate(strong, AROUND))
    missed = np.count_nonzero(strong > in_luma) / area
    return missed, *_standing_out(scene, picture, strong > 0), beside / area


def _standing_out(scene: Scene, picture: Bytes, moving: Flags) -> tuple[float, float]:
    """How far luma and chroma stand above what they must for a body, times that, over most of what moves."""
    excess = scene.excess(picture)[moving].astype(np.float64) / scene.strong[moving]
    return float(np.median(excess[:, 0])), float(np.median(excess[:, 1:].max(axis=1)))


def _covered(scene: Scene, picture: Bytes) -> Flags:
    """True where a body of the foreground lies, or within two pixels of it."""
    covered = np.zeros(picture.shape[:2], dtype=np.uint8)
    for core in cores(scene, picture):
        left, top, right, bottom = core.box
        covered[top:bottom, left:right] |= core.mask
    return cv2.dilate(covered, AROUND) > 0


def observe(video: FrameSource, stage: Stage, options: TrackOptions) -> list[Glimpse]:
    """The candidates of every frame, in one pass; ``options.progress`` is told how far it is."""
    glimpses: list[Glimpse] = []
    attention = stage.attention()
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        before = glimpses[-1].sightings if glimpses else ()
        glimpses.append(stage.lens.glimpse(frame, *attention.cores(frame), before))
    return glimpses
