"""What the tests about the project itself share: its root, its Python files, its real recordings."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("iris_sysid", "trackers", "fitters")
DATA = ROOT.parent / "shared" / "data"


def python_files() -> list[Path]:
    """Every Python file of the three packages."""
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def recording(name: str) -> Path:
    """The path of a real recording; the test is skipped where the recordings are absent."""
    if not DATA.is_dir():
        pytest.skip("the real recordings (../shared/data) are not on this machine")
    return DATA / name
