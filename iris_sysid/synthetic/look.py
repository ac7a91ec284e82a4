"""Realistic appearance of a clip: every part can be switched off, and none changes the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

from iris_sysid.errors import DataError
from iris_sysid.types import Transfer, transfer_tagged

Codec = Literal["h264", "lossless", "ffv1"]
CODECS: tuple[Codec, ...] = ("h264", "lossless", "ffv1")

# What a phone writes for 3840x2160 at 60 frames a second, as the benchmark's camera did.
PHONE_BITS_PER_PIXEL = 45e6 / (3840 * 2160 * 60)


@dataclass(frozen=True, slots=True)
class Look:
    """How the camera and the room appear. Grey levels are those of the file's luma plane, 0 to 255.

    ``texture`` standard deviation of the wall's texture, grey levels; ``vignetting`` light lost in the corners
    (fraction); ``uneven_light`` light lost towards one side (fraction); ``marks``, ``cord``, ``clamp``, ``hand``
    whether they are drawn; ``shadow`` darkness of soft shadows (fraction); ``shading`` light, limb and markings on
    the bodies. ``exposure_s`` length of the exposure, centred on each frame's time; 0 means no motion blur.
    ``read_noise`` standard deviation, grey levels; ``shot_noise`` variance per grey level; the noise variance at
    grey level I is ``read_noise**2 + shot_noise * I``. ``tilt_deg`` camera turned about its horizontal and vertical
    axis, ``roll_deg`` about its line of sight; ``distortion`` radial k1, k2 as OpenCV defines them; ``shake_px``
    standard deviation of the camera's shaking at 1280 px width; ``dropped`` fraction of frames that the camera
    left out, their times kept. ``codec``: ``h264`` at ``bit_rate`` bits/s (None: a phone's, by size and rate),
    ``lossless`` (H.264, quantiser 0) or ``ffv1``. ``transfer`` is the camera's curve from light to grey levels, as
    ``--transfer`` names it, by which light that a scene gives off is coded; ``transfer_tag`` what the file says of it
    (None: the same; empty: nothing).
    """

    texture: float = 1.2
    vignetting: float = 0.30
    uneven_light: float = 0.10
    marks: bool = True
    cord: bool = True
    clamp: bool = True
    hand: bool = True
    shadow: float = 0.12
    shading: bool = True
    exposure_s: float = 1 / 120
    read_noise: float = 1.0
    shot_noise: float = 0.02
    tilt_deg: tuple[float, float] = (0.0, 0.0)
    roll_deg: float = 0.0
    distortion: tuple[float, float] = (0.0, 0.0)
    shake_px: float = 0.0
    dropped: float = 0.0
    codec: Codec = "h264"
    bit_rate: float | None = None
    transfer: str = "bt709"
    transfer_tag: str | None = None

    def __post_init__(self) -> None:
        for name in ("texture", "shadow", "exposure_s", "read_noise", "shot_noise", "shake_px"):
            _check(name, getattr(self, name), 0.0, math.inf)
        for name in ("vignetting", "uneven_light", "shadow"):
            _check(name, getattr(self, name), 0.0, 1.0)
        _check("dropped", self.dropped, 0.0, 0.5)
        for name in ("tilt_deg", "distortion"):
            if not isinstance(getattr(self, name), tuple) or len(getattr(self, name)) != 2:
                raise DataError(f"{name} must be two numbers, not {getattr(self, name)!r}")
        for tilt in (*self.tilt_deg, self.roll_deg):
            _check("tilt_deg, roll_deg", tilt, -45.0, 45.0)
        for coefficient in self.distortion:
            _check("distortion", coefficient, -1.0, 1.0)
        if self.codec not in CODECS:
            raise DataError(f"codec must be one of {', '.join(CODECS)}, not {self.codec!r}")
        if self.bit_rate is not None:
            _check("bit_rate", self.bit_rate, 1e3, 1e10)
        _check_curves(self.transfer, self.transfer_tag or self.transfer)

    @classmethod
    def plain(cls, **changes: Any) -> Look:
        """Everything switched off: flat shapes on a flat wall, no blur, no noise, lossless; ``changes`` switch on."""
        off: dict[str, Any] = {
            item.name: False if isinstance(item.default, bool) else 0.0
            for item in fields(cls)
            if isinstance(item.default, bool | float)
        }
        return cls(**{**off, "codec": "lossless", **changes})

    @property
    def curve(self) -> Transfer:
        """The camera's curve from light to grey levels."""
        return transfer_tagged(self.transfer) or Transfer("linear")

    def bits_per_second(self, size: tuple[int, int], fps: float) -> float:
        """Bit rate of the file: as given, or a phone's (45 Mbit/s at 3840x2160, 60 frames/s) scaled by pixels."""
        if self.bit_rate is not None:
            return self.bit_rate
        return max(2e5, PHONE_BITS_PER_PIXEL * size[0] * size[1] * fps)


def _check_curves(*names: str) -> None:
    for name in names:
        if transfer_tagged(name) is None:
            raise DataError(f"transfer must be bt709, srgb, linear, hlg, pq or gamma=2.2, not {name!r}")


def _check(name: str, value: float, low: float, high: float) -> None:
    if not (isinstance(value, int | float) and low <= value <= high):
        raise DataError(f"{name} must lie between {low:g} and {high:g}, not {value!r}")
