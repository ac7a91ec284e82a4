"""Projects of Open Source Physics Tracker (``.trk``, ``.trz``): calibration, axes and marks, in our pixel convention.

Tracker counts image coordinates from the top-left corner of the image, so that the centre of the
first pixel is at (0.5, 0.5); here it is at (0, 0). All positions are shifted by -0.5 px. Checked on
Tracker's BallToss example, whose nine free marks lie 0.49 +- 0.05 px right of and 1.03 +- 0.08 px below the
ball's centroid as we count it: x gives the half pixel, and y half a pixel more, by which the hand clicked low
(0.60 px RMS after the shift, 1.17 px before; ``tests/io/test_osp_tracker.py``).

Layout of the file: Open Source Physics library, ``ImageCoordSystem``, ``VideoClip``, ``PointMass``
(loaders); angles are in degrees, times in ms, scales in px per length unit.
"""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import CalibrationError
from iris_sysid.io.archives import ZIP_TROUBLE, listed, member_of, members_named
from iris_sysid.types import Array, Track, frozen_array
from iris_sysid.units import OSP_LENGTHS, UNITS

CORNER_TO_CENTRE_PX = 0.5  # Tracker's origin is a corner of the first pixel, ours its centre
MAX_BYTES = 64 * 2**20
MAX_FRAMES = 10**9
# Filters that move pixels: marks made through them do not lie where the video file has the body
MOVING_FILTERS = ("Resize", "Rotate", "Perspective", "RadialDistortion", "BarrelPincushion")


@dataclass(frozen=True, eq=False, slots=True)
class OspProject:
    """The content of a Tracker project for one clip.

    ``scale_px_per_m`` is NaN where the project was never calibrated; ``length_unit`` is the unit it was
    stated in (empty when the project does not say: then metres are assumed). ``origin_px`` (x, y) is the
    origin of its axes, x right, y down, from the centre of pixel (0, 0).
    ``angle_rad`` turns the image's x axis anticlockwise (as seen) into the x axis of the project.
    ``delta_t_ms`` is the time from frame to frame, NaN where not stated; ``start_frame`` and ``step`` say
    which frames were stepped through. ``marks`` holds for each body the frame numbers in the file (n,)
    and positions (n, 2) px in our convention, x right, y down. ``video`` is the name of the video, or of
    the first image, as the project names it (None: it names none).
    """

    scale_px_per_m: float
    origin_px: tuple[float, float]
    angle_rad: float
    delta_t_ms: float
    start_frame: int
    step: int
    marks: Mapping[str, tuple[NDArray[np.int64], Array]]
    video: str | None
    length_unit: str

    @property
    def calibrated(self) -> bool:
        """Whether the project fixes a length."""
        return math.isfinite(self.scale_px_per_m)


def read_osp(path: str | Path) -> OspProject:
    """Read the calibration and the marks of a Tracker project.

    Parameters
    ----------
    path
        A ``.trk`` file, or a ``.trz`` archive with one in it; ``file.trz:NAME`` where it holds several.

    Returns
    -------
    OspProject
        Positions in our pixel convention: Tracker's minus (0.5, 0.5) px.

    Raises
    ------
    CalibrationError
        When it is no Tracker project, is damaged, declares XML entities, holds numbers that are not
        finite, has axes or a scale that change within the clip or differ between x and y, or when marks
        were made through a video filter that moves pixels.
    """
    label = str(path).encode("utf-8", "replace").decode()
    xml, packed = _read(path, label)
    panel = _panel(xml, label)
    clip, control = _object(panel, "videoclip"), _object(panel, "clipcontrol")
    video, axes, unit = _object(clip, "video"), _axes(panel, label), _text(panel, "length_unit")
    _check_filters(video, label)
    x, y = (_number(axes, name, label) - CORNER_TO_CENTRE_PX for name in ("xorigin", "yorigin"))
    delta_t_ms = _number(control, "delta_t", label, 0.0)
    return OspProject(
        scale_px_per_m=_scale_px_per_m(axes, unit, label),
        origin_px=(x, y),
        angle_rad=math.radians(_number(axes, "angle", label, 0.0)),
        delta_t_ms=delta_t_ms if delta_t_ms > 0 else math.nan,
        start_frame=_frames(clip, "startframe", label, 0),
        step=max(1, _frames(clip, "stepsize", label, 1)),
        marks=MappingProxyType(_marks(panel, _frames(clip, "frameshift", label, 0), label)),
        video=_video_name(video, packed),
        length_unit=unit,
    )


def marked_tracks(project: OspProject, *, fps: float | None = None) -> list[Track]:
    """The marks of a project as tracks, one per body, at the project's own times.

    Parameters
    ----------
    project
        From :func:`read_osp`; its ``delta_t_ms`` gives the times, frame 0 at 0 s.
    fps
        True frame rate in 1/s instead: for slow motion, and for a project that does not state its time step.

    Returns
    -------
    list of Track
        Every marked frame has a row. ``sigma_px`` is NaN: a hand does not say how well it points.

    Raises
    ------
    CalibrationError
        When the project has no marks, or does not state the time from frame to frame and no ``fps`` is given.
    """
    if not project.marks:
        raise CalibrationError("the Tracker project has no marks: no point mass was tracked in it")
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise CalibrationError(f"the frame rate must be above 0 and finite, not {fps}")
    step_s = project.delta_t_ms / 1000 if fps is None else 1 / fps
    if not math.isfinite(step_s):
        raise CalibrationError("the Tracker project does not state the time between frames; give the frame rate (fps)")
    return [
        Track(
            t_s=np.asarray(frames * step_s, dtype=np.float64),
            xy_px=xy_px,
            sigma_px=np.full(xy_px.shape, np.nan),
            valid=np.ones(frames.size, dtype=np.bool_),
            frame=frames,
            body=body,
            origin={"source": "marks of an Open Source Physics Tracker project"},
        )
        for body, (frames, xy_px) in project.marks.items()
    ]


# --------------------------------------------------------------------------- the file


def _read(source: str | Path, label: str) -> tuple[bytes, Sequence[str]]:
    """The XML of the project, and the names of the files packed with it."""
    path, wanted = member_of(source)
    if path.exists() and not path.is_file():  # a device or pipe may never end
        raise CalibrationError(f"cannot read {label}: it is not an ordinary file")
    try:
        if path.suffix.lower() not in (".trz", ".zip"):
            _check_size(path.stat().st_size, label)
            return path.read_bytes(), ()
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            return archive.read(_the_project(archive, wanted, label)), names
    except OSError as error:
        raise CalibrationError(f"cannot read {label}: {error.strerror or error}") from error
    except ZIP_TROUBLE as error:
        raise CalibrationError(f"{label} is not an archive that can be unpacked: {error}") from error


def _the_project(archive: zipfile.ZipFile, wanted: str | None, label: str) -> zipfile.ZipInfo:
    """The project of that name, or the only one."""
    projects = [name for name in archive.namelist() if PurePosixPath(name).suffix.lower() == ".trk"]
    meant = projects if wanted is None else members_named(wanted, projects)
    if not projects:
        raise CalibrationError(f"{label} holds no project (.trk)")
    if len(meant) != 1:
        which = f"{len(projects)} projects" if wanted is None else f"no single project named {wanted!r}"
        raise CalibrationError(f"{label} holds {which}; name one as FILE.trz:NAME: {listed(projects)}")
    entry = archive.getinfo(meant[0])
    _check_size(entry.file_size, f"{label}:{entry.filename}")
    return entry


def _check_size(size: int, label: str) -> None:
    if size > MAX_BYTES:
        raise CalibrationError(f"{label} has {size} bytes; a Tracker project has at most {MAX_BYTES}")


def _panel(xml: bytes, label: str) -> Element:
    """The project's root object, parsed with document types and entities refused."""

    def refuse(*declaration: object) -> None:
        raise CalibrationError(f"{label} declares a document type or entities, which no Tracker project does; not read")

    scout = expat.ParserCreate()
    scout.StartDoctypeDeclHandler = refuse
    try:
        scout.Parse(xml, True)
        root = ElementTree.fromstring(xml)
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise CalibrationError(f"{label} is no Tracker project: its XML is broken ({error})") from error
    if root.tag != "object" or not root.get("class", "").endswith(".TrackerPanel"):
        what = root.get("class") or f"<{root.tag}>"
        raise CalibrationError(f"{label} is no Tracker project: its root is {what}, not a TrackerPanel")
    return root


# --------------------------------------------------------------------------- properties


def _property(parent: Element | None, name: str) -> Element | None:
    """The property of that name of an object; None when it is not there."""
    if parent is None:
        return None
    return next((child for child in parent if child.tag == "property" and child.get("name") == name), None)


def _object(parent: Element | None, name: str) -> Element | None:
    """The object that the property of that name holds."""
    element = _property(parent, name)
    return None if element is None else element.find("object")


def _items(parent: Element | None, name: str) -> Iterator[tuple[str, Element]]:
    """Name and object of each entry of an array or collection."""
    element = _property(parent, name)
    for entry in () if element is None else element:
        held = entry.find("object")
        if held is not None:
            yield entry.get("name", ""), held


def _text(parent: Element | None, name: str) -> str:
    element = _property(parent, name)
    return "" if element is None else (element.text or "").strip()


def _number(parent: Element | None, name: str, label: str, default: float | None = None) -> float:
    """A finite number; the default where it is not stated."""
    text = _text(parent, name)
    if not text and default is not None:
        return default
    try:
        value = float(text)
    except ValueError as error:
        raise CalibrationError(f"{label}: {name} is missing or no number ({text!r:.40})") from error
    if not math.isfinite(value):
        raise CalibrationError(f"{label}: {name} is {text}, not a finite number; calibrate again in Tracker")
    return value


def _frames(parent: Element | None, name: str, label: str, default: int) -> int:
    """A whole number of frames; the default where it is not stated."""
    value = _number(parent, name, label, default)
    if abs(value) > MAX_FRAMES:
        raise CalibrationError(f"{label}: {name} is {value:g}, more frames than any clip has; the file is damaged")
    return int(value)


# --------------------------------------------------------------------------- what they mean


def _axes(panel: Element, label: str) -> Element:
    """The one set of axes; those that move or zoom within the clip are refused."""
    entries = [entry for _, entry in _items(_object(panel, "coords"), "framedata")]
    if not entries:
        raise CalibrationError(f"{label} has no coordinate system: open it in Tracker, set scale and axes, save")
    for name, what in (("xorigin", "origin"), ("yorigin", "origin"), ("angle", "direction"), ("xscale", "scale")):
        values = {_number(entry, name, label) for entry in entries}
        if len(values) > 1:
            raise CalibrationError(
                f"{label}: the {what} of the axes changes within the clip ({name} from {min(values):.6g} to "
                f"{max(values):.6g}); fix it in Tracker (Coordinate System > Fixed), save, and give it again"
            )
    return entries[0]


def _scale_px_per_m(axes: Element, unit: str, label: str) -> float:
    x, y = _number(axes, "xscale", label), _number(axes, "yscale", label)
    if unit not in OSP_LENGTHS:
        raise CalibrationError(
            f"{label}: the length unit is {unit!r}; it must be one of {', '.join(filter(None, OSP_LENGTHS))}"
        )
    if x <= 0 or abs(x - y) > 1e-6 * x:
        raise CalibrationError(
            f"{label}: the scale is {x:.6g} px per unit in x and {y:.6g} in y; it must be one, above 0"
        )
    return math.nan if x == 1.0 else x / UNITS[unit][1]  # 1 exactly: as Tracker starts, before any calibration


def _check_filters(video: Element | None, label: str) -> None:
    for _, element in _items(video, "filters"):
        kind = element.get("class", "").rpartition(".")[2]
        if kind.removesuffix("Filter") in MOVING_FILTERS and _text(element, "enabled") != "false":
            raise CalibrationError(
                f"{label}: the video is shown through a {kind}, so scale and marks do not hold for the file's own "
                "pixels; remove the filter in Tracker and calibrate again"
            )


def _video_name(video: Element | None, packed: Sequence[str]) -> str | None:
    """The video as the project names it, or the packed file that is meant."""
    paths = _property(video, "paths")  # of an image sequence, in newer versions
    first = (paths.findtext("property") or "").strip() if paths is not None else ""
    name = (_text(video, "path") or first).replace("\\", "/")
    if not name:
        return None
    same = [file for file in packed if PurePosixPath(file).name == PurePosixPath(name).name]
    return same[0] if name not in packed and len(same) == 1 else name


def _marks(panel: Element, frame_shift: int, label: str) -> dict[str, tuple[NDArray[np.int64], Array]]:
    """Frames and positions of each point mass; further ones of the same name are numbered."""
    marks: dict[str, tuple[NDArray[np.int64], Array]] = {}
    for _, body in _items(panel, "tracks"):
        if not body.get("class", "").endswith(".PointMass"):
            continue
        points = dict(_points(body, frame_shift, label))
        if points:
            frames = np.array(sorted(points), dtype=np.int64)
            frames.flags.writeable = False
            xy_px = frozen_array([points[frame] for frame in sorted(points)], (None, 2), "marks")
            marks[_free_name(_text(body, "name") or "mass", marks)] = (frames, xy_px)
    return marks


def _points(body: Element, frame_shift: int, label: str) -> Iterator[tuple[int, tuple[float, float]]]:
    for index, point in _items(body, "framedata"):
        number = re.fullmatch(r"\[(\d{1,9})\]", index)
        if number is None:
            raise CalibrationError(f"{label}: a mark has the frame number {index!r}; the file is damaged")
        x, y = (_number(point, name, label) - CORNER_TO_CENTRE_PX for name in ("x", "y"))
        yield int(number[1]) + frame_shift, (x, y)


def _free_name(name: str, taken: Mapping[str, object]) -> str:
    count, free = 1, name
    while free in taken:
        count += 1
        free = f"{name} {count}"
    return free
