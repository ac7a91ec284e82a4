"""Transfer functions: how a camera codes light as grey levels, and how to undo it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types._arrays import Array

CurveName = Literal["bt709", "srgb", "linear", "gamma", "hlg", "pq"]
TransferSource = Literal["tag", "given", "assumed"]
Matrix = Literal["bt601", "bt709", "bt2020"]

# Relative standard uncertainties of the exponent that undoes a camera's curve (GUM, type B). Over codes from 0.1 to 1
# BT.709's curve is undone by an exponent of about 1.77, sRGB's by 2.1; cameras write the tag of BT.709 and follow
# either, or their own profile: 0.1 keeps sRGB's within two standard errors. Without a tag anything from 1.5 to
# 2.7 is likely, a half width of 0.28 of 2.1, over the square root of three.
TAG_STDERR, ASSUMED_STDERR, LINEAR_STDERR = 0.10, 0.16, 0.01
ALPHA, BETA = 1.09929682680944, 0.018053968510807  # ITU-R BT.2020, table 4: BT.709's curve, joined smoothly
HLG_A, HLG_B, HLG_C = 0.17883277, 0.28466892, 0.55991073  # ITU-R BT.2100, table 5
PQ_M1, PQ_M2, PQ_C1, PQ_C2, PQ_C3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128  # SMPTE ST 2084


@dataclass(frozen=True, slots=True)
class PixelCoding:
    """What the file says of how light became the samples of its planes.

    ``transfer`` is the file's tag as a name that :class:`Transfer` knows, empty where there is none, or the tag's
    own name where it is of no use. ``limited`` is true where black is 16 and white 235, ``matrix`` how luma and colour
    differences were made, ``lost_bits`` how many low bits the 8-bit samples lack.
    """

    transfer: str = ""
    limited: bool = False
    matrix: Matrix = "bt709"
    lost_bits: int = 0

    @property
    def black(self) -> float:
        """Sample value of black, grey levels; what was cut off low bits is there half on average."""
        return (16.0 if self.limited else 0.0) - (1.0 - 2.0**-self.lost_bits) / 2.0

    @property
    def span(self) -> float:
        """Grey levels from black to white."""
        return 219.0 if self.limited else 255.0


@dataclass(frozen=True, slots=True)
class Transfer:
    """A camera's curve from light to code, both from 0 at black to 1 at white, and how well it is known.

    ``gamma`` is the exponent where ``name`` is ``gamma``. ``stderr`` is the relative standard uncertainty of the
    exponent that undoes the curve: light in truth is ``light(code)`` to the power 1 + stderr times a normal number.
    ``source`` says whether the file's tag or the user names the curve, or nobody.
    """

    name: CurveName
    gamma: float = 1.0
    stderr: float = TAG_STDERR
    source: TransferSource = "given"

    def __post_init__(self) -> None:
        if self.name not in CURVES:
            raise DataError(f"there is no transfer function {self.name!r}; there are {', '.join(CURVES)}")
        if not 0.1 <= self.gamma <= 10 or not 0 <= self.stderr <= 1:
            raise DataError(
                f"a gamma lies between 0.1 and 10 and its relative error between 0 and 1, not {self.gamma:g} and "
                f"{self.stderr:g}"
            )

    def light(self, code: Array) -> Array:
        """Light (...,), 1 at white, of codes (...,) from 0 to 1, dimensionless; codes below black give 0 or less."""
        code = np.asarray(code, dtype=np.float64)
        return np.asarray(CURVES[self.name][0](code, self.gamma))

    def code(self, light: Array) -> Array:
        """Code (...,), 0 to 1, of light of any shape (...,); dimensionless."""
        light = np.asarray(light, dtype=np.float64)
        return np.asarray(CURVES[self.name][1](light, self.gamma))

    @property
    def text(self) -> str:
        """The curve as it is typed: ``bt709``, ``gamma=2.2``."""
        return f"gamma={self.gamma:g}" if self.name == "gamma" else self.name


def transfer_tagged(tag: str) -> Transfer | None:
    """The curve of a file's tag; None where the tag is empty or names no curve of a camera."""
    name, _, gamma = tag.partition("=")
    if name not in CURVES or (name == "gamma") != bool(gamma):
        return None
    curve: CurveName = name  # type: ignore[assignment]
    return Transfer(curve, float(gamma or 1.0), LINEAR_STDERR if name == "linear" else TAG_STDERR, "tag")


def assumed_transfer() -> Transfer:
    """The curve of an unknown camera: sRGB's, with a wide uncertainty of its exponent."""
    return Transfer("srgb", stderr=ASSUMED_STDERR, source="assumed")


# --------------------------------------------------------------------------- curves


def _bt709_light(code: Array, _: float) -> Array:
    power = np.maximum((code + ALPHA - 1) / ALPHA, 0.0) ** (1 / 0.45)
    return np.where(code < 4.5 * BETA, code / 4.5, power)


def _bt709_code(light: Array, _: float) -> Array:
    return np.where(light < BETA, 4.5 * light, ALPHA * np.maximum(light, 0.0) ** 0.45 - ALPHA + 1)


def _srgb_light(code: Array, _: float) -> Array:
    return np.where(code <= 0.04045, code / 12.92, np.maximum((code + 0.055) / 1.055, 0.0) ** 2.4)


def _srgb_code(light: Array, _: float) -> Array:
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0) ** (1 / 2.4) - 0.055)


def _power_light(code: Array, gamma: float) -> Array:
    return np.asarray(np.maximum(code, 0.0) ** gamma)


def _power_code(light: Array, gamma: float) -> Array:
    return np.asarray(np.maximum(light, 0.0) ** (1 / gamma))


def _identity(values: Array, _: float) -> Array:
    return values


def _hlg_light(code: Array, _: float) -> Array:
    return np.where(code <= 0.5, code * np.abs(code) / 3, (np.exp((code - HLG_C) / HLG_A) + HLG_B) / 12)


def _hlg_code(light: Array, _: float) -> Array:
    log = HLG_A * np.log(np.maximum(12 * light - HLG_B, 1e-9)) + HLG_C
    return np.where(light <= 1 / 12, np.sqrt(3 * np.maximum(light, 0.0)), log)


def _pq_light(code: Array, _: float) -> Array:
    root = np.clip(code, 0.0, 1.0) ** (1 / PQ_M2)
    return np.asarray((np.maximum(root - PQ_C1, 0.0) / (PQ_C2 - PQ_C3 * root)) ** (1 / PQ_M1))


def _pq_code(light: Array, _: float) -> Array:
    root = np.clip(light, 0.0, 1.0) ** PQ_M1
    return np.asarray(((PQ_C1 + PQ_C2 * root) / (1 + PQ_C3 * root)) ** PQ_M2)


Curve = Callable[[Array, float], Array]
# (light of a code, code of a light): ITU-R BT.709-6; IEC 61966-2-1; ITU-R BT.2100-2 (HLG: light of the scene; PQ: 1 is
# 10,000 cd/m^2)
CURVES: Mapping[str, tuple[Curve, Curve]] = MappingProxyType(
    {
        "bt709": (_bt709_light, _bt709_code),
        "srgb": (_srgb_light, _srgb_code),
        "linear": (_identity, _identity),
        "gamma": (_power_light, _power_code),
        "hlg": (_hlg_light, _hlg_code),
        "pq": (_pq_light, _pq_code),
    }
)
