"""Frames sampled over a clip, kept as decoded; windows of them are converted on demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Frame
from trackers._frames.arrays import Box, Bytes
from trackers._frames.working_image import WorkingView


@dataclass(frozen=True, eq=False, slots=True)
class SampledFrames:
    """Some frames as a view shows them, each pixel the mean of ``step`` x ``step``."""

    frames: Sequence[Frame]
    view: WorkingView
    step: int = 1

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of frames, height and width in px, 3 where colour counts."""
        size = (len(self.frames), self.view.height // self.step, self.view.width // self.step)
        return (*size, 3) if self.view.chroma else size

    def window(self, box: Box) -> Bytes:
        """A window (k, h, w) or (k, h, w, 3) of all frames."""
        return np.stack([self.view.part(frame, box, self.step) for frame in self.frames])

    def reduced(self, step: int) -> SampledFrames:
        """The same frames with each pixel the mean of ``step`` x ``step`` of these."""
        return SampledFrames(self.frames, self.view, self.step * step)
