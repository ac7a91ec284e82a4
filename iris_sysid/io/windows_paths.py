"""The rules of Windows for names of files, as far as a program can break them that was written elsewhere.

https://learn.microsoft.com/windows/win32/fileio/naming-a-file
"""

from __future__ import annotations

import re
from pathlib import PureWindowsPath

# names that Windows keeps for devices, with any suffix, also with digits that are superscripts
RESERVED = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[\d¹²³])( *\..*)?", re.IGNORECASE)
FORBIDDEN = re.compile(r'[<>:"|?*\x00-\x1f]')
MAX_PATH = 259  # characters, unless the machine allows long ones


def name_trouble(path: PureWindowsPath) -> str:
    """Why Windows takes no file of such a ``path``; empty where it does. A drive is left out."""
    for name in path.parts[1:] if path.anchor else path.parts:
        if RESERVED.fullmatch(name):
            return f"Windows keeps the name {name} for a device"
        if found := FORBIDDEN.search(name):
            return f"a name on Windows has no {found[0]!r}"
        if name not in (".", "..") and name != name.rstrip(". "):
            return f"a name on Windows ends in no dot or space, as {name!r} does"
    return ""


def length_trouble(path: PureWindowsPath) -> str:
    """A remark on a ``path`` that is longer than Windows takes by itself; empty for others."""
    length = len(str(path))
    if length <= MAX_PATH:
        return ""
    return f"; the path has {length} characters and Windows takes {MAX_PATH}: use shorter names or folders"
