"""Detection in every frame of a clip: the background from sampled frames first, then the candidates of each frame."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile

import cv2
import numpy as np

from iris_sysid.types import Frame, FrameSource, TrackOptions, check_count, with_progress
from trackers._background.median import (
    Background,
    BackgroundEstimate,
    estimate_again,
    estimate_background,
    noise_inflation,
    with_unseen,
)
from trackers._detection.background_samples import usable_samples
from trackers._detection.coded_planes import plane_limits_of
from trackers._detection.connected import filled_round
from trackers._detection.detection import MIN_INSCRIBED, BlobDetector, Detection, FrameCandidates, FrameDetections
from trackers._detection.foreground import BackgroundRange, background_range_of, blobs
from trackers._detection.search_window import SearchWindows, sparse_range_of
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes, Flags, Image
from trackers._frames.sampled_frames import SampledFrames
from trackers._frames.working_image import WorkingView

SAMPLES = 40  # frames from which the background is made, fewer of a large clip
MISSED_BY_LUMA = 0.1  # share of the moving pixels that luma misses, above which colour is used too
SHADED = 0.3  # of the body's area is added to it by luma: its shadow
VIVID = 4.0  # times the noise: least colour difference from the background
MIN_FRAMES_SHARE = 0.5  # of the sampled frames
LARGE_ENOUGH, SPECKS = 12.0, 10  # px, inscribed radius at half the usual size; % of the blobs that may be smaller
AROUND = np.ones((5, 5), np.uint8)  # px about moving bodies: two more than their edge
MIN_COLOURED = 20  # px that must move in colour for a frame to count
REPORT_EVERY = 10  # frames between two calls of the progress function
Likely = Callable[[FrameDetections], Sequence[bool]]  # which detections of a frame are to be measured


@dataclass(frozen=True, eq=False, slots=True)
class DetectionSetup:
    """Setup from the sampled frames: the view, the background range for the search, the detector for centroids.

    ``still`` is the first background at the size of the search; None where colour is not searched. ``unseen`` and
    ``rest`` are as in :class:`trackers._detection.background_samples.UsableSamples`.
    """

    view: WorkingView
    background_range: BackgroundRange
    detector: BlobDetector
    stack: SampledFrames
    search_images: Bytes
    still: BackgroundEstimate | None = None
    unseen: Image | None = None
    rest: Flags | None = None

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the sampled frames: ``stack`` is of full size, ``search_images`` (k, h', w') reduced."""
        return tuple(frame.index for frame in self.stack.frames)

    def with_background_from(self, usable: Flags) -> DetectionSetup:
        """The same setup with the background from those samples (k, h', w') that may be used."""
        known = self.detector.background.reduced(self.view.step)
        estimate = (
            estimate_background(self.search_images, usable)
            if known.whole is None
            else estimate_again(self.search_images, known.whole, known.usable, usable)
        )
        estimate = with_unseen(estimate, self.unseen)
        return replace(
            self,
            background_range=background_range_of(estimate),
            detector=replace(self.detector, background=background_of(self.stack, estimate, usable, self.unseen)),
        )

    def search_windows(self) -> SearchWindows:
        """The search windows of this clip, for its frames in order."""
        return SearchWindows(
            self.view,
            self.background_range,
            sparse_range_of(self.stack, self.background_range, self.detector.background.usable),
            plane_limits_of(self.view, self.stack.frames[0], self.background_range),
        )


def background_of(
    samples: SampledFrames, estimate: BackgroundEstimate, usable: Flags | None, unseen: Image | None = None
) -> Background:
    """The background at full size, from that at the size of the search.

    Parameters
    ----------
    samples
        The sampled frames.
    estimate
        At the size of the search.
    usable, unseen
        The samples (k, h', w') that show the background, and the background (h', w') or (h', w', 3), grey levels, where
        none does.
    """
    step = samples.view.step
    if step == 1:
        return Background(samples, usable, estimate)
    return Background(samples, usable, None, unseen, {step: Background(samples.reduced(step), usable, estimate)})


def detection_setup(video: FrameSource, view: WorkingView, coarse: bool = False) -> DetectionSetup:
    """Background, noise and bounds from frames sampled over the clip; VideoError when there are too few.

    With ``coarse`` an image whose bodies are large is searched at half the usual size.
    """
    samples = video.sample(SAMPLES)
    check_count(len(samples), "the background")
    if coarse and _shows_large(half := replace(view, coarser=2), samples[::2]):
        view = half
    search_images = np.stack([view.with_chroma().search_image(frame) for frame in samples])
    known = None if view.chroma or view.step > 1 else estimate_background(search_images)
    if view.chroma or luma_misses(search_images[::2], known):  # half of them tell as much
        view, estimate = view.with_chroma(), known or estimate_background(search_images)
    else:
        search_images = np.ascontiguousarray(search_images[..., 0])
        estimate = known.channel(0) if known else estimate_background(search_images)
    stack = SampledFrames(samples, view)
    detector = BlobDetector(background_of(stack, estimate, None), view, noise_inflation(search_images, estimate))
    setup = DetectionSetup(view, background_range_of(estimate), detector, stack, search_images)
    usable, unseen, rest = usable_samples(search_images, estimate)
    if usable is not None:
        setup = replace(setup, unseen=unseen, rest=rest).with_background_from(usable)
    moving = [_covered(setup.background_range, image) for image in search_images] if view.colour is not None else []
    still = setup.detector.background.reduced(view.step).whole if view.chroma else None
    return replace(setup, view=view.fitted(samples, moving), still=still)


def _shows_large(view: WorkingView, samples: Sequence[Frame]) -> bool:
    """Whether the moving bodies, all but a few specks, are large at the search size of this view."""
    stack = np.stack([view.with_chroma().search_image(frame) for frame in samples])
    background_range = background_range_of(estimate_background(stack))
    seen = ahead(partial(blobs, background_range), stack)
    moving = [blob.inscribed for image_blobs in seen for blob in image_blobs if not blob.held]
    bodies = [inscribed for inscribed in moving if inscribed > MIN_INSCRIBED]
    return len(bodies) > MIN_FRAMES_SHARE * len(stack) and float(np.percentile(bodies, SPECKS)) > LARGE_ENOUGH


def luma_misses(stack: Bytes, known: BackgroundEstimate | None = None) -> bool:
    """Whether the search needs colour too: where luma shows a body badly, not at all, or with its shadow.

    A green ball on a wall as bright as it is such a case: in luma it is mostly shade, and its centre
    that of the lit side. A ball whose shadow on the wall touches it is another: luma shows both as one. A search
    in colour takes longer. ``stack`` (k, h, w, 3) are sampled images, ``known`` their background where it is known.
    """
    estimate = known or estimate_background(stack)
    background_range, luma_range = background_range_of(estimate), background_range_of(estimate.channel(0))
    seen = [evidence for evidence in ahead(partial(_in_colour, background_range, luma_range), stack) if evidence]
    if not seen:
        return False
    missed, in_luma, in_colour, shaded = np.array(seen).T
    if np.percentile(missed, 90) > MISSED_BY_LUMA or np.mean(in_colour > in_luma) > MIN_FRAMES_SHARE:
        return True
    vivid = len(seen) > MIN_FRAMES_SHARE * len(stack) and np.median(in_colour) > VIVID
    return bool(vivid and np.median(shaded) > SHADED)


def _in_colour(
    background_range: BackgroundRange, luma_range: BackgroundRange, image: Bytes
) -> tuple[float, float, float, float] | None:
    """What moves in colour: the share that luma misses, how far it stands out in luma and colour, what luma adds.

    None where nothing does.
    """
    excess = background_range.excess(image) > background_range.strong
    strong = cv2.morphologyEx((excess[..., 1] | excess[..., 2]).astype(np.uint8), cv2.MORPH_OPEN, AROUND)
    area = np.count_nonzero(strong)
    if area < MIN_COLOURED:
        return None
    in_luma = _covered(luma_range, np.ascontiguousarray(image[..., 0]))
    whole = filled_round(in_luma.astype(np.uint8), strong)
    beside = np.count_nonzero(whole > cv2.dilate(strong, AROUND))
    missed = np.count_nonzero(strong > in_luma) / area
    return missed, *_standing_out(background_range, image, strong > 0), beside / area


def _standing_out(background_range: BackgroundRange, image: Bytes, moving: Flags) -> tuple[float, float]:
    """Contrast of luma and chroma over the least contrast of a body, over most of the moving pixels."""
    excess = background_range.excess(image)[moving].astype(np.float64) / background_range.strong[moving]
    return float(np.median(excess[:, 0])), float(np.median(excess[:, 1:].max(axis=1)))


def _covered(background_range: BackgroundRange, image: Bytes) -> Flags:
    """True where a body of the foreground lies, or within two pixels of it."""
    covered = np.zeros(image.shape[:2], dtype=np.uint8)
    for blob in blobs(background_range, image):
        left, top, right, bottom = blob.box
        covered[top:bottom, left:right] |= blob.mask
    return cv2.dilate(covered, AROUND) > 0


def observe(
    video: FrameSource, setup: DetectionSetup, options: TrackOptions, likely: Likely | None = None
) -> list[FrameDetections]:
    """The candidates of every frame, in one pass.

    Parameters
    ----------
    video, setup
        The clip and what its samples show.
    options
        ``progress`` is called every ten frames.
    likely
        Called with the rough detections of each frame, in order, says which of them are measured; None: all.
    """
    frames = with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY)
    chosen = _chosen(setup, frames, likely or (lambda seen: [True] * len(seen.detections)))
    return list(ahead(lambda found: setup.detector.measured(*found), chosen))


def _chosen(
    setup: DetectionSetup, frames: Iterable[Frame], likely: Likely
) -> Iterator[tuple[FrameCandidates, Sequence[bool], Sequence[Detection]]]:
    """Candidate bodies of successive frames, which of them are likely, and the detections of the frame before."""
    before: Sequence[Detection] = ()
    for found in setup.search_windows().candidates(setup.detector, frames):
        yield found, likely(FrameDetections(found.frame.index, found.frame.t_s, found.detections, ())), before
        before = found.detections


def measure_rough(
    video: FrameSource, setup: DetectionSetup, rough: Collection[Detection]
) -> dict[Detection, Detection | None]:
    """Measure the detections that :func:`observe` left rough; None for one that the edge cuts.

    The clip is read again up to the last of them.
    """
    last = max((detection.frame for detection in rough), default=-1)

    def each(
        found: FrameCandidates, which: Sequence[bool], before: Sequence[Detection]
    ) -> list[tuple[Detection, Detection | None]]:
        seen = setup.detector.each_measured(found, which, before)
        return [pair for pair, wanted in zip(zip(found.detections, seen, strict=True), which, strict=True) if wanted]

    frames = takewhile(lambda frame: frame.index <= last, video.frames()) if rough else ()
    chosen = _chosen(setup, frames, lambda seen: [detection in rough for detection in seen.detections])
    return dict(pair for pairs in ahead(lambda found: each(*found), chosen) for pair in pairs)
