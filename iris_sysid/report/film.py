"""Frames of a clip for a page: small JPEGs within a budget, with the bodies and the models where they show them."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from iris_sysid.errors import IrisError
from iris_sysid.io.clip_place import places_of
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.files import sha256_of
from iris_sysid.report.figures import outline
from iris_sysid.types import Array, FitResult, FrameSource, Track, Trajectory
from iris_sysid.video.frame_access import jpeg_of
from iris_sysid.video.multiple_exposure import multiple_exposure, phases_of, sampled_views
from iris_sysid.video.reader import open_video

MAX_SIDE_PX = 640  # side of a frame in the page
MAX_BYTES = 1_400_000  # of all frames of a page, as JPEG
QUALITY, STILL_QUALITY = 70, 82  # of the frames, and of the picture on top
SHRINK, TRIES = 0.8, 6  # of the frames' sides, until they keep to the budget
MIN_SAMPLES = 5  # samples that show how coordinates lie in the image
MAX_OFF, MIN_PX = 0.03, 3.0  # largest rms error of that map, over the extent of the motion; smallest extent, px
SEEN_PX = 8.0  # radius of the marker of a body whose own is not known, px of the clip
BODIES = 4  # colours of bodies in the page


class Filmed(Protocol):
    """What has frames and tracks: a :class:`iris_sysid.Run`, or :class:`Footage`."""

    @property
    def video(self) -> FrameSource:
        """The clip."""

    @property
    def tracks(self) -> Sequence[Track]:
        """One a body, px."""


@dataclass(frozen=True, eq=False, slots=True)
class Footage:
    """A clip and the tracks of its bodies."""

    video: FrameSource
    tracks: Sequence[Track]


@dataclass(frozen=True, eq=False, slots=True)
class Marker:
    """One body, or where a model has it, in each frame.

    ``xy_px`` (m, 2) and ``radius_px`` (m,) are in px of the page's pictures, NaN where they are not known. ``colour``
    is a class of the page; a ``ring`` is drawn around the body, as models are, else a dot upon it.
    """

    name: str
    colour: str
    xy_px: Array
    radius_px: Array
    ring: bool
    body: int


@dataclass(frozen=True, eq=False, slots=True)
class Film:
    """What a page shows of a clip.

    ``still`` is a multiple exposure as JPEG, ``frames`` (m of them) are JPEGs at the times ``t_s`` (m,) s, all of the
    ``size`` in px; ``paths`` hold the track of each body (n, 2) px.
    """

    size: tuple[int, int]
    still: bytes
    t_s: Array
    frames: Sequence[bytes]
    paths: Sequence[Array]
    markers: Sequence[Marker]

    def document(self) -> dict[str, Any]:
        """The frames and markers for the script of the page."""
        return {
            "t": [round(float(t), 4) for t in self.t_s],
            "frames": [base64_of(frame) for frame in self.frames],
            "markers": [
                {
                    "name": marker.name,
                    "colour": marker.colour,
                    "ring": marker.ring,
                    "body": marker.body,
                    "xyr": [
                        [round(x, 1), round(y, 1), round(r, 1)] if np.isfinite(x + y + r) else None
                        for (x, y), r in zip(marker.xy_px, marker.radius_px, strict=True)
                    ],
                }
                for marker in self.markers
            ],
        }

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """Name, class and style of each marker, each name once."""
        return list(dict.fromkeys((one.name, one.colour, "ring" if one.ring else "dots") for one in self.markers))

    @property
    def still_base64(self) -> str:
        """The picture on top, for an address of data."""
        return base64_of(self.still)

    def path_svg(self) -> Markup:
        """The track of each body as SVG paths."""
        drawn = Markup('<path class="halo" d="{0}"/><path class="curve line body-{1}" d="{0}"/>')
        return Markup("").join(drawn.format(_path(path), k % BODIES + 1) for k, path in enumerate(self.paths))


def base64_of(content: bytes) -> str:
    """Bytes as an address of data has them."""
    return base64.b64encode(content).decode("ascii")


def _path(points: Array) -> str:
    steps, pen = [], "M"
    for x, y in points[np.union1d(outline(points[:, 0]), outline(points[:, 1]))].tolist():
        if np.isfinite(x + y):
            steps.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L" if np.isfinite(x + y) else "M"
    return "".join(steps)


def film_of(footage: Filmed, trajectory: Trajectory, models: Mapping[str, tuple[str, FitResult]]) -> Film | None:
    """Frames of a clip with its bodies, and with models where they have a place in the image.

    ``models`` are fits to the trajectory by the class of their colour, each with its name. None where no body was found
    in a frame that can be read.
    """
    video, tracks = footage.video, footage.tracks
    if not tracks or not any(track.valid.any() for track in tracks):
        return None
    images: list[NDArray[np.uint8]] = []
    rows: list[int] = []
    for t_s, image in sampled_views(video, tracks[0], MAX_SIDE_PX):
        row = int(np.argmin(np.abs(tracks[0].t_s - t_s)))
        if abs(tracks[0].t_s[row] - t_s) < 1e-6:
            images.append(image)
            rows.append(row)
    if not images:
        return None
    scale = min(1.0, MAX_SIDE_PX / max(video.width, video.height))
    still = multiple_exposure([images[k] for k in phases_of(tracks[0].xy_px[rows])])
    in_page = [(track.xy_px + 0.5) * scale for track in tracks]
    markers = [
        Marker(_name(k, tracks), f"body-{k % BODIES + 1}", path[rows], scale * _radius_px(tracks[k])[rows], False, k)
        for k, path in enumerate(in_page)
    ]
    for colour, (name, fit) in models.items():
        for k, track in enumerate(tracks):
            place, radius = model_px(track, trajectory, fit)
            if place is not None:
                markers.append(Marker(name, colour, (place[rows] + 0.5) * scale, scale * radius[rows], True, k))
    return Film(
        (still.shape[1], still.shape[0]),
        jpeg_of(still, STILL_QUALITY),
        tracks[0].t_s[rows],
        _within_budget(images),
        in_page,
        markers,
    )


def _name(k: int, tracks: Sequence[Track]) -> str:
    return f"body {tracks[k].body}, measured" if len(tracks) > 1 else "measured"


def _radius_px(track: Track) -> Array:
    """The radius (n,) px of a body in each sample, the median where it was not measured, or one that can be seen."""
    measured = np.full(track.valid.size, np.nan) if track.radius_px is None else track.radius_px
    usual = float(np.nanmedian(measured)) if np.isfinite(measured).any() else SEEN_PX
    return np.where(np.isfinite(measured), measured, usual)


def _within_budget(images: Sequence[NDArray[np.uint8]]) -> list[bytes]:
    """The frames as JPEG, smaller ones where all together exceed the budget: the page shows them at one size."""
    scale = 1.0
    for _ in range(TRIES):
        frames = [
            jpeg_of(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), QUALITY)
            for image in images
        ]
        if sum(map(len, frames)) <= MAX_BYTES:
            break
        scale *= SHRINK
    return frames


# --------------------------------------------------------------------------- models in the image


def model_px(track: Track, trajectory: Trajectory, fit: FitResult) -> tuple[Array | None, Array]:
    """Where the image would show a body, and how large, if it moved as a fit predicts: px, NaN outside the fit.

    Which coordinates place this body, and how, is read from the motion itself: the positions in the image are a
    linear function of a length or of two, or of the sine and cosine of an angle. The body is then moved from where it
    is seen by what this function says of the residual.

    Parameters
    ----------
    track
        Of the body, px.
    trajectory
        What was made of the tracks, at the same times.
    fit
        To that trajectory.

    Returns
    -------
    xy_px : ndarray or None
        (n, 2); None where no coordinate places the body: a brightness does not.
    radius_px : ndarray
        (n,); as the fit predicts it where that is what it describes, else as measured.
    """
    names, radius = [quantity.name for quantity in fit.model.observed], _radius_px(track)
    known = {quantity.name for quantity in trajectory.quantities}
    if track.valid.size != trajectory.n or fit.t_s.size != trajectory.n or not known >= set(names):
        return None, radius
    if not fit.used.any():
        return None, radius
    first, last = np.flatnonzero(fit.used)[[0, -1]]
    inside = (np.arange(trajectory.n) >= first) & (np.arange(trajectory.n) <= last)
    if names == ["r"]:
        return np.where(inside[:, None], track.xy_px, np.nan), fit.predicted[:, 0]
    observed = trajectory.position[:, [trajectory.column(name) for name in names]]
    used = track.valid & trajectory.valid & fit.used
    extent = float(np.max(np.ptp(track.xy_px[used], axis=0))) if used.sum() >= MIN_SAMPLES else 0.0
    if extent < MIN_PX:
        return None, radius
    angles = [quantity.unit == "rad" for quantity in fit.model.observed]
    single = [[k] for k in range(len(names))]
    pairs = [[k, k + 1] for k in range(len(names) - 1) if not angles[k]]
    maps = [_map_to_px(observed, track.xy_px, used, angles, some) for some in (*single, *pairs)]
    off, coefficients, some = min(maps, key=lambda one: one[0])
    if off > MAX_OFF * extent:
        return None, radius
    predicted = _basis(fit.predicted, angles, some) @ coefficients
    moved = track.xy_px + predicted - _basis(observed, angles, some) @ coefficients
    place = np.where((track.valid & trajectory.valid)[:, None], moved, predicted)
    return np.where(inside[:, None], place, np.nan), radius


def _map_to_px(
    observed: Array, xy_px: Array, used: NDArray[np.bool_], angles: Sequence[bool], some: list[int]
) -> tuple[float, Array, list[int]]:
    """The rms error, px, of positions as a function of some coordinates, its coefficients, and the coordinates."""
    basis = _basis(observed[used], angles, some)
    coefficients = np.linalg.lstsq(basis, xy_px[used], rcond=None)[0]
    off = basis @ coefficients - xy_px[used]
    return float(np.sqrt(np.mean(off**2))), np.asarray(coefficients), some


def _basis(observed: Array, angles: Sequence[bool], some: Sequence[int]) -> Array:
    columns: Iterator[Array] = (
        column
        for k in some
        for column in ((np.sin(observed[:, k]), np.cos(observed[:, k])) if angles[k] else (observed[:, k],))
    )
    return np.column_stack([np.ones(len(observed)), *columns])


# --------------------------------------------------------------------------- the clip of a table


def footage_of_table(table: str | Path, trajectory: Trajectory) -> Footage | None:
    """The clip that ``run`` made a table from, if it still lies where it was, beside or in its folder, or here.

    The table is ``trajectory.csv`` in a folder of ``run``, or that folder; the trajectory's origin names the clip and
    its sha256, which must be the same. None where there is no such clip or no ``track.csv``, or one of them cannot be
    read.
    """
    folder = Path(table) if Path(table).is_dir() else Path(table).parent
    name, digest = trajectory.origin.get("source"), trajectory.origin.get("sha256")
    if not isinstance(name, str) or not (folder / "track.csv").is_file():
        return None
    options = trajectory.origin.get("options")
    asked = options if isinstance(options, Mapping) else {}
    for clip in places_of(folder.absolute(), Path(name).name):
        try:
            if not clip.is_file() or sha256_of(clip) != digest:
                continue
            timing = {key: asked.get(key) for key in ("fps", "start_s", "stop_s")}
            video = open_video(clip, **timing, keep_partial=bool(asked.get("keep_partial")))
            return Footage(video, [replace(body, origin={}) for body in read_track(folder / "track.csv")])
        except (IrisError, OSError):
            continue
    return None
