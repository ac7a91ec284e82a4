"""What a table, a tensor or a picture cannot say of itself: origin, tensor, calibration."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, JsonValue

from iris_sysid.io.schemas._parts import Document, EstimateEntry, Number, Part, QuantityEntry, SegmentEntry

Triple = tuple[float, float, float]
PixelCount = Annotated[int, Field(ge=1, le=100_000)]


class Smoothing(Part):
    """How a trajectory was smoothed, one number a quantity."""

    psd: list[Number]
    """Process noise, unit^2/s^5."""
    nis: list[Number]
    """Mean normalised innovation squared; 1 when the filter is consistent."""


class OriginDocument(Document):
    """What a CSV file cannot say (the .origin.json file beside it)."""

    document: Literal["origin"] = "origin"
    version: Literal[1] = 1
    table: str
    """Name of the CSV file."""
    table_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    quantities: list[QuantityEntry] = []
    inputs: list[QuantityEntry] = []
    segments: list[SegmentEntry] = []
    geometry: dict[str, EstimateEntry] = {}
    systematic: dict[str, list[list[list[float]]]] = {}
    """By source, what errors of the positions have in common: patterns of one standard error, each a row a sample."""
    smoothing: Smoothing | None = None
    origin: dict[str, JsonValue] = {}
    bodies: dict[str, dict[str, JsonValue]] = {}
    """Origin by body, where the bodies of a track differ."""


class TensorDocument(Document):
    """What a tensor of pictures cannot say (the .npy.json file beside it)."""

    document: Literal["tensor"] = "tensor"
    version: Literal[1] = 1
    shape: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=5, max_length=5)]
    """Windows, frames a window, channels, height and width in px."""
    time_step_s: Annotated[float, Field(gt=0)] | None
    """True time between two frames of a window, the median; null where a window has one frame."""
    time_step_spread_s: Annotated[float, Field(ge=0)] | None
    """Largest difference from it."""
    step: Annotated[int, Field(ge=1, le=10_000)]
    """Frames of the clip from one frame of a window to the next."""
    stride: Annotated[int, Field(ge=1, le=10_000)]
    """Frames of the clip from the start of a window to that of the next."""
    t_s: Annotated[list[float], Field(min_length=1)]
    """True time of each frame of the clip that is in the tensor, in order."""
    origin: dict[str, JsonValue] = {}


class CalibrationDocument(Document):
    """How pixels become metres in the plane of motion (calibration.json)."""

    document: Literal["calibration"] = "calibration"
    version: Literal[1] = 1
    unit: Literal["m", "px"]
    """Unit of the world; px when no scale is known."""
    homography: tuple[Triple, Triple, Triple]
    """Maps (x, y, 1), undistorted px, y down, to the world, z up; rows."""
    scale: EstimateEntry
    """px per unit where the calibration was made; its standard error is common to all samples."""
    source: str = ""
    camera_matrix: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    """fx, fy, cx, cy, px; rows. With the distortion it takes pixels to undistorted px."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3 as OpenCV defines them."""
    budget: Annotated[dict[str, list[list[float]]], Field(max_length=100)] = {}
    """By source: part of the covariance (18, 18) of the homography's nine entries, row by row, and fx, fy, cx, cy, k1,
    k2, p1, p2, k3; independent parts that add up."""
    image_size: tuple[PixelCount, PixelCount] | None = None
    """Width and height of the pictures it is valid for, px; null where it was not made from pictures."""
    centre_px: tuple[float, float] = (0.0, 0.0)
    """Where in the picture it was made."""
    fixed: list[str] = []
    """What the data fixed."""
    assumed: list[str] = []
    """What was taken for granted."""
    notes: list[str] = []
    rms_px: Number = None
    """Root mean square distance of the board's corners from where they should be; null without a board."""
    origin: dict[str, JsonValue] = {}
