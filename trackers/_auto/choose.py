"""The choice among the ways to follow a clip: the one whose tracks are most probably on their bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from iris_sysid.errors import TrackingError
from iris_sysid.registry import TRACKERS
from iris_sysid.types import FrameSource, Track, TrackCandidate, TrackOptions
from trackers._auto.candidates import LED, TrackingStrategy, check_marks, marks_by_body, way_by_marks, ways_by_looks
from trackers._auto.evidence import lost_rows, missed_marks, two_on_one
from trackers._auto.fill_gaps import with_gaps_filled, with_marks
from trackers._auto.sampled_once import SampledOnce
from trackers._auto.scene import SampledScene
from trackers._auto.verdict import OF_WAYS, PROBABILITY, judged, largest_probability
from trackers._auto.verdict_weights import DOUBTFUL, SURE
from trackers._frames.working_image import view_of
from trackers._linking.moving_bodies import MovingBodies, follow, is_apart, is_marked
from trackers._tracklets.frame_to_frame import Tracklet

SAMPLES = 40  # as many as the background is made of
MAX_BODIES = 3  # more bodies are too alike to be followed by appearance
MAX_WAYS, NEXT = 3, 2  # ways by appearance; further objects that move before the still background
LIKELY = 0.5  # probability of a candidate that is rather right than wrong
ALIKE = 0.02  # a smaller difference of probabilities does not tell the better one
SAME = 0.5  # of the common frames: two tracks that are in one place more often are of one body
FIRST, FILLED = "median-background", ", gaps by appearance"  # the first way; ends the name of one with its gaps filled


@dataclass(eq=False)
class TrackerSelection:
    """The search for the tracks that are most probably on their bodies."""

    video: SampledOnce
    options: TrackOptions
    scene: SampledScene
    candidates: list[TrackCandidate] = field(default_factory=list)
    _moving: MovingBodies | None = None

    @classmethod
    def of(cls, video: FrameSource, options: TrackOptions) -> TrackerSelection:
        """The choice for a clip."""
        once = SampledOnce(video)
        return cls(once, options, SampledScene(view_of(video, options), once.sample(SAMPLES)))

    @property
    def by_appearance(self) -> bool:
        """Whether the bodies may be followed by appearance: not those of a mask, nor many that look alike."""
        return self.options.mask is None and (self.options.bodies <= MAX_BODIES or bool(self.options.marks))

    def attempt(self, way: TrackingStrategy) -> TrackCandidate:
        """Follow the bodies in one way, and judge the tracks."""
        try:
            tracks = self.named_by_marks(way.follow())
        except TrackingError as error:
            candidate = TrackCandidate(way.name, (), str(error))
        else:
            candidate = TrackCandidate(way.name, tuple(self._judged(track, tracks, way.against) for track in tracks))
        self.candidates.append(candidate)
        return candidate

    def _judged(self, track: Track, tracks: Sequence[Track], against: tuple[str, ...]) -> Track:
        others = [other for other in tracks if other is not track]
        return replace(track, quality=judged(track, self.scene, others, self.options.marks, against))

    def best(self) -> TrackCandidate:
        """The candidate that is most probable; beside marks, the most complete one of those about as probable."""
        trusted = [each for each in self.candidates if not contradicted(each, self.candidates)]
        best = max(trusted, key=probability)
        alike = [each for each in trusted if probability(each) >= probability(best) - ALIKE]
        return max(alike, key=found_share) if self.options.marks else best

    def best_filled(self) -> TrackCandidate:
        """The best candidate with its gaps filled, where it has any and :func:`no_worse_filled`."""
        best = self.best()
        if not self.by_appearance or not _has_gaps(best) or best.name.endswith(FILLED):
            return best
        filled = self.attempt(self.filled(best))
        return filled if no_worse_filled(probability(best), probability(filled)) else best

    def surpasses(self, way: TrackingStrategy) -> bool:
        """Whether a candidate is at least as probable as the tracks of a way can be, by the evidence that it brings."""
        return any(probability(candidate) >= largest_probability(way.against) for candidate in self.candidates)

    def first(self) -> list[Track]:
        """The bodies that move farthest before the still background."""
        moving = follow(self.video, self.options)
        self._moving = moving
        if moving.setup is not None:
            self.scene.known = moving.setup.still
            self.scene.view = replace(self.scene.view, colour=moving.setup.view.colour)
        return moving.tracks("auto", self.options)

    def at_marks(self) -> list[Track]:
        """The bodies that move before the still background and pass the marks."""
        return self._moving_among(partial(is_marked, self.options.marks))

    def next_best(self) -> list[Track]:
        """What moves before the still background beside all that was tried."""
        return self._moving_among(partial(is_apart, [track for one in self.candidates for track in one.tracks]))

    def _moving_among(self, meant: Callable[[Tracklet], bool]) -> list[Track]:
        if self._moving is None:
            raise TrackingError("nothing is followed before the still background")
        return self._moving.among(self.video, self.options, meant).tracks("auto", self.options)

    def filled(self, candidate: TrackCandidate) -> TrackingStrategy:
        """The tracks of a candidate with their gaps filled by the appearance of the bodies."""
        tracks = candidate.tracks
        others = [[other for other in tracks if other is not track] for track in tracks]
        return TrackingStrategy(
            candidate.name + FILLED,
            lambda: [with_gaps_filled(self.video, self.scene, *pair) for pair in zip(tracks, others, strict=True)],
            brought_along(candidate),
        )

    def named_by_marks(self, tracks: list[Track]) -> list[Track]:
        """The tracks under the names of the marks that they pass best, with those in their gaps."""
        named: list[Track] = []
        check_marks(self.options.marks, tracks[0].frame, (self.video.width, self.video.height))
        free = list(tracks)
        for name, marks in marks_by_body(self.options.marks).items():
            if free:
                best = min(free, key=lambda track: len(missed_marks(replace(track, body=name), marks)))
                free.remove(best)
                named.append(with_marks(replace(best, body=name), marks))
        return named if self.options.marks else tracks


def probability(candidate: TrackCandidate) -> float:
    """The probability that the track of a candidate which is least sure is on its body; -1 where there is none."""
    return min(
        (track.quality.evidence[PROBABILITY] for track in candidate.tracks if track.quality is not None), default=-1.0
    )


def no_worse_filled(as_it_was: float, filled: float) -> bool:
    """Whether a track of some probability is to be taken with its gaps filled: not where that raises a doubt."""
    return filled >= min(DOUBTFUL, as_it_was - ALIKE)


def brought_along(candidate: TrackCandidate) -> tuple[str, ...]:
    """The evidence that a candidate brings with it by the way of following its bodies."""
    known = [track.quality.evidence for track in candidate.tracks if track.quality is not None]
    return tuple(name for name in OF_WAYS if any(evidence[name] for evidence in known))


def found_share(candidate: TrackCandidate) -> float:
    """The share of the frames in which the bodies are found; 0 where there is no track."""
    return min((track.n_valid / track.valid.size for track in candidate.tracks), default=0.0)


def contradicted(candidate: TrackCandidate, others: Sequence[TrackCandidate]) -> bool:
    """Whether marks lead a candidate elsewhere than a likely one goes that passes them without being led.

    A path that marks lead passes them whatever it is on otherwise, so that passing them is not evidence for it.
    """
    likely = [other for other in others if other.name != LED and probability(other) > LIKELY]
    apart = [
        two_on_one(same, [track]) < SAME
        for other in likely
        for track in candidate.tracks
        for same in other.tracks
        if same.body == track.body
    ]
    return candidate.name == LED and any(apart)


def choose(video: FrameSource, options: TrackOptions) -> tuple[TrackCandidate, list[TrackCandidate]]:
    """The candidate that is taken, and all that were tried: none after one that is sure, unless ``explain`` asks.

    Nor, unless it asks, is a way that cannot be more probable than one before it.

    Raises
    ------
    TrackingError
        When no way follows the bodies, as the first of them says it.
    DataError, UnknownNameError
        When the options do not fit the clip.
    """
    options = replace(options, bodies=max(options.bodies, len(marks_by_body(options.marks))))
    choice = TrackerSelection.of(video, options)
    for way in _ways(choice):
        if options.explain is None and choice.surpasses(way):
            continue
        if probability(choice.attempt(way)) >= SURE and options.explain is None and way.name != LED:
            break
    best = choice.best_filled()
    if not best.tracks:
        raise TrackingError(choice.candidates[0].refusal)
    if options.explain is not None:
        options.explain([replace(candidate, chosen=candidate is best) for candidate in choice.candidates])
    return best, choice.candidates


def _ways(choice: TrackerSelection) -> Iterator[TrackingStrategy]:
    """The ways that suit the options; later ones are prepared only when they are needed."""
    video, options, scene = choice.video, choice.options, choice.scene
    yield TrackingStrategy(FIRST, choice.first)
    if not choice.by_appearance:
        return
    if options.marks:
        yield way_by_marks(video, scene, options)
        yield TrackingStrategy("path-at-marks", choice.at_marks)
    if _has_gaps(choice.candidates[-1]):
        yield choice.filled(choice.candidates[-1])
    if options.marks:
        return
    if options.bodies == 1:
        yield from [TrackingStrategy(f"{FIRST}-{k}", choice.next_best, ("beside",)) for k in range(2, 2 + NEXT)]
    moving = bool(choice.candidates[0].tracks)
    for tracker in TRACKERS.values():
        if tracker.suits is not None and tracker.suits(video, options, moving):
            yield TrackingStrategy(tracker.name, partial(tracker.track, video, options))
    yield from ways_by_looks(video, scene, options)[:MAX_WAYS]


def _has_gaps(candidate: TrackCandidate) -> bool:
    """Whether a body is neither found nor held in some frames."""
    return any(lost_rows(track).any() for track in candidate.tracks)
