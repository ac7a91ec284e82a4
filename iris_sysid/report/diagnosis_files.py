"""The files of a diagnosis, apart from what draws them: a command checks them before it loads matplotlib."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.io.files import check_writable

FILES = ("diagnosis.json", "residual.png", "state.png", "report.html")


def check_folder(folder: str | Path, *, overwrite: bool = False) -> Path:
    """Raise OutputError when a diagnosis could not be written into the folder: to be called before the work."""
    for name in FILES:
        check_writable(Path(folder) / name, overwrite=overwrite)
    return Path(folder)
