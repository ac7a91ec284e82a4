"""What sampled frames of a clip show: all that moves, its kinds, and a disc that changes its size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from iris_sysid.types import Frame, Track
from trackers._auto.appearance import search_image
from trackers._auto.survey import ObjectClass, foregrounds_of, kinds_of
from trackers._background.median import BackgroundEstimate
from trackers._detection.foreground import Blob
from trackers._disc.model import Disc
from trackers._disc.receding_disc import receding_disc
from trackers._frames.arrays import Bytes, Image
from trackers._frames.working_image import WorkingView

Place = tuple[float, float]


@dataclass(eq=False)
class SampledScene:
    """The sampled frames of a clip; what they show is worked out once, when it is first needed.

    ``view`` is the region of interest and the colour of the body, where one was stated; ``known`` the background of the
    samples, where it is known.
    """

    view: WorkingView
    frames: Sequence[Frame]
    known: BackgroundEstimate | None = None

    @cached_property
    def images(self) -> list[Bytes]:
        """The samples at the size of the search, (h, w, 3) luma and chroma."""
        return [search_image(self.view, frame) for frame in self.frames]

    @property
    def still(self) -> Image:
        """The scene (h, w, 3) without moving objects."""
        return self._survey[0]

    @property
    def foregrounds(self) -> list[list[Blob]]:
        """What differs from the still background in each sample."""
        return self._survey[1]

    @cached_property
    def kinds(self) -> list[ObjectClass]:
        """The kinds of objects that move, the likeliest body first."""
        return kinds_of(self.images, *self._survey)

    @cached_property
    def receding(self) -> dict[int, Disc]:
        """The disc that changes its size, by the number of the frame; empty if there is none."""
        return receding_disc(self.frames, self.view)

    @cached_property
    def _survey(self) -> tuple[Image, list[list[Blob]]]:
        return foregrounds_of(self.images, self.known, [self.view.colour_mask(frame) for frame in self.frames])

    def rows(self, track: Track) -> dict[int, int]:
        """The row of a track in each sample, by the sample's number; samples outside of the track are left out."""
        row_of = {int(number): row for row, number in enumerate(track.frame)}
        return {k: row_of[frame.index] for k, frame in enumerate(self.frames) if frame.index in row_of}

    def places(self, track: Track) -> dict[int, Place]:
        """Where (x, y), px of the search image, a track is in the samples, by their number; gaps are left out."""
        at = {k: row for k, row in self.rows(track).items() if track.valid[row]}
        return {k: self.view.in_search(*track.xy_px[row]) for k, row in at.items()}
