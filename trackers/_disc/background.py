"""Background from the samples without a disc in front, also behind a ball that never leaves the middle of the image."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from trackers._background.median import Background
from trackers._disc.expected_position import ExpectedPath
from trackers._frames.arrays import Flags, Image
from trackers._frames.working_image import WorkingView

ROUND_DISC = 3.0  # px about an expected disc that its outline may take
MIN_SAMPLES = 3  # that must show the background


@dataclass(frozen=True, eq=False, slots=True)
class KnownBackground:
    """Background and noise, and where (h', w'), at a reduced size, the background was ever seen."""

    background: Background
    known: Flags

    def patch(self, top: int, bottom: int, left: int, right: int) -> tuple[Image, Image, Flags]:
        """Background, noise and whether the background is known, of some rows and columns.

        All of them (h, w, channels), the last (h, w); background and noise in grey levels.
        """
        known = self.background.enlarged(self.known, top, bottom, left, right)
        return *self.background.patch(top, bottom, left, right), known


def background_without_discs(
    background: Background, view: WorkingView, numbers: Iterable[int], expected_paths: Sequence[ExpectedPath]
) -> KnownBackground:
    """The background from those samples (the frames of these numbers) in which no disc is in front of it."""
    height, width = background.stack.shape[1:3]
    columns, rows = (np.arange(size) for size in view.search_size)
    x, y = columns * width / columns.size + view.left, rows * height / rows.size + view.top
    free = [
        np.all([_away(expected_path, number, x, y, view.step) for expected_path in expected_paths], axis=0)
        for number in numbers
    ]
    usable = np.stack(free) if background.usable is None else np.stack(free) & background.usable
    count = usable.sum(axis=0)
    return KnownBackground(Background(background.stack, usable | (count == 0)), np.asarray(count >= MIN_SAMPLES))


def _away(expected_path: ExpectedPath, number: int, x: np.ndarray, y: np.ndarray, step: int) -> Flags:
    """Where (h', w') the disc expected in a frame is not."""
    disc = expected_path.discs.get(number)
    if disc is None:
        return np.ones((y.size, x.size), dtype=np.bool_)
    reach = disc.radius + ROUND_DISC + step
    return np.asarray((x - disc.x) ** 2 + (y[:, np.newaxis] - disc.y) ** 2 > reach**2)
