"""The choice among the ways to follow a clip: the first whose track nothing speaks against, else the least doubtful."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.registry import TRACKERS
from iris_sysid.types import Doubt, DoubtKind, Frame, FrameSource, Track, TrackCandidate, TrackOptions, TrackQuality
from trackers._auto.appearance import search_image
from trackers._auto.candidates import Way, check_marks, marks_by_body, way_by_marks, ways_by_looks
from trackers._auto.evidence import LEAST_COVERAGE, MOST_SHADOW, held_doubt, judged, measured, missed_marks, passes
from trackers._auto.fill_gaps import Place, known_looks, sampled_places, with_gaps_filled
from trackers._auto.receding_disc import not_followed, receding_disc
from trackers._auto.sampled_once import SampledOnce
from trackers._auto.scene_doubts import by_looks_alone, doubts_of_one_body, lost_together, off_motion
from trackers._auto.survey import Kind, blob_at, foregrounds_of, kinds_of
from trackers._detection.foreground import Blob
from trackers._disc.model import Disc
from trackers._frames.arrays import Bytes, Image
from trackers._frames.working_image import View, view_of
from trackers._linking.moving_bodies import MovingBodies, follow

SAMPLES = 40  # as many as the background is made of
# share of the found frames in which a hand touches the body: more is no free motion; chosen on marked clips, not
# confirmed on others
HELD = 0.5
ON_TRACK = 0.3  # share of the sightings of a kind that lie on the track: fewer, and another thing is followed
FAR_LIKELIER = 1.5  # times: so much more is another thing like a body than the tracked one
FEW = 3  # bodies: of more, each is too like the others to be known by its looks
MOST_REST = 0.5  # share of the samples: a body at rest for longer is to be followed there too
FEWEST_SHOWN = 4  # samples that show the body, to know its looks
# share of the samples that show the body, and number of them, in which it is plainly seen off its track: toss-ball-lamp
# shows it in 9 of 40 samples, and it is lost in 2 of these
MISSED, FEWEST_MISSED = 0.1, 2
MOST_WAYS = 3  # by looks
LEAST_SIGHTINGS = 0.3  # share of the samples
FIRST = "median-background"  # the way whose tracks are taken without a look at the scene where they show no fault
WEIGHT: dict[DoubtKind, float] = {"missed": 0.9, "jumps": 0.8, "shadow": 0.3, "ambiguous": 0.3}  # of a doubt
RIVAL = "disc"  # the registered tracker that also finds what does not move sideways


@dataclass(eq=False)
class Choice:
    """The search for a track nothing speaks against."""

    video: SampledOnce
    view: View
    options: TrackOptions
    candidates: list[TrackCandidate] = field(default_factory=list)
    _kinds: list[Kind] | None = None
    _receding: dict[int, Disc] | None = None
    _moving: MovingBodies | None = None

    @property
    def frames(self) -> list[Frame]:
        """The sampled frames."""
        return self.video.sample(SAMPLES)

    @property
    def kinds(self) -> list[Kind]:
        """The kinds of things that move."""
        if self._kinds is None:
            self._kinds = kinds_of(self._images, *self._survey)
        return self._kinds

    @property
    def foregrounds(self) -> list[list[Blob]]:
        """What differs from the still background in each sampled frame."""
        return self._survey[1]

    @cached_property
    def _survey(self) -> tuple[Image, list[list[Blob]]]:
        return foregrounds_of(self._images)

    @property
    def _images(self) -> list[Bytes]:
        return [search_image(self.view, frame) for frame in self.frames]

    @property
    def receding(self) -> dict[int, Disc]:
        """The disc that changes its size in the sampled frames, by the number of the frame."""
        if self._receding is None:
            self._receding = receding_disc(self.frames, self.view) if self.options.bodies == 1 else {}
        return self._receding

    def attempt(self, way: Way) -> TrackCandidate:
        """Follow the bodies in one way, and judge the tracks."""
        try:
            tracks = self.named_by_marks(way.follow())
        except TrackingError as error:
            candidate = TrackCandidate(way.name, (), str(error))
        else:
            evidence = [measured(track, self.view, self.frames) for track in tracks]
            judgements = [judged(*pair, self.options.marks) for pair in zip(tracks, evidence, strict=True)]
            if len(tracks) <= FEW and (way.name != FIRST or any(map(_suspicious, judgements))):
                judgements = self.against_the_scene(tracks, judgements)
            if way.name == FIRST and not self.options.marks:
                judgements = [own.with_doubts(*lost_together(tracks)) for own in judgements]
            if way.guessed:
                judgements = [own.with_doubts(*self._held(body)) for body, own in zip(tracks, judgements, strict=True)]
            if way.guessed and self.candidates and not self.candidates[0].tracks:
                judgements = [
                    own.with_doubts(by_looks_alone(body)) for body, own in zip(tracks, judgements, strict=True)
                ]
            of_bodies = [replace(body, quality=quality) for body, quality in zip(tracks, judgements, strict=True)]
            candidate = TrackCandidate(way.name, tuple(of_bodies))
        self.candidates.append(candidate)
        return candidate

    def first(self) -> list[Track]:
        """The bodies that move farthest before the still background."""
        moving = follow(self.video, self.options)
        self._moving = moving if self.options.marks else None
        return moving.tracks("auto", self.options)

    def at_marks(self) -> list[Track]:
        """The bodies that move before the still background and pass the marks."""
        if self._moving is None:
            raise TrackingError("nothing is followed before the still background")
        return self._moving.through_marks(self.video, self.options).tracks("auto", self.options)

    def filled(self, candidate: TrackCandidate) -> Way:
        """The tracks of a candidate with their gaps filled by the looks of the bodies."""
        tracks = candidate.tracks
        others = [[other for other in tracks if other is not track] for track in tracks]
        parts = (self.video, self.view, self.frames)
        return Way(
            f"{candidate.name}, gaps by looks",
            lambda: [with_gaps_filled(*parts, *pair) for pair in zip(tracks, others, strict=True)],
        )

    def named_by_marks(self, tracks: list[Track]) -> list[Track]:
        """The tracks under the names of the marks that they pass best."""
        named: list[Track] = []
        check_marks(self.options.marks, tracks[0].frame, (self.video.width, self.video.height))
        free = list(tracks)
        for name, marks in marks_by_body(self.options.marks).items():
            if free:
                best = min(free, key=lambda track: len(missed_marks(replace(track, body=name), marks)))
                free.remove(best)
                named.append(replace(best, body=name))
        return named if self.options.marks else tracks

    def against_the_scene(self, tracks: Sequence[Track], judgements: Sequence[TrackQuality]) -> list[TrackQuality]:
        """The judgements with what the other things that move, and the body itself seen elsewhere, say."""
        return [
            quality.with_doubts(*self._scene_doubts(track, tracks, quality))
            for track, quality in zip(tracks, judgements, strict=True)
        ]

    def _scene_doubts(self, track: Track, tracks: Sequence[Track], quality: TrackQuality) -> list[Doubt]:
        others = [other for other in tracks if other is not track]
        return [
            *doubts_of_one_body(track, others),
            *self._rival_doubts(track, tracks, quality),
            *self._missed(track, others),
            *off_motion(track, self.view, self.frames, self.foregrounds),
            *([] if self.options.marks else not_followed(track, self.receding)),
        ]

    def _held(self, track: Track) -> list[Doubt]:
        """Doubt where a body followed by its looks, which show no hand, mostly hangs together with the edge."""
        row_of = {int(number): row for row, number in enumerate(track.frame[track.valid])}
        places = track.xy_px[track.valid]
        found = [
            blob_at(foreground, self.view.in_search(*places[row_of[frame.index]]))
            for frame, foreground in zip(self.frames, self.foregrounds, strict=True)
            if frame.index in row_of
        ]
        seen = [blob.held or blob.at_edge for blob in found if blob is not None]
        return [held_doubt(track, float(np.mean(seen)))] if len(seen) >= FEWEST_SHOWN and np.mean(seen) > HELD else []

    def _rival_doubts(self, track: Track, tracks: Sequence[Track], quality: TrackQuality) -> list[Doubt]:
        """Doubt where a thing that nobody follows is far more like a body than the tracked one."""
        own = max((kind.salience for kind in self.kinds if self._share_on(kind, [track]) > ON_TRACK), default=0.0)
        rivals = [
            kind
            for kind in self.kinds
            if self._share_on(kind, tracks) < ON_TRACK and len(kind.samples) >= LEAST_SIGHTINGS * len(self.frames)
        ]
        best = max(rivals, key=lambda kind: kind.salience, default=None)
        if best is None or best.salience < FAR_LIKELIER * own or self.options.marks:
            return []
        thing, remedy = self._where(best), self._by_mark(track, best)
        if quality.evidence.get("shadow", 0.0) > MOST_SHADOW:
            return [Doubt("shadow", f"the track looks like a shadow, and {thing} moves too", remedy)]
        return [Doubt("ambiguous", f"{thing} moves too and looks more like a body", remedy)]

    def _where(self, kind: Kind) -> str:
        thing = kind.seen[len(kind.seen) // 2]
        x, y = self.view.in_frame(thing.x, thing.y)
        return f"what is at ({x:.0f}, {y:.0f}) px in frame {self.frames[thing.sample].index}"

    def _by_mark(self, track: Track, kind: Kind) -> str:
        thing = kind.seen[len(kind.seen) // 2]
        x, y = self.view.in_frame(thing.x, thing.y)
        return f"if that is the body: --mark {track.body}={x:.0f},{y:.0f}@{self.frames[thing.sample].index}"

    def _share_on(self, kind: Kind, tracks: Sequence[Track]) -> float:
        """Share of the sightings of a kind that lie on one of the tracks."""
        on = 0
        for thing in kind.seen:
            number = self.frames[thing.sample].index
            place = self.view.in_frame(thing.x, thing.y)
            reach = max(thing.radius, 3.0) * self.view.step
            on += any(passes(track, number, place, reach) for track in tracks)
        return on / len(kind.seen)

    def _missed(self, track: Track, others: Sequence[Track]) -> list[Doubt]:
        """Doubt where the body is plainly to be seen in sampled frames in which the track has lost it."""
        row_of = {int(number): k for k, number in enumerate(track.frame)}
        rows = [row_of.get(frame.index) for frame in self.frames]
        places = sampled_places(track, self.view, self.frames)
        held = np.zeros(track.valid.size, np.bool_) if track.hand is None else track.hand
        lost = [k for k, row in enumerate(rows) if row is not None and not track.valid[row] and not held[row]]
        if len(places) < FEWEST_SHOWN or not lost or track.radius_px is None:
            return []
        reach = float(np.nanmedian(track.radius_px[track.valid]))
        found = self._plainly_seen(places, reach, lost, others)
        seen = _without_rest(found, (min(places), max(places)), reach, MOST_REST * len(rows))
        showing = len(places) + len(seen)
        if len(seen) < FEWEST_MISSED or len(seen) <= MISSED * showing:
            return []
        number = self.frames[seen[0]].index
        shows = f"frame {number} and {len(seen) - 1} more of {showing} sampled frames that show it"
        finding = f"the body is lost in {shows}"
        return [Doubt("missed", finding, f"mark it there: --mark {track.body}=x,y@{number}")]

    def _plainly_seen(
        self, places: Mapping[int, Place], reach: float, lost: Sequence[int], others: Sequence[Track]
    ) -> dict[int, Place]:
        """Where, px of the frame, what is at some places of the samples is to be seen in others, by their number."""
        known = known_looks(self.view, self.frames, places, reach)
        moving: dict[int, Place] = {}
        still: dict[int, Place] = {}
        for k in lost:
            for at in known.plainly_in(search_image(self.view, self.frames[k])).xy:
                place = self.view.in_frame(*at)
                if not any(passes(other, self.frames[k].index, place, reach) for other in others):
                    moves = blob_at(self.foregrounds[k], (at[0], at[1])) is not None
                    (moving if moves else still).setdefault(k, place)
        # a body at rest is background in one place; what looks like it where nothing moves in several is scenery
        at_rest = still if still and _spread(list(still.values())) < 2 * reach else {}
        return {**at_rest, **moving}


def lost_in_places(candidate: TrackCandidate) -> bool:
    """Whether nothing else speaks against the tracks of a candidate than that they miss a body in places."""
    found = [track.quality or TrackQuality() for track in candidate.tracks]
    return {doubt.kind for quality in found for doubt in quality.doubts} == {"missed"}


def _without_rest(found: Mapping[int, Place], shown: tuple[int, int], reach: float, most: float) -> list[int]:
    """The samples in which a lost body was found, without those of a rest before its motion, or after it.

    At rest a body is background, and may be left out; unless that is so in more than ``most`` samples.
    """
    seen = sorted(found)
    for resting in ([k for k in seen if k < shown[0]], [k for k in seen if k > shown[1]]):
        if resting and len(resting) < most and _spread([found[k] for k in resting]) < reach:
            seen = [k for k in seen if k not in resting]
    return seen


def _spread(places: Sequence[tuple[float, float]]) -> float:
    """Largest distance, px, of places from their median."""
    off = np.array(places) - np.median(places, axis=0)
    return float(np.hypot(*off.T).max())


def _suspicious(quality: TrackQuality) -> bool:
    """Whether what else moves must be looked at: a doubt, a shadow's looks, a body often lost or held."""
    evidence = quality.evidence
    return (
        quality.doubtful
        or evidence.get("shadow", 0.0) > MOST_SHADOW
        or evidence["coverage"] < LEAST_COVERAGE
        or evidence["held"] > HELD
        or "contrast" not in evidence
    )


def worth(candidate: TrackCandidate) -> float:
    """How good a candidate is: found often, the same body throughout, and few doubts; 0 for none."""
    if not candidate.tracks:
        return 0.0
    values = []
    for track in candidate.tracks:
        quality = track.quality or TrackQuality()
        same = quality.evidence.get("same body", 0.5)
        found = 0.5 + 0.5 * quality.evidence["coverage"]
        values.append(same * found * np.prod([WEIGHT.get(doubt.kind, 0.6) for doubt in quality.doubts]))
    return float(np.mean(values))


def choose(video: FrameSource, options: TrackOptions) -> tuple[TrackCandidate, list[TrackCandidate]]:
    """The candidate that is taken, and all that were tried.

    Raises
    ------
    TrackingError
        When no way follows the bodies, as the first of them says it.
    DataError, UnknownNameError
        When the options do not fit the clip.
    """
    options = replace(options, bodies=max(options.bodies, len(marks_by_body(options.marks))))
    choice = Choice(SampledOnce(video), view_of(video, options), options)
    chosen: TrackCandidate | None = None
    for way in _ways(choice):
        candidate = choice.attempt(way)
        if chosen is None and candidate.tracks and not candidate.doubtful:
            chosen = candidate
        if chosen is not None and options.explain is None:
            break
    best = chosen or max(choice.candidates, key=worth)
    if not best.tracks:
        raise TrackingError(choice.candidates[0].refusal)
    if options.explain is not None:
        options.explain([replace(candidate, chosen=candidate is best) for candidate in choice.candidates])
    return best, choice.candidates


def _ways(choice: Choice) -> Iterator[Way]:
    """The ways in the order in which they are tried; later ones are prepared only when they are needed."""
    video, options = choice.video, choice.options
    yield Way(FIRST, choice.first)
    if options.mask is not None:
        return
    if options.marks:
        yield way_by_marks(video, choice.view, options)
        yield Way("path-at-marks", choice.at_marks)
        if lost_in_places(choice.candidates[-1]):
            yield choice.filled(choice.candidates[-1])
        return
    if options.bodies > FEW:
        return
    if lost_in_places(choice.candidates[0]):
        yield choice.filled(choice.candidates[0])
    if options.colour is not None:
        yield _registered("colour", choice)
    if choice.receding:
        yield _registered(RIVAL, choice)
    yield from ways_by_looks(video, choice.view, choice.frames, choice.kinds, options)[:MOST_WAYS]
    if not choice.receding and not choice.candidates[0].tracks:
        yield _registered(RIVAL, choice)


def _registered(name: str, choice: Choice) -> Way:
    return Way(name, lambda: TRACKERS[name].track(choice.video, choice.options))
