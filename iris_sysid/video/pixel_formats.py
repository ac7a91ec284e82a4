"""From a decoded image to arrays: the luma plane as it is coded, BGR on request, both turned as displayed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import av
import numpy as np
from av import VideoFrame
from av.video.reformatter import VideoReformatter
from numpy.typing import NDArray

from iris_sysid.errors import VideoError
from iris_sysid.types import Matrix, PixelCoding

Bytes = NDArray[np.uint8]

# Pixel formats whose first plane is luma alone, of 8 bits or more; the second kind has them in the high end of 16.
_LUMA_PLANE = re.compile(r"(?:yuv[aj]?4\d\dp|nv(?:12|16|21|24|42)|gray)(?:(\d\d?)(le|be))?")
_LUMA_HIGH_BITS = re.compile(r"p[0-4]1[026](le|be)")


# Transfer functions by number (ITU-T H.273, table 3), as iris_sysid.types.Transfer names them; 6, 7, 11, 14 and 15 are
# BT.709's curve under other names, or differ from it by less than its rounding.
_TRANSFERS = {
    **dict.fromkeys((1, 6, 7, 11, 14, 15), "bt709"),
    4: "gamma=2.2",
    5: "gamma=2.8",
    8: "linear",
    13: "srgb",
    16: "pq",
    18: "hlg",
}
_MATRICES: dict[int, Matrix] = {1: "bt709", 5: "bt601", 6: "bt601", 9: "bt2020", 10: "bt2020"}  # H.273, table 4
_UNSTATED = (0, 2, 3)  # reserved, unspecified
_SD_LINES = 576  # of an image whose matrix is not stated, up to which it is that of BT.601, as players take it

# OpenCV is imported where it is used: most clips need none of it, and it takes long to load.


# transposed, then mirrored left-right, then mirrored up-down, by degrees
_COUNTERCLOCKWISE = {
    0: (False, False, False),
    90: (True, False, True),
    180: (False, True, True),
    270: (True, True, False),
}


@dataclass(frozen=True, slots=True)
class Orientation:
    """How the coded image is turned for display: transposed first, then mirrored in x, in y."""

    transposed: bool = False
    mirrored_x: bool = False
    mirrored_y: bool = False

    @property
    def rotation_deg(self) -> int:
        """Clockwise rotation from the coded to the displayed image: 0, 90, 180 or 270 (after mirroring, if any)."""
        return 90 * self.transposed + 180 * self.mirrored_y

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Displayed width and height of a coded image of that width and height."""
        return (height, width) if self.transposed else (width, height)

    def turn(self, array: Bytes) -> Bytes:
        """The array (h, w) or (h, w, 3) as displayed; itself when nothing is to be done, else a copy."""
        if self == UPRIGHT:
            return array
        import cv2

        turned = cv2.transpose(array) if self.transposed else array
        if self.mirrored_x or self.mirrored_y:
            turned = cv2.flip(turned, -1 if self.mirrored_x and self.mirrored_y else int(self.mirrored_x))
        return np.asarray(turned)


UPRIGHT = Orientation()


def orientation_of(image: VideoFrame) -> Orientation:
    """The orientation in the image's display matrix; angles between are taken to the nearest right angle.

    The matrix ((a, b, u), (c, d, v), (x, y, w)) sends the coded point (p, q) to (a p + c q, b p + d q),
    y down (ISO 14496-12, 8.2.2).
    """
    try:
        matrix = cast(Any, image.side_data).get("DISPLAYMATRIX")
    except ValueError:  # PyAV refuses all side data when it does not know the type of one, e.g. EXIF
        return Orientation(*_COUNTERCLOCKWISE[90 * round(image.rotation / 90) % 360])
    if matrix is None:
        return UPRIGHT
    (a, b, _), (c, d, _) = np.frombuffer(memoryview(matrix), np.int32).reshape(3, 3)[:2].tolist()
    if abs(a) + abs(d) >= abs(b) + abs(c):
        return Orientation(False, a < 0, d < 0)
    return Orientation(True, c < 0, b < 0)


def luma_of(image: VideoFrame, orientation: Orientation) -> Bytes:
    """The image's brightness, (h, w) uint8, read-only.

    Where the image has a luma plane, this is that plane as coded, without a copy (unless the image
    is turned): 16-235 in limited range, 0-255 in full range; deeper planes give their upper 8 bits. The
    array keeps the decoder's buffer alive and is never written to again. Other images (GIF, PNG) are
    converted: 0.299 R + 0.587 G + 0.114 B (ITU-R BT.601). An interlaced image holds two moments, in alternate
    rows: the upper field is kept, and the rows between are interpolated.
    """
    layout = _luma_layout(image.format.name)
    if layout is None or image.planes[0].line_size <= 0:
        import cv2

        luma = np.asarray(cv2.cvtColor(_converted(image), cv2.COLOR_BGR2GRAY))
    else:
        luma = _plane(image, 0, *layout)
    luma = orientation.turn(_one_moment(image, luma))
    luma.flags.writeable = False
    return luma


def bgr_of(image: VideoFrame, orientation: Orientation) -> Bytes:
    """The image in colour, (h, w, 3) uint8 in the order blue, green, red; a new array."""
    return orientation.turn(_one_moment(image, _converted(image)))


def _converted(image: VideoFrame) -> Bytes:
    try:
        # a separate converter: that of the image is not safe where two threads ask for the same image
        return np.ascontiguousarray(VideoReformatter().reformat(image, format="bgr24").to_ndarray(), dtype=np.uint8)
    except (av.FFmpegError, ValueError) as error:  # of an image of one pixel, at times
        size = f"{image.width}x{image.height} px"
        raise VideoError(f"an image of {size} in {image.format.name} cannot be converted to colour: {error}") from error


def chroma_of(image: VideoFrame, orientation: Orientation) -> tuple[Bytes, Bytes] | None:
    """The colour planes (cb, cr) as coded, uint8, at their own size; None where there are not two planes beside luma.

    Without a copy, unless the image is turned, interlaced or deeper than 8 bits.
    """
    layout = _luma_layout(image.format.name)
    if layout is None or len(image.planes) < 3 or any(plane.line_size <= 0 for plane in image.planes):
        return None
    blue, red = (orientation.turn(_one_moment(image, _plane(image, number, *layout))) for number in (1, 2))
    return blue, red


def _one_moment(image: VideoFrame, array: Bytes) -> Bytes:
    """The array (h, w) or (h, w, 3) of an image; of an interlaced one the upper field, its rows interpolated."""
    if not image.interlaced_frame or len(array) < 3:
        return array
    filled = array.copy()
    upper = array[0::2].astype(np.uint16)
    between = filled[1::2]
    between[: len(upper) - 1] = (upper[:-1] + upper[1:] + 1) // 2
    if len(array) % 2 == 0:
        between[-1] = array[-2]
    return filled


def coding_of(image: VideoFrame) -> PixelCoding:
    """What the image's tags say of how light became its samples: transfer function, range, matrix, depth.

    A range that is not stated is limited where there are colour differences, full in grey and RGB images.
    """
    tags = int(image.color_trc), int(image.color_range), int(image.colorspace)
    return _coding(image.format.name, image.height, *tags)


@cache
def _coding(pixel_format: str, height: int, transfer: int, range_: int, matrix: int) -> PixelCoding:
    layout = _luma_layout(pixel_format)
    of_luma = layout is not None and not pixel_format.startswith(("gray", "yuvj"))
    return PixelCoding(
        transfer="" if transfer in _UNSTATED else _TRANSFERS.get(transfer, f"H.273 number {transfer}"),
        limited=range_ == 1 if range_ in (1, 2) else of_luma,
        matrix=_MATRICES.get(matrix, "bt601" if height <= _SD_LINES else "bt709"),
        lost_bits=layout[1] if layout and not _LUMA_HIGH_BITS.fullmatch(pixel_format) else _high_bits(pixel_format),
    )


def _high_bits(pixel_format: str) -> int:
    """Bits beyond 8 of a format that has its bits in the high end of 16."""
    high = _LUMA_HIGH_BITS.fullmatch(pixel_format)
    return int(pixel_format.removesuffix(high[1])[-2:]) - 8 if high else 0


def _plane(image: VideoFrame, number: int, dtype: str, shift: int) -> Bytes:
    plane = image.planes[number]
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: plane.height]
    samples = rows[:, : plane.width * np.dtype(dtype).itemsize].view(dtype)
    return samples if shift == 0 else np.right_shift(samples, shift).astype(np.uint8)


@cache
def _luma_layout(pixel_format: str) -> tuple[str, int] | None:
    """Type of a luma sample and how many low bits to drop; None where the first plane is not luma alone."""
    if high := _LUMA_HIGH_BITS.fullmatch(pixel_format):
        return ("<u2" if high[1] == "le" else ">u2", 8)
    if (low := _LUMA_PLANE.fullmatch(pixel_format)) is None:
        return None
    if low[1] is None:
        return ("u1", 0)
    return ("<u2" if low[2] == "le" else ">u2", int(low[1]) - 8)
