"""Where the clip of a folder of results is: ``clip.txt`` in the folder holds the way to it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from iris_sysid.io.files import write_atomic

CLIP_PLACE = "clip.txt"


def write_clip_place(clip: Path, folder: Path, *, overwrite: bool = False) -> Path:
    """Write the way from a ``folder`` to its ``clip`` into a file of the folder; gives its path."""
    return write_atomic(folder / CLIP_PLACE, f"{way_to(clip, folder)}\n", overwrite=overwrite)


def way_to(clip: Path, folder: Path) -> str:
    """The way from a folder to a clip; the whole path where there is none, as between drives of Windows."""
    try:
        return Path(os.path.relpath(clip, folder)).as_posix()
    except ValueError:
        return clip.resolve().as_posix()


def places_of(folder: Path, recorded: str) -> list[Path]:
    """Where the clip of a folder may be: as recorded, as its ``clip.txt`` says, beside it, in it, or here.

    ``recorded`` is its name, or the way to it from the folder. The likeliest first; none of them need exist.
    """
    name = Path(recorded).name
    places = [folder / recorded, folder.parent / name, folder / name, Path(name)]
    with suppress(OSError, UnicodeDecodeError):
        stated = folder / (folder / CLIP_PLACE).read_text(encoding="utf-8").strip()
        if stated.name == name:
            places.insert(1, stated)
    return places
