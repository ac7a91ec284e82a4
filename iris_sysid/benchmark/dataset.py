"""List the clips of a data set ``<Class>/<setting>/<clip>.mp4``, with the missing and unusable ones.

Each phenomenon lists its classes (``Phenomenon.classes``). No file is opened here.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.pipeline.clip_folders import CLIP_SUFFIXES, benchmark_classes
from iris_sysid.types import BenchmarkClass

BOARD = "checkerboard"  # the clip of a class folder that calibrates its camera
NAME = re.compile(r"[^\W_](?:[\w .+-]*[\w+-])?")  # letters first: no hidden file, no control character, no separator
MAX_NAME = 100


@dataclass(frozen=True, slots=True)
class Clip:
    """One recording; ``clip`` is its name without the suffix, ``phenomenon`` the registered name."""

    class_name: str
    setting: str
    clip: str
    path: Path
    phenomenon: str

    @property
    def place(self) -> str:
        """Path in the data set without the suffix: ``Pendulum/pendulum_45/06``."""
        return f"{self.class_name}/{self.setting}/{self.clip}"


@dataclass(frozen=True, slots=True)
class Gap:
    """A missing or unused part of a data set: its path in the data set, and the reason."""

    place: str
    reason: str


@dataclass(frozen=True, eq=False, slots=True)
class Listing:
    """The clips of a data set in the order of their names; checkerboards by class; missing and unused parts.

    ``unknown`` are the folders that are not a class of any phenomenon; they are among the ``gaps`` too.
    """

    folder: Path
    clips: tuple[Clip, ...]
    boards: Mapping[str, Path]
    gaps: tuple[Gap, ...]
    unknown: tuple[str, ...]


def places(clips: Iterable[Clip]) -> list[int]:
    """The position of each clip within its setting, from 0."""
    seen: Counter[tuple[str, str]] = Counter()
    positions = []
    for clip in clips:
        positions.append(seen[clip.class_name, clip.setting])
        seen[clip.class_name, clip.setting] += 1
    return positions


def list_clips(folder: str | Path) -> Listing:
    """List the clips of a data set and name its gaps, without opening any file.

    Links to files and folders are followed. Left out and listed as gaps: special and unreadable files, names with
    other characters than letters, digits, ``_ . + -`` and spaces, a second file for the same clip, and unknown
    classes. Files that are not clips (truth, tables, hidden files) are ignored.

    Parameters
    ----------
    folder
        Holds the classes.

    Returns
    -------
    Listing
        Its gaps include missing settings and, where clips are numbered, missing numbers.

    Raises
    ------
    DataError
        When the folder cannot be read or contains no class.
    """
    root, known = Path(folder), benchmark_classes()
    gaps: list[Gap] = []
    if not root.is_dir() or not os.access(root, os.R_OK | os.X_OK):
        raise DataError(f"{folder} is not a folder that can be read; give the one that holds the classes")
    names = [name for name in _entries(root, "", gaps) if (root / name).is_dir()]
    present = [name for name in names if name in known]
    if not present:
        raise DataError(
            f"{folder} has no class of a data set; its folders should be some of {', '.join(sorted(known))}"
        )
    unknown = tuple(name for name in names if name not in known)
    gaps += [Gap(name, _unknown(name, known)) for name in unknown]
    clips = [clip for name in present for clip in _of_class(root, name, *known[name], gaps)]
    boards = {name: board for name in present if (board := _board(root / name)) is not None}
    return Listing(root, tuple(clips), boards, tuple(sorted(gaps, key=lambda gap: gap.place)), unknown)


def _entries(folder: Path, prefix: str, gaps: list[Gap]) -> list[str]:
    """Sorted usable names in a folder; the others become gaps."""
    try:
        names = sorted(path.name for path in folder.iterdir())
    except OSError as error:
        gaps.append(Gap(prefix or folder.name, f"cannot be read: {error.strerror}"))
        return []
    visible = [name for name in names if not name.startswith(".")]
    usable = [name for name in visible if NAME.fullmatch(name) and len(name) <= MAX_NAME]
    gaps.extend(
        Gap(f"{prefix}{name!a}", "the name has other characters than letters, digits, _ . + - and spaces; rename it")
        for name in visible
        if name not in usable
    )
    return usable


def _unknown(name: str, known: Mapping[str, object]) -> str:
    close = get_close_matches(name, known, n=1) or [
        class_name for class_name in known if class_name.lower() == name.lower()
    ]
    hint = f"; did you mean {close[0]}?" if close else ""
    return f"unknown class: no phenomenon has it{hint}"


def _board(folder: Path) -> Path | None:
    """The clip of the checkerboard in a class folder, if there is one."""
    candidates = [folder / f"{BOARD}{suffix}" for suffix in CLIP_SUFFIXES]
    return next((path for path in candidates if path.is_file()), None)


def _of_class(root: Path, name: str, phenomenon: str, described: BenchmarkClass, gaps: list[Gap]) -> Iterator[Clip]:
    """Clips of one class; settings and clips missing from the published data set become gaps."""
    settings = [entry for entry in _entries(root / name, f"{name}/", gaps) if (root / name / entry).is_dir()]
    gaps.extend(
        Gap(f"{name}/{setting}", "this setting is missing") for setting in described.settings if setting not in settings
    )
    for setting in settings:
        paths = _clips(root / name / setting, f"{name}/{setting}/", gaps)
        missing = _missing(list(paths), described.trials)
        gaps.extend(Gap(f"{name}/{setting}/{clip}", "this clip is missing") for clip in missing)
        for clip, path in paths.items():
            yield Clip(name, setting, clip, path, phenomenon)


def _clips(folder: Path, prefix: str, gaps: list[Gap]) -> dict[str, Path]:
    """Clips of one setting by name."""
    clips: dict[str, Path] = {}
    for name in _entries(folder, prefix, gaps):
        path = folder / name
        if path.suffix.lower() not in CLIP_SUFFIXES:
            continue
        if path.stem in clips:
            gaps.append(Gap(f"{prefix}{name}", f"left out: {clips[path.stem].name} is the same clip"))
        elif not path.is_file():
            gaps.append(Gap(f"{prefix}{name}", "left out: a broken link, or not a regular file"))
        elif not os.access(path, os.R_OK):
            gaps.append(Gap(f"{prefix}{name}", "left out: no permission to read it"))
        else:
            clips[path.stem] = path
    return clips


def _missing(names: list[str], trials: int) -> list[str]:
    """Missing numbers from 1 to ``trials``, as wide as those of the clips; none where clips are not numbered."""
    if not all(name.isascii() and name.isdigit() for name in names):
        return []
    width = min((len(name) for name in names), default=2)
    present = {int(name) for name in names}
    return [f"{number:0{width}d}" for number in range(1, trials + 1) if number not in present]
