"""One frame of a clip under a grid of pixel coordinates, to read positions from: marks, scale bars, regions."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.files import write_atomic
from iris_sysid.report.text import round_step
from iris_sysid.types import Frame

FONT = cv2.FONT_HERSHEY_SIMPLEX
MIN_SIDE_PX = 1200  # px; a smaller frame is enlarged by a whole number until its longer side has this length
LINES, FINE = 14, 5  # labelled lines along the longer side; intervals between two of them
INK, PAPER = (30, 30, 30), (255, 255, 255)  # BGR
MAJOR, MINOR = 0.55, 0.22  # how much of a line covers the image

Picture = NDArray[np.uint8]


def write_frame(frame: Frame, path: str | Path, *, title: str = "", overwrite: bool = False) -> Path:
    """Draw a frame of a clip with a grid labelled in its own px, as PNG.

    Parameters
    ----------
    frame
        Of a clip, as displayed.
    path
        A ``.png`` file.
    title
        Written above the frame.
    overwrite
        Replace a file of that name.

    Raises
    ------
    OutputError
        When the file exists, or cannot be written.
    """
    _, encoded = cv2.imencode(".png", frame_sheet(frame.bgr(), title))
    return write_atomic(Path(path), encoded.tobytes(), overwrite=overwrite)


def frame_sheet(image: Picture, title: str = "") -> Picture:
    """The image, BGR (h, w, 3) in grey levels, enlarged by a whole number, with its grid, and its labels outside it.

    A line at x runs through the centres of the pixels of column x. The ``title`` stands above the image.
    """
    height, width = image.shape[:2]
    zoom = -(-MIN_SIDE_PX // max(height, width))
    step = max(1, round(round_step(max(height, width) / LINES)))
    drawn = cv2.resize(image, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST)
    for spacing, strength in ((step / FINE, MINOR), (step, MAJOR)):
        if zoom * spacing >= FINE:
            _draw_grid(drawn, spacing, zoom, strength)
    return _with_labels(drawn, step, zoom, title)


def _draw_grid(drawn: Picture, spacing: float, zoom: int, strength: float) -> None:
    """Lines at every ``spacing`` px, in place: dark beside bright, so that they are seen on any image."""
    width = max(1, round(max(drawn.shape[:2]) / 2500))
    for axis in (0, 1):
        for at in _places(drawn.shape[axis], spacing, zoom):
            for offset, colour in ((0, PAPER), (width, INK)):
                line = [slice(None), slice(None)]
                line[axis] = slice(at + offset, at + offset + width)
                part = drawn[line[0], line[1]]
                drawn[line[0], line[1]] = np.round((1 - strength) * part + strength * np.array(colour))


def _places(length: int, spacing: float, zoom: int) -> list[int]:
    """Where the lines at multiples of ``spacing`` lie in an enlarged side of that length, px."""
    last = length // zoom - 1
    return [round(zoom * (k * spacing + 0.5)) for k in range(int(last / spacing) + 1)]


def _with_labels(drawn: Picture, step: int, zoom: int, title: str) -> Picture:
    size = max(drawn.shape[:2]) / 2400
    (letters, line), _ = cv2.getTextSize("0" * len(str(max(drawn.shape[:2]) // zoom)), FONT, size, 1)
    left, top, edge = letters + line, 5 * line, letters // 2 + line
    sheet = cv2.copyMakeBorder(drawn, top, edge, left, edge, cv2.BORDER_CONSTANT, value=PAPER)
    thick = max(1, round(2 * size))

    def write(text: str, x: float, y: float) -> None:
        cv2.putText(sheet, text, (round(x), round(y)), FONT, size, INK, thick, cv2.LINE_AA)

    for k, x in enumerate(_places(drawn.shape[1], step, zoom)):
        text = f"{k * step}"
        (width, _), _ = cv2.getTextSize(text, FONT, size, thick)
        write(text, left + x - width / 2, top - line / 2)
    for k, y in enumerate(_places(drawn.shape[0], step, zoom)):
        write(f"{k * step}".rjust(len(str(drawn.shape[0] // zoom))), line / 4, top + y + line / 2)
    write(title, left, 2 * line)
    return sheet
