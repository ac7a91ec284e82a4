"""What a table or an image cannot say of itself: origin, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, JsonValue, field_validator

from iris_sysid.io.schemas._parts import Document, DoubtEntry, EstimateEntry, Number, Part, QuantityEntry, SegmentEntry
from iris_sysid.types import (
    Array,
    CurveName,
    ErrorAutocorrelation,
    Hold,
    PivotSource,
    Sensor,
    Track,
    TrackQuality,
    Transfer,
    TransferSource,
    VerticalSource,
    View,
    ViewKind,
)

Triple = tuple[float, float, float]
Pixels = Annotated[float, Field(ge=-1e9, le=1e9)]
PixelLength = Annotated[float, Field(gt=0, le=1e9)]
PixelPair = tuple[Pixels, Pixels]
PixelCount = Annotated[int, Field(ge=1, le=100_000)]


TOLD = ("read_as", "clipped_readings")  # lists of sentences in an origin, that commands tell


class Smoothing(Part):
    """How a trajectory was smoothed, one number a quantity."""

    psd: list[Number]
    """Process noise, unit^2/s^5."""
    nis: list[Number]
    """Mean normalised innovation squared; 1 when the filter is consistent."""


class ErrorAutocorrelationEntry(Part):
    """Partial autocorrelations of position errors at lags of 1, 2, ... frames."""

    partial: list[float]
    stderr: list[float]
    """Their standard errors."""

    def autocorrelation(self) -> ErrorAutocorrelation:
        """The entry as an ErrorAutocorrelation."""
        return ErrorAutocorrelation(tuple(self.partial), tuple(self.stderr))


class TrackQualityEntry(Part):
    """How far a track can be trusted; it is doubtful where there are doubts."""

    doubts: list[DoubtEntry] = []
    evidence: dict[str, Number] = {}
    """What was judged, by name."""

    def quality(self) -> TrackQuality:
        """The entry as a TrackQuality."""
        evidence = {name: value for name, value in self.evidence.items() if value is not None}
        return TrackQuality(tuple(doubt.doubt() for doubt in self.doubts), evidence)


class BrightnessEntry(Part):
    """How the intensities of a track were made from grey levels, and what their errors have in common."""

    transfer: CurveName
    """The camera's curve that was undone."""
    gamma: float
    """Its exponent, where it is a plain power."""
    stderr: float
    """Relative standard uncertainty of the exponent that undoes it."""
    source: TransferSource
    patterns: dict[str, list[list[float]]] = {}
    """By source, patterns of one standard error, each a number a frame."""

    @classmethod
    def of_track(cls, track: Track) -> BrightnessEntry | None:
        """The entry of a track; None where its intensities are grey levels, or it has none."""
        curve = track.transfer
        if curve is None:
            return None
        patterns = {source: rows.tolist() for source, rows in track.intensity_patterns.items()}
        return cls(transfer=curve.name, gamma=curve.gamma, stderr=curve.stderr, source=curve.source, patterns=patterns)

    def fields(self) -> dict[str, Any]:
        """The fields of a Track."""
        patterns = {source: np.array(rows) for source, rows in self.patterns.items()}
        transfer = Transfer(self.transfer, self.gamma, self.stderr, self.source)
        return {"transfer": transfer, "intensity_patterns": patterns}


class CameraMotionEntry(Part):
    """How the camera of a track's clip moved: maps from px of the first frame to px of each frame."""

    frame: list[int]
    """Numbers of the frames, ascending."""
    to_frame: list[tuple[Triple, Triple]]
    """The two rows of ``[A | b]`` for each: x in the frame is ``A x + b``."""

    @classmethod
    def of_tracks(cls, tracks: Sequence[Track]) -> CameraMotionEntry | None:
        """The entry of some tracks of one clip; None where the camera stands still."""
        maps = {
            int(frame): motion.tolist()
            for track in tracks
            if track.camera_motion is not None
            for frame, motion in zip(track.frame, track.camera_motion, strict=True)
        }
        rows = [tuple(tuple(row) for row in maps[frame]) for frame in sorted(maps)]
        return cls.model_validate({"frame": sorted(maps), "to_frame": rows}) if maps else None

    def maps(self, frame: NDArray[np.int64]) -> Array:
        """The maps (n, 2, 3), px, of the frames with these numbers (n,); where one is not known, of the one before."""
        rows = np.searchsorted(np.array(self.frame), frame, side="right") - 1
        return np.asarray(np.array(self.to_frame)[np.clip(rows, 0, len(self.frame) - 1)])


class ViewEntry(Part):
    """How coordinates lie in the image of a camera (px; x right, y down, origin at the centre of pixel (0, 0))."""

    kind: ViewKind
    """An angle about a pivot, a way along a line, or x and z in a plane."""
    origin_px: PixelPair
    """Where the coordinates are zero; the pivot of an angle."""
    right_px: PixelPair
    """Image of one unit along the line or x, or of one lever's length to the right of the pivot."""
    up_px: PixelPair
    """Image of one unit across the line or along z, or of one lever's length up from the pivot."""
    size_px: tuple[PixelLength, PixelLength]
    """Width and height of the picture."""
    axis_px: PixelPair
    """Where the optical axis meets the picture."""
    focal_px: PixelLength
    """Focal length."""
    pivot: PivotSource
    """Where the pivot of an angle comes from."""
    measured: bool
    """False where only the kind of the view is known."""

    def view(self) -> View:
        """The entry as a View; DataError where its axes are parallel."""
        return View(**self.model_dump())


class OriginDocument(Document):
    """What a CSV file cannot say (the .origin.json file beside it)."""

    document: Literal["origin"] = "origin"
    version: Literal[4] = 4
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
    error_autocorrelation: ErrorAutocorrelationEntry | None = None
    """How long the position errors last; of a track with several bodies, where it is the same for all."""
    body_error_autocorrelation: dict[str, ErrorAutocorrelationEntry] = {}
    """The same by body, where the bodies of a track differ."""
    body_quality: dict[str, TrackQualityEntry] = {}
    """How far the track of each body can be trusted; absent where nothing judged it."""
    body_brightness: dict[str, BrightnessEntry] = {}
    """How the light of each body was made from grey levels; absent where its intensity is in grey levels."""
    camera_motion: CameraMotionEntry | None = None
    """How the camera of a track's clip moved; null where it stands still."""
    doubts: list[DoubtEntry] = []
    """Evidence against the track from which a trajectory was made."""
    hold: Hold = "linear"
    """How the inputs of a trajectory vary between samples: on a line, or keeping the value of the last one."""
    known: dict[str, EstimateEntry] = {}
    """Constants of an equation that were stated when a trajectory was made."""
    free: list[str] | None = None
    """Constants of an equation that were left open then; null where that is not recorded."""
    first_frame: int | None = None
    """Number in the video of the frame that is the first sample of a trajectory; null when it is not known."""
    sensor: Sensor = "unknown"
    """What measured a trajectory."""
    view: ViewEntry | None = None
    """How the quantities of a trajectory lie in the image of a camera; null where that is not known."""

    @field_validator("origin")
    @classmethod
    def _sentences(cls, origin: dict[str, JsonValue]) -> dict[str, JsonValue]:
        for name in TOLD:
            told = origin.get(name, [])
            if not isinstance(told, list) or not all(isinstance(each, str) for each in told):
                raise ValueError(f"{name} is {told!r:.60}: give a list of sentences, or leave it out")
        return origin


class CalibrationDocument(Document):
    """How pixels become metres in the plane of motion (calibration.json)."""

    document: Literal["calibration"] = "calibration"
    version: Literal[2] = 2
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
    """Width and height of the images it is valid for, px; null where it was not made from images."""
    centre_px: tuple[float, float] = (0.0, 0.0)
    """Where in the image it was made."""
    vertical_source: VerticalSource = "unstated"
    """What fixed the direction of gravity."""
    fixed: list[str] = []
    """What else the data fixed."""
    assumed: list[str] = []
    """What else was taken for granted."""
    notes: list[str] = []
    doubts: list[DoubtEntry] = []
    """Evidence against it."""
    rms_px: Number = None
    """Root mean square residual of the board's corners, px; null without a board."""
    origin: dict[str, JsonValue] = {}
