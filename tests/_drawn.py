"""Clips drawn in memory with exact truth: a FrameSource of arrays, and discs by exact area coverage."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from iris_sysid.types import Frame

FPS = 60.0


@dataclass(eq=False)
class DrawnClip:
    """A FrameSource over images (h, w) grey or (h, w, 3) BGR, bytes; ``decoded`` counts the frames given out."""

    images: Sequence[np.ndarray]
    fps: float = FPS
    decoded: int = field(default=0)

    @property
    def width(self) -> int:
        return int(self.images[0].shape[1])

    @property
    def height(self) -> int:
        return int(self.images[0].shape[0])

    @property
    def n_expected(self) -> int:
        return len(self.images)

    def frames(self) -> Iterator[Frame]:
        for index in range(len(self.images)):
            self.decoded += 1
            yield self._frame(index)

    def sample(self, count: int) -> list[Frame]:
        indices = np.unique(np.linspace(0, len(self.images) - 1, count).astype(int))
        return [self._frame(int(index)) for index in indices]

    def _frame(self, index: int) -> Frame:
        image = self.images[index]
        if image.ndim == 2:
            return Frame(index, index / self.fps, image, lambda: np.repeat(image[..., np.newaxis], 3, axis=2))
        luma = np.clip(np.rint(image @ [0.114, 0.587, 0.299]), 0, 255).astype(np.uint8)
        return Frame(index, index / self.fps, luma, lambda: image)


def disc(shape: tuple[int, int], x: float, y: float, radius: float, lines: int = 32) -> np.ndarray:
    """Share of each pixel that a disc covers: exact along x, by ``lines`` scan lines a pixel along y."""
    share = np.zeros(shape)
    rows, columns = _reach(y, radius, shape[0]), _reach(x, radius, shape[1])
    scan = (np.arange(rows.start * lines, rows.stop * lines) + 0.5) / lines - 0.5
    half = np.sqrt(np.maximum(radius**2 - (scan - y) ** 2, 0))[:, np.newaxis]
    column = np.arange(columns.start, columns.stop)
    covered = np.minimum(x + half, column + 0.5) - np.maximum(x - half, column - 0.5)
    parts = np.clip(covered, 0, 1).reshape(rows.stop - rows.start, lines, column.size)
    share[rows, columns] = parts.mean(axis=1)
    return share


def _reach(centre: float, radius: float, n: int) -> slice:
    """The pixels of an axis that a disc may touch: no others need be computed."""
    start = min(max(int(np.floor(centre - radius)) - 1, 0), n)
    return slice(start, max(min(int(np.ceil(centre + radius)) + 2, n), start))


def paint(background: np.ndarray, share: np.ndarray, colour: object) -> np.ndarray:
    """Lay a colour (a number, or three) over a background by the share of each pixel that it covers."""
    if background.ndim == 3:
        share = share[..., np.newaxis]
    return background * (1 - share) + np.asarray(colour, dtype=float) * share


def noisy(images: Sequence[np.ndarray], sigma: float, seed: int = 0) -> list[np.ndarray]:
    """The images with normal noise, rounded to bytes."""
    rng = np.random.default_rng(seed)
    return [np.clip(np.rint(image + rng.normal(0, sigma, image.shape)), 0, 255).astype(np.uint8) for image in images]


def moving_disc(
    path: np.ndarray, radius: float, shape: tuple[int, int] = (96, 128), contrast: float = 100.0, noise: float = 3.0
) -> DrawnClip:
    """A clip of one uniform disc on a uniform background of grey level 80, at ``path`` (n, 2) px."""
    plain = np.full(shape, 80.0)
    return DrawnClip(noisy([paint(plain, disc(shape, x, y, radius), 80.0 + contrast) for x, y in path], noise))


def swing(n: int, centre: tuple[float, float], amplitude: tuple[float, float], period: float = 60.0) -> np.ndarray:
    """A path (n, 2) that oscillates with that period in frames, px."""
    phase = 2 * np.pi * np.arange(n) / period
    return np.column_stack([centre[0] + amplitude[0] * np.cos(phase), centre[1] + amplitude[1] * np.sin(2 * phase)])
