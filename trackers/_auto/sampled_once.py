"""A clip whose sampled frames are kept: several ways of following it look at the same ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from iris_sysid.types import Frame, FrameSource


@dataclass(eq=False)
class SampledOnce:
    """A clip whose sampled frames are read once, however often they are requested."""

    video: FrameSource
    _samples: dict[int, list[Frame]] = field(default_factory=dict)

    @property
    def width(self) -> int:
        """As that of the clip."""
        return self.video.width

    @property
    def height(self) -> int:
        """As that of the clip."""
        return self.video.height

    @property
    def n_expected(self) -> int:
        """As that of the clip."""
        return self.video.n_expected

    def frames(self) -> Iterator[Frame]:
        """Every frame of the clip."""
        return self.video.frames()

    def sample(self, count: int) -> list[Frame]:
        """Frames spread over the clip."""
        if count not in self._samples:
            self._samples[count] = self.video.sample(count)
        return self._samples[count]
