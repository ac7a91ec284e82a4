"""The output files of a diagnosis, checked before matplotlib is loaded."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.io.files import check_writable

FILES = (
    "diagnosis.json",
    "components.png",
    "residual.png",
    "state.png",
    "plan.json",
    "plan.png",
    "report.html",
)


def check_folder(folder: str | Path, *, overwrite: bool = False) -> Path:
    """Raise OutputError when a diagnosis cannot be written into the folder; call it before the computation."""
    for name in FILES:
        check_writable(Path(folder) / name, overwrite=overwrite)
    return Path(folder)
