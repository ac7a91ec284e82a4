"""Image sequences from a folder or an archive, and videos in archives; declared sizes are not trusted."""

from __future__ import annotations

import re
import shutil
import tempfile
import weakref
import zipfile
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import cast

import av
from av.video.codeccontext import VideoCodecContext

from iris_sysid.errors import CalibrationError, VideoError
from iris_sysid.io.archives import ZIP_TROUBLE, listed, members_named
from iris_sysid.io.osp_tracker import read_osp
from iris_sysid.video.container import MAX_PIXELS, ContainerSource, DamageError, check_size, open_container
from iris_sysid.video.pixel_formats import UPRIGHT, Orientation, orientation_of

# Decoder of each kind of image, by the end of the name
IMAGE_CODECS = {
    ".png": "png", ".jpg": "mjpeg", ".jpeg": "mjpeg", ".bmp": "bmp", ".tif": "tiff", ".tiff": "tiff",
    ".webp": "webp", ".pgm": "pgm", ".ppm": "ppm",
}  # fmt: skip
VIDEO_SUFFIXES = {
    ".mp4", ".m4v", ".mov", ".3gp", ".avi", ".mkv", ".webm", ".gif", ".mts", ".m2ts", ".ts", ".mpg", ".mpeg",
    ".wmv", ".asf", ".flv", ".ogv", ".mxf", ".h264", ".hevc",
}  # fmt: skip
MAX_MEMBERS = 200_000
MAX_MEMBER_BYTES = 64 * 2**30
MAX_IMAGE_BYTES = 2**30
MAX_RATIO = 200  # video shrinks by a few percent; raw video of a plain scene by up to about 50
RATIO_COUNTS_FROM_BYTES = 100 * 2**20

Read = Callable[[str], bytes]


@dataclass(eq=False)
class ImageSource:
    """Images in natural order of their names, all of one size; they carry no times."""

    label: str
    names: Sequence[str]
    reading: Callable[[], Iterator[Read]]
    width: int = 0
    height: int = 0
    orientation: Orientation = UPRIGHT
    time_base: Fraction | None = None
    rate: float | None = None
    first_s: float | None = None
    facts: Mapping[str, object] = field(default_factory=dict)
    note: str = ""
    cut: str = ""

    @property
    def expected(self) -> int:
        """Number of images."""
        return len(self.names)

    def images(self) -> Generator[tuple[float | None, av.VideoFrame]]:
        """Every image in order; raises DamageError at one that cannot be read, or has another size."""
        for _, image in self._decoded(range(len(self.names))):
            yield None, image

    def survey(self) -> list[tuple[int, bool]]:
        """The number of each image; each stands for itself, like a key frame."""
        return [(number, True) for number in range(len(self.names))]

    def seconds(self, stamp: int) -> float | None:
        """None: images have no times."""
        return None

    def orientation_for(self, image: av.VideoFrame) -> Orientation:
        """How that image is turned for display; each may differ."""
        return orientation_of(image)

    def pick(self, bursts: Sequence[tuple[int, Sequence[int]]]) -> Iterator[tuple[int, av.VideoFrame]]:
        """The images of those numbers."""
        return self._decoded([number for _, wanted in bursts for number in wanted])

    def images_from(self, stamp: int) -> Generator[tuple[int, av.VideoFrame]]:
        """Number and image of every frame from that number on."""
        yield from self._decoded(range(stamp, len(self.names)))

    def _decoded(self, numbers: Sequence[int]) -> Iterator[tuple[int, av.VideoFrame]]:
        with contextmanager(self.reading)() as read:
            for number in numbers:
                name = self.names[number]
                image = _decode_image(name, read)
                size = orientation_of(image).size(image.width, image.height)
                if self.width and size != (self.width, self.height):
                    raise DamageError(
                        f"{name} is {size[0]}x{size[1]} px, not {self.width}x{self.height} like the first"
                    )
                yield number, image


def open_folder(folder: Path, label: str) -> ImageSource:
    """The images that lie in a folder; VideoError when there are none, or of several kinds."""
    names = [entry.name for entry in folder.iterdir() if entry.is_file() and not entry.name.startswith(".")]
    images = _of_one_kind([name for name in names if _suffix(name) in IMAGE_CODECS], label)
    if not images:
        videos = sorted(name for name in names if _suffix(name) in VIDEO_SUFFIXES)
        hint = f"give the video in it: {videos[0]}" if videos else f"it holds {len(names)} other files"
        raise VideoError(f"{label} is a folder without images ({', '.join(IMAGE_CODECS)}); {hint}")

    def reading() -> Iterator[Read]:
        yield lambda name: (folder / name).read_bytes()

    return _open_images(label, images, reading)


def open_archive(path: Path, label: str, wanted: str | None = None) -> ContainerSource | ImageSource:
    """The one video, or else the one folder of images, in a ``.zip`` or ``.trz``; or that of the ``wanted`` name.

    A video is unpacked into a temporary folder, under a name of ours, which goes when the source goes.
    Raises VideoError for an archive that is damaged, encrypted or too large, or does not hold one of either.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = _members(archive, label)
            video = _the_video(members, path, label, wanted)
            if video is not None:
                return _open_member(archive, members[video], f"{label}:{video}")
    except ZIP_TROUBLE as error:
        raise VideoError(f"{label} cannot be unpacked as an archive: {error}; no frame was read") from error
    images = _the_images(members, path, label, wanted)

    def reading() -> Iterator[Read]:
        with zipfile.ZipFile(path) as archive:
            yield lambda name: _read_member(archive, members[name])

    return _open_images(label, images, reading)


# --------------------------------------------------------------------------- images


def _open_images(label: str, names: list[str], reading: Callable[[], Iterator[Read]]) -> ImageSource:
    try:
        _, first = next(ImageSource(label, names, reading)._decoded([0]))
    except DamageError as damage:
        raise VideoError(f"{label}: none of its {len(names)} images was read: {damage}") from damage
    orientation = orientation_of(first)
    width, height = orientation.size(first.width, first.height)
    check_size(width, height, label)
    facts = {"format": "images", "codec": IMAGE_CODECS[_suffix(names[0])], "pixel_format": first.format.name}
    note = _gap_note(names)
    return ImageSource(label, names, reading, width, height, orientation, facts=facts, note=note)


def _decode_image(name: str, read: Read) -> av.VideoFrame:
    decoder = cast(VideoCodecContext, av.CodecContext.create(IMAGE_CODECS[_suffix(name)], "r"))
    try:
        data = read(name)
        most = min(MAX_PIXELS, max(RATIO_COUNTS_FROM_BYTES, MAX_RATIO * len(data)))
        # FFmpeg counts every tag of a TIFF that it does not know as damage, such as those that OpenCV writes
        careful = {} if decoder.name == "tiff" else {"err_detect": "explode"}
        decoder.options = {"max_pixels": str(most), **careful}
        images = decoder.decode(av.Packet(data)) if data else []
    except (av.FFmpegError, *ZIP_TROUBLE) as error:
        raise DamageError(f"{name} cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if len(images) != 1 or images[0].is_corrupt:
        raise DamageError(f"{name} is empty or damaged")
    return images[0]


def natural_order(name: str) -> tuple[list[int | str], str]:
    """Key that sorts ``frame_10`` after ``frame_9``: digits count as numbers."""
    parts = re.split(r"(\d+)", name)
    return [int(part) if k % 2 else part for k, part in enumerate(parts)], name


def _gap_note(names: Sequence[str]) -> str:
    """Say so when the images' numbers jump: the times after the jump are then wrong."""
    numbers = [int((re.findall(r"\d+", name) or ["0"])[-1]) for name in names]
    steps = Counter(after - before for before, after in pairwise(numbers))
    usual = steps.most_common(1)[0][0] if steps else 0
    for k in range(1, len(numbers)):
        if numbers[k] - numbers[k - 1] > usual > 0:
            return f"the images' numbers jump from {names[k - 1]} to {names[k]}: times after it are too early"
    return ""


def _of_one_kind(names: Sequence[str], label: str) -> list[str]:
    kinds = Counter(IMAGE_CODECS[_suffix(name)] for name in names)
    if len(kinds) > 1:
        have = " and ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        raise VideoError(f"{label} holds images of several kinds, {have}; leave one kind in it")
    return sorted(names, key=natural_order)


# --------------------------------------------------------------------------- archives


def _members(archive: zipfile.ZipFile, label: str) -> dict[str, zipfile.ZipInfo]:
    """Files by name, without folders and hidden files."""
    listed = archive.infolist()
    if len(listed) > MAX_MEMBERS:
        raise VideoError(f"{label} holds {len(listed)} files; at most {MAX_MEMBERS} are read")
    # is_dir of a member without a name fails
    shown = [member for member in listed if member.filename and not member.is_dir() and not _hidden(member.filename)]
    return {member.filename: member for member in shown}


def _hidden(name: str) -> bool:
    return any(part == "__MACOSX" or (part.startswith(".") and part != "..") for part in PurePosixPath(name).parts)


def _the_video(members: Mapping[str, zipfile.ZipInfo], path: Path, label: str, wanted: str | None) -> str | None:
    """The video of the ``wanted`` name or of the project of that name; without a name, the only one."""
    videos = [name for name in members if _suffix(name) in VIDEO_SUFFIXES]
    if not videos or (wanted is None and len(videos) == 1):
        return videos[0] if videos else None
    meant = [] if wanted is None else members_named(wanted, videos)
    named = meant[0] if len(meant) == 1 else _named_by_project(path, wanted)
    if named in videos:
        return named
    which = f"{len(videos)} videos" if wanted is None else f"no single video or project named {wanted!r}"
    raise VideoError(f"{label} holds {which}; name one as FILE:NAME: {listed(videos)}")


def _the_images(members: Mapping[str, zipfile.ZipInfo], path: Path, label: str, wanted: str | None) -> list[str]:
    images = [name for name in members if _suffix(name) in IMAGE_CODECS]
    folders = {str(PurePosixPath(name).parent) for name in images}
    chosen = folders
    if wanted in folders:
        chosen = {wanted}
    elif folders and (wanted is not None or len(folders) > 1):
        named = _named_by_project(path, wanted)
        chosen = set() if named is None else {str(PurePosixPath(named).parent)} & folders
    if len(chosen) != 1:
        what = f"images in {len(folders)} folders" if folders else "no video and no images"
        choice = f"; name one as FILE:FOLDER: {listed(folders)}" if folders else ""
        raise VideoError(f"{label} holds {what}; it must hold one video, or images in one folder{choice}")
    return _of_one_kind([name for name in images if str(PurePosixPath(name).parent) in chosen], label)


def _named_by_project(path: Path, wanted: str | None = None) -> str | None:
    """The video that the Tracker project in the archive names, or that of the ``wanted`` name, if there is one."""
    try:
        return read_osp(path if wanted is None else f"{path}:{wanted}").video
    except CalibrationError:
        return None


def _open_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, label: str) -> ContainerSource:
    _check_member(member, label)
    folder = Path(tempfile.mkdtemp(prefix="iris-sysid-"))
    try:
        room = shutil.disk_usage(folder).free
        if member.file_size > room:
            raise VideoError(f"{label} needs {member.file_size} bytes unpacked; {room} are free in {folder.parent}")
        unpacked = folder / f"clip{_suffix(member.filename)}"
        with archive.open(member) as packed, unpacked.open("wb") as file:
            shutil.copyfileobj(packed, file, 2**20)
        source = open_container(unpacked, label)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(source, shutil.rmtree, folder, ignore_errors=True)
    return source


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    if member.file_size > MAX_IMAGE_BYTES or _is_bomb(member):
        raise DamageError(
            f"{member.filename} claims {member.file_size} bytes unpacked from {member.compress_size}; an image may "
            f"have {MAX_IMAGE_BYTES}, and {MAX_RATIO} times its packed size"
        )
    return archive.read(member)


def _check_member(member: zipfile.ZipInfo, label: str) -> None:
    if member.file_size > MAX_MEMBER_BYTES or _is_bomb(member):
        raise VideoError(
            f"{label} claims {member.file_size} bytes unpacked from {member.compress_size}: more than a video can be; "
            "unpack it yourself if you trust it"
        )


def _is_bomb(member: zipfile.ZipInfo) -> bool:
    """Whether a large file shrank more than any recording does."""
    return member.file_size > max(RATIO_COUNTS_FROM_BYTES, MAX_RATIO * member.compress_size)


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower()
